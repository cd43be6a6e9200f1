"""A photograph in memory, with all that its kind of file holds besides light."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from pipeline.imaging.colour import Encoding

SUFFIXES = {"jpeg": (".jpg", ".jpeg"), "png": (".png",), "tiff": (".tif", ".tiff"), "openexr": (".exr",),
             "hdr": (".hdr",)}


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph, upright, with all that is needed to write a changed version in the same kind.

    radiance: (H, W, 3) float32, linear scene-referred Rec.709, 1 = photo white for integer files;
    straight (not multiplied by alpha). Negative where a colour lies outside Rec.709.
    alpha: (H, W) float32, 1 = opaque, or None.
    clipped: (H, W) bool, a channel at the top code value; in float files a channel not finite or beyond 1e9, whose
    pixel then has radiance 0.
    codes: (H, W, n) the file's own values, colour (1 or 3 channels) and then alpha, if any.
    """

    path: Path
    radiance: np.ndarray
    alpha: np.ndarray | None
    clipped: np.ndarray
    codes: np.ndarray = field(repr=False)
    format: str
    sample_type: str
    encoding: Encoding = field(repr=False)
    header: oiio.ImageSpec = field(repr=False)
    resampled: bool = False

    @property
    def width(self) -> int:
        return self.radiance.shape[1]

    @property
    def height(self) -> int:
        return self.radiance.shape[0]

    @property
    def is_grey(self) -> bool:
        return self.codes.shape[2] <= 2

    @property
    def is_float(self) -> bool:
        return self.codes.dtype.kind == "f"

    @property
    def suffix(self) -> str:
        """The usual file suffix of this kind, for example ".jpg"."""
        return SUFFIXES[self.format][0]

    @property
    def has_associated_alpha(self) -> bool:
        """Whether the file's colours are multiplied by its alpha (OpenEXR's convention)."""
        return self.alpha is not None and not self.header.get_int_attribute("oiio:UnassociatedAlpha", 0)
