"""Photograph, T and V -> foggy.exr, the photograph's own kind of file, and foggy.png.

The PNG comes last: Make looks at it. Where the photograph is an EXR, foggy.exr is of its kind.
"""

from __future__ import annotations

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.physics.composition import composite, with_restored_lamps
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, read_photograph, read_strengths


def run(build: Build) -> None:
    photograph, medium = read_photograph(build), read_fog(build)
    metadata = {**fog_metadata(build, medium),
                "fog:content": "foggy photograph, linear scene-referred Rec.709"}
    if read_json(build.plan)["fog_is_clear"]:
        if photograph.suffix != ".exr":
            write_map(build.foggy(".exr"), read_map(build.photograph), metadata)
        for suffix in dict.fromkeys((photograph.suffix, ".png")):
            photographs.write_unchanged(build.foggy(suffix), photograph)
        return
    radiance = photograph.radiance
    if read_json(build.input("render"))["restore_clipped_lamps"]:
        lights, strengths = read_json(build.illumination)["lights"], read_strengths(build)
        shown = {index: strengths[name] for index, (name, light) in enumerate(lights.items())
                 if light["quantity"] == "radiance"}
        emitter = read_map(build.surfaces, radiance.shape[:2])[..., 1]
        radiance = with_restored_lamps(radiance, photograph.clipped, emitter, shown)
    # of another size they would be stretched in silence where they have one row, column or pixel
    foggy = composite(radiance, *(read_map(path, radiance.shape[:2])
                                  for path in (build.transmittance, build.in_scattering())))
    foggy = foggy.astype(np.float32)
    if photograph.suffix != ".exr":
        write_map(build.foggy(".exr"), foggy, metadata)
    if photograph.suffix != ".png":
        photographs.write(build.foggy(photograph.suffix), foggy, photograph, metadata)
    photographs.write_png(build.foggy(".png"), foggy, photograph)
