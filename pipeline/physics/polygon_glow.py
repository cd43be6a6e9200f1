"""Glow of a Lambertian polygon in fog: the in-scattering integral without shadows.

V = L * integral over the ray of exp(-tau_eye) delta * integral over the polygon of p exp(-tau) cos / d^2 dA
(Zhao et al. 2013, section 4.2, one area light). cos / d^2 dA is solid angle, which a polygon has in closed form (Van
Oosterom and Strackee 1983): close to the lamp, where sums over small lights fail, the inner integral is the solid
angle times a mean of p exp(-tau) that is smooth there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.geometry.planes import diagonals_crossing, polygon_area, polygon_midpoint
from pipeline.physics.emitters import polygon_cells

#: Nodes along the ray and across the lamp, refined where a level differs from the one before.
LEVELS = ((4, 1), (6, 2), (10, 3), (20, 4), (40, 6), (80, 10))
#: Relative difference of two levels below which the finer is taken, which is some ten times as near itself.
TOLERANCE = 5e-3
#: Points evaluated at once: what they take fits a processor's cache (measured: half the time of 2 million).
CHUNK = 100_000

#: Integral (...) [m] of the fog's relative density between points (..., 3) and (..., 3).
Path = Callable[[np.ndarray, np.ndarray], np.ndarray]


def solid_angle(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Solid angle [sr], (...), of a polygon (n, 3) from `points` (..., 3): positive where its normal points to, else 0."""
    points = np.asarray(points, float)
    from_corner = [points - corner for corner in polygon]
    squares = [np.einsum("...i,...i->...", one, one) for one in from_corner]
    lengths = [np.sqrt(one) for one in squares]

    def product(i: int, j: int) -> np.ndarray:
        """Scalar product (...) of the ways to two corners, by the side between them."""
        return (squares[i] + squares[j] - ((polygon[i] - polygon[j]) ** 2).sum()) / 2

    total = np.zeros(points.shape[:-1])
    for k in range(1, len(polygon) - 1):
        a, b, c = lengths[0], lengths[k], lengths[k + 1]
        # of the three ways' triple product only the height above the triangle depends on the point
        triple = from_corner[0] @ np.cross(polygon[k] - polygon[0], polygon[k + 1] - polygon[0])
        below = (a * b + product(0, k)) * c + product(0, k + 1) * b + product(k, k + 1) * a
        total += 2 * np.arctan2(triple, below)
    return np.clip(total, 0, 2 * np.pi)


def in_scattering(polygon: np.ndarray, normal: np.ndarray, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray,
                  density: Callable[[np.ndarray], np.ndarray], path: Path, phase: Callable[[np.ndarray], np.ndarray],
                  extinction: np.ndarray, scattering: np.ndarray, tolerance: float = TOLERANCE) -> np.ndarray:
    """V (n, 3) of unit radiance along rays from `eye` (3,), unit `directions` (n, 3), up to `depth` (n,) [m].

    polygon (k, 3) [m] shines to the side of `normal` (3,). density(points): relative density of the fog;
    phase(cosine) [1/sr]; extinction, scattering (3,) [1/m]. tolerance: relative difference of two levels below which
    the finer is taken.
    """
    values, channel = np.unique(extinction, return_inverse=True)
    near, far = _lit(polygon[0], normal, eye, directions, depth)
    result = np.zeros((len(depth), len(values)))
    open_ = np.nonzero(far > near)[0]
    before, convex = None, diagonals_crossing(polygon) is not None
    for nodes, count in LEVELS:
        if not len(open_):
            break
        parts = _Quadrilateral(polygon, normal, count) if convex else _Cells(polygon, count)
        rays = max(1, CHUNK // (2 * nodes * count**2))
        found = np.concatenate([_along(polygon, normal, parts, eye, directions[one], near[one], far[one],
                                       nodes, density, path, phase, values)
                                for one in np.split(open_, range(rays, len(open_), rays))])
        result[open_] = found
        if before is not None:
            rough = (np.abs(found - before) > tolerance * np.abs(found)).any(-1)
            open_, found = open_[rough], found[rough]
        before = found
    return result[:, channel] * scattering


def _lit(corner, normal, eye, directions, depth) -> tuple[np.ndarray, np.ndarray]:
    """The part of each ray in front of the lamp's plane: its two ends (n,) [m]."""
    height, slope = float((eye - corner) @ normal), directions @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(slope != 0, -height / slope, np.inf if height > 0 else -np.inf)
    near = np.where(slope > 0, np.maximum(crossing, 0), 0.0)
    far = np.where(slope < 0, np.minimum(crossing, depth), depth)
    return near, np.where((slope == 0) & (height <= 0), near, far)


class _Cells:
    """Parts of any polygon, the same for all points."""

    def __init__(self, polygon, count):
        self.centres, self.areas = polygon_cells(polygon, count)

    def seen_from(self, points):
        """Places (..., k, 3) [m] on the lamp and their areas (..., k) [m^2], for points (..., 3)."""
        return self.centres, self.areas


class _Quadrilateral:
    """Gauss nodes on a convex quadrilateral, crowded to where a point is near: in asinh of the offset over the distance,
    in which light and phase function change evenly."""

    def __init__(self, polygon, normal, count):
        self.corner, self.normal = polygon[0], normal
        self.edges = polygon[1] - polygon[0], polygon[3] - polygon[0]
        self.twist = polygon[2] - polygon[1] - polygon[3] + polygon[0]
        nodes, weights = np.polynomial.legendre.leggauss(count)
        self.nodes, self.weights = 0.5 + 0.5 * nodes, 0.5 * weights
        # coordinates along both edges of a point in the plane
        self.to_edges = np.linalg.pinv(np.stack(self.edges, 1))

    def seen_from(self, points):
        relative = points - self.corner
        place = relative @ self.to_edges.T
        height = np.abs(relative @ self.normal)
        beside = np.maximum(np.abs(place - 0.5) - 0.5, 0) * [np.linalg.norm(edge) for edge in self.edges]
        sides = []
        for k, edge in enumerate(self.edges):
            scale = np.maximum(np.hypot(height, beside[..., 1 - k]) / np.linalg.norm(edge), 1e-4)[..., None]
            first, last = (np.arcsinh((end - place[..., k, None]) / scale) for end in (0.0, 1.0))
            angle = first + (last - first) * self.nodes
            sides.append((np.clip(place[..., k, None] + scale * np.sinh(angle), 0, 1),
                          (last - first) * self.weights * scale * np.cosh(angle)))
        (u, du), (v, dv) = sides
        u, v = u[..., :, None, None], v[..., None, :, None]
        places = self.corner + u * self.edges[0] + v * self.edges[1] + u * v * self.twist
        stretch = np.cross(self.edges[0] + v * self.twist, self.edges[1] + u * self.twist) @ self.normal
        areas = du[..., :, None] * dv[..., None, :] * np.abs(stretch)
        return places.reshape(*points.shape[:-1], -1, 3), areas.reshape(*points.shape[:-1], -1)


def _along(polygon, normal, parts, eye, directions, near, far, nodes, density, path, phase, extinctions):
    """Integral over the rays, (n, extinctions), by Gauss nodes in the angle from which the lamp's centre sees the ray."""
    centre, size = polygon_midpoint(polygon), np.sqrt(polygon_area(polygon) / np.pi)
    foot = np.clip((centre - eye) @ directions.T, near, far)
    away = np.maximum(np.linalg.norm(eye + foot[:, None] * directions - centre, axis=-1), 0.05 * size)
    gauss, weights = np.polynomial.legendre.leggauss(nodes)
    total = np.zeros((len(far), len(extinctions)))
    for low, high in ((near, foot), (foot, far)):
        first, last = np.arctan2(low - foot, away), np.arctan2(high - foot, away)
        angle = first[:, None] + (last - first)[:, None] * (0.5 + 0.5 * gauss)
        distance = foot[:, None] + away[:, None] * np.tan(angle)
        step = (last - first)[:, None] * 0.5 * weights * away[:, None] / np.cos(angle) ** 2
        points = eye + distance[..., None] * directions[:, None]
        to_eye = path(np.broadcast_to(eye, points.shape), points)
        seen = solid_angle(points, polygon) * density(points) * step
        places, areas = parts.seen_from(points)
        way = points[..., None, :] - places
        squared = np.maximum((way**2).sum(-1), 1e-300)
        length = np.sqrt(squared)
        share = np.maximum(way @ normal, 0) * areas / (squared * length)
        share = share / np.maximum(share.sum(-1, keepdims=True), 1e-300)
        cosine = -np.einsum("...kj,...j->...k", way, np.broadcast_to(directions[:, None], points.shape)) / length
        share = share * phase(cosine)
        crossed = path(points[..., None, :], np.broadcast_to(places, way.shape))
        for k, extinction in enumerate(extinctions):
            mean = (share * np.exp(-extinction * crossed)).sum(-1)
            total[:, k] += (seen * mean * np.exp(-extinction * to_eye)).sum(-1)
    return total
