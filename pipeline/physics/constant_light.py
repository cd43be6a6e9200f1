"""Fog lit alike everywhere: what is left of the equation of transfer when the light that falls on the fog is one constant.

dL/ds = -kappa L + delta J with one J everywhere integrates to L = L_0 exp(-tau) + A (1 - exp(-tau)), A = J delta / kappa.
Koschmieder's law (1924) and Lopez-Moreno et al. 2008 are of this form.
"""

from __future__ import annotations

import numpy as np


def constant_light_fog(radiance: np.ndarray, optical_depth: np.ndarray, airlight: np.ndarray) -> np.ndarray:
    """Foggy picture (..., 3) of a clear one (..., 3), an optical depth (..., 3) or (..., 1), and airlight (3,), in one unit."""
    return radiance * np.exp(-optical_depth) - airlight * np.expm1(-optical_depth)


def fitted_airlight(survives: np.ndarray, share: np.ndarray, wanted: np.ndarray, counted: np.ndarray
                    ) -> tuple[np.ndarray, float]:
    """The airlight (3,), not below 0, with which survives + airlight * share is nearest to `wanted`, and the mean square error.

    All (h, w, 3), at pixels `counted` (h, w). Linear least squares in one unknown a channel.
    """
    y, x = (wanted - survives)[counted].astype(float), share[counted].astype(float)
    airlight = np.maximum((x * y).sum(0) / np.maximum((x * x).sum(0), 1e-300), 0.0)
    return airlight, float(((y - airlight * x) ** 2).mean())
