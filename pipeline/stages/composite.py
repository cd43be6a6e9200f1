"""Photograph, T and V -> foggy.png, foggy.exr and the photograph's own kind of file."""

from __future__ import annotations

import shutil

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.atomic import replacing
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.physics.composition import composite, with_restored_lamps
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, read_photograph, read_strengths


def run(build: Build) -> None:
    photograph, medium = read_photograph(build), read_fog(build)
    metadata = {**fog_metadata(build, medium), "fog:content": "foggy photograph, linear scene-referred Rec.709"}
    if read_json(build.plan)["fog_is_clear"]:
        with replacing(build.foggy(".exr")) as name:
            shutil.copyfile(build.photograph, name)
        photographs.write_unchanged(build.foggy(".png"), photograph)
        if photograph.suffix not in (".png", ".exr"):
            photographs.write_unchanged(build.foggy(photograph.suffix), photograph)
        return
    radiance = photograph.radiance
    if read_json(build.input("render"))["restore_clipped_lamps"]:
        lights, strengths = read_json(build.illumination)["lights"], read_strengths(build)
        shown = {index: strengths[name] for index, (name, light) in enumerate(lights.items())
                 if light["quantity"] == "radiance"}
        radiance = with_restored_lamps(radiance, photograph.clipped, read_map(build.surfaces)[..., 1], shown)
    foggy = composite(radiance, read_map(build.transmittance), read_map(build.in_scattering()))
    foggy = foggy.astype(np.float32)
    write_map(build.foggy(".exr"), foggy, metadata)
    photographs.write_png(build.foggy(".png"), foggy, photograph)
    if photograph.suffix not in (".png", ".exr"):
        photographs.write(build.foggy(photograph.suffix), foggy, photograph)
