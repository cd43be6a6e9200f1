"""Renders and light strengths -> transmittance.exr, in_scattering_LIGHT.exr, in_scattering.exr.

Of a large photograph these have the working size, and are of what is in front where a pixel shows two things;
behind_*.exr are of what is behind. The composite stage enlarges them.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.planning.accuracy import error_estimate
from pipeline.rendering import converged
from pipeline.rendering.enlarged import write_layers
from pipeline.rendering.runs import from_json
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, write_json


def run(build: Build) -> None:
    plan = read_json(build.plan)
    lights = plan["lights"]
    metadata = fog_metadata(build, read_fog(build))
    build.fog_images.mkdir(parents=True, exist_ok=True)
    written, total, scattered = [], 0.0, Scattered(build, mixed=not build.reduced)
    with ThreadPoolExecutor(read_json(build.input("render"))["threads"] or os.cpu_count()) as pool:
        surviving = pool.submit(scattered.transmittance, lights)
        for light, one in zip(lights, pool.map(scattered.by, lights)):
            total = total + one
            written.append(build.in_scattering(light))
            write_map(written[-1], one.astype(np.float32),
                      {**metadata, "fog:content": f"in-scattering V of {light}"})
        transmittance = surviving.result()
    total = np.broadcast_to(total, (*scattered.depth.shape, 3))
    write_map(build.transmittance, transmittance.astype(np.float32),
              {**metadata, "fog:content": "transmittance map T"})
    write_map(build.in_scattering(), total.astype(np.float32),
              {**metadata, "fog:content": "in-scattering map V"})
    if build.reduced:
        write_layers(build, scattered, lights, transmittance)
    for old in build.fog_images.glob("in_scattering_*.exr"):
        if old not in written:
            old.unlink()
    check = plan["check"]
    write_json(build.maps, {
        "transmittance_median": float(np.median(transmittance)),
        "in_scattering_median": float(np.median(total)),
        "lights": lights,
        "estimated_error": checked(build, scattered, lights, check, transmittance, total) if check else None})


def checked(build: Build, whole: Scattered, lights: list[str], check: dict, transmittance: np.ndarray, total: np.ndarray
            ) -> dict[str, float]:
    """How far the maps are off at the pixels that were made as finely as it takes."""
    pixels = converged.Pixels(*np.asarray(check["pixels"], int).reshape(-1, 2).T, np.asarray(check["weights"], float))
    runs = [from_json(data) for data in check["runs"]]
    true = converged.Converged(whole, pixels, runs).maps(lights)
    found = transmittance[pixels.where].astype(float), total[pixels.where].astype(float)
    radiance = np.maximum(read_map(build.photograph)[pixels.where].astype(float), 0)
    return error_estimate(radiance, found, true, pixels.weights)
