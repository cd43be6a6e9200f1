"""Smooth maps rendered small, at the photograph's size."""

from __future__ import annotations

import numpy as np

#: Depths that differ by this share belong to different things.
DEPTH_TOLERANCE = 0.05
#: Share of a pixel's four neighbours that must be of its thing; else it is looked for in so many rows and columns farther round.
FEWEST_ALIKE, FARTHER = 0.05, 2


class Enlargement:
    """Bilinear, but not across edges of depth, from maps of one size to those of another.

    coarse_depth (h, w) [m]: where the values were made; depth (H, W) [m]: where they are wanted. In-scattering is smooth
    along a surface and jumps where the ray's end does, so each of the four neighbours counts by its distance times how
    well its depth agrees (joint bilateral upsampling, Kopf et al. 2007). Beside an edge all four may be of another thing:
    then those farther round count alike; where none of them agrees, the likest one does.
    """

    def __init__(self, coarse_depth: np.ndarray, depth: np.ndarray):
        height, width = depth.shape
        rows, columns = coarse_depth.shape
        y = np.clip((np.arange(height) + 0.5) * rows / height - 0.5, 0, rows - 1)
        x = np.clip((np.arange(width) + 0.5) * columns / width - 0.5, 0, columns - 1)
        y0, x0 = np.minimum(y.astype(int), max(rows - 2, 0)), np.minimum(x.astype(int), max(columns - 2, 0))
        fy, fx = (y - y0)[:, None], (x - x0)[None]
        self.parts, total = [], np.zeros((height, width))
        for dy in (0, 1):
            for dx in (0, 1):
                at = np.minimum(y0 + dy, rows - 1), np.minimum(x0 + dx, columns - 1)
                weight = np.abs(1 - dy - fy) * np.abs(1 - dx - fx) * _alike(coarse_depth[at[0]][:, at[1]], depth)
                total += weight
                self.parts.append((at, weight))
        self.lost = np.nonzero(total < FEWEST_ALIKE)
        self.around = self.around_weight = None
        if self.lost[0].size:
            self._look_farther(coarse_depth, depth[self.lost], y[self.lost[0]], x[self.lost[1]])
        total[self.lost] = 1
        self.parts = [(at, (weight / total).astype(np.float32)) for at, weight in self.parts]

    def _look_farther(self, coarse_depth: np.ndarray, depth: np.ndarray, y: np.ndarray, x: np.ndarray) -> None:
        """Neighbours (n, k) of lost pixels at places y, x (n,) of the small map, and their weights."""
        reach = np.arange(-FARTHER, FARTHER + 2)
        dy, dx = (one.ravel() for one in np.meshgrid(reach, reach, indexing="ij"))
        row, column = (np.floor(one).astype(int)[:, None] + step for one, step in ((y, dy), (x, dx)))
        off = (row - y[:, None]) ** 2 + (column - x[:, None]) ** 2
        row, column = np.clip(row, 0, coarse_depth.shape[0] - 1), np.clip(column, 0, coarse_depth.shape[1] - 1)
        weight = np.exp(-off) * _alike(coarse_depth[row, column], depth[:, None])
        self.around, self.around_weight = (row, column), (weight / weight.sum(-1, keepdims=True)).astype(np.float32)

    def of(self, values: np.ndarray) -> np.ndarray:
        """`values` (h, w, c) made at the coarse size, (H, W, c)."""
        result = np.empty((*self.parts[0][1].shape, values.shape[2]))
        for channel in range(values.shape[2]):
            if channel and np.array_equal(values[..., channel], values[..., channel - 1]):
                result[..., channel] = result[..., channel - 1]  # of grey fog
                continue
            one = np.ascontiguousarray(values[..., channel])
            found = sum(weight * one[at[0]][:, at[1]] for at, weight in self.parts)
            if self.around is not None:
                found[self.lost] = (self.around_weight * one[self.around]).sum(-1)
            result[..., channel] = found
        return result


def _alike(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """How well depths [m] agree: 1, down to almost 0, and never quite that, so that the likest stands where none agrees."""
    off = np.abs(one - other) / (DEPTH_TOLERANCE * other)
    return np.exp(-np.minimum(off**2, 300.0)) + 1e-140 / (1 + off)
