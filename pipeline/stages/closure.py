"""Checks photograph * T + V against fog and surfaces in one render -> closure.json, closure.exr.

The estimated scene (geometry, mean albedo of each face, light strengths; direct light, hence no ambient)
is rendered twice: clear, which takes the photograph's place, and with surfaces, lights and fog all at
once. Lamps and sun are rendered apart, as only the sun comes from outside the fog, and added: light adds
up.
"""

from __future__ import annotations

import sys

import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.physics.composition import composite
from pipeline.plugins.lights.sun import Sun
from pipeline.rendering import povray
from pipeline.rendering.scattered import Scattered
from pipeline.rendering.emit import Run, Templates, emit, write_side_files
from pipeline.rendering.runs import MOST_INTERVALS, glow_size
from pipeline.scene.artefacts import read_fog, read_json, read_placed, read_strengths, write_json

#: Longer side [pixel] of the renders, and the points along their rays at least: what costs most, the glow of area lights,
#: is rendered once more with the surfaces in it.
SIZE, SAMPLES = 256, 24


def run(build: Build) -> None:
    scene, medium, templates = read_placed(build), read_fog(build), Templates(build.source)
    plan, illumination = read_json(build.plan), read_json(build.illumination)
    settings = read_json(build.input("render"))
    if plan["fog_is_clear"]:
        raise InputError("the fog is clear: nothing to check", place=str(build.scene_file),
                         remedy="pick a denser fog")
    strengths = {name: strength.tolist() for name, strength in read_strengths(build).items()}
    albedos = [illumination["face_albedo"].get(face, [0.5] * 3) for face, _ in scene.faces()]
    suns = [name for name in plan["lights"] if isinstance(scene.lights[name], Sun)]
    lamps = [name for name in plan["lights"] if name not in suns and scene.rendered(name)]
    if not lamps + suns:
        raise InputError("no light of it can be rendered with surfaces and fog at once: nothing to check",
                         place=str(build.scene_file), remedy="try a scene with lamps, or sun through windows")
    scattered = Scattered(build)
    depth, transmittance = scattered.depth, scattered.transmittance(lamps + suns)
    in_scattering = sum(scattered.by(light) for light in lamps + suns)
    width, height = glow_size(depth.shape[1], depth.shape[0], SIZE)
    glows = [r for r in plan["runs"] if r["kind"] == "in_scattering" and r["lights"][0] not in suns]
    nearest = np.ix_(((np.arange(height) + 0.5) * depth.shape[0] / height).astype(int),
                     ((np.arange(width) + 0.5) * depth.shape[1] / width).astype(int))
    transmittance, in_scattering = transmittance[nearest], in_scattering[nearest]
    emitter = read_map(build.surfaces)[..., 1][nearest]
    count = max(SAMPLES, *(r["samples"] for r in glows), 0)
    # in one render its edges are those of samples, not of a shaft
    sun_count = 3 * count if medium.render_step() == np.inf else min(3 * count, MOST_INTERVALS)
    photograph, foggy = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    folder = build.out / "closure"
    folder.mkdir(parents=True, exist_ok=True)
    write_side_files(folder, medium)
    for group, container in ((lamps, None), (suns, _room(scene))):
        if not group:
            continue
        level = float(np.percentile(in_scattering.max(-1), 95)) or 1.0
        exposure = float(2.0 ** np.round(np.log2(4 / level)))
        for clear in (True, False):
            name = f"{'sun' if container else 'lamps'}_{'clear' if clear else 'foggy'}"
            one = Run(name, "closure", group, width, height, exposure, sun_count if container else count,
                      {"without_fog": clear, "container": container})
            pov = folder / f"{name}.pov"
            with replacing(pov) as partial:
                partial.write_text(emit(one, scene, templates, medium=medium, albedos=albedos,
                                        strengths=strengths))
            seconds = povray.render(pov, folder / f"{name}.exr", width, height, threads=settings["threads"],
                                    timeout=settings["timeout"])
            print(f"  {name}: {seconds:.1f} s", file=sys.stderr, flush=True)
            image = read_map(folder / f"{name}.exr").astype(float) / exposure
            if clear:
                photograph += image
            else:
                foggy += image
    result = composite(photograph, transmittance, in_scattering)
    lit = (emitter < 0) & (foggy.max(-1) > 0)
    error = np.abs(result - foggy)[lit] / foggy[lit].max(-1, keepdims=True)
    facts = {"median_relative_difference": float(np.median(error)), "p90": float(np.percentile(error, 90)),
             "p99": float(np.percentile(error, 99)), "pixels": int(lit.sum())}
    write_map(build.out / "closure.exr", (result - foggy).astype(np.float32),
              {"fog:content": "photograph * T + V minus fog and surfaces in one render"})
    write_json(build.out / "closure.json", facts)
    print(f"closure: median {facts['median_relative_difference']:.2%}, 90 % within {facts['p90']:.2%}, "
          f"99 % within {facts['p99']:.2%}")


def _room(scene):
    """Lower and upper corner [m] of all shapes: the container of the fog that the sun comes into."""
    points = np.concatenate([corners for _, corners in scene.faces()])
    return [points.min(0).tolist(), points.max(0).tolist()]
