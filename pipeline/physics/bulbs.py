"""In-scattering V of point and spot lamps along eye rays, without shadows: the airlight integral.

A bulb of radius r throws irradiance 1 / (d^2 + r^2) at unit intensity. Along a ray that passes it at a distance
h this peaks sharply; in the angle theta = atan(t / H), H^2 = h^2 + r^2, t counted from the ray's nearest point, it
is constant (equi-angular sampling, Kulla and Fajardo 2012), and so is what a few Gauss nodes must follow.

V = S / H with S smooth over the photograph, which lets hundreds of lamps be summed from a coarse grid of rays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

#: Gauss-Legendre nodes of each piece of a ray, and the widths H off its nearest point to the lamp at which it is cut.
NODES, NODES_COARSE, BESIDE = 10, 6, 8.0
#: Pixels a step of the coarse grid; coarse steps round a lamp in which every ray is exact, and in which 1 / H is.
COARSE, EXACT, FINE = 8, 4, 12
#: Fewer rays than this are all exact.
FEW_RAYS = 20000
#: Lamps behind more optical depths than this are left out: exp(-12) is 6e-6.
UNSEEN = 12.0
_RAYS = 32768


@dataclass(frozen=True)
class Cone:
    """A spot's cone: unit axis (3,), cosines of its inner and outer half angle, smoothstep of the cosine between."""

    axis: np.ndarray
    inner: float
    outer: float

    def share(self, cosine: np.ndarray) -> np.ndarray:
        x = np.clip((cosine - self.outer) / (self.inner - self.outer), 0, 1)
        return x * x * (3 - 2 * x)


def bulb(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, position: np.ndarray,
         radius: float, cone: Cone | None = None) -> np.ndarray:
    """V (..., 3) at unit intensity of a lamp at `position` (3,) [m], along unit rays (..., 3) to `depth` (...)."""
    shape = np.shape(depth)
    rays, ends = np.reshape(directions, (-1, 3)), np.reshape(depth, -1).astype(float)
    result = np.empty((len(ends), 3))
    for first in range(0, len(ends), _RAYS):
        part = slice(first, first + _RAYS)
        smooth, width = _smooth(medium, eye, rays[part], ends[part], np.asarray(position, float), radius, cone)
        result[part] = smooth / width[:, None]
    return result.reshape(*shape, 3)


def bulbs(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, positions: np.ndarray,
          radius: float, weights: np.ndarray) -> np.ndarray:
    """V (..., 3) of lamps at positions (n, 3) of intensities `weights` (n,), all of one radius.

    Over a whole photograph, (H, W), V comes from every COARSE-th ray, not across edges of depth; nearer to each
    lamp only its smooth part S does, and next to it every ray is exact. What lies behind UNSEEN optical depths is
    left out.
    """
    seen = np.flatnonzero(visible(medium, eye, positions) & (np.asarray(weights) > 0))
    if np.ndim(depth) != 2 or np.size(depth) < FEW_RAYS:
        return sum((weights[i] * bulb(medium, eye, directions, depth, positions[i], radius) for i in seen),
                   np.zeros((*np.shape(depth), 3)))
    grid = _Coarse(directions, depth)
    channels = np.unique(np.add(*medium.coefficients()), return_inverse=True)[1]
    several = len(set(channels.tolist())) > 1 or np.ptp(medium.coefficients()[1]) > 0
    kept = 3 if several else 1
    coarse, fine = 0.0, np.zeros((*depth.shape, kept))
    for i in seen:
        position = np.asarray(positions[i], float)
        smooth, width = _smooth(medium, eye, grid.directions.reshape(-1, 3), grid.depth.ravel(), position, radius,
                                count=NODES_COARSE)
        smooth = weights[i] * smooth[:, :kept]
        coarse = coarse + smooth / width[:, None]
        near = grid.around(position - eye, FINE)
        if near is not None:
            foot = directions[near] @ (position - eye)
            width_near = np.sqrt(np.maximum(((position - eye) ** 2).sum() - foot**2, 0) + radius**2)
            one = grid.enlarged(smooth, near) / width_near[..., None]
            core = _core(near, grid.around(position - eye, EXACT))
            one[core] = weights[i] * bulb(medium, eye, directions[near][core], depth[near][core], position,
                                          radius)[..., :kept]
            fine[near] += one - grid.enlarged(smooth / width[:, None], near)
    total = fine + grid.enlarged(coarse, ...) if len(seen) else fine
    return np.broadcast_to(total, (*depth.shape, 3)) if not several else total


def visible(medium: Any, eye: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Which lamps (n,) are not hidden by the fog before them, whatever surface may hide them."""
    extinction = np.add(*medium.coefficients()).min()
    return extinction * medium.density_path(np.asarray(eye, float), np.asarray(positions, float)) < UNSEEN


def arrival(medium: Any, points: np.ndarray, normals: np.ndarray, positions: np.ndarray, radius: float,
            weights: np.ndarray, cone: Cone | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance (...) of all lamps at surface points (..., 3), and the share (..., 3) of it that fog lets through.

    Behind a surface's horizon a lamp counts a fiftieth, as what arrives by reflection: no point may get nothing.
    """
    extinction = np.add(*medium.coefficients())
    values = np.unique(extinction)
    total = np.zeros(points.shape[:-1])
    through = np.zeros((*points.shape[:-1], len(values)))
    for position, weight in zip(np.asarray(positions, float), weights):
        offset = position - points
        squared = (offset**2).sum(-1)
        cosine = (offset * normals).sum(-1) / np.sqrt(np.maximum(squared, 1e-24))
        one = weight * np.maximum(cosine, 0.02) / (squared + radius**2)
        if cone is not None:
            one = one * np.maximum(cone.share(-(offset @ cone.axis) / np.sqrt(np.maximum(squared, 1e-24))), 1e-3)
        total += one
        path = medium.density_path(position, points)
        for k, value in enumerate(values):
            through[..., k] += one * np.exp(-value * path)
    share = through / np.maximum(total, 1e-300)[..., None]
    return total, share[..., np.searchsorted(values, extinction)]


# --- one lamp -----------------------------------------------------------------------------------------------


def _smooth(medium, eye, rays, ends, position, radius, cone=None, count=NODES) -> tuple[np.ndarray, np.ndarray]:
    """S (n, 3) and H (n,) [m], V = S / H, of one lamp along rays (n, 3) to `ends` (n,)."""
    foot = rays @ (position - eye)
    aside = np.maximum(((position - eye) ** 2).sum() - foot**2, 0.0)
    width = np.sqrt(aside + radius**2)
    start, end = np.zeros_like(ends), ends
    if cone is not None:
        start, end = _within(cone, eye - position, rays, start, end)
    result = np.zeros((len(ends), 3))
    borders = _borders(medium, eye, rays, start, end, foot, width)
    for low, high in zip(borders[:-1], borders[1:]):
        some = high > low
        if some.all():
            some = slice(None)
        elif not some.any():
            continue
        result[some] += _piece(medium, eye, rays[some], low[some], high[some], foot[some], width[some], position,
                               cone, count)
    return result, width


def _borders(medium, eye, rays, start, end, foot, width) -> np.ndarray:
    """Distances (k, n) [m], rising, between which the integrand is smooth: the ray's nearest point to the lamp, where
    the equi-angular variable turns, where it grows fast, and the heights at which the density bends."""
    found = [start, foot - BESIDE * width, foot, foot + BESIDE * width, end]
    with np.errstate(divide="ignore", invalid="ignore"):
        for height in medium.bends():
            crossing = (height - eye[1]) / rays[:, 1]
            found.append(np.where(np.isfinite(crossing), crossing, 0.0))
    found = np.clip(found, start, end)
    return np.sort(found, axis=0) if len(found) > 5 else found


def _piece(medium, eye, rays, low, high, foot, width, position, cone, count) -> np.ndarray:
    """The part of S (n, 3) of one lamp that is scattered between distances low and high (n,)."""
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = (nodes + 1) / 2, weights / 2
    first, last = np.arctan((low - foot) / width), np.arctan((high - foot) / width)
    angle = first[:, None] + (last - first)[:, None] * nodes
    along = np.clip(foot[:, None] + width[:, None] * np.tan(angle), low[:, None], high[:, None])
    points = eye + along[..., None] * rays[:, None]
    offset = points - position
    distance = np.sqrt((offset**2).sum(-1))
    cosine = -(offset * rays[:, None]).sum(-1) / np.maximum(distance, 1e-12)
    common = medium.phase().value(cosine) * medium.density(points) * weights * (last - first)[:, None]
    if cone is not None:
        common = common * cone.share((offset @ cone.axis) / np.maximum(distance, 1e-12))
    path = medium.density_along(eye, rays, along) + medium.density_path(position, points)
    result = np.empty((len(rays), 3))
    for value in np.unique(extinction):
        same = extinction == value
        result[:, same] = (common * np.exp(-value * path)).sum(-1)[:, None] * scattering[same]
    return result


def _within(cone: Cone, origin: np.ndarray, rays: np.ndarray, start, end) -> tuple[np.ndarray, np.ndarray]:
    """The part of each ray inside the cone's outer angle; `origin` (3,) is the eye seen from the lamp."""
    axial, slope = origin @ cone.axis, rays @ cone.axis
    squared = cone.outer**2
    a = slope**2 - squared
    b = axial * slope - squared * (rays @ origin)
    c = axial**2 - squared * (origin @ origin)
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    a = np.where(np.abs(a) < 1e-12, 1e-12, a)
    one, two = (-b - root) / a, (-b + root) / a
    near, far = np.minimum(one, two), np.maximum(one, two)
    # an ellipse lies between the roots; a hyperbola's branch on the lamp's lit side beyond one of them
    inside = a < 0
    low = np.where(inside, near, np.where(slope > 0, far, -np.inf))
    high = np.where(inside, far, np.where(slope > 0, np.inf, near))
    lit = (b * b - a * c > 0) & (~inside | (axial + slope * (near + far) / 2 > 0))
    low, high = np.clip(low, start, end), np.clip(high, start, end)
    return np.where(lit, low, start), np.where(lit, np.maximum(high, low), start)


# --- many lamps over a photograph -----------------------------------------------------------------------------


def _core(outer: tuple[slice, slice], inner: tuple[slice, slice]) -> tuple[slice, slice]:
    """Slices of `inner` counted from where `outer` begins."""
    return tuple(slice(i.start - o.start, i.stop - o.start) for o, i in zip(outer, inner))


class _Coarse:
    """Every COARSE-th ray of a photograph, and the weights that bring values on them back to all pixels."""

    def __init__(self, directions: np.ndarray, depth: np.ndarray):
        height, width = depth.shape
        self.rows = np.unique(np.append(np.arange(0, height, COARSE), height - 1))
        self.columns = np.unique(np.append(np.arange(0, width, COARSE), width - 1))
        at = np.ix_(self.rows, self.columns)
        self.directions, self.depth, self.shape = directions[at], depth[at], depth.shape
        y = np.clip(np.searchsorted(self.rows, np.arange(height), side="right") - 1, 0, max(len(self.rows) - 2, 0))
        x = np.clip(np.searchsorted(self.columns, np.arange(width), side="right") - 1, 0,
                    max(len(self.columns) - 2, 0))
        fy = ((np.arange(height) - self.rows[y]) / np.maximum(np.diff(self.rows, append=np.inf)[y], 1))[:, None]
        fx = ((np.arange(width) - self.columns[x]) / np.maximum(np.diff(self.columns, append=np.inf)[x], 1))[None]
        # on a plane the inverse of depth is linear over the picture, on a steep one too; elsewhere there is an edge
        inverse, bilinear = 0.0, []
        for dy in (0, 1):
            for dx in (0, 1):
                tap = (np.minimum(y + dy, len(self.rows) - 1)[:, None], np.minimum(x + dx, len(self.columns) - 1)[None])
                bilinear.append(np.abs(1 - dy - fy) * np.abs(1 - dx - fx))
                inverse = inverse + bilinear[-1] / self.depth[tap]
        plane = np.abs(inverse * depth - 1) < 0.03
        self.taps, weights = [], []
        for dy in (0, 1):
            for dx in (0, 1):
                tap = (np.minimum(y + dy, len(self.rows) - 1)[:, None], np.minimum(x + dx, len(self.columns) - 1)[None])
                off = np.abs(self.depth[tap] - depth) / (0.05 * depth + 1e-12)
                alike = np.where(plane, 1.0, np.exp(-np.minimum(off**2, 300.0)))
                weights.append(bilinear[2 * dy + dx] * alike + 1e-140 / (1 + off))
                self.taps.append(np.ravel_multi_index(np.broadcast_arrays(*tap), self.depth.shape))
        total = sum(weights)
        self.weights = [(weight / total)[..., None] for weight in weights]
        self.middle = directions[height // 2, width // 2]

    def enlarged(self, values: np.ndarray, where) -> np.ndarray:
        """(h * w, c) at the pixels `where` of the photograph, (..., c)."""
        return sum(weight[where] * values[tap[where]] for weight, tap in zip(self.weights, self.taps))

    def around(self, towards: np.ndarray, steps: int):
        """Slices of the pixels within so many coarse steps of direction `towards` (3,), None outside the frame."""
        if towards @ self.middle <= 0:
            return None
        unit = towards / np.linalg.norm(towards)
        row, column = np.unravel_index(np.argmax(self.directions @ unit), self.depth.shape)
        row, column, reach = self.rows[row], self.columns[column], steps * COARSE
        return (slice(max(row - reach, 0), min(row + reach + 1, self.shape[0])),
                slice(max(column - reach, 0), min(column + reach + 1, self.shape[1])))
