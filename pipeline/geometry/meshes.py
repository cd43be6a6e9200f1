"""Triangle meshes: where rays meet them."""

from __future__ import annotations

import numpy as np

#: Pairs of ray and triangle at once: some arrays of three float64 each, a few hundred megabytes.
_PAIRS = 1_000_000


def mesh_hits(origin: np.ndarray, directions: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance (...) [m] along unit rays (..., 3) to the nearest triangle, inf where none is met.

    vertices (n, 3) [m], triangles (m, 3) indices; both sides count (Moeller and Trumbore 1997).
    """
    rays = np.reshape(directions, (-1, 3))
    corner = np.asarray(vertices, float)[np.asarray(triangles)]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    towards = np.asarray(origin, float) - corner[:, 0]
    across = np.cross(towards, first)  # (m, 3)
    reach = (second * across).sum(-1)
    nearest = np.full(len(rays), np.inf)
    step = max(1, _PAIRS // max(len(corner), 1))
    for begin in range(0, len(rays), step):
        some = rays[begin:begin + step]
        with np.errstate(divide="ignore", invalid="ignore"):
            normal = np.cross(some[:, None], second)  # (k, m, 3)
            determinant = (normal * first).sum(-1)
            u = (normal * towards).sum(-1) / determinant
            v = some @ across.T / determinant
            distance = reach / determinant
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0) & np.isfinite(distance)
        nearest[begin:begin + step] = np.where(met, distance, np.inf).min(-1, initial=np.inf)
    return nearest.reshape(np.shape(directions)[:-1])
