"""Two layers in one pixel, each dimmed by the fog before it."""

from __future__ import annotations

import numpy as np


def mixed_transmittance(alpha: np.ndarray, front: np.ndarray, behind: np.ndarray, front_transmittance: np.ndarray,
                        behind_transmittance: np.ndarray) -> np.ndarray:
    """T (..., 3) of pixels of which a share `alpha` (...) shows `front` (..., 3) and the rest `behind` (..., 3).

    T = (a F T_f + (1 - a) B T_b) / (a F + (1 - a) B), so that C = R T + V holds with R the photograph. With one T for
    the pixel's mean depth instead, bright sky would shine through the fog round everything that stands before it.
    Where both are black T is that of the shares.
    """
    a = np.asarray(alpha, float)[..., None]
    near, far = a * front, (1 - a) * behind
    total = near + far
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(total > 0, near / np.where(total > 0, total, 1), a)
    return share * front_transmittance + (1 - share) * behind_transmittance
