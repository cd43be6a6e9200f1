"""Grey fog by two numbers."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.plugins.base import Medium, parameter
from pipeline.plugins.choices import PhaseFunctionChoice


class Murk(Medium):
    """Even, grey fog by its extinction and the share of it that is scattered."""

    type: Literal["murk"] = "murk"
    extinction: float = parameter(unit="1/m", ge=0, le=1e6, description="light lost a metre")
    albedo: float = parameter(0.9, "1", ge=0, le=1, description="share of the extinction that is scattered")
    phase_function: PhaseFunctionChoice = parameter({"type": "isotropic"}, description="how it scatters")

    def coefficients(self):
        return np.full(3, self.extinction * (1 - self.albedo)), np.full(3, self.extinction * self.albedo)

    def density_path(self, origin, points):
        return np.linalg.norm(np.asarray(points, float) - origin, axis=-1)
