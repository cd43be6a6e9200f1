"""Measures the constants of the plan's model on this machine, over the scenes that the project carries."""

from __future__ import annotations

import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.optimize import nnls

from pipeline import chain
from pipeline.imaging.maps import read_map
from pipeline.paths import CALIBRATION, Build
from pipeline.planning import trial
from pipeline.planning.accuracy import relative_error
from pipeline.planning.model import (
    FULL_SIZE_MAPS, HALF_SHADOWS, SURROUNDINGS, Calibration, concerned, demands_from_json, level_of, seconds_of)
from pipeline.rendering import povray
from pipeline.rendering.emit import Templates, emit
from pipeline.rendering.enclosed import Enclosed
from pipeline.rendering.fineness import AREA, INTEGRATED, MIDPOINT, Fineness, as_json
from pipeline.rendering.fineness import from_json as fineness_from_json
from pipeline.rendering.runs import fog_runs, from_json
from pipeline.rendering.work import light_samples
from pipeline.scene.artefacts import FOG_STAGES, read_fog, read_json, read_placed, write_json

#: Scenes and fogs that are measured; None is a scene's own fog.
CASES = [("cornell", None), ("cornell", "homogeneous_a0.40_d0.30"), ("bathroom", None), ("bathroom", "thick"),
         ("cornell_height", None), ("building", None), ("lamps", None)]
#: All knobs but one are at these levels while that one is measured.
FINE = Fineness(in_scattering_size=192, glow_tolerance=0.005, shadow_size=128, samples=40, shadow_lights=6,
                shaft_samples=120, transmittance=INTEGRATED, transmittance_step=0.05)
LEVELS: dict[str, list[Any]] = {
    "in_scattering_size": [48, 64, 96], "glow_tolerance": [0.1, 0.05, 0.02], "shadow_size": [24, 48, 72],
    "samples": [4, 8, 16], "shadow_lights": [2, 3, 4], "shaft_samples": [6, 12, 24, 48]}
#: Numbers of directions in a room, which are compared to all.
ROOM_DIRECTIONS = [32, 64]
#: Pixels made as finely as it takes, to which all are compared.
PIXELS = 200
#: Longer side [pixel] of the photograph that is large.
LARGE = 3000
PHOTOGRAPH_STAGES = ("photograph", "camera", "geometry", "sun_direction", "illumination")
#: Longer sides [pixel] of T's renders that are measured.
T_SIZES = [64, 128]
#: Share of V below which what a knob adds to its error is lost among the rest.
LEAST_SHARE = 0.05
#: Share of the measurements that a law is to lie above: a plan that promises too much helps nobody.
QUANTILE = 0.8
#: Exponents are fitted, but kept within what a law of its kind may be.
EXPONENTS = {"in_scattering_size": (-2.0, -1.0), SURROUNDINGS: (-2.0, -1.0), "glow_tolerance": (0.4, 1.0),
             "shadow_size": (-2.0, -0.7),
             "samples": (-1.5, -0.8), "transmittance_size": (-1.5, -0.5), "room_directions": (-2.0, -0.5),
             "shadow_lights": (-2.0, -0.8), "shaft_samples": (-1.5, -0.8)}


def calibrate(scenes: Path, builds: Path) -> Path:
    """Measures, fits and writes what `model.calibration` reads; the fogs of CASES must have been made."""
    made = [Build(scene, fog, scenes, builds) for scene, fog in CASES]

    screen = sys.stderr

    def told(line: str) -> None:
        print(f"  {line}", file=screen, flush=True)

    with quiet():
        constants = seconds(made[2], made[0], made)
        told("seconds: " + ", ".join(f"{name} {value:.2g}" for name, value in constants.items()))
        records = measured_errors(made, told)
    found = laws(records)
    told("errors: " + ", ".join(f"{name} {value[0]:.2g}" for name, value in found.items()))
    path = builds / CALIBRATION
    write_json(path, {
        "cores": os.cpu_count() or 1, "machine": platform.processor() or platform.machine(), "povray": povray.version(),
        "seconds": constants, "error": found, "measured": records})
    return path


@contextmanager
def quiet() -> Iterator[None]:
    """Stages say what they do; hundreds of times that helps nobody."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stderr(nowhere):
        yield


def measured_errors(builds: list[Build], told: Callable[[str], None]) -> list[dict[str, Any]]:
    """One record a trial: case, knob, level, what it adds to the error of V or T, and what of V it concerns."""
    records = []
    for build in builds:
        case = f"{build.scene}:{build.fog or 'default'}"
        base = _trial(build, FINE)
        for knob, levels in LEVELS.items():
            # of V: by the knob's own law, and by what stands round the fog
            share, besides = (concerned(base["demands"], knob, law) / max(base["demands"].share(), 1e-12)
                              for law in (knob, SURROUNDINGS))
            if not max(share, besides) > LEAST_SHARE:
                continue
            for level in levels:
                one = _trial(build, replace(FINE, **{knob: level}))
                # as many samples in a shaft as all others are compared with leave about as much
                least = 0.0 if knob == "shaft_samples" else base["error"]["in_scattering"]
                added = _added(one["error"]["in_scattering"], least)
                records.append({"case": case, "knob": knob, "added": added, "share": share, "besides": besides,
                                "error": added / share if share > LEAST_SHARE and not besides else None,
                                "level": level_of(base["demands"], replace(FINE, **{knob: level}), knob)})
                told(f"{case}: {knob} {level}: V {added:.2%}")
        if any(one.half_shadow[MIDPOINT] > 0 for one in base["demands"].lights):
            surfaces = base["demands"].surfaces
            for knob, level, change in (("half_shadow", INTEGRATED, {}), ("half_shadow", MIDPOINT, {"transmittance": MIDPOINT}),
                                        *(("transmittance_size", size, {"transmittance": AREA, "transmittance_size": size})
                                          for size in T_SIZES)):
                one = _trial(build, replace(FINE, **change)) if change else base
                spread = base["demands"].half_shadow(level if knob == "half_shadow" else INTEGRATED)
                records.append({"case": case, "knob": knob, "level": level,
                                "error": one["error"]["transmittance"] * surfaces / max(spread, 1e-12)})
                told(f"{case}: {knob} {level}: T {one['error']['transmittance']:.2%}")
        if base["demands"].reflecting:
            _trial(build, FINE)
            whole = trial.picture(build, "calibrate")
            for count in ROOM_DIRECTIONS:
                _trial(build, replace(FINE, room_directions=count))
                off = relative_error(trial.picture(build, "calibrate"), whole)
                records.append({"case": case, "knob": "room_directions", "level": count, "error": off / base["demands"].reflecting})
                told(f"{case}: room_directions {count}: picture {off:.2%}")
    return records


def laws(records: list[dict[str, Any]]) -> dict[str, list[float]]:
    """Factor and exponent of each knob, and the factor of half-shadows, so that most of what was measured lies below."""
    found = {knob: _law(knob, [one for one in records if one["knob"] == knob and one["error"]])
             for knob in (*LEVELS, "transmittance_size", "room_directions")}
    # what is left where things stand round the fog
    factor, exponent = found["in_scattering_size"]
    besides = [{**one, "error": _added(one["added"], one["share"] * factor * one["level"] ** exponent) / one["besides"]}
               for one in records if one.get("besides", 0) > LEAST_SHARE]
    found[SURROUNDINGS] = _law(SURROUNDINGS, besides)
    found["half_shadow"] = []
    for way in HALF_SHADOWS:
        factors = [one["error"] for one in records if (one["knob"], one["level"]) == ("half_shadow", way)]
        found["half_shadow"].append(float(np.quantile(factors, QUANTILE)) if factors else 1.0)
    return found


def _law(name: str, records: list[dict[str, Any]]) -> list[float]:
    """Factor and exponent."""
    own = [one for one in records if one["error"] > 1e-6]
    low, high = EXPONENTS[name]
    slopes = []
    for case in {one["case"] for one in own}:
        points = np.log([(one["level"], one["error"]) for one in own if one["case"] == case])
        # where fog takes more samples than were asked for, all of these are one level
        if len(set(points[:, 0])) > 1:
            slopes.append(np.polyfit(*points.T, 1)[0])
    exponent = float(np.clip(np.median(slopes), low, high)) if slopes else (low + high) / 2
    factors = [one["error"] * one["level"] ** -exponent for one in own]
    return [float(np.quantile(factors, QUANTILE)) if factors else 0.0, exponent]


def seconds(room: Build, lit: Build, builds: list[Build]) -> dict[str, float]:
    """Time constants. room: an interior with lamps and a shaft of sun; lit: a scene of few faces and one lamp; builds: what
    whole chains are timed on."""
    for build in (room, lit):
        trial.run(build, "calibrate", {**as_json(FINE), "quality": "final"})
    wait, start = _render_once(lit, replace(_run_of(lit, "shadows"), width=1, height=1, samples=1))
    per_sample, faces = {}, {}
    for build in (room, lit):
        one = _run_of(build, "shadows")
        scene = read_placed(build)
        per_sample[build] = (_render_once(build, one)[1] - start) / light_samples(scene, one)
        faces[build] = len(scene.faces())
    slope = max((per_sample[room] - per_sample[lit]) / max(faces[room] - faces[lit], 1), 0.0)
    sample = max(per_sample[lit] - slope * faces[lit], 0.2 * per_sample[lit])
    shaft = _shaft_run(room)
    shaft_sample = (_render_once(room, shaft)[1] - start) / (shaft.width * shaft.height * shaft.samples)
    face = slope / sample
    rays, exponent = _glow(lit)
    constants = {"wait": wait - start, "render": start, "light_sample": sample, "face": face, "shaft_sample": shaft_sample,
                 "surface_light": sample * 1e6, "glow_ray": rays, "glow_ray_exponent": exponent,
                 "surroundings_ray": _surroundings_ray(room),
                 **dict.fromkeys(("fixed", "megapixel", "megapixel_of_light", "full_size_map", "room", "room_direction"), 0.0)}
    # what is left of whole chains, over their megapixels and lights
    left, rows = [], []
    for build in builds:
        for quality in ("draft", "normal"):
            taken = trial.run(build, "calibrate", {"quality": quality})
            plan = read_json(trial.of(build, "calibrate").plan)
            demand = demands_from_json(plan["demands"])
            known = seconds_of(demand, fineness_from_json(plan["fineness"]),
                               Calibration(constants, {}, os.cpu_count() or 1, ""))
            left.append(sum(taken.values()) - known)
            in_room = demand.reflecting > 0
            rows.append([1.0, demand.megapixels, demand.megapixels * len(demand.lights), float(in_room),
                         in_room * float(plan["fineness"]["room_directions"])])
    # each counts by its share of what it took, none below nothing
    weights = 1 / np.maximum(left, 0.3)
    fitted = nnls(np.array(rows) * weights[:, None], np.array(left) * weights)[0]
    constants |= dict(zip(("fixed", "megapixel", "megapixel_of_light", "room", "room_direction"), map(float, fitted)))
    constants["fixed"] += _imports()
    constants["full_size_map"] = _full_size_map(lit)
    return constants


def _trial(build: Build, fineness: Fineness) -> dict[str, Any]:
    trial.run(build, "calibrate", {**as_json(fineness), "quality": "final", "checked_pixels": PIXELS}, fresh=False)
    made = trial.of(build, "calibrate")
    return {"error": read_json(made.maps)["estimated_error"], "demands": demands_from_json(read_json(made.plan)["demands"])}


def _added(error: float, base: float) -> float:
    return float(np.sqrt(max(error**2 - base**2, 0.0)))


def _run_of(build: Build, kind: str):
    runs = [from_json(data) for data in read_json(trial.of(build, "calibrate").plan)["runs"]]
    return max((one for one in runs if one.id.startswith(kind)), key=lambda one: one.width * one.height * one.samples)


def _shaft_run(build: Build):
    """The render of a shaft, whether or not this fog asks for one."""
    scene, medium = read_placed(build), read_fog(build)
    name = next(name for name, light in scene.lights.items() if not light.smooth)
    return next(one for one in fog_runs(scene, medium, [name], FINE, (), [name]) if one.kind == "in_scattering")


def _render_once(build: Build, run) -> tuple[float, float]:
    """Wall time [s] of one POV-Ray run on one thread, and what the processor worked."""
    made = trial.of(build, "calibrate")
    pov, image = made.out / "timing.pov", made.out / "timing.exr"
    pov.write_text(emit(run, read_placed(build), Templates(build.source), medium=read_fog(build)), encoding="utf-8")
    for old in (image, image.with_suffix(".sha256")):
        old.unlink(missing_ok=True)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    povray.render(pov, image, run.width, run.height, threads=1)
    wall, after = time.monotonic() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _glow(build: Build) -> tuple[float, float]:
    """Factor and exponent of the seconds of one core a ray, by the tolerance."""
    scene, medium = read_placed(build), read_fog(build)
    light = next(one for one in scene.lights.values() if one.parts(1) is not None)
    small = scene.camera.resized(48, 48)
    directions = small.directions(small.pixel_centres())
    depth = read_map(build.depth)[:: scene.camera.height // 48, :: scene.camera.width // 48][:48, :48].astype(float)
    taken = []
    for tolerance in (0.1, 0.02, 0.005):
        start = time.monotonic()
        light.glow(medium, scene.camera.position, directions, depth, tolerance)
        taken.append((tolerance, (time.monotonic() - start) / depth.size))
    exponent, factor = np.polyfit(*np.log(taken).T, 1)
    return float(np.exp(factor)), float(exponent)


def _surroundings_ray(build: Build) -> float:
    """Seconds a ray of what things round the fog make of a light from all sides."""
    made = trial.of(build, "calibrate")
    scene, medium = read_placed(made), read_fog(made)
    around = Enclosed(made, scene, medium, FINE.room_directions)
    light = next(name for name in scene.lights if around.changes(name))
    small = scene.camera.resized(96, 96)
    depth = cv2.resize(read_map(build.depth), (96, 96), interpolation=cv2.INTER_NEAREST).astype(float)
    around.factor(light, small, small.pixel_centres(), depth)
    start = time.monotonic()
    around.factor(light, small, small.pixel_centres(), depth)
    return (time.monotonic() - start) / depth.size


def _full_size_map(build: Build) -> float:
    """Seconds a megapixel of one map at the size of a large photograph, where it is enlarged: the scene's own, resampled."""
    with tempfile.TemporaryDirectory(dir=build.builds) as folder:
        large, taken = replace(build, builds=Path(folder)), {}
        subprocess.run([sys.executable, "-m", "pipeline", "resolve", "--scene", large.scene, "--scenes", str(large.scenes), "--build",
                        folder, "--set", f"photograph.size={LARGE}"], check=True, stderr=subprocess.DEVNULL)
        chain.run(large, PHOTOGRAPH_STAGES + FOG_STAGES, done=taken.__setitem__)
        demand = demands_from_json(read_json(large.plan)["demands"])
    return taken["composite"] / (demand.full_size * (len(demand.lights) + FULL_SIZE_MAPS))


def _imports() -> float:
    """Seconds that the process of a fog's stages takes to import what these need."""
    timed = ("import time, importlib; import pipeline.cli; start = time.monotonic();"
             " [importlib.import_module('pipeline.stages.' + name) for name in {!r}];"
             " from pipeline.plugins.registry import KINDS, registry; [registry(kind) for kind in KINDS];"
             " import scipy.interpolate, scipy.spatial, scipy.special;"
             " print(time.monotonic() - start)").format(FOG_STAGES)
    return float(subprocess.run([sys.executable, "-c", timed], check=True, capture_output=True, text=True).stdout)
