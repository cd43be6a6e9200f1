"""Directions as unit vectors: angles between them, their mean, and a chart of the sphere."""

from __future__ import annotations

import numpy as np


def angles_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles [radian] between vectors, (..., 3); exact near 0 and pi, where arccos loses half its digits."""
    a, b = np.broadcast_arrays(a, b)
    crossed = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return np.arctan2(np.sqrt((crossed**2).sum(-1)), (a * b).sum(-1))


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def mean_direction(rays: np.ndarray) -> np.ndarray:
    """Mean direction of unit vectors, (n, 3); the first of them where they cancel."""
    total = rays.sum(0)
    return unit(total if np.linalg.norm(total) > 1e-6 else rays[0])


def spread(rays: np.ndarray) -> float:
    """Mean angle [radian] of unit vectors, (n, 3), from their mean direction."""
    return float(angles_between(rays, mean_direction(rays)).mean())


class Chart:
    """The sphere around a centre in two coordinates [radian]: azimuthal equidistant, singular only behind."""

    def __init__(self, centre: np.ndarray):
        across = np.eye(3)[np.argmin(np.abs(centre))]
        u = unit(np.cross(centre, across))
        self.centre, self.tangents = centre, np.array([u, np.cross(centre, u)])

    def direction(self, x: np.ndarray) -> np.ndarray:
        angle = np.hypot(*x)
        return unit(np.cos(angle) * self.centre + np.sinc(angle / np.pi) * (x @ self.tangents))
