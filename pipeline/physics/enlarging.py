"""T and V of a large photograph from those of a smaller one, some rows at a time.

What is smooth is enlarged, what is sharp is worked out where it is sharp. With tau the optical depth up to the exact
depth of each pixel, T = exp(-tau) F and V = (1 - exp(-tau)) J: F, what fog leaves of the light on its way to the
surface, J, the radiance of fog that fills the ray, and the mean density of fog along the ray change little along a
surface. Enlarging of J is that of V over that of 1 - exp(-tau), so that V of a ray of another length is near the truth, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

#: Depths that differ by this share belong to different things.
DEPTH_TOLERANCE = 0.05
#: Weight of a pixel of another surface, where its depth is alike.
OTHER_SURFACE = 1e-4
#: Weight of pixels beyond the nearest four, which count where none of these does.
FARTHER = 1e-3
#: Of the depth within four pixels, by which it may vary within one thing whose faces are not told apart.
SMOOTH = 1.1
#: Key of a pixel of which only the depth is known.
UNKNOWN = -1
_PIXELS = 200_000


def eye_path(extinction: np.ndarray, density: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """exp(-tau) and 1 - exp(-tau), (..., 3), of rays of a mean density (...) and depth (...) [m]."""
    tau = (density * depth)[..., None] * np.asarray(extinction, np.float32)
    return np.exp(-tau), -np.expm1(-tau)


def layer_values(extinction: np.ndarray, depth: np.ndarray, density: np.ndarray, transmittance: np.ndarray,
                 lights: Sequence[np.ndarray]) -> np.ndarray:
    """`Small.values` (h, w, n) from T (h, w, 3) and V of each light (h, w, 3), up to depth (h, w) [m]."""
    eye, filled = eye_path(extinction, density, depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        on_the_way = np.where(eye > 1e-30, np.clip(transmittance / eye, 0, 1), 1)
    return np.concatenate([density[..., None], on_the_way, filled, *lights], -1, dtype=np.float32)


@dataclass(frozen=True)
class Small:
    """What is known of the smaller photograph's pixels.

    depth (h, w) [m]; key (h, w) int32: equal where pixels show one smooth surface, UNKNOWN where only depth tells;
    values (h, w, n) float32: mean density, F (3), 1 - exp(-tau) (3), and V (3) of each light. mixed (h, w): where these
    are of what is in front; behind_depth (h, w) [m] and behind (h, w, n) are then of what is behind that.
    """

    depth: np.ndarray
    key: np.ndarray
    values: np.ndarray
    mixed: np.ndarray | None = None
    behind_depth: np.ndarray | None = None
    behind: np.ndarray | None = None


@dataclass(frozen=True)
class Pixels:
    """Rows of the large photograph: depth (n, W) [m], key (n, W) as in `Small`; bare (n, W): lamps and sky, F = 1 there."""

    depth: np.ndarray
    key: np.ndarray
    bare: np.ndarray


class Enlarging:
    """Maps at the size (H, W) of the large photograph."""

    def __init__(self, small: Small, size: tuple[int, int], extinction: np.ndarray):
        self.small, self.size, self.extinction = small, size, np.asarray(extinction, np.float32)
        rows, columns = small.depth.shape
        self.y, self.x = (((np.arange(many) + 0.5) * few / many - 0.5).astype(np.float32)
                          for few, many in zip((rows, columns), size))
        # four pixels of one key, as far as one another where keys do not tell
        window = np.ones((2, 2), np.uint8)
        key = small.key.astype(np.float32)
        border = {"anchor": (0, 0), "borderType": cv2.BORDER_REPLICATE}
        one = cv2.erode(key, window, **border) == cv2.dilate(key, window, **border)
        near = cv2.dilate(small.depth, window, **border) <= SMOOTH * cv2.erode(small.depth, window, **border)
        self.cell = np.where(one & ((small.key != UNKNOWN) | near), small.key, UNKNOWN - 1)
        self.flat = small.values.reshape(rows * columns, -1)
        self.flat_depth, self.flat_key = small.depth.ravel(), small.key.ravel()
        if small.mixed is not None and small.mixed.any():
            # a second layer of pixels, after the first; where[i]: index of what is behind pixel i, 0 for nothing
            at = np.flatnonzero(small.mixed)
            self.where_behind = np.zeros(rows * columns, np.int32)
            self.where_behind[at] = rows * columns + np.arange(len(at))
            self.flat = np.concatenate([self.flat, small.behind.reshape(rows * columns, -1)[at]])
            self.flat_depth = np.concatenate([self.flat_depth, small.behind_depth.ravel()[at].astype(np.float32)])
            self.flat_key = np.concatenate([self.flat_key, np.full(len(at), UNKNOWN, np.int32)])
        else:
            self.where_behind = None

    def rows(self, top: int, bottom: int, pixels: Pixels) -> np.ndarray:
        """T and V of each light, one after the other (n, W, 3 + 3 L) float32, as if each pixel showed one thing."""
        y = np.clip(self.y[top:bottom], 0, len(self.small.depth) - 1)
        y0, x0 = (np.clip(np.floor(at), 0, few - 1).astype(np.int32)
                  for at, few in zip((y, np.clip(self.x, 0, None)), self.small.depth.shape))
        cell = self.cell[y0][:, x0]
        plain = cell == pixels.key
        unknown = pixels.key == UNKNOWN
        if unknown.any():
            off = pixels.depth / self.small.depth[y0][:, x0]
            plain &= ~unknown | ((off < SMOOTH) & (off > 1 / SMOOTH))
        y1, down = np.minimum(y0 + 1, len(self.small.depth) - 1), (y - y0)[:, None, None]
        values = self.small.values[y0] * (1 - down) + self.small.values[y1] * down
        values = self._across(values)
        at = np.nonzero(~plain)
        for first in range(0, len(at[0]), _PIXELS):
            rows, columns = at[0][first:first + _PIXELS], at[1][first:first + _PIXELS]
            values[rows, columns] = self._gathered(self.y[top + rows], self.x[columns], pixels.depth[rows, columns],
                                                   pixels.key[rows, columns])
        return self._finished(values, pixels.depth, pixels.bare)

    def at(self, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray, bare: np.ndarray) -> np.ndarray:
        """The same (n, 3 + 3 L) of rays through single pixels (n,) that end at other depths (n,) [m]."""
        parts = [np.zeros((0, self.flat.shape[1] - 4), np.float32)]
        for first in range(0, len(rows), _PIXELS):
            part = np.s_[first:first + _PIXELS]
            values = self._gathered(self.y[rows[part]], self.x[columns[part]], depth[part], None)
            parts.append(self._finished(values, depth[part], bare[part]))
        return np.concatenate(parts)

    def _across(self, values: np.ndarray) -> np.ndarray:
        """Rows (n, w, c) at the width of the large photograph, bilinear."""
        few, many = values.shape[1], self.size[1]
        if few == many:
            return values
        return np.concatenate([cv2.resize(np.ascontiguousarray(values[..., k:k + 4]), (many, len(values)),
                                          interpolation=cv2.INTER_LINEAR).reshape(len(values), many, -1)
                               for k in range(0, values.shape[2], 4)], -1)

    def _gathered(self, y: np.ndarray, x: np.ndarray, depth: np.ndarray, key: np.ndarray | None) -> np.ndarray:
        """Weighted means (n, c) of the sixteen small pixels round places (n,), by how alike they are (joint bilateral)."""
        rows, columns = self.small.depth.shape
        y0, x0 = np.floor(y).astype(np.int32), np.floor(x).astype(np.int32)
        total, weights = np.zeros((len(y), self.flat.shape[1]), np.float32), np.zeros(len(y), np.float32)

        def add(index, spatial, counts):
            off = np.abs(self.flat_depth[index] - depth) / (DEPTH_TOLERANCE * depth)
            alike = np.exp(-np.minimum(off**2, 80))
            if key is not None:
                of = self.flat_key[index]
                alike = np.where((of == key) & (key != UNKNOWN), 1, np.where((of == UNKNOWN) | (key == UNKNOWN), 1,
                                                                           OTHER_SURFACE) * alike)
            # never quite 0, so that the likest neighbour stands where none agrees
            weight = (spatial * alike + 1e-16 / (1 + np.minimum(off, 1e4) ** 4)) * counts
            np.add(total, weight[:, None] * self.flat[index], out=total)
            np.add(weights, weight, out=weights)

        for dy in (-1, 0, 1, 2):
            for dx in (-1, 0, 1, 2):
                away_y, away_x = np.abs(y0 + dy - y), np.abs(x0 + dx - x)
                spatial = (np.maximum(1 - away_y, 0) * np.maximum(1 - away_x, 0)
                           + FARTHER * np.exp(-(away_y**2 + away_x**2))).astype(np.float32)
                index = np.clip(y0 + dy, 0, rows - 1) * columns + np.clip(x0 + dx, 0, columns - 1)
                add(index, spatial, 1)
                if self.where_behind is not None:
                    behind = self.where_behind[index]
                    there = behind > 0
                    if there.any():
                        add(np.where(there, behind, index), spatial, there)
        return total / weights[:, None]

    def _finished(self, values: np.ndarray, depth: np.ndarray, bare: np.ndarray) -> np.ndarray:
        """T and V of each light at these depths (...) [m]."""
        eye, filled = eye_path(self.extinction, values[..., 0], depth)
        result = np.empty((*depth.shape, values.shape[-1] - 4), np.float32)
        result[..., :3] = eye * np.where(bare[..., None], 1, values[..., 1:4])
        known = values[..., 4:7] > 1e-35
        share = np.where(known, filled / np.where(known, values[..., 4:7], 1), 0)
        for k in range(7, values.shape[-1], 3):
            result[..., k - 4:k - 1] = values[..., k:k + 3] * share
        return result
