"""Whether anything stands between pairs of points."""

from __future__ import annotations

import numpy as np

#: Segments at once.
_BLOCK = 200_000


def blocked(starts: np.ndarray, ends: np.ndarray, faces: list[np.ndarray], last: float = 1.0) -> np.ndarray:
    """Whether a face crosses each segment, (n,), from starts to ends (n, 3) [m] before the share `last` of its length.

    faces: planar simple polygons (m, 3), convex or not. Inside is where an odd number of edges lies to one side.
    """
    result = np.zeros(len(starts), bool)
    for first in range(0, len(starts), _BLOCK):
        part = np.s_[first:first + _BLOCK]
        way = ends[part] - starts[part]
        for face in faces:
            result[part] |= _crossed(starts[part], way, np.asarray(face, float), last)
    return result


def _crossed(start: np.ndarray, way: np.ndarray, face: np.ndarray, last: float) -> np.ndarray:
    normal = np.cross(face, np.roll(face, -1, 0)).sum(0)  # twice the area
    slope = way @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((face[0] - start) @ normal) / slope
    inside = (slope != 0) & (share > 0) & (share < last)
    if not inside.any():
        return inside
    u, v = np.delete(np.arange(3), np.argmax(np.abs(normal)))
    point = start[inside] + share[inside, None] * way[inside]
    odd = np.zeros(len(point), bool)
    for a, b in zip(face, np.roll(face, -1, 0)):
        across = (a[v] > point[:, v]) != (b[v] > point[:, v])
        if a[v] != b[v]:
            odd ^= across & (point[:, u] < a[u] + (point[:, v] - a[v]) * ((b[u] - a[u]) / (b[v] - a[v])))
    inside[inside] = odd
    return inside
