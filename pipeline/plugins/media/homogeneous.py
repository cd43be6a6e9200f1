"""Homogeneous fog: the same everywhere."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.plugins.media_base import DenseMedium


class Homogeneous(DenseMedium):
    """Fog of one density, by its visibility or by its coefficients."""

    type: Literal["homogeneous"] = "homogeneous"

    def density_path(self, origin, points):
        return np.linalg.norm(np.asarray(points, float) - origin, axis=-1)
