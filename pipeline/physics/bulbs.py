"""In-scattering V of point and spot lamps over a photograph, without shadows, and what of their light arrives at surfaces.

V = S / H with H the distance at which a ray passes the lamp and S smooth over the photograph (`bulb_integral`), which
lets hundreds of lamps be summed from a coarse grid of rays.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.physics.bulb_integral import Cone, Lamp, smooth_part
from pipeline.side_by_side import side_by_side

#: Gauss-Legendre nodes of each piece of a ray of the coarse grid.
NODES_COARSE = 6
#: Pixels a step of the coarse grid; coarse steps round a lamp in which every ray is exact, and in which 1 / H is.
COARSE, EXACT, FINE = 8, 4, 12
#: Logarithms of depth: so near, a ray serves a pixel beside it as it is, on a plane even at STEEP; else the ray is asked
#: for depths a RUNG apart.
SAME_DEPTH, STEEP, RUNG = 0.02, 0.05, 0.05
#: At most one further depth for so many pixels.
MOST_FURTHER = 6
_LIFT = 2**20
#: Points at once: a few arrays of so many float64 stay in the processor's cache.
_AT_ONCE = 2**15
#: Rows a step where the density jumps by more than that at a height, for seen from afar a layer is thin; of any layered
#: fog's rows, a step at most, as a part of their elevation.
COARSE_IN_LAYERS, LARGEST_JUMP, ROWS_PER_ELEVATION = 2, 0.05, 0.25
#: Fewer rays than this are all exact.
FEW_RAYS = 20000
#: Lamps behind more optical depths than this are left out: exp(-16) is 1e-7.
UNSEEN = 16.0


def bulb(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, position: np.ndarray,
         radius: float, cone: Cone | None = None) -> np.ndarray:
    """V (..., 3) at unit intensity of a lamp at `position` (3,) [m], along unit rays (..., 3) to `depth` (...)."""
    smooth, width = smooth_part(medium, eye, np.reshape(directions, (-1, 3)), np.reshape(depth, -1).astype(float),
                                Lamp(np.asarray(position, float), radius, cone))
    return (smooth / width[:, None]).reshape(*np.shape(depth), 3)


def bulbs(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, positions: np.ndarray,
          radius: float, weights: np.ndarray) -> np.ndarray:
    """V (..., 3) of lamps at positions (n, 3) of intensities `weights` (n,), all of one radius.

    Over a whole photograph, (H, W), V comes from every COARSE-th ray; nearer to each lamp only its smooth part S
    does, and next to it every ray is exact. What lies behind UNSEEN optical depths is left out.
    """
    seen = np.flatnonzero(visible(medium, eye, positions) & (np.asarray(weights) > 0))
    if np.ndim(depth) != 2 or np.size(depth) < FEW_RAYS:
        each = side_by_side(lambda i: weights[i] * bulb(medium, eye, directions, depth, positions[i], radius), seen)
        return sum(each, np.zeros((*np.shape(depth), 3)))
    grid = _grid_of(directions, depth, medium)
    rays, ends = grid.directions, grid.depth
    several = any(np.ptp(one) > 0 for one in medium.coefficients())
    kept = 3 if several else 1
    coarse, fine = np.zeros((len(ends), kept)), np.zeros((*depth.shape, kept))

    def of(i: int):
        """V of one lamp on the grid's rays, and what it is more than that near the lamp, where that is in the picture."""
        position = np.asarray(positions[i], float)
        smooth, width = smooth_part(medium, eye, rays, ends, Lamp(position, radius), NODES_COARSE)
        smooth = weights[i] * smooth[:, :kept]
        near = grid.around(position - eye, FINE)
        if near is None:
            return smooth / width[:, None], None, None
        foot = directions[near] @ (position - eye)
        width_near = np.sqrt(np.maximum(((position - eye) ** 2).sum() - foot**2, 0) + radius**2)
        one = grid.enlarged(smooth, near) / width_near[..., None]
        core = _core(near, grid.around(position - eye, EXACT))
        one[core] = weights[i] * bulb(medium, eye, directions[near][core], depth[near][core], position, radius)[..., :kept]
        return smooth / width[:, None], near, one - grid.enlarged(smooth / width[:, None], near)

    for far, near, more in side_by_side(of, seen):
        coarse += far
        if near is not None:
            fine[near] += more
    return np.broadcast_to(fine + grid.enlarged(coarse, ...), (*depth.shape, 3))


def visible(medium: Any, eye: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Which lamps (n,) are not hidden by the fog before them, whatever surface may hide them.

    Light may come round the thickest fog: by way of a point beside or above, where it is scattered.
    """
    eye, positions = np.asarray(eye, float), np.reshape(np.asarray(positions, float), (-1, 3))
    extinction = np.add(*medium.coefficients()).min()
    depth = extinction * medium.density_path(eye, positions)
    middle, offset = (eye + positions) / 2, positions - eye
    distance = np.linalg.norm(offset, axis=-1, keepdims=True)
    aside = np.cross(offset, [0.0, 1.0, 0.0]) / np.maximum(distance, 1e-12)
    ways = [middle + side * 0.25 * distance * one for one in (aside, np.array([0.0, 1.0, 0.0])) for side in (-1, 1)]
    for height in medium.bends():
        ways += [np.stack(np.broadcast_arrays(one[..., 0], height, one[..., 2]), -1) for one in (eye, middle, positions)]
    for way in ways:
        # thin fog there scatters little
        thin = -np.log(np.clip(medium.density(way), 1e-300, 1.0))
        depth = np.minimum(depth, extinction * (medium.density_path(eye, way) + medium.density_path(positions, way)) + thin)
    return depth < UNSEEN


def arrival(medium: Any, points: np.ndarray, normals: np.ndarray, positions: np.ndarray, radius: float,
            weights: np.ndarray, cone: Cone | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance (...) of all lamps at surface points (..., 3), and the share (..., 3) of it that fog lets through.

    Behind a surface's horizon a lamp counts a fiftieth, as what arrives by reflection: no point may get nothing.
    """
    extinction = np.add(*medium.coefficients())
    values = np.unique(extinction)
    flat, facing = (np.ascontiguousarray(np.reshape(one, (-1, 3)).T, float) for one in (points, normals))
    total, through = np.zeros(flat.shape[1]), np.zeros((len(values), flat.shape[1]))
    reach = float(np.abs(flat).max(initial=0.0) + np.abs(positions).max()) * 2
    for position, weight in zip(np.asarray(positions, float), weights):
        from_lamp = medium.paths_from(position, reach, flat.shape[1])
        for first in range(0, flat.shape[1], _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            x, y, z = position[:, None] - flat[:, part]
            squared = x * x + y * y + z * z
            distance = np.sqrt(np.maximum(squared, 1e-24))
            normal = facing[:, part]
            cosine = (x * normal[0] + y * normal[1] + z * normal[2]) / distance
            one = weight * np.maximum(cosine, 0.02) / (squared + radius**2)
            if cone is not None:
                axial = -(x * cone.axis[0] + y * cone.axis[1] + z * cone.axis[2])
                one *= np.maximum(cone.share(axial / distance), 1e-3)
            total[part] += one
            path = (medium.between(position[1], flat[1, part], distance) if medium.layered
                    else from_lamp(flat[:, part].T))
            for k, value in enumerate(values):
                through[k, part] += one * np.exp(-value * path)
    share = (through / np.maximum(total, 1e-300))[np.searchsorted(values, extinction)]
    return total.reshape(points.shape[:-1]), np.moveaxis(share.reshape(3, *points.shape[:-1]), 0, -1)


# --- many lamps over a photograph -----------------------------------------------------------------------------


def _core(outer: tuple[slice, slice], inner: tuple[slice, slice]) -> tuple[slice, slice]:
    """Slices of `inner` counted from where `outer` begins."""
    return tuple(slice(i.start - o.start, i.stop - o.start) for o, i in zip(outer, inner))


_LAST: dict[str, Any] = {}


def _grid_of(directions: np.ndarray, depth: np.ndarray, medium: Any) -> _Coarse:
    """The grid of a photograph; the last one is kept, for each of its lights asks for the same."""
    heights = np.array(medium.bends())
    jumps = heights.size and np.ptp([medium.level_density(heights + side * 1e-9 * np.maximum(np.abs(heights), 1))
                                     for side in (-1, 1)], axis=0).max() > LARGEST_JUMP
    key = (directions, depth, heights.size > 0, COARSE_IN_LAYERS if jumps else COARSE)
    if not all(one is other for one, other in zip(_LAST.get("key", (None,) * 4), key)):
        _LAST.update(key=key, grid=_Coarse(*key))
    return _LAST["grid"]


def _rows(directions: np.ndarray, layered: bool, most: int) -> np.ndarray:
    """Rows (n,) of the coarse grid, at most `most` apart; in layers less near the horizon, for how far a ray goes in one
    is 1 / its elevation."""
    height = len(directions)
    if not layered or height < 2:
        return np.arange(0, height, most)
    elevation = np.abs(directions[..., 1])
    step = np.abs(np.diff(directions[:, directions.shape[1] // 2, 1])).max()
    allowed = np.clip(ROWS_PER_ELEVATION * elevation.min(axis=1) / max(step, 1e-12), 1, most).astype(int)
    rows = [0]
    while rows[-1] < height - 1:
        last = rows[-1]
        ahead = np.arange(last + 1, min(last + most, height - 1) + 1)
        # as far as every row up to there allows
        reach = ahead[np.minimum.accumulate(allowed[ahead]) >= ahead - last]
        rows.append(int(reach[-1]) if len(reach) else last + 1)
    return np.array(rows)


def _steps(places: np.ndarray, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of the coarse grid along an axis; for each pixel the step it is in and how far, from 0 to 1."""
    places = np.unique(np.append(places, length - 1))
    if len(places) == 1:
        places = np.append(places, places)
    step = np.clip(np.searchsorted(places, np.arange(length), side="right") - 1, 0, len(places) - 2)
    return places, step, (np.arange(length) - places[step]) / np.maximum(np.diff(places)[step], 1)


def _with(tap: np.ndarray, where: np.ndarray, values: np.ndarray) -> np.ndarray:
    tap = tap.copy()
    tap[where] = values
    return tap


class _Coarse:
    """Every COARSE-th ray of a photograph, to about the depths at which pixels round it end, and what brings values of
    those back to the pixels: each lies between four rays, and between two depths of each."""

    def __init__(self, directions: np.ndarray, depth: np.ndarray, layered: bool = False, rows: int = COARSE):
        self.shape = depth.shape
        self.rows, y, fy = _steps(_rows(directions, layered, rows), depth.shape[0])
        self.columns, x, fx = _steps(np.arange(0, depth.shape[1], COARSE), depth.shape[1])
        at = np.ix_(self.rows, self.columns)
        self.grid, self.middle = directions[at], directions[depth.shape[0] // 2, depth.shape[1] // 2]
        # a depth of nothing has a logarithm, too
        depth = np.maximum(depth, 1e-12)
        own = depth[at]
        nearest = [np.ravel_multi_index(np.broadcast_arrays((y + dy)[:, None], (x + dx)[None]), own.shape)
                   for dy in (0, 1) for dx in (0, 1)]
        weights = [np.abs(1 - dy - fy)[:, None] * np.abs(1 - dx - fx)[None] for dy in (0, 1) for dx in (0, 1)]
        # on a plane the inverse of depth is linear over the picture; where it is not, or where the plane is steep,
        # each ray is asked for the two depths of a ladder between which the pixel's lies
        inverse = sum(weight / own.ravel()[tap] for weight, tap in zip(weights, nearest))
        plane = np.abs(inverse * depth - 1) < SAME_DEPTH
        logarithm = np.log(depth)
        off = np.max([np.where(weight > 0, np.abs(np.log(own.ravel()[tap]) - logarithm), 0.0)
                      for tap, weight in zip(nearest, weights)], axis=0)
        coarser = 1
        while True:
            share, rung = np.modf(logarithm / (coarser * RUNG) + _LIFT)
            far = off > coarser * np.where(plane, STEEP, SAME_DEPTH)
            keys = np.stack([tap[far] * 2 * _LIFT + rung[far].astype(np.int64) for tap in nearest])
            further, index = np.unique(np.stack([keys, keys + 1]), return_inverse=True)
            # leaves before the sky have a depth at every pixel: then less accuracy must do
            if len(further) * MOST_FURTHER < depth.size or coarser > 30:
                break
            coarser *= 2
        self.directions = np.concatenate([self.grid.reshape(-1, 3), self.grid.reshape(-1, 3)[further // (2 * _LIFT)]])
        self.depth = np.concatenate([own.ravel(), np.exp((further % (2 * _LIFT) - _LIFT) * coarser * RUNG)])
        index = own.size + index.reshape(2, 4, -1)
        self.taps = []
        for tap, weight, lower, upper in zip(nearest, weights, *index):
            lower, upper = (_with(tap, far, one) for one in (lower, upper))
            self.taps += [(lower, weight * np.where(far, 1 - share, 1.0)), (upper, weight * np.where(far, share, 0.0))]

    def enlarged(self, values: np.ndarray, where) -> np.ndarray:
        """Values (n, c) of all rays of the grid at the pixels `where` of the photograph, (..., c)."""
        return sum(weight[where][..., None] * values[tap[where]] for tap, weight in self.taps)

    def around(self, towards: np.ndarray, steps: int):
        """Slices of the pixels within so many coarse steps of direction `towards` (3,), None outside the frame."""
        if towards @ self.middle <= 0:
            return None
        unit = towards / np.linalg.norm(towards)
        row, column = np.unravel_index(np.argmax(self.grid @ unit), self.grid.shape[:2])
        row, column, reach = self.rows[row], self.columns[column], steps * COARSE
        return (slice(max(row - reach, 0), min(row + reach + 1, self.shape[0])),
                slice(max(column - reach, 0), min(column + reach + 1, self.shape[1])))
