"""Large maps as OpenEXR files, written and read some rows at a time.

Compression is zip at its fastest, lossless: of a photograph's noise a higher level saves 1 % and takes up to twice the
time. Half floats, a quarter of the time and size, hold 11 bits: half a step of them is 0.02 % of a value.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing, write_error
from pipeline.imaging.maps import Metadata, opened, set_attribute
from pipeline.imaging.oiio_error import oiio_error

#: Pixels of a strip.
STRIP = 700_000
#: Magnitudes between which half floats have all their digits.
HALF_RANGE = 1e-4, 3e4


def strips(width: int, height: int) -> Iterator[tuple[int, int]]:
    """First row and the row after the last of each strip of an image."""
    # whole blocks of the 16 rows that are compressed together
    rows = max(16, STRIP // max(width, 1) // 16 * 16)
    for top in range(0, height, rows):
        yield top, min(top + rows, height)


class MapWriter:
    """An EXR that is being written from top to bottom, in a thread of its own; see `writing`."""

    def __init__(self, output: oiio.ImageOutput, path: Path, channels: int, thread: ThreadPoolExecutor):
        self.output, self.path, self.channels, self.row = output, path, channels, 0
        self.thread, self.writing = thread, None

    def add(self, values: np.ndarray) -> None:
        """The next rows, (n, W) or (n, W, channels), which may not change any more. Raises what the rows before met."""
        self.finish()
        self.writing = self.thread.submit(self._write, values)

    def finish(self) -> None:
        """Waits for the rows that were given. Raises InputError where they cannot be written."""
        if self.writing is not None:
            self.writing.result()

    def _write(self, values: np.ndarray) -> None:
        values = np.ascontiguousarray(values, np.float32).reshape(len(values), -1, self.channels)
        if not self.output.write_scanlines(self.row, self.row + len(values), 0, values):
            raise write_error(self.path, values.nbytes, self.output.geterror())
        self.row += len(values)


@contextmanager
def writing(path: str | os.PathLike, width: int, height: int, channels: int, metadata: Metadata = {}, *,
            half: bool = False, is_depth: bool = False, patchy: bool = False) -> Iterator[MapWriter]:
    """Writes a map as `maps.write_map` does, but by its rows. Nothing is left behind of what does not become whole.

    patchy: of large parts that are one value, which run lengths hold as well as zip does, in 2/3 of the time.
    """
    spec = oiio.ImageSpec(width, height, channels, "half" if half else "float")
    spec.channelnames = ("R", "G", "B") if channels == 3 else ("Z",) if is_depth else ("Y",)
    spec.attribute("compression", "rle" if patchy else "zip:1")
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    for name, value in metadata.items():
        set_attribute(spec, name, value)
    with replacing(Path(path)) as partial:
        output = oiio.ImageOutput.create("openexr")
        if not output.open(str(partial), spec):
            raise write_error(partial, 0, output.geterror())
        closed = False
        try:
            with ThreadPoolExecutor(1) as thread:
                writer = MapWriter(output, partial, channels, thread)
                yield writer
                writer.finish()
            closed = True
        finally:
            closed = output.close() and closed
        size = width * height * channels * (2 if half else 4)
        written = oiio.ImageInput.open(str(partial)) if closed else None
        # the last block tells whether the end fitted on the disk
        if written is None or written.read_scanlines(height - 1, height, 0, 0, channels, "float") is None:
            raise write_error(partial, size, output.geterror() or "the EXR writer failed")


class MapReader:
    """A map whose rows are read as they are asked for. Raises InputError where it is of another size (H, W)."""

    def __init__(self, path: str | os.PathLike, size: tuple[int, int]):
        self.path = Path(path)
        self.source = opened(self.path)
        spec = self.source.spec()
        self.channels = spec.nchannels
        if (spec.height, spec.width) != tuple(size) or self.channels not in (1, 3):
            raise InputError(f"a map of {spec.width}x{spec.height} pixels and {self.channels} channels, not of"
                             f" {size[1]}x{size[0]} and 1 or 3", remedy="delete it and run the pipeline again",
                             place=str(path))

    def rows(self, top: int, bottom: int) -> np.ndarray:
        """(n, W, 3) float32, or (n, W) of a map of one channel."""
        values = self.source.read_scanlines(top, bottom, 0, 0, self.channels, "float")
        if values is None:
            raise InputError(f"truncated or damaged map ({oiio_error(self.source)})",
                             remedy="delete it and run the pipeline again", place=str(self.path))
        values = values.reshape(bottom - top, -1, self.channels)
        return values if self.channels == 3 else values[..., 0]


def write_large(path: str | os.PathLike, array: np.ndarray, metadata: Metadata = {}, *, half: bool = False) -> None:
    """A whole map (H, W) or (H, W, 3), a strip at a time."""
    height, width = array.shape[:2]
    with writing(path, width, height, 1 if array.ndim == 2 else 3, metadata, half=half) as writer:
        for top, bottom in strips(width, height):
            writer.add(array[top:bottom])


def fits_half(greatest: float) -> bool:
    """Whether half floats hold a map whose greatest value is this, to 0.02 % of what matters of it."""
    return HALF_RANGE[0] < greatest < HALF_RANGE[1]
