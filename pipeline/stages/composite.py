"""Photograph, T and V -> foggy.exr, the photograph's own kind of file, and foggy.png.

The PNG comes last: Make looks at it. Where the photograph is an EXR, foggy.exr is of its kind.
T and V of a photograph larger than its working size are enlarged here, strip by strip, and written beside.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.map_strips import fits_half, write_large
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.physics.composition import burnt_out, composite, restored, with_restored_lamps
from pipeline.rendering.enlarged import enlarged
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, read_photograph, read_strengths, working


def beforehand(build: Build) -> photographs.Photograph:
    """`run` takes what this reads while POV-Ray renders."""
    return read_photograph(build)


def run(build: Build, photograph: photographs.Photograph | None = None) -> None:
    photograph, medium = photograph or read_photograph(build), read_fog(build)
    metadata = fog_metadata(build, medium)
    reduced = working(build).reduced
    strips = enlarged(build, read_json(build.plan)["lights"], metadata) if reduced else None
    metadata = {**metadata, "fog:content": "foggy photograph, linear scene-referred Rec.709"}
    settings, clear = read_json(build.input("composite")), read_json(build.plan)["fog_is_clear"]
    if settings["exposure"]:
        metadata["fog:exposure_ev"] = settings["exposure"]
    elif clear:
        for _ in strips or ():
            pass
        if photograph.suffix != ".exr":
            _write_linear(build, photograph.radiance, photograph, metadata, reduced)
        for suffix in dict.fromkeys((photograph.suffix, ".png")):
            photographs.write_unchanged(build.foggy(suffix), photograph)
        return
    restore = settings["restore_clipped_lamps"] and not clear
    shown = _lamps(build) if restore else {}
    if reduced:
        foggy = _by_strips(build, photograph, strips, shown)
    else:
        radiance = photograph.radiance
        if restore:
            emitter = read_map(build.surfaces, radiance.shape[:2])[..., 1]
            radiance = with_restored_lamps(radiance, photograph.clipped, emitter, shown)
        # of another size they would be stretched in silence where they have one row, column or pixel
        foggy = composite(radiance, *(read_map(path, radiance.shape[:2])
                                      for path in (build.transmittance, build.in_scattering())))
        foggy = foggy.astype(np.float32)
    if settings["exposure"]:
        foggy *= np.float32(2.0 ** settings["exposure"])
    with ThreadPoolExecutor(1) as beside:
        linear = beside.submit(_write_linear, build, foggy, photograph, metadata, reduced) if photograph.suffix != ".exr" else None
        finished = linear.result if linear else None
        if photograph.suffix == ".png":
            finished()
            photographs.write_png(build.foggy(".png"), foggy, photograph)
        else:
            photographs.write_with_png(build.foggy(photograph.suffix), build.foggy(".png"), foggy, photograph, metadata, finished)


def _lamps(build: Build) -> dict[int, np.ndarray]:
    """Radiance (3,) of the lights that are seen as that, by their index."""
    lights, strengths = read_json(build.illumination)["lights"], read_strengths(build)
    return {index: strengths[name] for index, (name, light) in enumerate(lights.items())
            if light["quantity"] == "radiance"}


def _by_strips(build: Build, photograph: photographs.Photograph, strips: Iterator[tuple], shown: dict[int, np.ndarray]
               ) -> np.ndarray:
    """The foggy photograph (H, W, 3) float32 from strips of T and V."""
    if shown:
        emitter = read_map(working(build).surfaces)[..., 1]
        # one pixel of the photograph for each of the working size
        some = np.ix_(*(((np.arange(few) + 0.5) * many / few).astype(int)
                        for few, many in zip(emitter.shape, photograph.clipped.shape)))
        shown = burnt_out(photograph.clipped[some], emitter, shown)
    foggy = np.empty(photograph.radiance.shape, np.float32)
    for top, bottom, transmittance, in_scattering, emitter in strips:
        part = np.s_[top:bottom]
        radiance = photograph.radiance[part]
        if shown:
            radiance = restored(radiance.copy(), photograph.clipped[part], emitter, shown)
        foggy[part] = composite(radiance, transmittance, in_scattering)
    return foggy


def _write_linear(build: Build, foggy: np.ndarray, photograph: photographs.Photograph, metadata: dict, large: bool
                  ) -> None:
    if large:
        half = photograph.sample_type == "uint8" and fits_half(float(foggy.max()))
        write_large(build.foggy(".exr"), foggy, metadata, half=half)
    else:
        write_map(build.foggy(".exr"), foggy, metadata)
