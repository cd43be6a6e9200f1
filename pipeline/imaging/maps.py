"""Maps of transmittance, in-scattering and depth as linear float32 OpenEXR files.

Three-channel maps have the channels R, G, B; one-channel maps have Y, or Z for a depth (the names
by which compositors know them). Compression is zip, lossless. Parameters go along as EXR
attributes with names such as "fog:visibility_m".
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Mapping

import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing, write_error
from pipeline.imaging.oiio_error import oiio_error

Metadata = Mapping[str, "str | int | float | tuple[float, ...]"]


def write_map(path: str | os.PathLike, array: np.ndarray, metadata: Metadata = {}, *,
              is_depth: bool = False) -> None:
    """Writes `array`, (H, W), (H, W, 1) or (H, W, 3), as a float32 EXR with `metadata`.

    Metadata values are text, numbers or sequences of numbers; None and other types raise `TypeError`.
    Raises `InputError` if the file cannot be written; then nothing is left behind.
    """
    values = np.asarray(array, np.float32)
    values = values[..., None] if values.ndim == 2 else values
    if values.ndim != 3 or values.shape[2] not in (1, 3) or values.size == 0:
        raise ValueError(f"a map of shape {np.shape(array)}: want (H, W), (H, W, 1) or (H, W, 3)")
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, "float")
    spec.channelnames = ("R", "G", "B") if channels == 3 else ("Z",) if is_depth else ("Y",)
    spec.attribute("compression", "zip")
    # OpenImageIO would write the time of day, and no two builds would have the same bytes
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    for name, value in metadata.items():
        set_attribute(spec, name, value)
    with replacing(Path(path)) as partial:
        output = oiio.ImageOutput.create("openexr")
        succeeded = output.open(str(partial), spec) and output.write_image(np.ascontiguousarray(values))
        succeeded = output.close() and succeeded
        if not succeeded:
            raise write_error(partial, values.nbytes, output.geterror())
        # the writer says nothing of what its last buffer could not hold (measured with OpenEXR by OIIO 3.2)
        written = oiio.ImageInput.open(str(partial))
        if written is None or written.read_scanlines(height - 1, height, 0, 0, channels) is None:
            oiio.geterror()
            raise write_error(partial, values.nbytes, "it ends early, as on a full disk")


def read_map(path: str | os.PathLike, size: tuple[int, int] | None = None) -> np.ndarray:
    """The map at `path`: (H, W, 3) float32 of the channels R, G, B, or (H, W) of a single Y, Z or other.

    Half floats, as POV-Ray writes them, are widened; an alpha beside R, G, B is left out. Raises
    `InputError` for a missing, damaged or otherwise organised file, and for one of another `size` (H, W).
    """
    source = opened(Path(path))
    spec = source.spec()
    names = list(spec.channelnames)
    if {"R", "G", "B"} <= set(names):
        chosen = [names.index(name) for name in "RGB"]
    elif spec.nchannels == 1:
        chosen = [0]
    else:
        raise InputError(f"a map with the channels {', '.join(names)}",
                         remedy="a map has R, G, B or a single channel", place=str(path))
    if size is not None and (spec.height, spec.width) != tuple(size):
        raise InputError(f"a map of {spec.width}x{spec.height} pixels, not {size[1]}x{size[0]}",
                         remedy="delete it and run the pipeline again", place=str(path))
    values = source.read_image(0, 0, 0, spec.nchannels, "float")
    if values is None or source.has_error:
        raise InputError(f"truncated or damaged map ({oiio_error(source)})",
                         remedy="delete it and run the pipeline again", place=str(path))
    values = values.reshape(spec.height, spec.width, spec.nchannels)
    return np.ascontiguousarray(values[..., chosen]) if len(chosen) == 3 else values[..., 0]


def read_metadata(path: str | os.PathLike) -> dict[str, str | int | float | tuple]:
    """All attributes in the header of the EXR at `path`, by name."""
    return {item.name: tuple(item.value.tolist()) if isinstance(item.value, np.ndarray) else item.value
            for item in opened(Path(path)).spec().extra_attribs}


def opened(path: Path) -> oiio.ImageInput:
    """The EXR at `path`, its header read."""
    if not path.is_file():
        raise InputError("no such map", remedy="run the stage that writes it", place=str(path))
    source = oiio.ImageInput.open(str(path))
    if source is None or source.format_name() != "openexr":
        reason = oiio_error(oiio) or f"it is {source.format_name()}"
        raise InputError(f"not a readable OpenEXR file ({reason})",
                         remedy="delete it and run the pipeline again", place=str(path))
    return source


def set_attribute(spec: oiio.ImageSpec, name: str, value) -> None:
    if isinstance(value, str):
        spec.attribute(name, value)
    elif isinstance(value, (bool, int, np.integer)):
        spec.attribute(name, int(value))
    elif isinstance(value, (float, np.floating)):
        spec.attribute(name, float(value))
    elif isinstance(value, (list, tuple, np.ndarray)):
        numbers = np.asarray(value, np.float32).ravel()
        spec.attribute(name, oiio.TypeDesc(f"float[{numbers.size}]"), numbers)
    else:
        raise TypeError(f"metadata {name}: {value!r} is neither text nor numbers")
