"""Light strengths after Karsch et al. 2011: each light rendered alone, their sum fitted to the photograph.

basis/bounce_LIGHT_ROUND.exr (small, with interreflection on surfaces of the albedo estimated so far) serves
the estimate alone.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.intensities import (
    EstimationMaps, IntensityFit, estimate_intensities, reduce_for_estimation)
from pipeline.estimation.observations import reduced_size
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.rendering import povray
from pipeline.rendering.emit import Run, Templates, emit
from pipeline.rendering.runs import irradiance_run
from pipeline.scene.artefacts import annotation_scale, read_json
from pipeline.scene.placed import PlacedScene

#: Darker than this is not believed of a whole face, and light bounces off it for the estimate's sake.
ALBEDO_RANGE = (0.05, 0.95)


def separated(build: Build, scene: PlacedScene, settings, given: dict, templates: Templates,
              begun: dict[str, list[float]] | None = None) -> tuple[IntensityFit, dict[int, np.ndarray]]:
    """The fit, and the albedo (3,) of each face.

    begun: albedos (3,) by SHAPE.FACE from which the first round's bounced light starts, instead of the default.
    """
    names = sources(scene)
    maps, measured, at_least = _observations(build, scene, settings)
    scene = at_estimate_size(scene, settings)
    stated, albedos = _stated_albedos(scene), first_albedos(scene, settings, begun)
    fit = None
    for turn in range(settings.rounds):
        basis = _bounces(build, scene, turn, albedos, maps.surface, settings, templates)
        fit = estimate_intensities(
            replace(maps, basis=basis), names,
            given={names.index(name): value for name, value in given.items() if name in names},
            measured=measured, at_least=at_least, start=fit.intensity if fit else None,
            max_side=settings.size)
        estimated = {i: fit.surface_albedo.get(i, np.full(3, settings.default_albedo)) for i in albedos}
        albedos = {i: stated.get(i, np.clip(albedo, *ALBEDO_RANGE)) for i, albedo in estimated.items()}
        print(f"  round {turn + 1}/{settings.rounds}: median residual {fit.residual_median:.1%}",
              file=sys.stderr)
        if settings.bounces == 0:
            break
    return fit, albedos


def sources(scene: PlacedScene) -> list[str]:
    """Lights that can be rendered alone, whose strengths the fit tells apart."""
    return [name for name, light in scene.lights.items() if light.light_source]


def _stated_albedos(scene: PlacedScene) -> dict[int, np.ndarray]:
    stated, index = {}, 0
    for shape in scene.shapes.values():
        for _ in shape.faces():
            if shape.albedo is not None:
                stated[index] = np.asarray(shape.albedo, float)
            index += 1
    return stated


def _observations(build: Build, scene: PlacedScene, settings):
    """The photograph and what each pixel shows, at the estimate's size; radiance of visible lamps."""
    photograph = read_map(build.photograph)
    clipped = read_map(build.clipped) > 0.5
    surfaces = read_map(build.surfaces)
    surface, emitter = surfaces[..., 0].astype(np.int32), surfaces[..., 1].astype(np.int32)
    names = sources(scene)
    # the map counts all lights, the fit those that can be rendered alone
    emitter = np.array([names.index(name) if name in names else -1 for name in scene.lights] + [-1],
                       np.int32)[emitter]
    measured, at_least = {}, {}
    for index, light in enumerate(scene.lights[name] for name in names):
        shown = emitter == index
        if light.strength_name != "radiance" or not shown.any():
            continue
        core = cv2.erode(shown.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        core = core if core.any() else shown
        # the mean, not the median: a window shows bright sky and dark trees, and all of it gives light
        radiance = photograph[core].mean(0).astype(float)
        # a lamp that is burnt out shows only that it is brighter than white
        (at_least if clipped[core].mean() > 0.5 else measured)[index] = radiance
    annotated, scale = [], annotation_scale(build)
    for region in settings.albedos:
        mask = np.zeros(clipped.shape, np.uint8)
        cv2.fillPoly(mask, [np.round(np.asarray(region.pixels) * scale - 0.5).astype(np.int32)], 1)
        if not mask.any():
            raise InputError(f"albedo region {region.pixels[0]}... covers no pixel of the photograph",
                             remedy="give its outline in pixels of the photograph")
        annotated.append((mask > 0, np.asarray(region.albedo)))
    for index, albedo in _stated_albedos(scene).items():
        if (surface == index).any():
            annotated.append((surface == index, albedo))

    maps = reduce_for_estimation(
        EstimationMaps(photograph, None, surface, emitter, clipped, tuple(annotated)), settings.size)
    # a face or region of a few pixels may vanish at this size, and then says nothing
    kept = tuple((mask, albedo) for mask, albedo in maps.annotated if mask.any())
    return replace(maps, photograph=maps.photograph.astype(float), annotated=kept), measured, at_least


def first_albedos(scene: PlacedScene, settings, begun: dict[str, list[float]] | None = None) -> dict[int, np.ndarray]:
    """Albedo (3,) of each face from which the first round starts."""
    stated, guessed = _stated_albedos(scene), {name: np.asarray(one, float) for name, one in (begun or {}).items()}
    return {i: stated.get(i, guessed.get(name, np.full(3, settings.default_albedo)))
            for i, (name, _) in enumerate(scene.faces())}


def at_estimate_size(scene: PlacedScene, settings) -> PlacedScene:
    camera = scene.camera
    return replace(scene, camera=camera.resized(*reduced_size(camera.width, camera.height, settings.size)))


def bounce_runs(scene: PlacedScene, settings, turn: int) -> list[Run]:
    """Renders of each light alone with interreflection, of one round; scene: of the estimate's size."""
    rays = settings.rays if turn == settings.rounds - 1 else max(1, settings.rays // 2)
    return [Run(f"bounce_{light}_{turn + 1}", "bounce", [light], scene.camera.width, scene.camera.height,
                irradiance_run(scene, light).exposure, options={"bounces": settings.bounces, "rays": rays})
            for light in sources(scene)]


def bounce_jobs(build: Build, scene: PlacedScene, runs: list[Run], albedos: dict[int, np.ndarray], templates: Templates
                ) -> list[tuple[Path, Path, int, int]]:
    """What to render of these runs, their .pov files written."""
    listed = [albedos[i].tolist() for i in range(len(albedos))]
    return [_written(build, run, emit(run, scene, templates, albedos=listed)) for run in runs]


def _bounces(build: Build, scene: PlacedScene, turn: int, albedos: dict[int, np.ndarray], surface: np.ndarray, settings,
             templates: Templates) -> np.ndarray:
    """Irradiance/pi (L, h, w, 3) of each light at unit strength, interreflection included."""
    of_face = np.array([*(albedos[i].tolist() for i in range(len(albedos))), [1.0, 1.0, 1.0]])[surface]
    runs = bounce_runs(scene, settings, turn)
    jobs = bounce_jobs(build, scene, runs, albedos, templates)
    limits = _limits(build)
    for run, seconds in zip(runs, povray.render_side_by_side(jobs, at_once=limits["threads"], timeout=limits["timeout"])):
        _tell(run, seconds)
    reflected = [read_map(build.basis / f"{run.id}.exr").astype(float) / run.exposure for run in runs]
    return np.stack(reflected) / np.maximum(of_face, 1e-3)


def irradiance_jobs(build: Build, scene: PlacedScene, runs: list[Run], templates: Templates) -> list[tuple[Path, Path, int, int]]:
    """The same of direct light."""
    return [_written(build, run, emit(run, scene, templates)) for run in runs]


def render(build: Build, scene: PlacedScene, runs: list[Run], templates: Templates) -> None:
    """Renders of direct light."""
    povray.render_together(irradiance_jobs(build, scene, runs, templates), **_limits(build),
                           told=lambda index, seconds: _tell(runs[index], seconds))


def _limits(build: Build) -> dict:
    """Threads and seconds [s] a render may take; they change no pixel, so that Make does not redo it."""
    settings = read_json(build.input("render"))
    return {"threads": settings["threads"], "timeout": settings["timeout"]}


def _written(build: Build, run: Run, text: str) -> tuple[Path, Path, int, int]:
    """The run's .pov file, put into basis/ where it is new, and what its render needs."""
    build.basis.mkdir(parents=True, exist_ok=True)
    pov = build.basis / f"{run.id}.pov"
    if not pov.exists() or pov.read_text(encoding="utf-8") != text:
        with replacing(pov) as name:
            name.write_text(text, encoding="utf-8")
    return pov, build.basis / f"{run.id}.exr", run.width, run.height


def _tell(run: Run, seconds: float) -> None:
    if seconds:
        print(f"  {run.id}: {seconds:.1f} s", file=sys.stderr, flush=True)
