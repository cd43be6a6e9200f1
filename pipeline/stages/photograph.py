"""Photograph -> photograph.exr (linear, scene-referred) and photograph.json (size, clipped pixels' share)."""

from __future__ import annotations

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.maps import write_map
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json, read_photograph, write_json


def run(build: Build) -> None:
    photograph = read_photograph(build)
    write_map(build.photograph, photograph.radiance,
              {"fog:content": "photograph, linear scene-referred Rec.709"})
    write_map(build.shared / "clipped.exr", photograph.clipped.astype(np.float32),
              {"fog:content": "1 where clipped"})
    focal = photographs.read_exif_focal_length(build.source / read_json(build.input("photograph"))["file"])
    write_json(build.photograph_facts, {
        "width_pixel": photograph.width, "height_pixel": photograph.height, "suffix": photograph.suffix,
        "clipped_share": float(photograph.clipped.mean()), "focal_length_35mm_mm": focal})
