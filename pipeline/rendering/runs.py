"""Which renders a scene needs, and how finely: the runs, with the reason for each choice."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.plugins.base import Medium
from pipeline.plugins.lights.sun import Sun
from pipeline.rendering.emit import FARTHEST_OPTICAL_DEPTH, IN_RED, Run, farthest_seen
from pipeline.rendering.fineness import AREA, MIDPOINT, Fineness
from pipeline.scene.placed import PlacedScene

#: Where the run's 90th percentile is put in half float, whose digits are all there from 6e-5 to 65504:
#: room for a lamp's peak above, and for shadow and dense fog below.
TARGET_LEVEL = 16.0
#: Brightest point of the grid: a lamp's glow between its points may be some hundred times as bright.
HIGHEST_LEVEL = 128.0
#: Kinds of the two small renders that tell what shadows take from a light whose V is known without them; and of the one
#: that is both, in red and in green.
SHADED, UNSHADED, SHADOWS = "shaded", "unshaded", "shadows"
#: Single lamps that get such renders; of more than these the brightest to the eye.
MOST_SHADED = 16
#: From so many small lights on their shadows' edges blur one another's steps.
FEWEST_BLURRED = 9
#: Most samples of T that uneven fog asks for.
MOST_DENSITY_STEPS = 256
#: POV-Ray 3.7 stops with a fatal error at more intervals, which uneven fog and shafts need (measured: 256 do, 257 do not).
MOST_INTERVALS = 256
#: V adds up many samples, whose errors cancel: its steps may be so many times as long as T's.
STEPS_OF = {"in_scattering": 2.0, "transmittance": 1.0}


def irradiance_run(scene: PlacedScene, light: str) -> Run:
    points, _ = surface_grid(scene)
    return Run(f"irradiance_{light}", "irradiance", [light], scene.camera.width, scene.camera.height,
               _exposure(_irradiance(scene, light, points) / np.pi))


def fog_runs(scene: PlacedScene, medium: Medium, lights: list[str], fineness: Fineness, shaded: Container[str],
             by_template: Container[str] = (), in_one: bool = True) -> list[Run]:
    """Transmittance and in-scattering of each light.

    by_template: lights whose T and V are rendered even where they are known without shadows.
    in_one: whether the shapes' statements allow that one render tells light with shadows and without, in grey fog.
    shaded: lights whose V is known without shadows, and of which renders tell what shadows take from it.
    """
    runs = []
    width, height = scene.camera.width, scene.camera.height
    glow = glow_size(width, height, fineness.in_scattering_size)
    shadow = glow_size(width, height, fineness.shadow_size)
    points, directions = surface_grid(scene)
    depths = medium.optical_depth(scene.camera.position, points)
    eye, clearest = np.exp(-depths.mean(-1)), np.exp(-depths.min(-1))
    extinction = np.add(*medium.coefficients())
    grey = all(np.ptp(coefficient) == 0 for coefficient in medium.coefficients())
    scatters = medium.coefficients()[1].max() > 0
    uneven = medium.render_step() < np.inf
    dense = max(dense_samples(scene, medium, fineness), uneven_samples(scene, medium, "in_scattering", fineness))
    for light in lights:
        one = scene.lights[light]
        blurred = one.sub_light_count() >= FEWEST_BLURRED
        count = max(dense, fineness.samples if blurred else fineness.shaft_samples)
        if light in shaded and scatters:
            part = replace(scene, lights={light: one.shaded_part(scene.camera.position)})
            exposure = _exposure(in_scattering_about(part, medium, light, directions, points))
            runs += _shadow_runs(Run("", "in_scattering", [light], *(shadow if blurred else glow), exposure, count),
                                 in_one and grey)
        if not scene.rendered(light):
            continue
        if light in by_template or transmittance_is_rendered(scene, medium, light, fineness):
            runs += _transmittance_runs(scene, medium, light, fineness, points, (eye, clearest), extinction)
        if scatters:
            # a shaft's edges are sharp and it is cheap; a lamp's glow is smooth and costs most
            size = glow if one.smooth else (width, height)
            level = in_scattering_about(scene, medium, light, directions, points)
            in_clear_air = in_scattering_about(scene, medium, light, directions, points, through=0.0) if uneven else None
            exposure = _exposure(level, in_clear_air)
            if light in by_template or not scene.completes(light, medium):
                runs.append(Run(f"in_scattering_{light}", "in_scattering", [light], *size, exposure, count))
            elif scene.dimmed(light):
                options = {"shadow_lights": fineness.shadow_lights} if blurred else {}
                runs += _shadow_runs(Run("", "in_scattering", [light], *(shadow if blurred else glow), exposure, count, options),
                                     in_one and grey)
    return [replace(one, samples=min(one.samples, MOST_INTERVALS))
            if uneven or not all(scene.lights[name].smooth for name in one.lights) else one for one in runs]


def transmittance_is_rendered(scene: PlacedScene, medium: Medium, light: str, fineness: Fineness) -> bool:
    """Whether T of a rendered light takes a render, and is not what its midpoint or its unoccluded area says."""
    one = scene.lights[light]
    if not one.integrates(medium):
        return fineness.transmittance != MIDPOINT or one.midpoint() is None
    # what has no parts casts no half-shadow: its way is known
    return fineness.transmittance == AREA and one.parts(1) is not None


def _transmittance_runs(scene: PlacedScene, medium: Medium, light: str, fineness: Fineness, points, through, extinction
                        ) -> list[Run]:
    """The render of a light's T, and of what it is divided by where that is not known already."""
    one, (eye, clearest), uneven = scene.lights[light], through, medium.render_step() < np.inf
    clear, path = _irradiance(scene, light, points) / np.pi, _path(scene, light, points)
    level = clear * eye * np.exp(-extinction.mean() * path)
    # the channel that the fog dims least must not overflow
    brightest = clear if uneven else clear * clearest * np.exp(-extinction.min() * path)
    finer = one.finer(fineness.transmittance_step, float(extinction.max()))
    options = {} if finer is one else {"finer": [fineness.transmittance_step, float(extinction.max())]}
    full = scene.camera.width, scene.camera.height
    size = full if one.midpoint() is None else glow_size(*full, fineness.transmittance_size)
    fogged = Run(f"transmittance_{light}", "transmittance", [light], *size,
                 _exposure(level, brightest), uneven_samples(scene, medium, "transmittance", fineness), options)
    if not options and size == full:
        return [fogged]
    # what is divided by must be lit by the same small lights, and be of the same size
    return [replace(irradiance_run(scene, light), id=f"clear_{light}", width=size[0], height=size[1], options=options), fogged]


def _shadow_runs(run: Run, in_one: bool) -> list[Run]:
    light = run.lights[0]
    if in_one:
        return [replace(run, id=f"{SHADOWS}_{light}", options={**run.options, "shadows": IN_RED})]
    return [replace(run, id=f"{kind}_{light}", options={**run.options, "shadows": kind == SHADED})
            for kind in (SHADED, UNSHADED)]


def glow_size(width: int, height: int, longer_side: int) -> tuple[int, int]:
    """Width and height of what is found at this longer side [pixel] or the photograph's, for a photograph's."""
    reduction = min(1.0, longer_side / max(width, height))
    return max(1, round(width * reduction)), max(1, round(height * reduction))


def hidden(scene: PlacedScene, medium: Medium, light: str) -> bool:
    """Whether fog hides all of a light that is not rendered."""
    one = scene.lights[light]
    count = 0 if scene.rendered(light) else one.hidden_count(medium, scene.camera.position)
    return count > 0 and count == one.sub_light_count()


def shaded_lights(scene: PlacedScene, strengths: dict[str, float]) -> list[str]:
    """Those of the lights by strength that get renders of their shadows: the most worth it, where lamps are many."""
    able = [name for name in strengths if scene.shaded(name)]
    worth = {name: strengths[name] * scene.lights[name].shadow_worth(scene.camera.position) for name in able}
    many = sorted((name for name in able if np.isfinite(worth[name])), key=worth.get, reverse=True)
    return [name for name in able if name not in many[MOST_SHADED:]]


def dense_samples(scene: PlacedScene, medium: Medium, fineness: Fineness) -> int:
    """Points along a ray below which a step of it spans too much optical depth."""
    extinction = float(np.add(*medium.coefficients()).max())
    depth = extinction * 2 * scene.extent()
    if medium.render_step() == np.inf:
        return int(np.ceil(min(FARTHEST_OPTICAL_DEPTH, depth) / fineness.optical_step))
    # one ray may end in fog where another sees far
    return int(np.ceil(min(depth / fineness.optical_step, fineness.density_steps)))


def uneven_samples(scene: PlacedScene, medium: Medium, kind: str, fineness: Fineness) -> int:
    """Points along a ray below which a step of it would miss how the fog's density varies."""
    step = medium.render_step()
    if step == np.inf:
        return 1
    # each sample of V is lit through as many again, those of T are few
    most = {"in_scattering": fineness.density_steps, "transmittance": MOST_DENSITY_STEPS}[kind]
    longest = min(scene.extent(), farthest_seen(scene, medium))
    return int(np.clip(np.ceil(longest / (STEPS_OF[kind] * step)), 1, most))


def as_json(run: Run) -> dict[str, Any]:
    return asdict(run)


def from_json(data: dict[str, Any]) -> Run:
    try:
        return Run(**data)
    except TypeError as error:
        raise InputError(f"a run is not as this version of the pipeline plans it ({error})", place="plan.json",
                         remedy="remove the scene's build folder and run make again") from None


def planned_runs(plan: dict[str, Any]) -> list[Run]:
    """All renders of a plan: of the maps, and of the single pixels that check them."""
    return [from_json(data) for data in [*plan["runs"], *(plan["check"] or {"runs": []})["runs"]]]


def surface_grid(scene: PlacedScene, count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Surface points (count, count, 3) [m] and ray directions over the photograph; worked out once for all lights."""
    known = scene.__dict__.setdefault("surface_grids", {})
    if count not in known:
        known[count] = _surface_grid(scene, count)
    return known[count]


def _surface_grid(scene: PlacedScene, count: int) -> tuple[np.ndarray, np.ndarray]:
    camera = scene.camera.resized(count, count)
    directions = camera.directions(camera.pixel_centres())
    depth = np.full((count, count), np.inf)
    for shape in scene.shapes.values():
        depth = np.minimum(depth, shape.intersect(camera.position, directions)[0])
    depth = np.where(np.isfinite(depth), depth, scene.extent())
    return camera.position + depth[..., None] * directions, directions


def _irradiance(scene: PlacedScene, light: str, points: np.ndarray) -> np.ndarray:
    """Rough irradiance of the light at unit strength, where it falls."""
    if isinstance(scene.lights[light], Sun):
        return np.ones(points.shape[:-1])
    return scene.lights[light].incident(points)[0]


def _path(scene: PlacedScene, light: str, points: np.ndarray) -> np.ndarray:
    """Way of the light to the points [m] as far as a render counts it: the sun's begins at no known place."""
    if isinstance(scene.lights[light], Sun):
        return np.zeros(points.shape[:-1])
    return scene.lights[light].incident(points)[1]


def in_scattering_about(scene: PlacedScene, medium: Medium, light: str, directions: np.ndarray, points: np.ndarray,
                   through: float = 1.0) -> np.ndarray:
    """Rough, unoccluded V along the grid's rays; phase function taken as even, and the light's way to have
    `through` times the stated extinction."""
    eye = scene.camera.position
    total = np.zeros(points.shape[:-1])
    steps = 32
    scattering, extinction = medium.coefficients()[1].mean(), np.add(*medium.coefficients()).mean()
    for k in range(steps):
        sample = eye + (points - eye) * ((k + 0.5) / steps)
        path = _path(scene, light, sample)
        step = np.linalg.norm(points - eye, axis=-1) / steps
        attenuated = np.exp(-medium.optical_depth(eye, sample).mean(-1) - through * extinction * path)
        total += _irradiance(scene, light, sample) * attenuated * scattering / (4 * np.pi) * step
    return total


def _exposure(level: np.ndarray, brightest: np.ndarray | None = None) -> float:
    """Power of two that brings the 90th percentile to the target; 2^k costs no digits.

    brightest: levels if the light came through clear air, as it may between banks; they must not overflow.
    """
    highest = max(float(level.max()), 0.0 if brightest is None else float(brightest.max()))
    if not highest > 1e-300:
        return 1.0
    # in dense fog what is near outshines the rest by more than a half float spans; it must not overflow
    wanted = min(TARGET_LEVEL / max(float(np.percentile(level, 90)), 1e-300), HIGHEST_LEVEL / highest)
    return float(2.0 ** np.clip(np.round(np.log2(wanted)), -60, 60))
