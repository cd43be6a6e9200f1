"""Renders and light strengths -> transmittance.exr, in_scattering_LIGHT.exr, in_scattering.exr.

Of a large photograph these have the working size, and are of what is in front where a pixel shows two things;
behind_*.exr are of what is behind. The composite stage enlarges them.
"""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.planning.accuracy import error_estimate
from pipeline.rendering import converged
from pipeline.rendering.enlarged import write_layers
from pipeline.rendering.runs import from_json
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, write_json


@dataclass(frozen=True)
class Begun:
    """What needs no render: of the maps, and of the pixels that are made as finely as it takes, None where none are."""

    scattered: Scattered
    check: converged.Converged | None


def beforehand(build: Build) -> Begun:
    """`run` takes what this works out while POV-Ray renders."""
    begun, lights = _begun(build), read_json(build.plan)["lights"]
    with ThreadPoolExecutor(1) as beside:
        checked = beside.submit(begun.check.beforehand, lights) if begun.check else None
        begun.scattered.beforehand(lights)
        if checked:
            checked.result()
    return begun


def _begun(build: Build) -> Begun:
    scattered, check = Scattered(build, mixed=not build.reduced), read_json(build.plan)["check"]
    if not check:
        return Begun(scattered, None)
    pixels = converged.Pixels(*np.asarray(check["pixels"], int).reshape(-1, 2).T, np.asarray(check["weights"], float))
    return Begun(scattered, converged.Converged(scattered, pixels, [from_json(data) for data in check["runs"]]))


def run(build: Build, begun: Begun | None = None) -> None:
    begun = begun or _begun(build)
    lights, scattered = read_json(build.plan)["lights"], begun.scattered
    metadata = fog_metadata(build, read_fog(build))
    build.fog_images.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(read_json(build.input("render"))["threads"] or os.cpu_count()) as pool:
        writing: dict[Path, Future] = {}

        def write(path: Path, values: np.ndarray, content: str) -> None:
            writing[path] = pool.submit(write_map, path, values.astype(np.float32), {**metadata, "fog:content": content})

        surviving, total = pool.submit(scattered.transmittance, lights), 0.0
        for light, one in zip(lights, pool.map(scattered.by, lights)):
            total = total + one
            write(build.in_scattering(light), one, f"in-scattering V of {light}")
        transmittance = surviving.result()
        write(build.transmittance, transmittance, "transmittance map T")
        total = np.broadcast_to(total, (*scattered.depth.shape, 3))
        write(build.in_scattering(), total, "in-scattering map V")
        if build.reduced:
            # these read what was written
            for each in writing.values():
                each.result()
            write_layers(build, scattered, lights, transmittance)
        error = checked(build, begun.check, lights, transmittance, total) if begun.check else None
        for each in writing.values():
            each.result()
    for old in build.fog_images.glob("in_scattering_*.exr"):
        if old not in writing:
            old.unlink()
    write_json(build.maps, {
        "transmittance_median": float(np.median(transmittance)), "in_scattering_median": float(np.median(total)),
        "lights": lights, "estimated_error": error})


def checked(build: Build, check: converged.Converged, lights: list[str], transmittance: np.ndarray, total: np.ndarray
            ) -> dict[str, float]:
    """How far the maps are off at the pixels that were made as finely as it takes."""
    pixels, true = check.pixels, check.maps(lights)
    found = transmittance[pixels.where].astype(float), total[pixels.where].astype(float)
    radiance = np.maximum(read_map(build.photograph)[pixels.where].astype(float), 0)
    # light of all orders in a room is the same for both
    shared = read_json(build.plan)["expected"]["relative_error_by"]["room_directions"]
    return error_estimate(radiance, found, true, pixels.weights, shared)
