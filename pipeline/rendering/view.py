"""Rays whose V and T are asked for, and the fog along them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from pipeline.plugins.base import Medium


@dataclass(frozen=True)
class View:
    """Rays that end at given depths: the whole photograph's, or some of its pixels' once more.

    depth (...) [m], directions, points, normals (..., 3), optical_depth (..., 3), of grey fog (..., 1). full_depth (H, W) [m]:
    the depth map that it belongs to; where: the pixels' indices in that, an Ellipsis for all of them.
    """

    full_depth: np.ndarray
    where: object
    depth: np.ndarray
    directions: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    optical_depth: np.ndarray


class Remembering:
    """The fog, but the integral of its density from the eye along the same rays is worked out once for all lights.

    Where the density stands on a grid that takes minutes, and each light asks for it.
    """

    def __init__(self, medium: Medium, eye: np.ndarray):
        self.medium, self.eye, self.known = medium, eye, {}

    def __getattr__(self, name: str):
        return getattr(self.medium, name)

    def density_path(self, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        if not np.array_equal(origin, self.eye):
            return self.medium.density_path(origin, points)
        key = (np.shape(points), hashlib.blake2b(np.ascontiguousarray(points)).digest())
        if key not in self.known:
            self.known[key] = self.medium.density_path(origin, points)
        return self.known[key]

    def optical_depth(self, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        return self.density_path(origin, points)[..., None] * np.add(*self.medium.coefficients())
