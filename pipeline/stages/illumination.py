"""Photograph and clear renders of each light alone -> illumination.json, albedo.exr, basis/.

basis/irradiance_LIGHT.exr (full size, direct, white surfaces) serves T as well;
basis/bounce_LIGHT_ROUND.exr (small, with interreflection on surfaces of the albedo estimated so far)
serves the estimate alone.
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
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.rendering import povray
from pipeline.rendering.emit import Run, Templates, emit
from pipeline.rendering.runs import as_json, irradiance_run
from pipeline.scene.artefacts import plugin_from_json, read_json, read_placed, scene_place, write_json
from pipeline.scene.placed import PlacedScene

#: Darker than this is not believed of a whole face, and light bounces off it for the estimate's sake.
ALBEDO_RANGE = (0.05, 0.95)


def run(build: Build) -> None:
    scene = read_placed(build)
    settings = plugin_from_json("estimators", read_json(build.input("illumination")))
    strengths = read_json(build.input("strengths"))
    if not read_json(build.input("demand"))["light_strengths"]:
        return _without_fog(build)
    templates = Templates(build.source)
    runs = {}
    rendered = [name for name, light in scene.lights.items() if light.rendered]
    for light in rendered:
        planned = irradiance_run(scene, light)
        _render(build, planned, emit(planned, scene, templates))
        runs[planned.id] = as_json(planned)
    write_json(build.basis / "runs.json", runs)

    given = {name: strength for name, strength in strengths.items() if strength is not None}
    lights = {name: {"strength": given[name], "source": "given"} for name in scene.lights if name in given}
    for name in set(scene.lights) - set(rendered) - set(given):
        lights[name] = {"strength": _mean_radiance(build), "source": "mean of the photograph"}
    if len(lights) == len(scene.lights):
        fit, report = None, {"estimator": "none needed: every strength is given", "messages": []}
        faces = {}
    else:
        try:
            fit, faces = _estimate(build, scene, settings, given, templates)
        except InputError as error:
            raise error.at(scene_place(build, "illumination")) from None
        # an error without bound is none that JSON can hold
        error = np.where(np.isfinite(fit.standard_error), fit.standard_error, None)
        lights |= {name: {"strength": fit.intensity[i].tolist(), "standard_error": error[i],
                          "source": "given" if name in given else settings.type}
                   for i, name in enumerate(rendered)}
        report = {"estimator": settings.type, "scale_source": fit.scale_source,
                  "messages": list(fit.messages),
                  "residual_median": fit.residual_median, "residual_p90": fit.residual_p90,
                  "condition_number": fit.condition_number, "usable_fraction": fit.usable_fraction,
                  "correlation": fit.correlation,
                  "inseparable": [[rendered[i] for i in pair] for pair in fit.inseparable]}
    lights = {name: lights[name] for name in scene.lights}
    for name, light in scene.lights.items():
        lights[name].update(quantity=light.strength_name,
                            unit=type(light).model_fields[light.strength_name].json_schema_extra["unit"])
    names = [face for face, _ in scene.faces()]
    albedos = {names[i]: np.clip(albedo, *ALBEDO_RANGE).tolist() for i, albedo in sorted(faces.items())}
    for message in report["messages"]:
        print(f"  note: {message}", file=sys.stderr)
    _write_albedo(build, fit.albedo if fit is not None else np.full((1, 1, 3), 0.5))
    # last: Make looks at it
    write_json(build.illumination, {**report, "lights": lights, "face_albedo": albedos})


def _without_fog(build: Build) -> None:
    """Without fog nobody asks how strong the lights are: no render, no estimate."""
    _write_albedo(build, np.full((1, 1, 3), 0.5))
    write_json(build.illumination, {
        "estimator": "none needed: the fog is clear", "messages": [], "lights": {}, "face_albedo": {}})


def _write_albedo(build: Build, albedo: np.ndarray) -> None:
    size = read_json(build.photograph_facts)
    albedo = cv2.resize(albedo.astype(np.float32), (size["width_pixel"], size["height_pixel"]),
                        interpolation=cv2.INTER_LINEAR)
    write_map(build.albedo, albedo, {"fog:content": "estimated diffuse albedo"})


def _estimate(build: Build, scene: PlacedScene, settings, given: dict, templates: Templates
              ) -> tuple[IntensityFit, dict[int, np.ndarray]]:
    names = [name for name, light in scene.lights.items() if light.rendered]
    maps, measured, at_least = _observations(build, scene, settings)
    height, width = maps.surface.shape
    small = scene.camera.resized(width, height)
    small_scene = replace(scene, camera=small)
    stated = _stated_albedos(scene)
    albedos = {i: stated.get(i, np.full(3, settings.default_albedo)) for i in range(len(scene.faces()))}
    fit = None
    for turn in range(settings.rounds):
        basis = _bounces(build, small_scene, names, turn, albedos, maps.surface, settings, templates)
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
    clipped = read_map(build.shared / "clipped.exr") > 0.5
    surfaces = read_map(build.surfaces)
    surface, emitter = surfaces[..., 0].astype(np.int32), surfaces[..., 1].astype(np.int32)
    rendered = [light for light in scene.lights.values() if light.rendered]
    # the map counts all lights, the fit those that are rendered
    emitter = np.array([rendered.index(light) if light.rendered else -1 for light in scene.lights.values()]
                       + [-1], np.int32)[emitter]
    measured, at_least = {}, {}
    for index, light in enumerate(rendered):
        shown = emitter == index
        if light.strength_name != "radiance" or not shown.any():
            continue
        core = cv2.erode(shown.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        core = core if core.any() else shown
        # the mean, not the median: a window shows bright sky and dark trees, and all of it gives light
        radiance = photograph[core].mean(0).astype(float)
        # a lamp that is burnt out shows only that it is brighter than white
        (at_least if clipped[core].mean() > 0.5 else measured)[index] = radiance
    annotated = []
    for region in settings.albedos:
        mask = np.zeros(clipped.shape, np.uint8)
        cv2.fillPoly(mask, [np.round(np.asarray(region.pixels) - 0.5).astype(np.int32)], 1)
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


def _mean_radiance(build: Build) -> list[float]:
    """Mean radiance (3,) of the photograph's surfaces, lamps left out: what is reflected about the room."""
    surfaces = read_map(build.surfaces)[..., 1] < 0
    photograph = np.maximum(read_map(build.photograph), 0)
    return photograph[surfaces].mean(0).tolist() if surfaces.any() else [0.0, 0.0, 0.0]


def _bounces(build: Build, scene: PlacedScene, lights: list[str], turn: int, albedos: dict[int, np.ndarray],
             surface: np.ndarray, settings, templates: Templates) -> np.ndarray:
    """Irradiance/pi (L, h, w, 3) of each light at unit strength, interreflection included."""
    listed = [albedos[i].tolist() for i in range(len(albedos))]
    of_face = np.array([*listed, [1.0, 1.0, 1.0]])[surface]
    runs = [Run(f"bounce_{light}_{turn + 1}", "bounce", [light], scene.camera.width, scene.camera.height,
                irradiance_run(scene, light).exposure, options={"bounces": settings.bounces, "rays": 120})
            for light in lights]
    jobs = [_written(build, run, emit(run, scene, templates, albedos=listed)) for run in runs]
    for run, seconds in zip(runs, povray.render_side_by_side(jobs, **_limits(build))):
        _tell(run, seconds)
    reflected = [read_map(build.basis / f"{run.id}.exr").astype(float) / run.exposure for run in runs]
    return np.stack(reflected) / np.maximum(of_face, 1e-3)


def _render(build: Build, run: Run, text: str) -> None:
    _tell(run, povray.render(*_written(build, run, text), **_limits(build)))


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
