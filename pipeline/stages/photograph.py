"""Photograph -> photograph.exr (linear, scene-referred) and photograph.json (size, clipped pixels' share).

A photograph larger than its working size is written at that size, too, into working/.
"""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.map_strips import write_large
from pipeline.imaging.maps import write_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json, read_photograph, write_json

PHOTOGRAPH, CLIPPED = {"fog:content": "photograph, linear scene-referred Rec.709"}, {"fog:content": "1 where clipped"}


def run(build: Build) -> None:
    photograph = read_photograph(build)
    settings = read_json(build.input("photograph"))
    size = photographs.working_size(photograph.width, photograph.height, settings["working_size"])
    reduced = size != (photograph.width, photograph.height)
    if reduced:
        working = replace(build, reduced=True)
        working.images.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor(1) as beside:
            written = beside.submit(write_large, build.photograph, photograph.radiance, PHOTOGRAPH,
                                    half=photograph.sample_type == "uint8")
            write_map(working.photograph, photographs.averaged(photograph.radiance, size), PHOTOGRAPH)
            write_map(working.clipped, (photographs.averaged(photograph.clipped, size) > 0).astype(np.float32), CLIPPED)
            write_large(build.clipped, photograph.clipped, CLIPPED, half=True)
            written.result()
    else:
        shutil.rmtree(replace(build, reduced=True).images, ignore_errors=True)
        write_map(build.photograph, photograph.radiance, PHOTOGRAPH)
        write_map(build.clipped, photograph.clipped.astype(np.float32), CLIPPED)
    focal = photographs.read_exif_focal_length(build.source / settings["file"])
    write_json(build.photograph_facts, {
        "width_pixel": photograph.width, "height_pixel": photograph.height, "suffix": photograph.suffix,
        "clipped_share": float(photograph.clipped.mean()), "focal_length_35mm_mm": focal,
        **({"working_width_pixel": size[0], "working_height_pixel": size[1]} if reduced else {})})
