"""Area emitters as grids of small ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from shapely.geometry import Polygon, box

from pipeline.geometry.planes import polygon_normal


def polygon_cells(polygon: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Centroids (n, 3) [m] and areas (n,) [m^2] of a polygon cut into about count^2 cells.

    The grid follows the polygon's smallest bounding rectangle and its cells are as square as their
    number allows, for a cell's error grows with its longer side; cells outside the polygon are left out.
    POV-Ray's own `area_light` softens shadows only (its fading, cone and scattering are those of the
    centre), hence explicit sub-lights.
    """
    edge = polygon[1] - polygon[0]
    along = edge / np.linalg.norm(edge)
    across = np.cross(polygon_normal(polygon), along)
    flat = Polygon(np.stack([(polygon - polygon[0]) @ along, (polygon - polygon[0]) @ across], 1))
    rectangle = np.asarray(flat.minimum_rotated_rectangle.exterior.coords)[:4]
    side_a, side_b = rectangle[1] - rectangle[0], rectangle[3] - rectangle[0]
    to_unit = np.linalg.inv(np.stack([side_a, side_b], 1))
    unit = Polygon((np.asarray(flat.exterior.coords)[:, :2] - rectangle[0]) @ to_unit.T)
    aspect = np.linalg.norm(side_a) / np.linalg.norm(side_b)
    columns = int(np.clip(round(count * np.sqrt(aspect)), 1, count * count))
    rows = max(1, round(count * count / columns))
    centres, areas = [], []
    for i in range(columns):
        for j in range(rows):
            cell = unit.intersection(box(i / columns, j / rows, (i + 1) / columns, (j + 1) / rows))
            if cell.area > 1e-6 / (columns * rows):
                centres.append([cell.centroid.x, cell.centroid.y])
                areas.append(cell.area)
    on_plane = np.asarray(centres) @ np.stack([side_a, side_b]) + rectangle[0]
    scale = abs(float(np.cross(np.append(side_a, 0), np.append(side_b, 0))[2]))
    world = polygon[0] + on_plane[:, :1] * along + on_plane[:, 1:] * across
    return world, np.asarray(areas) * scale


def emitted_way(centres: np.ndarray, areas: np.ndarray, normal: np.ndarray, points: np.ndarray, normals: np.ndarray,
                extinction: np.ndarray, path: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Transmittance (..., 3) of light from a Lambertian emitter's cells to surface points, averaged by irradiance.

    centres (n, 3) [m], areas (n,) [m^2], normal (3,) of the emitter; points, normals (..., 3) of the surfaces;
    extinction (3,) [1/m]; path: integral of the fog's relative density between points [m]. The light's area in
    Zhao et al. 2013, eq. 5.
    """
    values, channel = np.unique(extinction, return_inverse=True)
    shape = np.shape(points)[:-1]
    total, arriving = np.zeros((len(values), *shape)), np.full(shape, 1e-300)
    for centre, area in zip(centres, areas):
        way = points - centre
        squared = np.maximum(np.einsum("...i,...i->...", way, way), 1e-300)
        # grazing and backward ways keep a trace: every point gets a mean
        leaving = np.maximum(way @ normal, 1e-3 * np.sqrt(squared))
        arriving_at = np.maximum(-np.einsum("...i,...i->...", way, normals), 1e-3 * np.sqrt(squared))
        share = area * leaving * arriving_at / squared**2
        crossed = path(np.broadcast_to(centre, points.shape), points)
        arriving += share
        for k, value in enumerate(values):
            total[k] += share * np.exp(-value * crossed)
    return np.moveaxis(total / arriving, 0, -1)[..., channel]
