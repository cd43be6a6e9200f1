"""T and V of each light against Mitsuba 3 -> crosscheck.json, crosscheck.png.

Both average over the same coarse pixels: ours by area, Mitsuba's by a box filter. T's light paths are rendered there,
clear and fogged; its eye path is exp(-optical depth) over Mitsuba's own depth.
Mitsuba's V shows the lamp itself where it is in sight: those pixels are left out, and are white in the picture. Its fog
is met at random on every way, so that an error as large as the stated noise says nothing: raise the samples then.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.plugins.base import registry
from pipeline.rendering.describe import describe
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import read_json, write_json

SIZE = 32
SAMPLES = {"in_scattering": 8192, "transmittance": 4096, "clear": 1024}
#: Largest median of the relative error.
TOLERANCE = {"T": 0.01, "V": 0.02}


def run(build: Build) -> None:
    try:
        import mitsuba
    except ImportError:
        raise InputError("Mitsuba 3 is not installed", place="crosscheck",
                         remedy="run: .venv/bin/python -m pip install mitsuba==3.9.1") from None
    # LLVM of some systems stops the whole process on Mitsuba's vectorised code; the scalar variant needs none
    mitsuba.set_variant("scalar_rgb")
    size = _whole("FOG_CROSSCHECK_SIZE", SIZE)
    scattered = Scattered(build)
    full, medium, strengths = scattered.scene, scattered.medium, scattered.strengths
    lights = read_json(build.plan)["lights"]
    share = min(1.0, size / max(full.camera.width, full.camera.height))
    width, height = (max(1, round(n * share)) for n in (full.camera.width, full.camera.height))
    scene = replace(full, camera=full.camera.resized(width, height))
    exporter_class = registry("exporters")["mitsuba"]
    folder = build.export("crosscheck")
    folder.mkdir(parents=True, exist_ok=True)

    def coarse(image):
        return cv2.resize(np.asarray(image, np.float32), (width, height), interpolation=cv2.INTER_AREA).astype(float)

    def render(what, light, seed):
        count = _whole("FOG_CROSSCHECK_SAMPLES", SAMPLES[what]) if what == "in_scattering" else SAMPLES[what]
        exporter = exporter_class(samples=count)
        name = f"{what}_{light}"
        for file, content in exporter.export(name, describe(what, scene, medium, strengths, [light], {}, exporter)).items():
            with replacing(folder / file) as partial:
                partial.write_bytes(content.encode() if isinstance(content, str) else content)
        return np.array(mitsuba.render(mitsuba.load_file(str(folder / f"{name}.xml")), seed=seed)), folder / f"{name}.xml"

    lamp = coarse(scattered.without_surface) > 0
    facts, pictures, sums = {"size_pixel": [width, height], "maps": {}, "not_compared": []}, [], []
    for light in lights:
        if not scene.rendered(light) or scene.lights[light].type_name() not in exporter_class.states:
            facts["not_compared"].append(f"{light} ({scene.lights[light].type_name()}): "
                                         + ("closed form" if not scene.rendered(light) else "not stated in Mitsuba"))
            continue
        print(f"  {light}", file=sys.stderr, flush=True)
        # ---- V, two seeds
        one, two = (render("in_scattering", light, seed)[0] for seed in (0, 1))
        theirs, ours = (one + two) / 2, coarse(scattered.by(light))
        sums.append((ours, one, two))
        facts["maps"][f"V {light}"] = _compared(ours, theirs, one, two, ~lamp)
        pictures.append((f"V {light}", ours, theirs))
        # ---- T, two seeds
        found = []
        for seed in (0, 1):
            clear, file = render("clear", light, seed)
            fogged, _ = render("transmittance", light, seed)
            found.append(np.where(clear > 0, fogged / np.where(clear > 0, clear, 1), np.nan))
        depth = _depth(mitsuba, file)
        points = scene.camera.position + depth[..., None] * scene.camera.directions(scene.camera.pixel_centres())
        facts["maps"].setdefault("depth", _compared(coarse(scattered.depth)[..., None], depth[..., None], depth[..., None],
                                                    depth[..., None], ~lamp & (depth > 0)))
        eye = np.exp(-medium.optical_depth(scene.camera.position, points))
        one, two = (f * eye for f in found)
        basis = read_map(build.basis / f"irradiance_{light}.exr").astype(float).max(-1)
        # where nothing direct arrives ours is a stand-in for what comes by reflection
        direct = (coarse(basis > 0) >= 1) & ~lamp & np.isfinite(one + two).all(-1)
        ours = coarse(scattered.transmittance([light]))
        facts["maps"][f"T {light}"] = {**_compared(ours, (one + two) / 2, one, two, direct),
                                       "excluded_pixels": int((~direct).sum())}
        pictures.append((f"T {light}", np.where(direct[..., None], ours, 0), np.where(direct[..., None], (one + two) / 2, 0)))
    if sums:
        ours, one, two = (sum(s) for s in zip(*sums))
        facts["maps"]["V total"] = _compared(ours, (one + two) / 2, one, two, ~lamp)
        pictures.append(("V total", ours, (one + two) / 2))
    failed = [name for name, m in facts["maps"].items() if name[0] in TOLERANCE and m["pixels"]
              and m["median_relative_error"] > TOLERANCE[name[0]]]
    facts["failed"] = failed
    write_json(build.crosscheck, facts)
    _draw(build, pictures)
    print(f"{'map':22} {'median':>8} {'99 %':>8} {'ratio':>8} {'noise':>8} {'pixels':>7}")
    for name, m in facts["maps"].items():
        if m["pixels"]:
            print(f"{name:22} {m['median_relative_error']:8.2%} {m['p99_relative_error']:8.2%} {m['median_ratio']:8.4f} "
                  f"{m['noise_of_theirs']:8.2%} {m['pixels']:7d}")
    for line in facts["not_compared"]:
        print(f"not compared: {line}")
    if failed:
        raise InputError(f"{', '.join(failed)}: median beyond {TOLERANCE['T']:.0%} (T) or {TOLERANCE['V']:.0%} (V)",
                         place=str(build.crosscheck),
                         remedy="look at crosscheck.png; where the noise is as large, set FOG_CROSSCHECK_SAMPLES higher")


def _whole(variable: str, default: int) -> int:
    text = os.environ.get(variable) or str(default)
    if not text.isdigit() or not 1 <= int(text) <= 10**6:
        raise InputError(f"{variable}={text}", place="environment", remedy="give a whole number from 1 to 1000000")
    return int(text)


def _compared(ours, theirs, one, two, seen) -> dict:
    """Relative error where theirs is not black; noise: median of the two seeds' mean's own standard error."""
    # a thousandth of the brightest is black beside it
    used = seen[..., None] & (theirs > 1e-3 * np.nanmax(np.where(seen[..., None], theirs, 0), initial=0.0))
    if not used.any():
        return {"pixels": 0}
    error = np.abs(ours[used] / theirs[used] - 1)
    return {"median_relative_error": float(np.median(error)), "p99_relative_error": float(np.percentile(error, 99)),
            "median_ratio": float(np.median(ours[used] / theirs[used])),
            "noise_of_theirs": float(np.median(np.abs(one[used] - two[used]) / 2 / theirs[used])),
            "pixels": int(used.any(-1).sum())}


def _depth(mitsuba, file) -> np.ndarray:
    """Radial depth (H, W) [m] at pixel centres, by Mitsuba's own rays; 0 where nothing is met."""
    scene = mitsuba.load_file(str(file))
    sensor = scene.sensors()[0]
    width, height = sensor.film().crop_size()
    result = np.zeros((height, width))
    for v in range(height):
        for u in range(width):
            ray, _ = sensor.sample_ray(0, 0, [(u + 0.5) / width, (v + 0.5) / height], [0.5, 0.5])
            hit = scene.ray_intersect(ray)
            if hit.is_valid():
                result[v, u] = np.linalg.norm(np.array(hit.p) - np.array(sensor.world_transform() @ mitsuba.Point3f(0)))
    return result


def _draw(build: Build, pictures) -> None:
    """Rows: ours, Mitsuba's, ten times the difference about grey."""
    rows = []
    for name, ours, theirs in pictures:
        scale = max(float(np.nanpercentile(ours, 99)), 1e-30)
        panels = [ours / scale, theirs / scale, 0.5 + 5 * (ours - theirs) / scale]
        row = np.concatenate([np.clip(np.nan_to_num(p), 0, 1) for p in panels], 1)
        row = cv2.resize(row, None, fx=5, fy=5, interpolation=cv2.INTER_NEAREST)
        row = (255 * row ** (1 / 2.2)).astype(np.uint8)[..., ::-1]
        bar = np.full((22, row.shape[1], 3), 255, np.uint8)
        cv2.putText(bar, f"{name}: ours | Mitsuba | difference x 10 about grey", (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45,
                    (0, 0, 0), 1, cv2.LINE_AA)
        rows += [bar, row]
    if rows:
        with replacing(build.crosscheck.with_suffix(".png")) as partial:
            partial.write_bytes(cv2.imencode(".png", np.concatenate(rows))[1].tobytes())
