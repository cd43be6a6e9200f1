"""Surface normals from a depth map's points."""

from __future__ import annotations

import numpy as np

#: Pixels at once.
_BLOCK = 1_000_000


def surface_normals(points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """Unit normals (H, W, 3), towards the eye (3,), of a photograph's surface points (H, W, 3) [m].

    Along rows and columns the nearer of the two neighbours counts, so that normals stay those of their own
    surface up to an edge of depth. Where there is no neighbour at all the normal points to the eye.
    """
    normals = np.empty(points.shape)
    rows = max(1, _BLOCK // points.shape[1])
    for top in range(0, len(points), rows):
        # with a row more on each side, whose neighbours count too
        above = min(top, 1)
        block = points[top - above:top + rows + 1]
        normals[top:top + rows] = _of(block, eye)[above:above + rows]
    return normals


def _of(points: np.ndarray, eye: np.ndarray) -> np.ndarray:
    to_eye = eye - points
    to_eye /= np.maximum(_length(to_eye), 1e-300)
    normals = np.cross(_step(points, 1), _step(points, 0))
    length = _length(normals)
    normals = np.where(length > 0, normals / np.maximum(length, 1e-300), to_eye)
    return normals * np.where(np.einsum("...i,...i->...", normals, to_eye)[..., None] < 0, -1.0, 1.0)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))[..., None]


def _step(points: np.ndarray, axis: int) -> np.ndarray:
    """Difference to the nearer neighbour along an axis, always in its positive sense."""
    if points.shape[axis] < 2:
        return np.zeros_like(points)
    step = np.diff(points, axis=axis)
    first, last = np.take(step, [0], axis), np.take(step, [-1], axis)
    ahead, back = np.concatenate([step, last], axis), np.concatenate([first, step], axis)
    nearer = _length(ahead) <= _length(back)
    return np.where(nearer, ahead, back)
