"""The foggy picture at the size at which it is shown, from maps of a smaller size: a few operations a pixel.

As `physics/enlarging.py` does for results: what is smooth along surfaces is enlarged, and T and V follow the exact depth of
each pixel. Here all that depends on the geometry alone is worked out beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.annotate.sliders import Maps
from pipeline.physics.composition import burnt_out, restored
from pipeline.physics.enlarging import centres

#: Depths that differ by this share belong to different things.
ALIKE = 0.05
#: Steps of linear light from 0 to 1 by which it is encoded for the screen.
CODES = 1 << 14


@dataclass(frozen=True)
class Scenery:
    """What pixels show, at the size of the picture (H, W) or of the maps (h, w).

    depth [m]; key: equal where pixels show one surface. bare: lamps and open sky, of which only the way to the eye counts;
    emitter: index of the light that is seen, -1 for none.
    """

    depth: np.ndarray
    key: np.ndarray
    bare: np.ndarray
    emitter: np.ndarray


@dataclass(frozen=True)
class Layers:
    """Pixels at rows and columns (n,) that show two things: a share alpha (n,) of `front` (n, 3) at front_depth (n,) [m], the
    rest of `behind`, at behind_depth; open: whether that is the open sky."""

    rows: np.ndarray
    columns: np.ndarray
    alpha: np.ndarray
    front_depth: np.ndarray
    behind_depth: np.ndarray
    front: np.ndarray
    behind: np.ndarray
    open: np.ndarray


class Display:
    """Makes foggy pictures of one geometry."""

    def __init__(self, radiance: np.ndarray, clipped: np.ndarray, exposure: float, scenery: Scenery, small: Scenery,
                 layers: Layers | None = None):
        self.clipped, self.exposure, self.scenery = clipped, exposure, scenery
        self.radiance = np.maximum(radiance, 0).astype(np.float32)
        self.depth = scenery.depth.astype(np.float32)
        self.layers = layers
        y, x = centres(self.depth.shape, small.depth.shape)
        self.at = np.meshgrid(np.clip(x, 0, small.depth.shape[1] - 1), np.clip(y, 0, small.depth.shape[0] - 1))
        self._keep_apart(scenery, small)
        if layers is not None:
            self.depth[layers.rows, layers.columns] = layers.front_depth

    def _keep_apart(self, scenery: Scenery, small: Scenery) -> None:
        """Of pixels not all of whose four neighbours in the maps are of their surface takes the likest one round there."""
        x, y = self.at
        x0, y0 = (np.minimum(np.floor(at).astype(np.int32), max(most - 2, 0)) for at, most in zip((x, y), small.depth.shape[::-1]))
        plain = np.ones(self.depth.shape, bool)
        for dy in (0, 1):
            for dx in (0, 1):
                near = (np.minimum(y0 + dy, small.depth.shape[0] - 1), np.minimum(x0 + dx, small.depth.shape[1] - 1))
                plain &= (small.key[near] == scenery.key) & (np.abs(small.depth[near] - self.depth) <= 2 * ALIKE * self.depth)
        rows, columns = np.nonzero(~plain)
        if not len(rows):
            return
        depth, key = self.depth[rows, columns], scenery.key[rows, columns]
        best, place = np.full(len(rows), np.inf, np.float32), np.zeros((2, len(rows)), np.float32)
        fx, fy = x[rows, columns], y[rows, columns]
        for dy in (-1, 0, 1, 2):
            for dx in (-1, 0, 1, 2):
                row = np.clip(y0[rows, columns] + dy, 0, small.depth.shape[0] - 1)
                column = np.clip(x0[rows, columns] + dx, 0, small.depth.shape[1] - 1)
                off = np.abs(small.depth[row, column] - depth) / (ALIKE * depth)
                # another surface as far away is better than the same one elsewhere
                cost = np.hypot(row - fy, column - fx) + 2 * np.minimum(off, 50) + 3 * (small.key[row, column] != key)
                better = cost < best
                best = np.where(better, cost, best)
                place = np.where(better, np.stack([column, row]).astype(np.float32), place)
        x[rows, columns], y[rows, columns] = place

    def picture(self, maps: Maps, lamps: dict[int, np.ndarray] | None = None, exposure_ev: float = 0.0) -> np.ndarray:
        """(H, W, 3) uint8 sRGB. lamps: radiance (3,) that burnt-out lamps take, by the light's index."""
        enlarged = [cv2.remap(values, *self.at, cv2.INTER_LINEAR) for values in (maps.on_the_way, maps.filling)]
        on_the_way, filling = enlarged
        on_the_way[self.scenery.bare] = 1
        density = maps.density
        dense = np.float32(1) if (density == density.flat[0]).all() and density.flat[0] == 1 else cv2.remap(
            density, *self.at, cv2.INTER_LINEAR).reshape(self.depth.shape)
        radiance = self.radiance
        if lamps and (lamps := burnt_out(self.clipped, self.scenery.emitter, lamps)):
            radiance = restored(radiance.copy(), self.clipped, self.scenery.emitter, lamps)
        foggy = _mixed(radiance, self.depth * dense, maps.extinction, on_the_way, filling)
        if self.layers is not None:
            self._add_layers(foggy, maps, on_the_way, filling, dense)
        return _encoded(foggy, self.exposure * 2.0**exposure_ev)

    def _add_layers(self, foggy: np.ndarray, maps: Maps, on_the_way: np.ndarray, filling: np.ndarray, dense: np.ndarray) -> None:
        layers = self.layers
        at = layers.rows, layers.columns
        share, thick = layers.alpha[:, None], dense if np.ndim(dense) == 0 else dense[at]
        way = np.where(layers.open[:, None], np.float32(1), on_the_way[at])
        front = _mixed(layers.front, layers.front_depth * thick, maps.extinction, on_the_way[at], filling[at])
        behind = _mixed(layers.behind, layers.behind_depth * thick, maps.extinction, way, filling[at])
        foggy[at] = share * front + (1 - share) * behind


def _mixed(radiance: np.ndarray, path: np.ndarray, extinction: np.ndarray, on_the_way: np.ndarray, filling: np.ndarray
           ) -> np.ndarray:
    """R T + V (..., 3) float32 behind a path (...) [m] of fog as dense as stated."""
    if np.ptp(extinction) == 0:
        eye = np.exp(path * np.float32(-extinction[0]))[..., None]
    else:
        eye = np.exp(path[..., None] * -np.asarray(extinction, np.float32))
    foggy = radiance * on_the_way
    foggy -= filling
    foggy *= eye
    foggy += filling
    return foggy


def _encoded(linear: np.ndarray, exposure: float) -> np.ndarray:
    """As `imaging.display.displayed`, by a table."""
    codes = np.clip(linear * np.float32(exposure * (CODES - 1)), 0, CODES - 1).astype(np.uint16)
    return _table()[codes]


_TABLE: list[np.ndarray] = []


def _table() -> np.ndarray:
    if not _TABLE:
        from pipeline.imaging.display import displayed

        steps = (np.arange(CODES, dtype=np.float32) + np.float32(0.5)) / (CODES - 1)
        _TABLE.append(displayed(np.repeat(steps[None, :, None], 3, -1))[0, :, 0])
    return _TABLE[0]
