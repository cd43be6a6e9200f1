"""Fog, lights and geometry -> plan.json: which renders are needed, how fine, and why."""

from __future__ import annotations

import sys
from dataclasses import fields
from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.physics.bulbs import UNSEEN
from pipeline.planning.choosing import Choice, choose
from pipeline.planning.demands import demands
from pipeline.planning.model import calibration, demands_as_json, errors_of
from pipeline.plugins.base import Medium
from pipeline.rendering import converged
from pipeline.rendering.emit import Run, Templates
from pipeline.rendering.fineness import MIDPOINT, Fineness
from pipeline.rendering.fineness import as_json as fineness_json
from pipeline.rendering.own_templates import rendered_for_their_templates, surfaces_are_ours
from pipeline.rendering.runs import (FEWEST_BLURRED, MOST_SHADED, SHADED, SHADOWS, as_json, fog_runs, hidden,
                                     shaded_lights, uneven_samples)
from pipeline.rendering.surroundings_files import is_room, surrounded
from pipeline.rendering.work import refuse_too_much
from pipeline.scene.artefacts import (
    image_size, read_edges, read_fog, read_json, read_placed, read_strengths, scene_place, write_json)
from pipeline.scene.placed import PlacedScene

#: Pixels that are made as finely as it takes, to tell how far off the others are, by quality.
CHECKED = {"draft": 48, "normal": 160, "final": 320}


def run(build: Build) -> None:
    scene, medium = read_placed(build), read_fog(build)
    settings = read_json(build.input("render"))
    lights: list[str] = []
    runs: list[Run] = []
    fineness, check, expected, wanted_json = Fineness(), None, None, None
    if medium.is_clear():
        reasons = ["the fog extinguishes nothing: no render, the photograph comes back unchanged"]
    else:
        strengths = {name: max(light["strength"])
                     for name, light in read_json(build.illumination)["lights"].items()}
        bright = [name for name in scene.lights if strengths[name] > 0]
        lights = [name for name in bright if not hidden(scene, medium, name)]
        shaded = shaded_lights(scene, {name: strengths[name] for name in lights})
        templates = Templates(build.source)
        by_template = rendered_for_their_templates(templates, scene, medium)
        own = lights if settings["glow"] == "rendered" else by_template
        constants = calibration(build.builds)
        wanted = demands(scene, medium, read_map(build.photograph), read_strengths(build), lights, shaded, own,
                         uneven_samples(scene, medium, "in_scattering", Fineness()),
                         np.prod(image_size(build.full)) / 1e6 if build.reduced else 0.0, surrounded(build, scene, lights),
                         is_room(build, scene, lights))
        wanted_json = demands_as_json(wanted)
        choice = choose(wanted, settings, constants)
        fineness = choice.fineness
        expected = {"asked": asked_for(settings, choice), "seconds": choice.seconds, "relative_error": choice.error,
                    "relative_error_by": errors_of(wanted, fineness, constants), "calibration": constants.source}
        print(f"  {told(expected)}", file=sys.stderr, flush=True)
        in_one = surfaces_are_ours(templates, scene)
        runs = fog_runs(scene, medium, lights, fineness, shaded, own, in_one)
        stated = settings["checked_pixels"]
        count = CHECKED[settings["quality"]] if stated is None else stated
        if count and any(scene.rendered(name) or name in shaded for name in lights):
            pixels = converged.chosen(read_map(build.depth), ~_mixed_or_lamp(build), max(
                1, round(max(scene.camera.width, scene.camera.height) / fineness.in_scattering_size)), count)
            checks = converged.runs(scene, medium, lights, shaded, in_one, pixels)
            check = {"pixels": np.stack(pixels.where, -1).tolist(), "weights": pixels.weights.tolist(),
                     "runs": [as_json(one) for one in checks]}
        try:
            refuse_too_much(scene, runs, settings["max_light_samples"])
        except InputError as error:
            raise error.at(scene_place(build, "render")) from None
        reasons = [told(expected), *chosen_knobs(fineness, settings)]
        reasons += [f"{name}: strength 0, no render" for name in scene.lights if name not in bright]
        reasons += [f"{name}: left out, behind {UNSEEN:g} optical depths of fog" for name in bright if name not in lights]
        reasons += reasons_for(scene, medium, lights, runs, fineness)
    write_json(build.plan, {
        "fineness": fineness_json(fineness),
        "demands": wanted_json, "expected": expected, "check": check, "fog_is_clear": medium.is_clear(), "lights": lights,
        "runs": [as_json(r) for r in runs],
        "reasons": reasons})


def asked_for(settings: dict[str, Any], choice: Choice) -> dict[str, Any]:
    """What a person asked, in the words of the scene file."""
    if choice.tolerance is None:
        return {"budget": settings["budget"]}
    return {"tolerance": choice.tolerance} if settings["tolerance"] else {
        "quality": settings["quality"], "tolerance": choice.tolerance}


def told(expected: dict[str, Any]) -> str:
    asked = expected["asked"]
    what = (f"a budget of {asked['budget']:g} s" if "budget" in asked else
            f"quality {asked['quality']}, a tolerance of {asked['tolerance']:g}" if "quality" in asked else
            f"a tolerance of {asked['tolerance']:g}")
    return f"asked for {what}: expects a relative error of {expected['relative_error']:.2g} in {expected['seconds']:.1f} s"


def chosen_knobs(fineness: Fineness, settings: dict[str, Any]) -> list[str]:
    """What the plan chose, and what the scene states."""
    own = [one.name for one in fields(fineness) if settings.get(one.name) is not None]
    values = fineness_json(fineness)
    chosen = ", ".join(f"{name} {value:g}" if isinstance(value, (int, float)) else f"{name} {value}"
                       for name, value in values.items() if name not in own)
    return [f"chosen for that: {chosen}"] + ([f"as the scene states: {', '.join(own)}"] if own else [])


def _mixed_or_lamp(build: Build) -> np.ndarray:
    """Pixels (H, W) that show a lamp, or two things at once: as the edges say, else where faces meet."""
    edges, surfaces = read_edges(build), read_map(build.surfaces)
    lamp = surfaces[..., 1] >= 0
    if edges is not None:
        return lamp | edges.mixed
    # the middle of a pixel between two faces is a hair's breadth on either
    beside = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return lamp | (cv2.morphologyEx(np.ascontiguousarray(surfaces[..., 0]), cv2.MORPH_GRADIENT, beside) > 0)


def reasons_for(scene: PlacedScene, medium: Medium, lights: list[str], runs: list[Run],
                fineness: Fineness) -> list[str]:
    """Why the runs are these and no others, one line a choice."""
    reasons = []
    for name in lights:
        count = scene.lights[name].hidden_count(medium, scene.camera.position)
        if count and not scene.rendered(name):
            reasons.append(f"{name}: {count} of {scene.lights[name].sub_light_count()} lamps left out, behind {UNSEEN:g}"
                           " optical depths of fog")
        kinds = [kind for kind in (SHADED, SHADOWS) if any(one.id == f"{kind}_{name}" for one in runs)]
        if kinds:
            reasons.append(shadow_reason(scene, name, SHADOWS in kinds))
        elif scene.shaded(name) and medium.coefficients()[1].max() > 0:
            reasons.append(f"{name}: V without shadows, by quadrature; only the {MOST_SHADED} brightest lamps have theirs"
                           " rendered")
        elif not scene.rendered(name):
            reasons.append(f"{name}: known in closed form, no render")
        elif medium.coefficients()[1].max() > 0 and not any(one.id == f"in_scattering_{name}" for one in runs):
            reasons.append(f"{name}: V in closed form, no render; nothing stands in its way")
        if scene.rendered(name) and f"transmittance_{name}" not in {one.id for one in runs}:
            reasons.append(f"{name}: T by the light's midpoint, no render" if fineness.transmittance == MIDPOINT
                           else f"{name}: T without shadows of parts of it, by quadrature; no render")
        if f"clear_{name}" in {one.id for one in runs}:
            reasons.append(f"{name}: smaller parts of it for T, for the fog is dense and its half-shadows wide")
    if not medium.coefficients()[1].max() > 0:
        reasons.append("the fog scatters nothing: no in-scattering renders, V = 0")
    if not scene.outdoors and not any(light.type == "sun" for light in scene.lights.values()):
        reasons.append("no sun: no shaft")
    for one in runs:
        if one.kind != "in_scattering" or "shadows" in one.options:
            continue
        name, = one.lights
        if one.width < scene.camera.width:
            reasons.append(f"{name}: glow at {one.width}x{one.height}, for it is smooth; edges of depth are kept")
        single = scene.lights[name].sub_light_count() < FEWEST_BLURRED
        asked = fineness.shaft_samples if single else fineness.samples
        if one.samples > asked and one.samples == uneven_samples(scene, medium, one.kind, fineness):
            few = one.samples == fineness.density_steps
            reasons.append(f"{name}: {one.samples} samples instead of {asked}: steps that follow how the fog"
                           " varies" + (", as nearly as is affordable" if few else ""))
        elif one.samples > asked:
            reasons.append(f"{name}: {one.samples} samples instead of {asked}: dense fog, {fineness.optical_step:.2g}"
                           " optical depths each")
        elif single:
            reasons.append(f"{name}: {one.samples} samples, for the shadow edges of a single light are blurred by nothing")
    return reasons


def shadow_reason(scene: PlacedScene, name: str, in_one: bool) -> str:
    light = scene.lights[name]
    part, count = light.shaded_part(scene.camera.position), light.sub_light_count()
    few = f" of the {part.sub_light_count()} strongest of {count}" if part is not light else ""
    renders = "a small render tells" if in_one else "two small renders tell"
    return f"{name}: V without shadows by quadrature; {renders} what shadows{few} take from it"
