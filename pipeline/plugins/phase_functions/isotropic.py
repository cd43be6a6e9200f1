"""Isotropic phase function."""

from typing import Literal

import numpy as np

from pipeline.plugins.base import PhaseFunction


class Isotropic(PhaseFunction):
    """Scatters equally in all directions: p = 1/(4 pi) [1/sr]."""

    type: Literal["isotropic"] = "isotropic"

    def value(self, cosine):
        return np.full(np.shape(cosine), 1 / (4 * np.pi))
