"""How far one picture is from another, in linear light."""

from __future__ import annotations

import cv2
import numpy as np


def shrunk_to(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """`picture` (H, W) or (H, W, n), averaged by area to `size` (h, w), in the light that it holds."""
    if picture.shape[:2] == tuple(size):
        return picture
    return cv2.resize(np.ascontiguousarray(picture), size[::-1], interpolation=cv2.INTER_AREA)


def measured(found: np.ndarray, true: np.ndarray, counted: np.ndarray) -> tuple[float, float]:
    """Root mean square of the difference of pictures (h, w, 3) at pixels `counted` (h, w); and, as Zhao et al. 2013, Fig. 10,
    at all pixels, of values clipped to [0, 1]. NaN where nothing counts."""
    wrong = (found - true)[counted]
    clipped = np.clip(found, 0, 1) - np.clip(true, 0, 1)
    return float(np.sqrt((wrong**2).mean())) if wrong.size else float("nan"), float(np.sqrt((clipped**2).mean()))
