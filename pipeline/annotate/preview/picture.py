"""The photograph as the preview works on it: read once, and made small."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.imaging import photograph as photographs
from pipeline.imaging.display import FLOAT_KINDS, display_exposure
from pipeline.paths import Build, inside
from pipeline.plugins.base import Model


@dataclass(frozen=True, eq=False)
class Picture:
    """A photograph at the size at which it is shown.

    width, height [pixel] and focal_length_35mm [mm] (EXIF's, or None) are the photograph's own. radiance (h, w, 3) float32,
    linear; clipped (h, w) bool; exposure: factor by which a screen shows it.
    """

    width: int
    height: int
    focal_length_35mm: float | None
    radiance: np.ndarray
    clipped: np.ndarray
    exposure: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixel] as shown."""
        return self.radiance.shape[1], self.radiance.shape[0]

    def reduced(self, longer_side: int) -> tuple[np.ndarray, np.ndarray]:
        """Radiance (h, w, 3) float32 and clipped (h, w) bool at a smaller size; as shown where that is no larger."""
        size = photographs.working_size(*self.size, longer_side)
        if size == self.size:
            return self.radiance, self.clipped
        return photographs.averaged(self.radiance, size), photographs.averaged(self.clipped, size) > 0

    def smaller(self, share: float) -> Picture:
        """The same, shown with this share of its pixels."""
        radiance, clipped = self.reduced(max(1, round(max(self.size) * share**0.5)))
        return replace(self, radiance=np.ascontiguousarray(radiance, np.float32), clipped=clipped)


class Pictures:
    """Reads the scene's photograph, once as long as neither the file nor what is said of it changes."""

    def __init__(self, build: Build, megapixels: float):
        self.build, self.most_pixels = build, megapixels * 1e6
        self._key: tuple | None = None
        self._picture: Picture | None = None

    def of(self, described: Model) -> Picture:
        """Raises InputError as the photograph stage does."""
        path = inside(self.build, described.file)
        key = described.model_dump_json(), str(path), stamp(path)
        if key != self._key or self._picture is None:
            self._picture, self._key = self._read(path, described), key
        return self._picture

    def _read(self, path: Path, described: Model) -> Picture:
        photograph = photographs.read(path, described.colour_space, int(described.max_megapixels * 1e6))
        if described.size is not None:
            photograph = photographs.resampled(photograph, described.size)
        width, height = photograph.width, photograph.height
        scale = min(1.0, (self.most_pixels / (width * height)) ** 0.5)
        radiance, clipped = photograph.radiance, photograph.clipped
        size = photographs.working_size(width, height, int(scale * max(width, height)))
        if size != (width, height):
            radiance, clipped = photographs.averaged(radiance, size), photographs.averaged(clipped, size) > 0
        exposure = display_exposure(radiance) if photograph.suffix in FLOAT_KINDS else 1.0
        return Picture(width, height, photographs.read_exif_focal_length(path), np.ascontiguousarray(radiance, np.float32),
                       clipped, exposure)


def stamp(path: Path) -> tuple[int, int] | None:
    """By which a file that was written anew is told; None of one that is not there."""
    try:
        facts = path.stat()
    except OSError:
        return None
    return facts.st_mtime_ns, facts.st_size
