"""Light on its way to points inside fog on a grid: its ways worked out once, and looked up from then on.

An eye ray asks at many points how much fog sun, sky or a lamp's light have crossed, and each answer is an integral
through the grid. A lamp's light is followed from it in all directions. Parallel light is followed from the fog's top down, and its path noted level by level: a table over where it enters
and the height, in which all points on one ray of light share one integral.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import scipy

from pipeline.physics.density_grid import DensityGrid

Lookup = Callable[[np.ndarray], np.ndarray]

#: Least sine of the light's elevation: the sun's disc is five times as high, and lower light crosses 1000 times the
#: fog's height.
LOWEST = 1e-3
#: Rays of sunlight a cell, and most of them along an axis; levels at which their paths are noted.
RAYS_PER_CELL, MOST_RAYS, LEVELS = 2.0, 192, 256
#: The same for each of the sky's directions, whose errors average out.
SKY_RAYS_PER_CELL, SKY_MOST_RAYS, SKY_LEVELS = 1.0, 64, 48
#: Nodes of the table of skylight; directions of the sky: Gauss nodes of the sine of elevation, azimuths at each.
SKY_NODES, ELEVATIONS, AZIMUTHS = 2**17, 4, 8

#: Polar angles and distances at which the paths from a lamp are noted; twice as many azimuths. Beyond so many cells the
#: mean density so far stands for the rest.
POLAR, DISTANCES, FARTHEST_CELLS = 128, 160, 1500


def sun_paths(grid: DensityGrid, direction: np.ndarray) -> Lookup:
    """Points (..., 3) [m] -> integral of the density [m] on the way of light that travels along `direction` (3,)."""
    return _followed(grid, direction, RAYS_PER_CELL, MOST_RAYS, LEVELS)


def sky_paths(grid: DensityGrid, extinctions: Sequence[float]) -> list[Lookup]:
    """For each extinction [1/m] a function of points (..., 3) [m]: path [m] straight up through level layers that
    would let through as much of an even sky's light, from all its directions together."""
    directions, weights = _sky()
    ways = [_followed(grid, -one, SKY_RAYS_PER_CELL, SKY_MOST_RAYS, SKY_LEVELS) for one in directions]

    def exact(points: np.ndarray, extinction: float) -> np.ndarray:
        arriving = sum(weight * np.exp(-extinction * way(points)) for way, weight in zip(ways, weights))
        return _as_level(arriving, directions, weights) / extinction

    table = _table(grid, SKY_NODES)
    nodes = _places(table)
    lookups = []
    for value in extinctions:
        filled = replace(table, values=exact(nodes, value).astype(np.float32))

        def at(points: np.ndarray, value: float = value, filled: DensityGrid = filled) -> np.ndarray:
            found, beside = filled.density(points), grid.beside(points)
            if beside.any():
                found[beside] = exact(points[beside], value)
            return found

        lookups.append(at)
    return lookups


def lamp_paths(grid: DensityGrid, position: np.ndarray, reach: float) -> Lookup:
    """Points (..., 3) [m], up to `reach` [m] from `position` (3,) -> integral of the density [m] from there to them."""
    reach = min(reach, FARTHEST_CELLS * float(grid.spacing.min()))
    polar, azimuth = np.linspace(0, np.pi, POLAR), np.linspace(0, 2 * np.pi, 2 * POLAR)
    nearest = min(float(grid.spacing.min()), reach / 2)
    distances = np.geomspace(nearest, reach, DISTANCES)
    sine, cosine = np.sin(polar)[:, None], np.cos(polar)[:, None]
    directions = np.stack(np.broadcast_arrays(sine * np.cos(azimuth), cosine, sine * np.sin(azimuth)), axis=-1)
    paths = grid.path_along(position, directions, np.broadcast_to(distances, (POLAR, 2 * POLAR, DISTANCES)))
    # what is noted is the mean density so far, which has a limit at the lamp itself
    mean = (paths / distances).astype(np.float32)
    steps = np.array([(POLAR - 1) / np.pi, (2 * POLAR - 1) / (2 * np.pi),
                      (DISTANCES - 1) / np.log(reach / nearest)])

    def at(points: np.ndarray) -> np.ndarray:
        x, y, z = np.moveaxis(np.asarray(points, float) - position, -1, 0)
        distance = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12)
        where = np.stack([np.arctan2(np.hypot(x, z), y), np.arctan2(z, x) % (2 * np.pi),
                          np.log(np.maximum(distance / nearest, 1.0))])
        return distance * scipy.ndimage.map_coordinates(mean, (where.T * steps).T, order=1, mode="nearest", prefilter=False)

    return at


def _followed(grid: DensityGrid, direction: np.ndarray, rays_per_cell: float, most: int, levels: int) -> Lookup:
    direction = np.asarray(direction, float)
    direction = np.array([direction[0], min(direction[1], -LOWEST), direction[2]])
    direction /= np.linalg.norm(direction)
    top = grid.first[1] + grid.spacing[1] * (grid.values.shape[1] - 1)
    height = top - grid.first[1]
    back = direction * height / direction[1]
    if grid.periodic[0]:
        frame, low, high = grid, np.zeros(3), grid.spacing * grid.values.shape
        count = np.array(grid.values.shape) * rays_per_cell
    else:
        # along the light its rays lie nearer to each other than their entries do, across it not
        frame = replace(grid, yaw=float(np.degrees(np.arctan2(-direction[2], direction[0]))), spacing=np.ones(3))
        ends = frame.in_cells(grid.corners() - grid.first)
        way = frame.in_cells(back)
        low = ends.min(0) + np.minimum(way, 0) - grid.spacing.max()
        high = ends.max(0) + np.maximum(way, 0) + grid.spacing.max()
        finest = grid.spacing.min()
        count = (high - low) / finest * rays_per_cell * [max(-direction[1], finest / np.ptp(ends[:, 0])), 1, 1]
    count = np.clip(np.ceil(count), 2, most).astype(int)
    count[1] = levels
    spacing = (high - low) / np.where(grid.periodic, count, count - 1)
    low[1], spacing[1] = 0.0, height / (levels - 1)
    table = replace(frame, values=np.zeros(count, np.float32), first=grid.first + frame.turned(low), spacing=spacing,
                    outside=0.0)
    entries = _places(replace(table, values=np.zeros((count[0], 1, count[2]), np.float32)))[:, 0]
    entries[..., 1] = top
    down = np.linspace(0, height, levels) / -direction[1]
    paths = grid.path_along(entries, direction, np.broadcast_to(down, (*entries.shape[:-1], levels)))
    filled = replace(table, values=np.ascontiguousarray(np.moveaxis(paths, -1, 1)[:, ::-1], np.float32))

    def at(points: np.ndarray) -> np.ndarray:
        points = np.asarray(points, float)
        back = (np.minimum(points[..., 1], top) - top) / direction[1]
        entered = points - back[..., None] * direction
        entered[..., 1] = points[..., 1]
        return filled.density(entered)

    return at


def _sky() -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (k, 3) to the sky and the share (k,) of its light that comes from round each."""
    sines, weights = np.polynomial.legendre.leggauss(ELEVATIONS)
    sines, weights = np.repeat((sines + 1) / 2, AZIMUTHS), np.repeat(weights / 2, AZIMUTHS) / AZIMUTHS
    index = np.arange(len(sines))
    azimuths = 2 * np.pi * (index + index // AZIMUTHS % 2 / 2) / AZIMUTHS
    level = np.sqrt(1 - sines**2)
    return np.stack([level * np.cos(azimuths), sines, level * np.sin(azimuths)], -1), weights


def _as_level(arriving: np.ndarray, directions: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Optical depth (...) straight up of level layers that let through the share `arriving` (...) of skylight.

    Level layers are summed over the same directions, so that how few those are hardly matters.
    """
    depths = np.append(0.0, np.geomspace(1e-6, 60.0, 600))
    through = np.exp(-depths[:, None] / directions[:, 1]) @ weights
    return np.interp(-np.log(np.maximum(arriving, 1e-300)), -np.log(through), depths)


def _table(grid: DensityGrid, most: int) -> DensityGrid:
    """An empty grid over the same space, of about so many nodes at most."""
    shape, periodic = np.array(grid.values.shape), np.array(grid.periodic)
    # a periodic axis ends one cell behind its last node
    cells = np.where(periodic, shape, shape - 1)
    fewer = np.maximum(np.floor(cells / max(1.0, (np.prod(shape, dtype=float) / most) ** (1 / 3))), 1).astype(int)
    return replace(grid, values=np.zeros(np.where(periodic, fewer, fewer + 1), np.float32),
                   spacing=grid.spacing * cells / fewer, outside=0.0)


def _places(table: DensityGrid) -> np.ndarray:
    """Where the nodes stand, (nx, ny, nz, 3) [m]."""
    return table.first + table.turned(np.moveaxis(np.indices(table.values.shape), 0, -1) * table.spacing)
