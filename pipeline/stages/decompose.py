"""Renders and light strengths -> transmittance.exr, in_scattering_LIGHT.exr, in_scattering.exr.

Of a large photograph these have the working size, and are of what is in front where a pixel shows two things;
behind_*.exr are of what is behind. The composite stage enlarges them.
"""

from __future__ import annotations

import numpy as np

from pipeline.imaging.maps import write_map
from pipeline.paths import Build
from pipeline.rendering.enlarged import write_layers
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, write_json


def run(build: Build) -> None:
    lights = read_json(build.plan)["lights"]
    metadata = fog_metadata(build, read_fog(build))
    build.fog_images.mkdir(parents=True, exist_ok=True)
    written, total, scattered = [], 0.0, Scattered(build, mixed=not build.reduced)
    for light in lights:
        one = scattered.by(light)
        total = total + one
        written.append(build.in_scattering(light))
        write_map(written[-1], one.astype(np.float32),
                  {**metadata, "fog:content": f"in-scattering V of {light}"})
    total = np.broadcast_to(total, (*scattered.depth.shape, 3))
    transmittance = scattered.transmittance(lights)
    write_map(build.transmittance, transmittance.astype(np.float32),
              {**metadata, "fog:content": "transmittance map T"})
    write_map(build.in_scattering(), total.astype(np.float32),
              {**metadata, "fog:content": "in-scattering map V"})
    if build.reduced:
        write_layers(build, scattered, lights, transmittance)
    for old in build.fog_images.glob("in_scattering_*.exr"):
        if old not in written:
            old.unlink()
    write_json(build.maps, {
        "transmittance_median": float(np.median(transmittance)),
        "in_scattering_median": float(np.median(total)),
        "lights": lights})
