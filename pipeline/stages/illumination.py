"""Photograph and clear renders of each light alone -> illumination.json, albedo.exr, basis/.

basis/irradiance_LIGHT.exr (full size, direct, white surfaces) serves T as well as the estimate.
"""

from __future__ import annotations

import sys
from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.rendering.daylight import daylight
from pipeline.rendering.emit import Templates
from pipeline.rendering.runs import as_json, irradiance_run
from pipeline.rendering.separated_lights import ALBEDO_RANGE, render, separated, sources
from pipeline.rendering.surroundings_files import write_surroundings
from pipeline.rendering.work import refuse_too_much
from pipeline.scene.artefacts import image_size, plugin_from_json, read_json, read_placed, scene_place, write_json
from pipeline.scene.placed import PlacedScene

#: Pixels round a bulb that its blur fills, and round any lamp that show some of it.
BULB_BORDER, LAMP_BORDER = 3, 1


def run(build: Build) -> None:
    scene = read_placed(build)
    settings = plugin_from_json("estimators", read_json(build.input("illumination")))
    demand = read_json(build.input("demand"))
    if not demand["light_strengths"]:
        return _without_fog(build)
    templates = Templates(build.source)
    wanted = [irradiance_run(scene, light) for light in filter(scene.rendered, scene.lights)]
    try:
        # a stage of the photograph reads the fog's settings for this limit alone; nothing is made from it
        refuse_too_much(scene, wanted, read_json(build.input("render"))["max_light_samples"])
    except InputError as error:
        raise error.at(scene_place(build, "render")) from None
    render(build, scene, wanted, templates)
    runs = {planned.id: as_json(planned) for planned in wanted}
    for old in build.basis.glob("irradiance_*"):
        if old.stem not in runs:
            old.unlink()  # of a light that is no more: Make looks whether each has its picture
    write_json(build.basis / "runs.json", runs)

    given = {name: s for name, s in read_json(build.input("strengths")).items() if s is not None}
    lights = {name: {"strength": given[name], "source": "given"} for name in given}
    by_means, notes = _by_means(build, scene, [name for name in scene.lights if name not in given])
    lights |= by_means
    albedo, faces = np.full((1, 1, 3), 0.5), {}
    try:
        if len(lights) == len(scene.lights):
            report: dict[str, Any] = {"estimator": "none needed: every strength is given", "messages": []}
        elif settings.type == "liu_xing":
            found, report = daylight(build, scene, settings, [n for n in scene.lights if n not in lights],
                                     _ground_radiance(build, scene, lights))
            lights |= found
        else:
            albedo, faces, found, report = _by_separation(build, scene, settings, given, templates)
            lights |= found
    except InputError as error:
        raise error.at(scene_place(build, "illumination")) from None
    report["messages"] = [*notes, *report["messages"]]
    lights = {name: lights[name] for name in scene.lights}
    for name, light in scene.lights.items():
        lights[name].update(quantity=light.strength_name,
                            unit=type(light).model_fields[light.strength_name].json_schema_extra["unit"])
    names = [face for face, _ in scene.faces()]
    albedos = {names[i]: np.clip(one, *ALBEDO_RANGE).tolist() for i, one in sorted(faces.items())}
    for message in report["messages"]:
        print(f"  note: {message}", file=sys.stderr)
    _write_albedo(build, albedo)
    around = write_surroundings(build, scene, lights, _lamps(build, scene), demand.get("surroundings", 1.0))
    # last: Make looks at it
    write_json(build.illumination, {**report, "lights": lights, "face_albedo": albedos, "surroundings": around})


def _without_fog(build: Build) -> None:
    """Without fog nobody asks how strong the lights are: no render, no estimate."""
    _write_albedo(build, np.full((1, 1, 3), 0.5))
    write_json(build.illumination, {
        "estimator": "none needed: the fog is clear", "messages": [], "lights": {}, "face_albedo": {}})


def _write_albedo(build: Build, albedo: np.ndarray) -> None:
    albedo = cv2.resize(albedo.astype(np.float32), image_size(build), interpolation=cv2.INTER_LINEAR)
    write_map(build.albedo, albedo, {"fog:content": "estimated diffuse albedo"})


def _by_means(build: Build, scene: PlacedScene, names: list[str]) -> tuple[dict[str, dict], list[str]]:
    """Lights that are what the photograph shows on average: of its surfaces, or of its ground; and notes."""
    found, messages = {}, []
    for name in names:
        which = {"ambient": "surfaces", "ground": "ground"}.get(scene.lights[name].type)
        if which is None:
            continue
        mean = _mean_radiance(build, scene, which)
        if mean is None:
            messages.append(f"the photograph shows no {which}, so {name} is taken as 0; give it a"
                            f" '{scene.lights[name].strength_name}'")
        found[name] = {"strength": [0.0, 0.0, 0.0] if mean is None else mean.tolist(),
                       "source": f"mean of the photograph's {which}"}
    return found, messages


def _mean_radiance(build: Build, scene: PlacedScene, which: str) -> np.ndarray | None:
    """Mean radiance (3,) of the photograph's surfaces, lamps and sky left out, or of those that face up."""
    surfaces, geometry = read_map(build.surfaces), read_json(build.geometry)
    chosen = ~_lamps(build, scene)
    if geometry["outdoors"]:
        chosen &= surfaces[..., 0] >= 0
    if which == "ground":
        chosen &= np.isin(surfaces[..., 0], geometry.get("ground_faces", []))
    photograph = np.maximum(read_map(build.photograph), 0)
    return photograph[chosen].mean(0, dtype=float) if chosen.any() else None


def _lamps(build: Build, scene: PlacedScene) -> np.ndarray:
    """Pixels (H, W) that show lamps, or part of them."""
    shown = (read_map(build.surfaces)[..., 1] >= 0) | _bulbs(scene)
    return cv2.dilate(shown.astype(np.uint8), np.ones((2 * LAMP_BORDER + 1,) * 2, np.uint8)) > 0


def _bulbs(scene: PlacedScene) -> np.ndarray:
    """Pixels (H, W) that show bulbs, with a border that a lens's blur fills: a thousand times as bright as what they
    light, a few of them would outshine all surfaces."""
    camera = scene.camera
    mask = np.zeros((camera.height, camera.width), np.uint8)
    for light in scene.lights.values():
        positions, radius = light.bulbs()
        for pixel, depth in zip(*camera.project(positions)):
            if depth > 0 and np.abs(pixel).max() < 1e5:
                reach = 2 * camera.focal_length * radius / max(depth, 1e-6) + BULB_BORDER
                cv2.circle(mask, np.round(pixel - 0.5).astype(int).tolist(), int(np.ceil(min(reach, 1e4))), 1, -1)
    return mask > 0


def _ground_radiance(build: Build, scene: PlacedScene, lights: dict[str, dict]) -> np.ndarray:
    """Radiance (3,) of the ground, which lights upright patches: of the scene's own light, or as photographed."""
    stated = [lights[name]["strength"] for name, light in scene.lights.items() if light.type == "ground"]
    if stated:
        return np.asarray(stated[0], float)
    mean = _mean_radiance(build, scene, "ground")
    return np.zeros(3) if mean is None else mean


def _by_separation(build: Build, scene: PlacedScene, settings, given: dict, templates: Templates):
    """Albedo (h, w, 3), that of faces, lights' strengths and what is worth reporting of the fit."""
    names = sources(scene)
    for name in scene.lights:
        if name not in given and name not in names and scene.lights[name].type not in ("ambient", "ground"):
            raise InputError(f"{settings.type} cannot estimate {name}, a light of type {scene.lights[name].type}",
                             remedy=f"give it a '{scene.lights[name].strength_name}', or choose illumination"
                                    " type liu_xing")
    begun = read_json(build.albedos_begun) if build.albedos_begun.exists() else None
    fit, faces = separated(build, scene, settings, {n: s for n, s in given.items() if n in names}, templates, begun)
    # an error without bound is none that JSON can hold
    error = np.where(np.isfinite(fit.standard_error), fit.standard_error, None)
    lights = {name: {"strength": fit.intensity[i].tolist(), "standard_error": error[i],
                     "source": "given" if name in given else settings.type}
              for i, name in enumerate(names)}
    return fit.albedo, faces, lights, {
        "estimator": settings.type, "scale_source": fit.scale_source, "messages": list(fit.messages),
        "residual_median": fit.residual_median, "residual_p90": fit.residual_p90,
        "condition_number": fit.condition_number, "usable_fraction": fit.usable_fraction,
        "correlation": fit.correlation,
        "inseparable": [[names[i] for i in pair] for pair in fit.inseparable]}
