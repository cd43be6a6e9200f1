"""Surfaces of a scene cut into patches about as large as one another."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
import shapely


#: How much farther apart, in spacings, patches count as that look another way.
TURNED = 2.0
#: Patches that stand for a point together, and how far each reaches, in spacings.
NEIGHBOURS, SMOOTH = 9, 0.8
#: A side of the finest grid that one face is cut into.
FINEST = 64


@dataclass(frozen=True)
class Patches:
    """points, normals (q, 3) [m] and spacing [m]: a side of a patch."""

    points: np.ndarray
    normals: np.ndarray
    spacing: float

    def nearest(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Index (...) of the patch that is nearest to points (..., 3) on surfaces with normals (..., 3)."""
        return self._tree.query(self._place(points, normals))[1]

    def between(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the patches that are nearest to points (..., 3) on surfaces with normals (..., 3), indices and weights
        (..., k), whose sums are 1: a mean that changes smoothly over a surface."""
        distance, index = self._tree.query(self._place(points, normals), k=min(NEIGHBOURS, len(self.points)))
        distance, index = (np.reshape(one, (*points.shape[:-1], -1)) for one in (distance, index))
        weight = np.exp(-((distance / SMOOTH) ** 2) + (distance[..., :1] / SMOOTH) ** 2)
        return index, weight / weight.sum(-1, keepdims=True)

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        return scipy.spatial.cKDTree(self._place(self.points, self.normals))

    def _place(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        return np.concatenate([points / self.spacing, TURNED * normals], -1)


def areas_and_normals(faces: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Areas (f,) [m^2] and normals (f, 3) of planar faces (n, 3), as their corners say (Newell's method); of a face without
    area any normal."""
    vectors, count = np.zeros((len(faces), 3)), np.array([len(corners) for corners in faces], int)
    for n in np.unique(count):
        some = np.flatnonzero(count == n)
        corners = np.stack([faces[i] for i in some])
        corners = corners - corners[:, :1]
        vectors[some] = np.cross(corners, np.roll(corners, -1, 1)).sum(1) / 2
    areas = np.linalg.norm(vectors, axis=-1)
    normals = np.where(areas[:, None] > 0, vectors / np.where(areas, areas, 1)[:, None], [0.0, 1.0, 0.0])
    return areas, normals


def patches(faces: list[np.ndarray], count: int) -> Patches:
    """About `count` patches of planar faces (n, 3) [m]; normals as the corners say. Of faces much smaller than a patch
    some stand for others."""
    areas, turned = areas_and_normals(faces)
    shown = [(faces[i], areas[i], turned[i]) for i in np.flatnonzero(areas > 0)]
    spacing = float(np.sqrt(areas.sum() / count)) or 1.0
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for corners, area, normal in shown:
        cut = _cut(corners, normal, spacing) if area > spacing**2 else corners.mean(0)[None]
        points.append(cut)
        normals.append(np.broadcast_to(normal, cut.shape))
    points, normals = np.concatenate(points), np.concatenate(normals)
    if len(points) > 2 * count:
        cell = np.concatenate([np.floor(points / spacing), np.round(normals)], 1)
        first = np.unique(cell, axis=0, return_index=True)[1]
        points, normals = points[first], normals[first]
    return Patches(points, normals, spacing)


def _cut(corners: np.ndarray, normal: np.ndarray, spacing: float) -> np.ndarray:
    """Centres (m, 3) of the cells of a grid on a face that lie within it."""
    along = corners[1] - corners[0]
    along = along / np.linalg.norm(along)
    axes = np.stack([along, np.cross(normal, along)])
    flat = (corners - corners[0]) @ axes.T
    low, size = flat.min(0), np.ptp(flat, axis=0)
    count = np.clip(np.round(size / spacing).astype(int), 1, FINEST)
    u, v = ((np.arange(n) + 0.5) / n * length + start for n, length, start in zip(count, size, low))
    centres = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    inside = shapely.contains_xy(shapely.Polygon(flat), centres)
    return corners[0] + centres[inside] @ axes if inside.any() else corners.mean(0)[None]
