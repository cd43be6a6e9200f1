"""T and V of each light against Mitsuba 3 -> crosscheck.json, crosscheck.png.

Both average over the same coarse pixels: ours by area, Mitsuba's by a box filter. T's light paths are rendered there,
clear and fogged; its eye path is exp(-optical depth) over Mitsuba's own depth.
Mitsuba's V shows the lamp itself where it is in sight: those pixels are left out, and are white in the picture. So are
pixels with an edge of the scene in them from what is compared of T, for a mean of ratios is no ratio of means.
"""

from __future__ import annotations

import os
import sys

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.rendering.scattered import Scattered
from pipeline.rendering.second_opinion import Estimate, SecondOpinion, coarse_scene
from pipeline.scene.artefacts import read_json, write_json

SIZE = 32
#: Paths a pixel beyond which no picture goes on.
MOST = 1 << 21
#: Of its mean, by which depth may vary within a pixel that has no edge in it.
SMOOTH = 0.02
#: Largest median of the relative error, and the share of it that Mitsuba's noise is rendered down to.
TOLERANCE, NOISE = {"T": 0.01, "V": 0.02}, 0.25


def run(build: Build) -> None:
    size, most = _whole("FOG_CROSSCHECK_SIZE", SIZE, 512), _whole("FOG_CROSSCHECK_SAMPLES", MOST, 1 << 30)
    scattered = Scattered(build)
    scene = coarse_scene(scattered.scene, size)
    width, height = scene.camera.width, scene.camera.height
    second = SecondOpinion(scene, scattered.medium, scattered.strengths, build.export("crosscheck"), most)

    def coarse(image) -> np.ndarray:
        return cv2.resize(np.asarray(image, np.float32), (width, height), interpolation=cv2.INTER_AREA).astype(float)

    facts = {"size_pixel": [width, height], "maps": {}, "not_compared": []}
    lights = []
    for light in read_json(build.plan)["lights"]:
        if scene.rendered(light) and second.states(light):
            lights.append(light)
        else:
            facts["not_compared"].append(f"{light} ({scene.lights[light].type_name()}): "
                                         + ("not stated in Mitsuba" if scene.rendered(light) else "closed form"))
    surface = ~(coarse(scattered.without_surface) > 0)
    relative = scattered.depth / scattered.depth.mean()
    varies = np.sqrt(np.maximum(coarse(relative**2) - coarse(relative) ** 2, 0))
    smooth = surface & (varies <= SMOOTH * coarse(relative))
    pictures, glows, fogged_of, clear_of = [], [], [], []
    lit, partly = np.zeros((2, height, width), bool)

    def compare(name: str, ours: np.ndarray, theirs: Estimate, seen: np.ndarray) -> None:
        facts["maps"][name] = _compared(ours, theirs, seen)
        shown = seen[..., None] if name[0] == "T" else True
        pictures.append((name, np.where(shown, ours, 0), np.where(shown, theirs.mean, 0)))

    if lights:
        depth = second.depth(lights[0])
        exact = Estimate(depth[..., None], np.zeros_like(depth[..., None]))
        facts["maps"]["depth"] = _compared(coarse(scattered.depth)[..., None], exact, smooth & (depth > 0))
        points = scene.camera.position + depth[..., None] * scene.camera.directions(scene.camera.pixel_centres())
        eye = np.exp(-scattered.medium.optical_depth(scene.camera.position, points))
    for light in lights:
        print(f"  {light}", file=sys.stderr, flush=True)
        glow = second.in_scattering(light, surface, NOISE * TOLERANCE["V"])
        glows.append((coarse(scattered.by(light)), glow))
        compare(f"V {light}", *glows[-1], surface)
        # where nothing direct arrives ours is a stand-in for what comes by reflection
        basis = read_map(build.basis / f"irradiance_{light}.exr").astype(float).max(-1)
        share = coarse(basis > 0)
        direct = (share >= 1) & smooth
        fogged, clear = second.transmittance(light, direct, NOISE * TOLERANCE["T"])
        fogged = [eye * one for one in fogged]
        # the walls with windows are away there, and sunlight is everywhere: it counts where it comes through the windows
        fogged_of.append(Estimate.of([one * direct[..., None] for one in fogged]))
        clear_of.append(Estimate.of([one * direct[..., None] for one in clear]))
        compare(f"T {light}", coarse(scattered.transmittance([light])),
                Estimate.ratio(fogged, clear), direct)
        facts["maps"][f"T {light}"]["excluded_pixels"] = int((~direct).sum())
        lit |= direct
        partly |= (share > 0) & (share < 1)
    if len(lights) > 1:
        compare("V total", sum(ours for ours, _ in glows), Estimate.total([theirs for _, theirs in glows]), surface)
        together = Estimate.quotient(Estimate.total(fogged_of), Estimate.total(clear_of))
        compare("T total", coarse(scattered.transmittance(lights)), together, lit & ~partly)
    _draw(build, pictures)
    _judged(build, facts)


def _judged(build: Build, facts: dict) -> None:
    """Writes and prints what was found. Raises InputError where a map is wrong, or too noisy to be told right."""
    compared = {name: m for name, m in facts["maps"].items() if m["pixels"]}
    judged = {name: (m, TOLERANCE[name[0]]) for name, m in compared.items() if name[0] in TOLERANCE}
    noisy = [name for name, (m, limit) in judged.items() if m["noise_of_theirs"] > 2 * NOISE * limit]
    failed = [name for name, (m, limit) in judged.items() if m["median_relative_error"] > limit and name not in noisy]
    facts.update(failed=failed, too_noisy=noisy)
    write_json(build.crosscheck, facts)
    print(f"{'map':22} {'median':>8} {'99 %':>8} {'ratio':>8} {'noise':>8} {'pixels':>7}")
    for name, m in compared.items():
        print(f"{name:22} {m['median_relative_error']:8.2%} {m['p99_relative_error']:8.2%} {m['median_ratio']:8.4f} "
              f"{m['noise_of_theirs']:8.2%} {m['pixels']:7d}")
    for line in facts["not_compared"]:
        print(f"not compared: {line}")
    if failed:
        raise InputError(f"{', '.join(failed)}: median beyond {TOLERANCE['T']:.0%} (T) or {TOLERANCE['V']:.0%} (V)",
                         place=str(build.crosscheck), remedy="look at crosscheck.png beside it")
    if noisy:
        raise InputError(f"{', '.join(noisy)}: Mitsuba's noise is too large to tell", place=str(build.crosscheck),
                         remedy="set FOG_CROSSCHECK_SAMPLES (paths a pixel at most) higher")


def _whole(variable: str, default: int, most: int) -> int:
    text = os.environ.get(variable) or str(default)
    if not text.isdecimal() or len(text) > 12 or not 1 <= int(text) <= most:
        raise InputError(f"{variable}={text[:40]}", place="environment", remedy=f"give a whole number from 1 to {most}")
    return int(text)


def _compared(ours: np.ndarray, theirs: Estimate, seen: np.ndarray) -> dict:
    """Relative error where theirs is not black."""
    used = theirs.used(seen)
    if not used.any():
        return {"pixels": 0}
    ratio = ours[used] / theirs.mean[used]
    return {"median_relative_error": float(np.median(np.abs(ratio - 1))),
            "p99_relative_error": float(np.percentile(np.abs(ratio - 1), 99)), "median_ratio": float(np.median(ratio)),
            "noise_of_theirs": theirs.noise(seen), "pixels": int(used.any(-1).sum())}


def _draw(build: Build, pictures: list[tuple[str, np.ndarray, np.ndarray]]) -> None:
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
