"""Rayleigh phase function."""

from typing import Literal

import numpy as np

from pipeline.plugins.base import PhaseFunction


class Rayleigh(PhaseFunction):
    """Scattering by particles much smaller than the wavelength: p = 3 (1 + cos^2) / (16 pi) [1/sr]."""

    type: Literal["rayleigh"] = "rayleigh"

    def value(self, cosine):
        return 3 / (16 * np.pi) * (1 + np.square(np.asarray(cosine, float)))
