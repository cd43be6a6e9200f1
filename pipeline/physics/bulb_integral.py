"""The airlight integral of one lamp along eye rays through any fog.

A lamp of radius r throws irradiance 1 / (d^2 + r^2) at unit intensity. Along a ray that passes it at a distance h
this peaks sharply; in the angle theta = atan(t / H), H^2 = h^2 + r^2, t counted from the ray's nearest point, it
is constant (equi-angular sampling, Kulla and Fajardo 2012), and so is what a few Gauss nodes must follow. Rays are
cut where the density bends; in fog that varies at every step they are summed in many cells instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Gauss-Legendre nodes of each piece of a ray, and the widths H off its nearest point to the lamp at which it is cut.
NODES, BESIDE = 10, 8.0
#: Cells of a ray through uneven fog: steps that follow the density from the eye on and to either side of the lamp, so
#: many even ones of so many, the rest growing; and cells of equal angle.
FROM_EYE, FROM_LAMP, TURNING_CELLS = (48, 144), (32, 96), 48
#: Points at once: a few arrays of so many float64 stay in the processor's cache.
_VALUES = 2**17


@dataclass(frozen=True)
class Cone:
    """A spot's cone: unit axis (3,), cosines of its inner and outer half angle, smoothstep of the cosine between."""

    axis: np.ndarray
    inner: float
    outer: float

    def share(self, cosine: np.ndarray) -> np.ndarray:
        x = np.clip((cosine - self.outer) / (self.inner - self.outer), 0, 1)
        return x * x * (3 - 2 * x)


@dataclass(frozen=True)
class Lamp:
    """A bulb at `position` (3,) [m] of `radius` [m], in a cone or none."""

    position: np.ndarray
    radius: float
    cone: Cone | None = None


@dataclass(frozen=True)
class _Rays:
    """Rays (n, 3) from the eye, where each is nearest to the lamp (n,), and how far from it squared (n,)."""

    eye: np.ndarray
    directions: np.ndarray
    foot: np.ndarray
    aside: np.ndarray
    width: np.ndarray

    def some(self, which) -> _Rays:
        return _Rays(self.eye, self.directions[which], self.foot[which], self.aside[which], self.width[which])


def smooth_part(medium: Any, eye: np.ndarray, directions: np.ndarray, ends: np.ndarray, lamp: Lamp,
                nodes: int = NODES) -> tuple[np.ndarray, np.ndarray]:
    """S (n, 3) and H (n,) [m] of a lamp of unit intensity along unit rays (n, 3) to `ends` (n,) [m]; V = S / H."""
    rays, start, end = _met(eye, directions, ends, lamp)
    uneven = medium.longest_step() < np.inf
    cells = FROM_EYE[1] + 2 * FROM_LAMP[1] + TURNING_CELLS if uneven else nodes
    reach = float(np.linalg.norm(lamp.position - eye) + ends.max(initial=0.0))
    from_lamp = medium.paths_from(lamp.position, reach, len(ends) * cells)
    rule = np.polynomial.legendre.leggauss(nodes)
    result = np.zeros((len(ends), 3))
    at_once = max(1, _VALUES // cells)
    for first in range(0, len(ends), at_once):
        part = slice(first, first + at_once)
        if uneven:
            result[part] = _in_cells(medium, rays.some(part), lamp, start[part], end[part], from_lamp)
        else:
            result[part] = _in_pieces(medium, rays.some(part), lamp, start[part], end[part], from_lamp, rule)
    return result, rays.width


def _met(eye, directions, ends, lamp) -> tuple[_Rays, np.ndarray, np.ndarray]:
    """The rays, and where the lamp's light is met on each, from and to."""
    foot = directions @ (lamp.position - eye)
    # squares of the sides would cancel: of a lamp 10 km away nothing would be left of how near a ray passes it
    aside = ((lamp.position - eye - foot[:, None] * directions) ** 2).sum(-1)
    start, end = np.zeros_like(ends), ends
    if lamp.cone is not None:
        start, end = _within(lamp.cone, eye - lamp.position, directions, start, end)
    return _Rays(eye, directions, foot, aside, np.sqrt(aside + lamp.radius**2)), start, end


def _in_pieces(medium, rays, lamp, start, end, from_lamp, rule) -> np.ndarray:
    """S (n, 3) by a Gauss rule between the ray's borders."""
    result = np.zeros((len(start), 3))
    borders = _borders(medium, rays, start, end)
    for low, high in zip(borders[:-1], borders[1:]):
        some = high > low
        if some.all():
            some = slice(None)
        elif not some.any():
            continue
        result[some] += _piece(medium, rays.some(some), lamp, low[some], high[some], from_lamp, rule)
    return result


def _borders(medium, rays, start, end) -> np.ndarray:
    """Distances (k, n) [m], rising, between which the integrand is smooth: the ray's nearest point to the lamp, where
    the equi-angular variable turns, where it grows fast, and the heights at which the density bends."""
    found = [start, rays.foot - BESIDE * rays.width, rays.foot, rays.foot + BESIDE * rays.width, end]
    with np.errstate(divide="ignore", invalid="ignore"):
        for height in medium.bends():
            crossing = (height - rays.eye[1]) / rays.directions[:, 1]
            found.append(np.where(np.isfinite(crossing), crossing, 0.0))
    found = np.clip(found, start, end)
    return np.sort(found, axis=0) if len(found) > 5 else found


def _piece(medium, rays, lamp, low, high, from_lamp, rule) -> np.ndarray:
    """The part of S (n, 3) that is scattered between distances low and high (n,)."""
    nodes, weights = (rule[0] + 1) / 2, rule[1] / 2
    foot, width = rays.foot[:, None], rays.width[:, None]
    first, last = np.arctan((low[:, None] - foot) / width), np.arctan((high[:, None] - foot) / width)
    along = np.clip(foot + width * np.tan(first + (last - first) * nodes), low[:, None], high[:, None])
    if medium.layered:
        heights = rays.eye[1] + along * rays.directions[:, 1:2]
        distance = np.sqrt((along - foot) ** 2 + rays.aside[:, None])
        path = medium.between(rays.eye[1], heights, along) + medium.between(lamp.position[1], heights, distance)
        density = medium.level_density(heights)
    else:
        points = rays.eye + along[..., None] * rays.directions[:, None]
        path = medium.density_along(rays.eye, rays.directions, along) + from_lamp(points)
        density = medium.density(points)
    turn = _turn(low[:, None] - foot, high[:, None] - foot, width)
    return _summed(medium, rays, lamp, along, weights * turn * density, path)


def _in_cells(medium, rays, lamp, start, end, from_lamp) -> np.ndarray:
    """S (n, 3) in fog that varies along the ray: midpoints of many cells, short near the eye and near the lamp."""
    along, angles = _midpoints(rays, start, end, *(medium.longest_step() * _growing(*counts)
                                                   for counts in (FROM_EYE, FROM_LAMP)))
    points = rays.eye + along[..., None] * rays.directions[:, None]
    path = medium.density_along(rays.eye, rays.directions, along) + from_lamp(points)
    return _summed(medium, rays, lamp, along, angles * medium.density(points), path)


def shaded_part(medium: Any, eye: np.ndarray, directions: np.ndarray, ends: np.ndarray, lamp: Lamp,
                lit: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """S (n, 3) of what a lamp lights through a share `lit` of points (..., 3), and of all of it, by the same cells, so
    that their errors are alike."""
    rays, start, end = _met(eye, directions, ends, lamp)
    uneven = medium.longest_step() < np.inf
    cells = FROM_EYE[1] + 2 * FROM_LAMP[1] + TURNING_CELLS
    reach = float(np.linalg.norm(lamp.position - eye) + ends.max(initial=0.0))
    from_lamp = medium.paths_from(lamp.position, reach, len(ends) * cells)
    shaded, whole = np.zeros((len(ends), 3)), np.zeros((len(ends), 3))
    at_once = max(1, _VALUES // cells)
    for first in range(0, len(ends), at_once):
        part = slice(first, first + at_once)
        some = rays.some(part)
        if uneven:
            eye_steps, lamp_steps = (medium.longest_step() * _growing(*counts) for counts in (FROM_EYE, FROM_LAMP))
        else:
            # shadows have edges at any distance from the lamp
            eye_steps = np.zeros(0)
            lamp_steps = some.width[:, None] * np.geomspace(0.2, 2000.0, FROM_LAMP[1])
        along, angles = _midpoints(some, start[part], end[part], eye_steps, lamp_steps)
        points = eye + along[..., None] * some.directions[:, None]
        path = medium.density_along(eye, some.directions, along) + from_lamp(points)
        weights = angles * medium.density(points)
        whole[part] = _summed(medium, some, lamp, along, weights, path)
        shaded[part] = _summed(medium, some, lamp, along, weights * lit(points), path)
    return shaded, whole


def _midpoints(rays, start, end, eye_steps, lamp_steps) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n, k) of the middles of cells, and the angles (n, k) under which the lamp sees these.

    Cells are of equal angle, and end at `eye_steps` [m] from the eye and `lamp_steps` [m] to either side of the foot.
    """
    start, end, foot, width = start[:, None], end[:, None], rays.foot[:, None], rays.width[:, None]
    first, last = np.arctan((start - foot) / width), np.arctan((end - foot) / width)
    turning = foot + width * np.tan(first + (last - first) * np.linspace(0, 1, TURNING_CELLS + 1))
    edges = np.concatenate([np.broadcast_to(eye_steps, (len(foot), len(eye_steps))), turning, foot - lamp_steps,
                            foot + lamp_steps], axis=1)
    edges = np.sort(np.clip(edges, start, end), axis=1)
    return (edges[:, 1:] + edges[:, :-1]) / 2, _turn(edges[:, :-1] - foot, edges[:, 1:] - foot, width)


def _turn(low, high, width) -> np.ndarray:
    """atan(high / width) - atan(low / width): of a far lamp both are nearly a quarter turn, and would cancel."""
    return np.arctan2(width * (high - low), width**2 + low * high)


def _summed(medium, rays, lamp, along, weights, path) -> np.ndarray:
    """Sum (n, 3) over points at distances `along` (n, k) of `weights` (n, k) [1] that are angles times densities.

    path (n, k) [m]: integral of the density from eye to point to lamp.
    """
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    beyond = along - rays.foot[:, None]
    distance = np.maximum(np.sqrt(beyond**2 + rays.aside[:, None]), 1e-12)
    common = medium.phase().value(-beyond / distance) * weights
    if lamp.cone is not None:
        axial = (rays.eye - lamp.position) @ lamp.cone.axis + along * (rays.directions @ lamp.cone.axis)[:, None]
        common = common * lamp.cone.share(axial / distance)
    result = np.empty((len(along), 3))
    for value in np.unique(extinction):
        same = extinction == value
        result[:, same] = (common * np.exp(-value * path)).sum(-1)[:, None] * scattering[same]
    return result


def _growing(even: int, count: int) -> np.ndarray:
    """Rising numbers (count,): 1, 2, ... up to `even`, then growing in proportion."""
    index = np.arange(1, count + 1)
    return np.where(index < even, index, even * np.exp((index - even) / even))


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
