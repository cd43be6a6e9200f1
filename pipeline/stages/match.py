"""A foggy photograph -> the fog that makes a clear one look like it: match.json, comparison.png, residual.png, and a named
fog in the scene file.

After the future work of Zhao et al. 2013 (section 7). The reference shows the view of a scene whose photograph is its clear
counterpart, pixel upon pixel: of the scene itself, or of another, from which the fog is taken over. Light comes from what
was estimated there, and T and V from trial fogs that the chain made.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from pipeline.errors import InputError, nearest
from pipeline.estimation.fog_match import Asked
from pipeline.imaging import photograph as photographs
from pipeline.imaging.display import FLOAT_KINDS, display_exposure, write_png
from pipeline.imaging.maps import read_map
from pipeline.imaging.photograph import averaged
from pipeline.paths import Build, inside
from pipeline.planning.match_maps import TrialFogs, matched, visibility_of_level
from pipeline.reporting.matched import fog_of, numbers, pictures, settings_of, visibility_in_words, words
from pipeline.scene.artefacts import image_size, read_fog, read_json, scene_place, write_json
from pipeline.scene.fog_entry import refuse_taken, write_fog

#: What may be asked for besides exposure; visibility is always found.
FIT = ("visibility", "albedo", "gains", "g")
#: Longer side [pixel] at which pictures are compared, and tiles along it, of which neighbours may err alike.
SIZE, TILES = 256, 8
#: By so much the two photographs' shapes may differ, as roundings of their sizes do.
SAME_SHAPE = 0.01
FEWEST = 100


def run(view: Build, scene: Build, reference: str, name: str, fit: str) -> None:
    """view: the build in whose photograph's view the reference lies; scene: the one whose file gets the fog."""
    names = _asked(fit)
    refuse_taken(scene.scene_file, name)
    medium = read_fog(view)
    if not read_json(view.input("demand"))["light_strengths"]:
        raise InputError("the fog is clear, so that no light was estimated", place=scene_place(view, "fog"),
                         remedy="pick a denser fog to begin with: fog=NAME")
    foggy, left_out, size = _reference(view, reference)
    shape = size[::-1]
    depth = averaged(read_map(view.depth), size)
    left_out |= averaged(((read_map(view.clipped) > 0) | (read_map(view.surfaces)[..., 1] >= 0)).astype(np.float32), size) > 0
    used = ~left_out
    if used.sum() < FEWEST:
        raise InputError(f"only {used.sum()} of {used.size} pixels can be compared", place=reference,
                         remedy="give photographs that are less burnt out")
    v, u = np.mgrid[:shape[0], :shape[1]]
    tiles = np.stack([v, u], -1) * TILES // max(shape)
    absorption, scattering = medium.coefficients()
    albedo = np.divide(scattering, absorption + scattering, out=np.ones(3), where=absorption + scattering > 0)
    phase = medium.phase()
    asked = Asked(np.ones(3) if "albedo" in names else albedo, getattr(phase, "asymmetry", 0.0), "albedo" in names,
                  "gains" in names, "g" in names)
    fogs = TrialFogs(view, size, medium, lambda line: print(f"  {line}", file=sys.stderr, flush=True))
    found, response, lights, levels = matched(fogs, depth.ravel(), used.ravel(), foggy.reshape(-1, 3), tiles.reshape(-1, 2), asked)
    ours = found.picture(response).reshape(*shape, 3)
    unexplained = float(np.sqrt(((foggy - ours)[used] ** 2).mean() / max((foggy[used] ** 2).mean(), 1e-30)))
    stated = read_json(view.input("gains"))
    settings = settings_of(found, lights, stated)
    line = None
    if found.determined["visibility"]:
        phase_json = {"type": "henyey_greenstein", "asymmetry": 0.0} if asked.fit_asymmetry else phase.model_dump(mode="json")
        what = f"of {reference}" + (f" in {view.scene}" if view.scene != scene.scene else "")
        remark = "; ".join([what, visibility_in_words(found), *([f"the reference besides: {' '.join(settings)}"] if settings else [])])
        line = write_fog(scene.scene_file, name, fog_of(found, phase_json), remark)
    write_json(scene.match / "match.json", {
        "reference": reference, "reference_scene": view.scene, "scene": scene.scene, "fog": name if line else None,
        **numbers(found, lights, unexplained), "size_pixel": list(size), "share_left_out": float(1 - used.mean()),
        "trial_visibilities_m": [visibility_of_level(level) for level in levels]})
    exposure = display_exposure(foggy) if read_json(view.photograph_facts)["suffix"] in FLOAT_KINDS else 1.0
    told = words(found, lights, unexplained)
    clear = response.clear.reshape(*shape, 3)
    residual, together = pictures(clear, foggy, ours, used, exposure, told[:1])
    write_png(scene.match / "residual.png", residual)
    write_png(scene.match / "comparison.png", together)
    print("\n".join(told))
    if line is None:
        print("note: no fog was written, for its visibility is not determined", file=sys.stderr)
    else:
        print(f"done: {scene.scene_file}:{line}, {scene.match / 'comparison.png'}")
        besides = settings if view.scene == scene.scene else []
        print(f"now: {' '.join(['make', f'scene={scene.scene}', f'fog={name}', *besides])}")


def _asked(fit: str) -> set[str]:
    names = [one.strip() for one in fit.split(",") if one.strip()]
    for one in names:
        if one not in FIT:
            raise InputError(f"fit={fit}: nothing is called '{one}'", place="command line",
                             remedy=f"name some of {', '.join(FIT)}, with commas between" + nearest(one, list(FIT)))
    return set(names)


def _reference(view: Build, name: str) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """The foggy photograph at the size (w, h) of comparison, linear (h, w, 3), and which of its pixels say nothing (h, w)."""
    if not name:
        raise InputError("no photograph in fog is named", place="command line",
                         remedy=f"put it into {view.source} and say: make match scene={view.scene} reference=FILE")
    path = inside(view, name, "command line")
    settings = read_json(view.input("photograph"))
    foggy = photographs.read(path, "auto", int(settings["max_megapixels"] * 1e6))
    width, height = image_size(replace(view, reduced=False))
    ratio = foggy.width / foggy.height * height / width
    if abs(ratio - 1) > SAME_SHAPE:
        raise InputError(f"{foggy.width} x {foggy.height} pixels, of another shape than the photograph's {width} x {height}",
                         place=str(path), remedy="crop it to what the clear photograph shows")
    longest = min(SIZE, max(image_size(view)), max(foggy.width, foggy.height))
    scale = longest / max(width, height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    unusable = foggy.clipped | (False if foggy.alpha is None else foggy.alpha < 1)
    return averaged(foggy.radiance, size).astype(float), averaged(unusable.astype(np.float32), size) > 0, size
