"""Skylight and light from the ground in fog that something stands round, as factors of what they are without.

V of light from all sides is the integral of extinction T J along the eye ray, J being the radiance that arrives, weighted
by the phase function. Where something upright hides sky or ground from a point J lacks their part, and has the thing's
own radiance. Factors of V, rather than V, keep what closed forms know of fog with a top.
"""

from __future__ import annotations

from typing import Any

import numpy as np

#: Directions over each of which the phase function is averaged, so that no narrow peak falls between them.
WITHIN = 24
#: Shares of the phase function below this light nothing that shows.
LEAST_SHARE = 1e-6


def weights(phase: Any, rays: np.ndarray, directions: np.ndarray, solid_angles: np.ndarray) -> np.ndarray:
    """Share (h, w, d) of the light scattered into rays (h, w, 3) that comes from each of `directions` (d, 3), which stand for
    solid angles (d,) [sr]; their sum is 1."""
    cosine = np.clip(rays @ directions.T, -1, 1)[..., None]
    # averaged over a cap of that solid angle
    index = np.arange(WITHIN) + 0.5
    aside = np.arccos(1 - np.outer(solid_angles, index / WITHIN) / (2 * np.pi))
    turn = index * np.pi * (3 - np.sqrt(5))
    within = cosine * np.cos(aside) + np.sqrt(1 - cosine**2) * np.sin(aside) * np.cos(turn)
    found = phase.value(np.clip(within, -1, 1)).mean(-1) * solid_angles
    return found / found.sum(-1, keepdims=True)


def left_of(weight: np.ndarray, half: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Share (h, w, k, 1) of the light from one half (d,) of the sphere that is left where it is seen (h, w, k, d); weight (h, w, d)."""
    whole = np.maximum(weight[..., half].sum(-1), LEAST_SHARE)[..., None]
    return (np.einsum("ijd,ijkd->ijk", weight[..., half], seen[..., half].astype(float)) / whole)[..., None]


def instead(weight: np.ndarray, radiance: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Radiance (h, w, k, d, 3) by the phase function, relative to a light's `own` (h, w, 3) by it, (h, w, k, 3).

    A channel that the light does not have stays without.
    """
    found, own = np.einsum("ijd,ijkdc->ijkc", weight, radiance), own[:, :, None]
    return np.where(own > 0, found / np.where(own > 0, own, 1), 0)


def along_rays(medium: Any, eye: np.ndarray, rays: np.ndarray, depth: np.ndarray, distances: np.ndarray, values: np.ndarray
               ) -> np.ndarray:
    """Mean (h, w, 3) of values (h, w, k + 1, 3) along rays (h, w, 3) up to depth (h, w) [m], weighted as scattered light
    reaches the eye: at `distances` (k,) [m], and farther than the last of them by half a step."""
    extinction = np.add(*medium.coefficients())
    steps = np.sqrt(distances[1:] * distances[:-1])
    borders = np.concatenate([[0.0], steps, [distances[-1] ** 2 / steps[-1]], [np.inf]])
    ends = np.minimum(borders, depth[..., None])
    path = medium.density_along(eye, rays.reshape(-1, 3), ends.reshape(-1, len(borders))).reshape(ends.shape)
    tau = path[..., None] * extinction
    # what each cell adds, relative to the whole: thin fog is as the densities are
    weight = np.exp(-tau[..., :-1, :]) * -np.expm1(-np.diff(tau, axis=-2))
    total = weight.sum(-2)
    some = total > 0
    weight = np.where(some[..., None, :], weight / np.where(some, total, 1)[..., None, :], 0)
    weight[..., 0, :] = np.where(some, weight[..., 0, :], 1)
    return np.einsum("ijkc,ijkc->ijc", weight, values)
