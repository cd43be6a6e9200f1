"""How far one picture is from another, in linear light."""

from __future__ import annotations

import numpy as np


def measured(found: np.ndarray, true: np.ndarray, counted: np.ndarray) -> tuple[float, float]:
    """Root mean square of the difference of pictures (h, w, 3) at pixels `counted` (h, w); and, as Zhao et al. 2013, Fig. 10,
    at all pixels, of values clipped to [0, 1]. NaN where nothing counts."""
    wrong = (found - true)[counted]
    clipped = np.clip(found, 0, 1) - np.clip(true, 0, 1)
    return float(np.sqrt((wrong**2).mean())) if wrong.size else float("nan"), float(np.sqrt((clipped**2).mean()))
