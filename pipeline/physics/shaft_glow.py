"""In-scattering V of parallel light in even fog, inside convex volumes that nothing else shades.

Zhao et al. 2013, section 5.1: the sun scatters only between a window and its patch. There light has crossed fog
since the window, and crosses more to the eye; along a ray both lengths are linear, so that the integral is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Shaft:
    """planes (m, 4): outward unit normals and offsets [m] of a convex volume; inside is n . x <= offset.

    entry, normal (3,): a point [m] of the plane at which the light enters the fog, and that plane's normal.
    """

    planes: np.ndarray
    entry: np.ndarray
    normal: np.ndarray


def interval(planes: np.ndarray, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray]:
    """Distances (n,) [m] between which unit rays (n, 3) from `eye` (3,) to depth (n,) [m] are inside; equal where never."""
    rising, left = directions @ planes[:, :3].T, planes[:, 3] - planes[:, :3] @ eye
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        meets = left / rising
    near = np.where(rising < 0, meets, 0.0).max(-1)
    far = np.where(rising > 0, meets, np.inf).min(-1)
    outside = ((rising == 0) & (left < 0)).any(-1)
    near, far = np.minimum(np.maximum(near, 0.0), depth), np.minimum(far, depth)
    return near, np.where(outside, near, np.maximum(far, near))


def in_scattering(shafts: Sequence[Shaft], light: np.ndarray, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray,
                  extinction: np.ndarray, scattering: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """V (n, 3) for an irradiance of 1 on a surface that faces the light, which shines once where shafts overlap.

    light (3,): direction in which it travels. directions (n, 3), depth (n,) [m]: unit rays from `eye` (3,).
    extinction, scattering (3,) [1/m]; phase (n,) [1/sr] of the turn from the light into the ray.
    """
    found = np.zeros((len(directions), 3))
    near, far = (np.stack(ends) for ends in zip(*(interval(one.planes, eye, directions, depth) for one in shafts)))
    rays = np.flatnonzero((far > near).any(0))
    if not len(rays):
        return found
    near, far, along = near[:, rays], far[:, rays], directions[rays]
    # between two neighbouring ends a ray is in the same shafts all the way; the first of them is asked
    ends = np.sort(np.concatenate([near, far]), axis=0)
    for start, end in zip(ends[:-1], ends[1:]):
        middle, unlit = (start + end) / 2, end > start
        for k, one in enumerate(shafts):
            here = np.flatnonzero(unlit & (near[k] < middle) & (middle < far[k]))
            unlit[here] = False
            if len(here):
                found[rays[here]] += _between(one, light, eye, along[here], start[here], end[here], extinction)
    return scattering * phase[:, None] * found


def _between(shaft: Shaft, light: np.ndarray, eye: np.ndarray, directions: np.ndarray, start: np.ndarray, end: np.ndarray,
             extinction: np.ndarray) -> np.ndarray:
    """Integral (n, 3) [m] of the transmittance on the way window - fog - eye, from `start` to `end` (n,) [m]."""
    slant = light @ shaft.normal

    def crossed(distance: np.ndarray) -> np.ndarray:
        since_window = (eye - shaft.entry + distance[:, None] * directions) @ shaft.normal / slant
        return distance + np.maximum(since_window, 0)

    first, last = crossed(start), crossed(end)
    spent = np.abs(last - first)[:, None] * extinction
    mean = np.where(spent > 1e-12, -np.expm1(-spent) / np.maximum(spent, 1e-12), 1.0)
    return np.exp(-np.minimum(first, last)[:, None] * extinction) * mean * (end - start)[:, None]
