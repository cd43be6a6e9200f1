"""Smooth maps rendered small, at the photograph's size."""

from __future__ import annotations

import numpy as np

#: Depths that differ by this share belong to different things.
DEPTH_TOLERANCE = 0.05


class Enlargement:
    """Bilinear, but not across edges of depth, from maps of one size to those of another.

    coarse_depth (h, w) [m]: where the values were made; depth (H, W) [m]: where they are wanted. In-scattering is smooth
    along a surface and jumps where the ray's end does, so each of the four neighbours counts by its distance times how
    well its depth agrees (joint bilateral upsampling, Kopf et al. 2007); where none agrees, the likest one does.
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
                off = np.abs(coarse_depth[at[0]][:, at[1]] - depth) / (DEPTH_TOLERANCE * depth)
                # never quite 0, so that the likest neighbour stands where none agrees
                alike = np.exp(-np.minimum(off**2, 300.0))
                weight = np.abs(1 - dy - fy) * np.abs(1 - dx - fx) * alike + 1e-140 / (1 + off)
                total += weight
                self.parts.append((at, weight))
        self.parts = [(at, (weight / total).astype(np.float32)) for at, weight in self.parts]

    def of(self, values: np.ndarray) -> np.ndarray:
        """`values` (h, w, 3) made at the coarse size, (H, W, 3)."""
        result = np.empty((*self.parts[0][1].shape, values.shape[2]))
        for channel in range(values.shape[2]):
            if channel and np.array_equal(values[..., channel], values[..., channel - 1]):
                result[..., channel] = result[..., channel - 1]  # of grey fog
                continue
            one = np.ascontiguousarray(values[..., channel])
            result[..., channel] = sum(weight * one[at[0]][:, at[1]] for at, weight in self.parts)
        return result
