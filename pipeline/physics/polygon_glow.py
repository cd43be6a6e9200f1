"""Glow of a Lambertian polygon in fog: the in-scattering integral without shadows.

V = L * integral over the ray of exp(-tau_eye) delta * integral over the polygon of p exp(-tau) cos / d^2 dA
(Zhao et al. 2013, section 4.2, one area light). cos / d^2 dA is solid angle, which a polygon has in closed form (Van
Oosterom and Strackee 1983): close to the lamp, where sums over small lights fail, the inner integral is the solid
angle times a mean of p exp(-tau) that is smooth there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.physics.emitters import polygon_cells

#: Nodes along the ray and small cells a side of the lamp, refined where a level differs from the one before.
LEVELS = ((8, 2), (16, 3), (32, 5), (64, 8), (128, 12), (256, 12))
#: Relative difference of two levels below which the finer is taken: it is several times as near itself.
TOLERANCE = 2e-3
#: Points evaluated at once: some hundred megabytes.
CHUNK = 2_000_000

#: (points (..., 3), from or to) -> optical depth by one extinction; density at points (...).
Depths = Callable[[np.ndarray, np.ndarray], np.ndarray]


def solid_angle(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Solid angle [sr], (...), of a polygon (n, 3) from `points` (..., 3): positive where its normal points to, else 0."""
    from_point = polygon - points[..., None, :]
    length = np.linalg.norm(from_point, axis=-1)
    a, la = from_point[..., 0, :], length[..., 0]
    total = np.zeros(points.shape[:-1])
    for k in range(1, len(polygon) - 1):
        b, c, lb, lc = from_point[..., k, :], from_point[..., k + 1, :], length[..., k], length[..., k + 1]
        triple = np.einsum("...i,...i->...", a, np.cross(b, c))
        below = (la * lb * lc + np.einsum("...i,...i->...", a, b) * lc + np.einsum("...i,...i->...", a, c) * lb
                 + np.einsum("...i,...i->...", b, c) * la)
        total += 2 * np.arctan2(-triple, below)
    return np.clip(total, 0, 2 * np.pi)


def in_scattering(polygon: np.ndarray, normal: np.ndarray, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray,
                  density: Callable[[np.ndarray], np.ndarray], path: Depths, phase: Callable[[np.ndarray], np.ndarray],
                  extinction: np.ndarray, scattering: np.ndarray) -> np.ndarray:
    """V (n, 3) of unit radiance along rays from `eye` (3,), unit `directions` (n, 3), up to `depth` (n,) [m].

    polygon (k, 3) [m] shines to the side of `normal` (3,). density(points): relative density of the fog; path(a, b):
    its integral [m] between points; phase(cosine) [1/sr]; extinction, scattering (3,) [1/m].
    """
    values, channel = np.unique(extinction, return_inverse=True)
    near, far = _lit(polygon[0], normal, eye, directions, depth)
    result = np.zeros((len(depth), len(values)))
    open_ = np.nonzero(far > near)[0]
    before = None
    for nodes, count in LEVELS:
        centres, areas = polygon_cells(polygon, count)
        rays = max(1, CHUNK // (nodes * len(centres)))
        found = np.concatenate([_along(polygon, normal, centres, areas, eye, directions[one], near[one], far[one],
                                       nodes, density, path, phase, values)
                                for one in np.split(open_, range(rays, len(open_), rays))]) if len(open_) else None
        if found is None:
            break
        result[open_] = found
        if before is not None:
            rough = (np.abs(found - before) > TOLERANCE * np.abs(found)).any(-1)
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


def _along(polygon, normal, centres, areas, eye, directions, near, far, nodes, density, path, phase, extinctions):
    """Integral over the rays, (n, extinctions), by Gauss nodes in the angle from which the lamp's centre sees the ray."""
    centre = areas @ centres / areas.sum()
    size = np.sqrt(areas.sum() / np.pi)
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
        way = points[..., None, :] - centres
        squared = np.maximum((way**2).sum(-1), 1e-300)
        length = np.sqrt(squared)
        share = np.maximum(way @ normal, 0) * areas / (squared * length)
        share = share / np.maximum(share.sum(-1, keepdims=True), 1e-300)
        cosine = -np.einsum("...kj,...j->...k", way, np.broadcast_to(directions[:, None], points.shape)) / length
        share = share * phase(cosine)
        crossed = path(points[..., None, :], np.broadcast_to(centres, way.shape))
        for k, extinction in enumerate(extinctions):
            mean = (share * np.exp(-extinction * crossed)).sum(-1)
            total[:, k] += (seen * mean * np.exp(-extinction * to_eye)).sum(-1)
    return total
