"""EXR data windows: a file may hold more or less than the picture it belongs to."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio


def in_display_window(pixels: np.ndarray, spec: oiio.ImageSpec, missing: float = 0) -> np.ndarray:
    """A file's pixels (h, w, n) on its display window (H, W, n): overscan cut off, `missing` where it holds nothing."""
    if (spec.x, spec.y, spec.width, spec.height) == (spec.full_x, spec.full_y, spec.full_width, spec.full_height):
        return pixels
    canvas = np.full((spec.full_height, spec.full_width, pixels.shape[2]), missing, pixels.dtype)
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + spec.width, spec.full_width), min(y + spec.height, spec.full_height)
    if right > left and bottom > top:
        canvas[top:bottom, left:right] = pixels[top - y:bottom - y, left - x:right - x]
    return canvas
