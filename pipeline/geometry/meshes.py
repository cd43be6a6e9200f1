"""Triangle meshes: where rays meet them."""

from __future__ import annotations

import numpy as np

#: Pairs of ray and triangle at once: some arrays of three float64 each, some tens of megabytes.
_PAIRS = 200_000
#: Share of a triangle that it reaches beyond its edges, so that no ray slips between neighbours by rounding.
_SEAM = 1e-9


def mesh_hits(origin: np.ndarray, directions: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distance (...) [m] along unit rays (..., 3) to the nearest triangle, inf where none is met; as `nearest_triangles`."""
    return nearest_triangles(origin, directions, vertices, triangles)[0]


def nearest_triangles(origin: np.ndarray, directions: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Distance (...) [m] along unit rays (..., 3) to the nearest triangle, inf where none is met, and its index, -1 for none.

    vertices (n, 3) [m], triangles (m, 3) indices; both sides count (Moeller and Trumbore 1997).
    Rays that point alike are tried together on those triangles alone that lie in their direction.
    """
    rays = np.reshape(np.asarray(directions, float), (-1, 3))
    corners = np.asarray(vertices, float)[np.asarray(triangles).reshape(-1, 3)] - np.asarray(origin, float)
    nearest, which = np.full(len(rays), np.inf), np.full(len(rays), -1)
    shape = np.shape(directions)[:-1]
    if not len(rays) or not len(corners):
        return nearest.reshape(shape), which.reshape(shape)
    axes, cosines = _cones(corners)
    for members in _bundles(rays, len(corners)):
        some = rays[members]
        middle = some.mean(0)
        length = np.linalg.norm(middle)
        if length > 0.1:
            middle = middle / length
            spread = np.arccos(np.clip((some @ middle).min(), -1, 1))
            towards = np.arccos(np.clip(axes @ middle, -1, 1)) <= np.arccos(cosines) + spread + 1e-6
            chosen = np.flatnonzero(towards)
        else:
            chosen = np.arange(len(corners))
        step = max(1, _PAIRS // max(len(chosen), 1))
        for begin in range(0, len(some) if len(chosen) else 0, step):
            distance, index = _hits(some[begin:begin + step], corners[chosen])
            nearest[members[begin:begin + step]] = distance
            which[members[begin:begin + step]] = np.where(np.isfinite(distance), chosen[index], -1)
    return nearest.reshape(shape), which.reshape(shape)


def _cones(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axis (m, 3), and cosine (m,) of the half angle, of a cone round each triangle (m, 3, 3) seen from the origin."""
    length = np.linalg.norm(corners, axis=-1, keepdims=True)
    towards = corners / np.where(length > 0, length, 1)
    axes = towards.sum(1)
    norm = np.linalg.norm(axes, axis=1, keepdims=True)
    axes = axes / np.where(norm > 0, norm, 1)
    cosines = np.clip((towards @ axes[..., None])[..., 0].min(1), -1, 1)
    # a cone holds the triangle between its corners only below half a turn; the eye may even lie in the triangle
    return axes, np.where((cosines > 0.01) & (length[..., 0] > 0).all(1), cosines, -1.0)


def _bundles(rays: np.ndarray, triangles: int) -> list[np.ndarray]:
    """Indices of rays (n, 3) that point alike, some hundred of them each where there are as many."""
    if len(rays) * triangles <= _PAIRS:
        return [np.arange(len(rays))]
    low, high = rays.min(0), rays.max(0)
    # cells on a surface: their number goes with the square of how many there are along an axis
    along = int(np.clip(np.sqrt(len(rays) / 256), 1, 60))
    cell = np.minimum(((rays - low) / np.maximum(high - low, 1e-12) * along).astype(int), along - 1)
    key = (cell[:, 0] * along + cell[:, 1]) * along + cell[:, 2]
    order = np.argsort(key, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(key[order])) + 1)


def _hits(rays: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance (n,) along rays (n, 3) from 0 to the nearest of triangles (m, 3, 3), inf for none, and its index."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(-corners[:, 0], first)
    reach = (second * across).sum(-1)
    # triple products with the ray, as products of matrices: ray . (second x first) and ray . (second x towards)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = rays @ np.cross(second, first).T
        u = rays @ np.cross(second, -corners[:, 0]).T / determinant
        v = rays @ across.T / determinant
        distance = reach / determinant
        met = (u >= -_SEAM) & (v >= -_SEAM) & (u + v <= 1 + _SEAM) & (distance > 0) & np.isfinite(distance)
    distance = np.where(met, distance, np.inf)
    index = distance.argmin(-1)
    return np.take_along_axis(distance, index[:, None], -1)[:, 0], index
