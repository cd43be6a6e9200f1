"""What fogs have in common whose density depends on height alone."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from pipeline.plugins.media_base import DenseMedium

#: Least sine of the light's elevation: lower light crosses so much fog that nothing of it is left.
LOWEST_SUN = 1e-6
#: Heights that differ by less than this share of a segment's length are one.
LEVEL = 1e-9


class LayeredMedium(DenseMedium):
    """Fog of a relative density D(y); all its integrals follow from that over height."""

    layered: ClassVar[bool] = True

    def level_density(self, height: np.ndarray) -> np.ndarray:
        """D, by height [m]."""
        raise NotImplementedError(type(self).__name__)

    def column(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Integral [m] of D from height `low` up to `high` >= low, without loss of digits where they are near."""
        raise NotImplementedError(type(self).__name__)

    def density(self, points):
        return self.level_density(np.asarray(points, float)[..., 1])

    def between(self, one: np.ndarray, other: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Integral [m] of D over segments of these lengths [m] between two heights [m]."""
        low, high = np.minimum(one, other), np.maximum(one, other)
        rise = high - low
        level = rise <= LEVEL * length
        slanted = self.column(low, high) * (length / np.where(level, 1.0, rise))
        return np.where(level, length * self.level_density((low + high) / 2), slanted)

    def density_path(self, origin, points):
        points, origin = np.asarray(points, float), np.asarray(origin, float)
        return self.between(origin[..., 1], points[..., 1], np.linalg.norm(points - origin, axis=-1))

    def daylight_path(self, points, direction):
        points, direction = np.broadcast_arrays(np.asarray(points, float), np.asarray(direction, float))
        if self.top() is None:
            return np.zeros(points.shape[:-1])
        height = np.minimum(points[..., 1], self.top())
        return self.column(height, np.full(height.shape, self.top())) / np.maximum(-direction[..., 1], LOWEST_SUN)
