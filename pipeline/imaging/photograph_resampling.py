"""A photograph at another size."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from pipeline.imaging.photograph_file import Photograph


#: A working copy's shorter side [pixel] is not below this: what is so narrow is no large photograph.
NARROWEST = 32


def working_size(width: int, height: int, longer_side: int | None) -> tuple[int, int]:
    """Width and height at which light and fog of a photograph are worked out: its own, or smaller."""
    scale = min(1.0, (longer_side or max(width, height)) / max(width, height))
    if scale == 1.0 or scale * min(width, height) < NARROWEST:
        return width, height
    return round(width * scale), round(height * scale)


def averaged(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """An image (H, W, ...) at a smaller size, (w, h), each pixel the mean of what it covers; float32."""
    return cv2.resize(np.ascontiguousarray(values, np.float32), size, interpolation=cv2.INTER_AREA)


def resampled(photograph: Photograph, longer_side: int) -> Photograph:
    """The photograph with this longer side [pixel], in linear light: averaged when smaller, else bicubic.

    A pixel is clipped where any part of it was.
    """
    scale = longer_side / max(photograph.width, photograph.height)
    size = max(1, round(photograph.width * scale)), max(1, round(photograph.height * scale))
    if size == (photograph.width, photograph.height):
        return photograph

    def at_size(values: np.ndarray) -> np.ndarray:
        values = np.ascontiguousarray(values, np.float32)
        if scale < 1:
            return cv2.resize(values, size, interpolation=cv2.INTER_AREA)
        # bicubic weights reach beyond the values beside an edge: none may turn darker than black
        low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
        return np.clip(cv2.resize(values, size, interpolation=cv2.INTER_CUBIC), low, high)

    codes = np.moveaxis(np.stack([at_size(photograph.codes[..., k]) for k in range(photograph.codes.shape[2])]), 0, -1)
    if photograph.codes.dtype.kind != "f":
        codes = np.rint(codes)
    return replace(photograph, radiance=at_size(photograph.radiance), clipped=at_size(photograph.clipped) > 0,
                   alpha=None if photograph.alpha is None else at_size(photograph.alpha),
                   codes=codes.astype(photograph.codes.dtype), resampled=True)
