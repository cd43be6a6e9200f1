"""Relative density of fog on a regular grid: trilinear lookup, and its integrals along rays.

The conventions are those of POV-Ray's `density_file` with `interpolate 1` (measured with 3.7.0.10): value
[i, j, k] stands at the node (i, j, k) * spacing, between nodes it is trilinear, along a periodic axis the
node after the last is the first again. What is bounded along an axis holds the value `outside` at both ends
of it, so that there is no jump there in either program.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

#: A step for values of any kind: the density may bend at every face of a cell.
CELLS_PER_STEP = 0.5
#: Rays that cross fewer cells take a step for each.
SHORT = 96
#: Most steps of one ray: a longer one is sampled more coarsely, its steps' errors average out.
MOST_STEPS = 1024
#: Rays looked up at once: arrays of them stay in the processor's cache.
BLOCK = 16384
#: A path that never leaves the grid ends here [m].
FARTHEST = 1e7
#: Density files hold 16 bits.
LEVELS = 65535


@dataclass(frozen=True)
class DensityGrid:
    """Relative density at nodes; everywhere by trilinear interpolation.

    values (nx, ny, nz) float32, axes along x, y (up), z before the turn. first (3,) [m]: where node
    (0, 0, 0) stands. spacing (3,) [m]. periodic: by axis. outside: relative density beyond a bounded axis.
    yaw [degree]: turn about the vertical through the first node, from z towards x. cells_per_step: how many
    cells a midpoint step may span on long rays, whose errors average out; smooth values need fewer.
    """

    values: np.ndarray
    first: np.ndarray
    spacing: np.ndarray
    periodic: tuple[bool, bool, bool]
    outside: float = 0.0
    yaw: float = 0.0
    cells_per_step: float = CELLS_PER_STEP

    def moved(self, offset: np.ndarray) -> DensityGrid:
        """The same grid displaced by `offset` (3,) [m]."""
        return replace(self, first=self.first + offset)

    def density(self, points: np.ndarray) -> np.ndarray:
        """Relative density (...) at points (..., 3) [m]."""
        points = np.asarray(points, float)
        flat, result = points.reshape(-1, 3), np.empty(points.size // 3)
        for block in _blocks(np.arange(len(flat))):
            result[block] = self._looked_up(self.in_cells(flat[block] - self.first).T)
        return result.reshape(points.shape[:-1])

    def path(self, origin: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Integral of the relative density [m], (...), from origin, (3,) or (..., 3), to points (..., 3)."""
        way = np.asarray(points, float) - origin
        length = np.linalg.norm(way, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            directions = np.where(length[..., None] > 0, way / length[..., None], [0.0, 0.0, 1.0])
        return self.path_along(origin, directions, length[..., None])[..., 0]

    def path_along(self, origin: np.ndarray, directions: np.ndarray, distances: np.ndarray) -> np.ndarray:
        """Integral of the relative density [m], (..., n), from origin to (..., n) rising distances [m].

        origin (3,) or (..., 3), directions (..., 3) of unit length. Midpoint rule, once along each ray, on
        that part of it that lies in the grid; beyond it the density is constant.
        """
        distances = np.minimum(np.asarray(distances, float), FARTHEST)
        shape = np.broadcast_shapes(np.shape(directions)[:-1], distances.shape[:-1], np.shape(origin)[:-1])
        count = distances.shape[-1]
        distances = np.broadcast_to(distances, (*shape, count)).reshape(-1, count)
        start = np.asarray(origin, float) - self.first
        starts = self.in_cells(np.broadcast_to(start, (*shape, 3)).reshape(-1, 3))
        slopes = self.in_cells(np.broadcast_to(directions, (*shape, 3)).reshape(-1, 3))
        enter, leave = self._part_inside(starts, slopes)
        enter = np.clip(enter, 0.0, distances[:, -1])
        leave = np.clip(leave, enter, distances[:, -1])
        cells = np.linalg.norm(slopes, axis=-1)  # a metre
        result = np.empty(distances.shape)
        # rays alike in length together, so that a short one does not wait for the steps of a long one
        for block in _blocks(np.argsort((leave - enter) * cells)):
            stops = np.clip(distances[block], enter[block, None], leave[block, None])
            begins = np.concatenate([enter[block, None], stops[:, :-1]], axis=1)
            inside = self._integrals(starts[block].T, slopes[block].T, begins, stops - begins, cells[block])
            result[block] = np.cumsum(inside, axis=1)
            result[block] += self.outside * (distances[block] - (stops - enter[block, None]))
        return result.reshape(*shape, count)

    def path_out(self, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Integral of the relative density [m], (...), on the way of light that comes to points (..., 3) from
        beyond the grid, travelling along `direction`, (3,) or (..., 3)."""
        shape = np.broadcast_shapes(np.shape(points), np.shape(direction))
        back = -np.broadcast_to(direction, shape)
        return self.path_along(points, back, np.full((*shape[:-1], 1), FARTHEST))[..., 0]

    def corners(self) -> np.ndarray:
        """Places (8, 3) [m] of the outermost nodes."""
        last = (np.array(self.values.shape) - 1) * self.spacing
        return self.first + self.turned(np.indices((2, 2, 2)).reshape(3, 8).T * last)

    def beside(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., 3) [m] lie beyond a bounded axis, (...)."""
        nodes = self.in_cells(np.reshape(np.asarray(points, float) - self.first, (-1, 3)))
        beyond = (nodes < 0) | (nodes > np.array(self.values.shape) - 1)
        return (beyond & ~np.array(self.periodic)).any(-1).reshape(np.shape(points)[:-1])

    def encoded(self) -> np.ndarray:
        """The values as whole numbers, (nx, ny, nz) uint16, from `first_level` to LEVELS."""
        low, high = self.bounds
        share = (self.values.astype(float) - low) / (high - low) if high > low else np.ones(self.values.shape)
        return np.rint(self.first_level + share * (LEVELS - self.first_level)).astype(np.uint16)

    def rounded(self) -> DensityGrid:
        """The same with values that 16 bits hold, so that a density file says exactly the same."""
        low, high = self.bounds
        share = (self.encoded().astype(float) - self.first_level) / (LEVELS - self.first_level)
        return replace(self, values=(low + share * (high - low)).astype(np.float32))

    @cached_property
    def bounds(self) -> tuple[float, float]:
        return float(self.values.min()), float(self.values.max())

    @property
    def first_level(self) -> int:
        """Level of the lowest value. 0 stands for `outside`; where that is not the lowest, it stays apart."""
        return 0 if all(self.periodic) or self.bounds[0] == np.float32(self.outside) else 2

    def in_cells(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) [m] in cells of the turned grid."""
        cosine, sine = np.cos(np.radians(self.yaw)), np.sin(np.radians(self.yaw))
        x, y, z = np.moveaxis(vectors, -1, 0)
        return np.stack([x * cosine - z * sine, y, x * sine + z * cosine], axis=-1) / self.spacing

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) [m] along the grid's own axes, in the world."""
        cosine, sine = np.cos(np.radians(self.yaw)), np.sin(np.radians(self.yaw))
        x, y, z = np.moveaxis(vectors, -1, 0)
        return np.stack([x * cosine + z * sine, y, -x * sine + z * cosine], axis=-1)

    def _part_inside(self, starts: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] at which rays enter and leave the bounded axes; leave <= enter where they miss."""
        enter, leave = np.full(len(starts), -np.inf), np.full(len(starts), np.inf)
        for axis in range(3):
            if self.periodic[axis]:
                continue
            faces = np.array([[0.0], [self.values.shape[axis] - 1.0]])
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = (faces - starts[:, axis]) / slopes[:, axis]
            ends = np.where(np.isnan(ends), 0.0, ends)  # along a face, on which the density is that outside
            enter, leave = np.maximum(enter, ends.min(0)), np.minimum(leave, ends.max(0))
        return enter, leave

    def _integrals(self, starts, slopes, begins, lengths, cells) -> np.ndarray:
        """Integrals (N, n) over the intervals from `begins` (N, n) [m]; starts, slopes (3, N) in cells."""
        result = np.empty(begins.shape)
        crossed = float((lengths.sum(axis=1) * cells).max(initial=0.0))
        wanted = self.cells_per_step if crossed > SHORT else min(1.0, self.cells_per_step)
        cells_per_step = max(wanted, crossed / MOST_STEPS)
        for i in range(begins.shape[1]):
            spanned = float((lengths[:, i] * cells).max(initial=0.0))
            steps = max(1, int(np.ceil(spanned / cells_per_step)))
            total = np.zeros(len(begins))
            for k in range(steps):
                middle = begins[:, i] + lengths[:, i] * ((k + 0.5) / steps)
                total += self._looked_up(starts + slopes * middle)
            result[:, i] = total * lengths[:, i] / steps
        return result

    def _looked_up(self, nodes: np.ndarray) -> np.ndarray:
        for axis in range(3):
            if not self.periodic[axis]:
                nodes[axis] = np.clip(nodes[axis], 0.0, self.values.shape[axis] - 1.0)
        return scipy.ndimage.map_coordinates(self.values, nodes, np.float32, order=1, mode="grid-wrap", prefilter=False)


def bounded(cells: np.ndarray, lower: np.ndarray, size: np.ndarray, outside: float, yaw: float
            ) -> DensityGrid:
    """A box of cells (nx, ny, nz) whose values stand at their cells' centres, turned about its corner.

    It fades to `outside` between the outermost centres and those of the cells that would follow beyond the
    box. lower (3,) [m]: the corner; size (3,) [m]: along the box's own axes.
    """
    spacing = np.asarray(size, float) / cells.shape
    values = np.pad(cells.astype(np.float32), 1, constant_values=np.float32(outside))
    cosine, sine = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    x, y, z = -spacing / 2
    first = np.asarray(lower, float) + [x * cosine + z * sine, y, -x * sine + z * cosine]
    return DensityGrid(values, first, spacing, (False, False, False), outside, yaw, CELLS_PER_STEP)


def density_file(grid: DensityGrid) -> bytes:
    """A grid in POV-Ray's df3 format, 16 bits a value: three sizes, then values, x fastest; big-endian."""
    levels = grid.encoded()
    return np.array(levels.shape, ">u2").tobytes() + levels.transpose(2, 1, 0).astype(">u2").tobytes()


def read_density_file(data: bytes) -> np.ndarray:
    """Values (nx, ny, nz) from 0 to 1 of a df3 file; ValueError where it is none."""
    sizes = np.frombuffer(data[:6], ">u2").astype(int) if len(data) >= 6 else np.zeros(3, int)
    count = int(np.prod(sizes))
    width = (len(data) - 6) / count if count else 0
    if width not in (1, 2, 4):
        raise ValueError(f"{len(data)} bytes are no df3 file of {' x '.join(map(str, sizes))} values")
    values = np.frombuffer(data, f">u{int(width)}", count, 6).reshape(sizes[::-1]).transpose(2, 1, 0)
    return values.astype(float) / (256 ** int(width) - 1)


def _blocks(order: np.ndarray) -> Iterator[np.ndarray]:
    for begin in range(0, len(order), BLOCK):
        yield order[begin:begin + BLOCK]
