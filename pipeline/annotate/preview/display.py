"""The foggy picture at the size at which it is shown, from maps of a smaller size: a few operations a pixel.

As `physics/enlarging.py` does for results: what is smooth along surfaces is enlarged, and T and V follow the exact depth of
each pixel. Here all that depends on the geometry alone is worked out beforehand.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.annotate.preview.sliders import Maps
from pipeline.imaging.display import displayed
from pipeline.physics.composition import NEAR_WHITE, burnt_out
from pipeline.physics.enlarging import FARTHER, NEAREST, centres
from pipeline.side_by_side import side_by_side

#: Depths that differ by this share belong to different things.
ALIKE = 0.05
#: Steps of linear light from 0 to 1 by which it is encoded for the screen.
CODES = 1 << 14
#: Rows of the picture that are worked on at a time.
ROWS = 64


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
        self.exposure, self.scenery = exposure, scenery
        self.radiance = np.maximum(radiance, 0).astype(np.float32)
        self.depth = scenery.depth.astype(np.float32)
        self.layers = layers
        #: pixels of each lamp that is burnt out, by the light's index
        self.lamps = {index: np.nonzero((scenery.emitter == index) & (clipped | (radiance.min(-1) > NEAR_WHITE)))
                      for index in burnt_out(clipped, scenery.emitter, dict.fromkeys(np.unique(scenery.emitter[scenery.emitter >= 0])))}
        y, x = centres(self.depth.shape, small.depth.shape)
        x, y = np.meshgrid(np.clip(x, 0, small.depth.shape[1] - 1), np.clip(y, 0, small.depth.shape[0] - 1))
        self._keep_apart(x, y, scenery, small)
        self.at = cv2.convertMaps(x, y, cv2.CV_16SC2)
        if layers is not None:
            self.depth[layers.rows, layers.columns] = layers.front_depth

    def _keep_apart(self, x: np.ndarray, y: np.ndarray, scenery: Scenery, small: Scenery) -> None:
        """Moves places (H, W) in the maps, where not all four round them are of the pixel's surface, to the likest one there."""
        rows, columns = small.depth.shape
        x0, y0 = (np.minimum(at.astype(np.int32), max(most - 2, 0)) for at, most in ((x, columns), (y, rows)))
        # of each pixel of the maps: whether it, the next and those below are one surface
        window, border = np.ones((2, 2), np.uint8), {"anchor": (0, 0), "borderType": cv2.BORDER_REPLICATE}
        code = small.key.astype(np.float32)
        one = cv2.erode(code, window, **border) == cv2.dilate(code, window, **border)
        one &= cv2.dilate(small.depth, window, **border) <= (1 + 4 * ALIKE) * cv2.erode(small.depth, window, **border)
        plain = one[y0, x0] & (small.key[y0, x0] == scenery.key) & (
            np.abs(small.depth[y0, x0] - self.depth) <= 4 * ALIKE * self.depth)
        at = np.flatnonzero(~plain)
        if not len(at):
            return
        depth, key, fx, fy, x0, y0 = (values.ravel()[at] for values in (self.depth, scenery.key, x, y, x0, y0))
        best, place = np.full(len(at), np.inf, np.float32), np.zeros(len(at), np.int32)
        flat_depth, flat_key, some = small.depth.ravel(), small.key.ravel(), np.arange(len(at))
        for steps in (NEAREST, FARTHER):
            for dy, dx in steps:
                row, column = np.clip(y0[some] + dy, 0, rows - 1), np.clip(x0[some] + dx, 0, columns - 1)
                index = row * columns + column
                off = np.abs(flat_depth[index] - depth[some]) / (ALIKE * depth[some])
                # another surface as far away is better than the same one elsewhere
                cost = (np.hypot(row - fy[some], column - fx[some]) + 2 * np.minimum(off, 50) + 3 * (flat_key[index] != key[some])
                        ).astype(np.float32)
                better = some[cost < best[some]]
                best[better], place[better] = cost[cost < best[some]], index[cost < best[some]]
            some = np.flatnonzero(best > 3)
        y.ravel()[at], x.ravel()[at] = np.divmod(place, columns)

    def picture(self, maps: Maps, lamps: dict[int, np.ndarray] | None = None, exposure_ev: float = 0.0) -> np.ndarray:
        """(H, W, 3) uint8 sRGB. lamps: radiance (3,) that burnt-out lamps take, by the light's index."""
        even = (maps.density == 1).all()
        on_the_way, filling, foggy = np.empty((3, *self.radiance.shape), np.float32)
        dense = np.float32(1) if even else np.empty(self.depth.shape, np.float32)
        codes, exposure = np.empty(self.radiance.shape, np.uint8), self.exposure * 2.0**exposure_ev

        def work(rows: slice) -> None:
            at = [one[rows] for one in self.at]
            for values, part in ((maps.on_the_way, on_the_way[rows]), (maps.filling, filling[rows])):
                cv2.remap(np.ascontiguousarray(values), *at, cv2.INTER_LINEAR, dst=part)
            on_the_way[rows][self.scenery.bare[rows]] = 1
            thick = self.depth[rows]
            if not even:
                cv2.remap(maps.density, *at, cv2.INTER_LINEAR, dst=dense[rows])
                thick = thick * dense[rows]
            foggy[rows] = _mixed(self.radiance[rows], thick, maps.extinction, on_the_way[rows], filling[rows])
            codes[rows] = _encoded(foggy[rows], exposure)

        # a few rows at a time stay in a processor's cache
        deque(side_by_side(work, (slice(top, top + ROWS) for top in range(0, len(self.depth), ROWS))), 0)
        for index, at in self.lamps.items():
            if index in (lamps or {}):
                bright = np.maximum(self.radiance[at], np.asarray(lamps[index], np.float32))
                thick = dense if even else dense[at]
                foggy[at] = _mixed(bright, self.depth[at] * thick, maps.extinction, on_the_way[at], filling[at])
                codes[at] = _encoded(foggy[at], exposure)
        if self.layers is not None:
            at = self.layers.rows, self.layers.columns
            codes[at] = _encoded(self._layered(maps, on_the_way[at], filling[at], dense if even else dense[at]), exposure)
        return codes

    def _layered(self, maps: Maps, on_the_way: np.ndarray, filling: np.ndarray, thick: np.ndarray) -> np.ndarray:
        """Foggy radiance (n, 3) of the pixels that show two things."""
        layers = self.layers
        share, way = layers.alpha[:, None], np.where(layers.open[:, None], np.float32(1), on_the_way)
        front = _mixed(layers.front, layers.front_depth * thick, maps.extinction, on_the_way, filling)
        behind = _mixed(layers.behind, layers.behind_depth * thick, maps.extinction, way, filling)
        return share * front + (1 - share) * behind


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
        steps = (np.arange(CODES, dtype=np.float32) + np.float32(0.5)) / (CODES - 1)
        _TABLE.append(displayed(np.repeat(steps[None, :, None], 3, -1))[0, :, 0])
    return _TABLE[0]
