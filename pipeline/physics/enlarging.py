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
#: Weight of a pixel that is as far as the next but one.
BEYOND = 1e-3
#: Weight of the nearest four together below which those round them are asked, too.
ENOUGH = 1e-2
NEAREST = [(dy, dx) for dy in (0, 1) for dx in (0, 1)]
FARTHER = [(dy, dx) for dy in (-1, 0, 1, 2) for dx in (-1, 0, 1, 2) if (dy, dx) not in NEAREST]
#: Of the depth within four pixels, by which it may vary within one thing whose faces are not told apart.
SMOOTH = 1.1
#: Key of a pixel of which only the depth is known.
UNKNOWN = -1
_PIXELS = 200_000


def eye_path(extinction: np.ndarray, density: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """exp(-tau) and 1 - exp(-tau), (..., 3), of rays of a mean density (...) and depth (...) [m]."""
    tau = (density * depth)[..., None].astype(np.float32, copy=False) * np.asarray(extinction, np.float32)
    eye = np.exp(-tau)
    # as expm1 would, to 1e-6, in a quarter of its time
    filled = 1 - eye
    thin = tau < 0.05
    if thin.any():
        filled = np.where(thin, tau * (1 - tau / 2 * (1 - tau / 3 * (1 - tau / 4))), filled)
    return eye, filled


def centres(size: tuple[int, int], small: tuple[int, int]) -> list[np.ndarray]:
    """Rows (H,) and columns (W,) at which pixels of an image of this size (H, W) lie in a `small` one (h, w), counted
    from pixel centres."""
    return [((np.arange(many) + 0.5) * few / many - 0.5).astype(np.float32) for many, few in zip(size, small)]


def bilinear(values: np.ndarray, y: np.ndarray, width: int) -> np.ndarray:
    """An image (h, w, c) at rows y (n,), as of `centres`, and at `width` columns."""
    y = np.clip(y, 0, len(values) - 1)
    y0 = np.floor(y).astype(np.int32)
    down = (y - y0)[:, None, None]
    rows = values[y0] * (1 - down) + values[np.minimum(y0 + 1, len(values) - 1)] * down
    if rows.shape[1] == width:
        return rows
    return cv2.resize(rows, (width, len(y)), interpolation=cv2.INTER_LINEAR).reshape(len(y), width, -1)


def _cells(key: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Key (h, w) of each pixel, the next, and those below, where it is one; where only depth tells, if that is alike."""
    window, border = np.ones((2, 2), np.uint8), {"anchor": (0, 0), "borderType": cv2.BORDER_REPLICATE}
    code = key.astype(np.float32)
    one = cv2.erode(code, window, **border) == cv2.dilate(code, window, **border)
    near = cv2.dilate(depth, window, **border) <= SMOOTH * cv2.erode(depth, window, **border)
    return np.where(one & ((key != UNKNOWN) | near), key, UNKNOWN - 1)


def _near(depth: np.ndarray, other: np.ndarray) -> np.ndarray:
    return (depth < SMOOTH * other) & (other < SMOOTH * depth)


def layer_values(extinction: np.ndarray, depth: np.ndarray, density: np.ndarray, transmittance: np.ndarray,
                 lights: Sequence[np.ndarray]) -> np.ndarray:
    """`Small.values` (h, w, n) from T (h, w, 3) and V of each light (h, w, 3), up to depth (h, w) [m]."""
    eye, filled = eye_path(extinction, density, depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        on_the_way = np.where(eye > 1e-30, np.clip(transmittance / eye, 0, 1), 1)
    return np.concatenate([density[..., None], on_the_way, filled, *lights], -1, dtype=np.float32)


def _planes(values: np.ndarray) -> list[np.ndarray]:
    """`Small.values` (..., n) by what they are: mean density (..., 1), and all else (..., 3)."""
    return [np.ascontiguousarray(values[..., max(first, 0):first + 3]) for first in range(-2, values.shape[-1], 3)]


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
        self.y, self.x = centres(size, small.depth.shape)
        self.cell = _cells(small.key, small.depth)
        self.planes = _planes(small.values)
        self.flat = small.values.reshape(rows * columns, -1)
        self.flat_depth, self.flat_key = small.depth.ravel(), small.key.ravel()
        if small.mixed is not None and small.mixed.any():
            # a second layer of pixels, after the first; where[i]: index of what is behind pixel i, 0 for nothing
            at = np.flatnonzero(small.mixed)
            self.cell_behind = _cells(np.where(small.mixed, UNKNOWN, UNKNOWN - 1), small.behind_depth)
            self.where_behind = np.zeros(rows * columns, np.int32)
            self.where_behind[at] = rows * columns + np.arange(len(at))
            self.planes_behind = _planes(small.behind)
            self.flat = np.concatenate([self.flat, small.behind.reshape(rows * columns, -1)[at]])
            self.flat_depth = np.concatenate([self.flat_depth, small.behind_depth.ravel()[at].astype(np.float32)])
            self.flat_key = np.concatenate([self.flat_key, np.full(len(at), UNKNOWN, np.int32)])
        else:
            self.where_behind = None

    def rows(self, top: int, bottom: int, pixels: Pixels) -> list[np.ndarray]:
        """T and V of each light (n, W, 3) float32, as if each pixel showed one thing."""
        y0, x0 = self._before(top, bottom)
        plain = self.cell[y0][:, x0] == pixels.key
        unknown = pixels.key == UNKNOWN
        if unknown.any():
            plain &= ~unknown | _near(pixels.depth, self.small.depth[y0][:, x0])
        values = [bilinear(plane, self.y[top:bottom], self.size[1]) for plane in self.planes]
        at = np.nonzero(~plain)
        for plane, of in zip(values, _planes(self._gathered(top + at[0], at[1], pixels.depth[at], pixels.key[at]))):
            plane[at] = of
        return self._finished(values, pixels.depth, pixels.bare)

    def behind(self, top: int, bottom: int, where: tuple[np.ndarray, np.ndarray], depth: np.ndarray, bare: np.ndarray
               ) -> list[np.ndarray]:
        """The same (k, 3) behind what is in front at pixels `where` (rows, columns) of these rows, up to depth (k,)."""
        rows, columns = where
        unknown = np.full(len(rows), UNKNOWN, np.int32)
        if self.where_behind is None:
            values = self._gathered(top + rows, columns, depth, unknown)
        else:
            y0, x0 = self._before(top, bottom)
            y0, x0 = y0[rows], x0[columns]
            plain = (self.cell_behind[y0, x0] == UNKNOWN) & _near(depth, self.small.behind_depth[y0, x0])
            values = np.concatenate([bilinear(plane, self.y[top:bottom], self.size[1])[where]
                                     for plane in self.planes_behind], -1)
            at = np.flatnonzero(~plain)
            values[at] = self._gathered(top + rows[at], columns[at], depth[at], unknown[at])
        return self._finished(_planes(values), depth, bare)

    def _before(self, top: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows (n,) and columns (W,) of the first of the four small pixels round each pixel."""
        return tuple(np.floor(np.maximum(at, 0)).astype(np.int32) for at in (self.y[top:bottom], self.x))

    def _gathered(self, rows: np.ndarray, columns: np.ndarray, depth: np.ndarray, key: np.ndarray) -> np.ndarray:
        """Weighted means (k, c) of the small pixels round pixels (k,), by how alike they are (joint bilateral)."""
        result = np.empty((len(rows), self.flat.shape[1]), np.float32)
        for first in range(0, len(rows), _PIXELS):
            part = np.s_[first:first + _PIXELS]
            result[part] = self._mean(self.y[rows[part]], self.x[columns[part]], depth[part], key[part])
        return result

    def _mean(self, y: np.ndarray, x: np.ndarray, depth: np.ndarray, key: np.ndarray) -> np.ndarray:
        y0, x0 = np.floor(y).astype(np.int32), np.floor(x).astype(np.int32)
        total, weights = np.zeros((len(y), self.flat.shape[1]), np.float32), np.zeros(len(y), np.float32)
        everywhere = np.arange(len(y))
        for step in NEAREST:
            self._add(total, weights, everywhere, step, y, x, y0, x0, depth, key)
        # where none of the nearest is of this thing, one of those round them may be
        few = np.flatnonzero(weights < ENOUGH)
        for step in FARTHER:
            self._add(total, weights, few, step, y, x, y0, x0, depth, key)
        return total / weights[:, None]

    def _add(self, total, weights, at, step, y, x, y0, x0, depth, key) -> None:
        """Adds the small pixel `step` away from the first of four, and what is behind it, of the pixels `at`."""
        rows, columns = self.small.depth.shape
        row, column = y0[at] + step[0], x0[at] + step[1]
        away_y, away_x = np.abs(row - y[at]), np.abs(column - x[at])
        near = np.maximum(1 - away_y, 0) * np.maximum(1 - away_x, 0) + BEYOND * np.exp(-(away_y**2 + away_x**2))
        index = np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)
        self._add_layer(total, weights, at, index, near, depth, key)
        if self.where_behind is not None:
            behind = self.where_behind[index]
            there = np.flatnonzero(behind)
            self._add_layer(total, weights, at[there], behind[there], near[there], depth, key)

    def _add_layer(self, total, weights, at, index, near, depth, key) -> None:
        if not len(at):
            return
        off = np.abs(self.flat_depth[index] - depth[at]) / (DEPTH_TOLERANCE * depth[at])
        alike = np.exp(-np.minimum(off**2, 80))
        of, wanted = self.flat_key[index], key[at]
        told = (of != UNKNOWN) & (wanted != UNKNOWN)
        alike = np.where(told & (of == wanted), 1, np.where(told, OTHER_SURFACE, 1) * alike)
        # never quite 0, so that the likest neighbour stands where none agrees
        weight = (near * alike + 1e-16 / (1 + np.minimum(off, 1e4) ** 4)).astype(np.float32)
        total[at] += weight[:, None] * self.flat[index]
        weights[at] += weight

    def _finished(self, values: list[np.ndarray], depth: np.ndarray, bare: np.ndarray) -> list[np.ndarray]:
        """T and V of each light at these depths (...) [m]."""
        density, on_the_way, known, *lights = values
        eye, filled = eye_path(self.extinction, density[..., 0], depth)
        on_the_way[bare] = 1
        eye *= on_the_way
        some = known > 1e-35
        filled = np.divide(filled, known, out=filled, where=some)
        filled[~some] = 0
        for light in lights:
            light *= filled
        return [eye, *lights]
