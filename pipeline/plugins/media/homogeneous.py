"""Homogeneous fog: the same everywhere."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from pipeline.plugins.layered_medium import LayeredMedium


class Homogeneous(LayeredMedium):
    """Fog of one density, by its visibility or by its coefficients."""

    type: Literal["homogeneous"] = "homogeneous"
    even: ClassVar[bool] = True

    def level_density(self, height):
        return np.ones(np.shape(height))

    def column(self, low, high):
        return high - low

    def between(self, one, other, length):
        return np.broadcast_to(length, np.broadcast_shapes(np.shape(one), np.shape(other), np.shape(length)))
