"""In-scattering V of sunlight, skylight and light from the ground along eye rays, without shadows.

All functions take `medium` (coefficients, density_path, density_along, daylight_path, top, layered, phase), the eye
(3,) [m], unit `directions` (..., 3) and radial `depth` (...) [m], and return V (..., 3) at unit strength of the light.
Phase functions take the cosine between propagation directions.

Where the light's own way is clear, V = p * delta/kappa * (1 - exp(-tau)) whatever the density does along the ray
(delta/kappa is the same everywhere). Where the fog has a top the light is dimmed on its way down. In level layers
the optical depth above a point is linear in that along the ray, so that sunlight has a closed form and skylight is a
function of the ray's elevation and optical depth alone. Elsewhere the ray is cut into cells in which the logarithm of
what arrives is taken as linear in optical depth.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

#: Cells along a ray through uneven fog with a top: even ones, and some that grow from a smallest in optical depths.
EVEN_CELLS, GROWING_CELLS, SMALLEST_CELL = 112, 48, 0.02
#: Rays at once: a few arrays of float64 for each cell, some tens of megabytes.
_RAYS = 16384
#: Optical depth behind which nothing is left: exp(-60) is 1e-26.
DEEPEST = 60.0
#: Nodes of the tables of skylight by the sine of the ray's elevation, dense round the horizon, where a narrow phase
#: function sees the sky begin; and by optical depth, as log(tau + _THIN).
_TURN, _THIN = 300.0, 1e-3
_SINES, _FINE_SINES = (np.sinh(np.linspace(-1, 1, n) * np.arcsinh(_TURN)) / _TURN for n in (97, 385))
_DEPTHS, _FINE_DEPTHS = (np.geomspace(_THIN, DEEPEST + _THIN, n) - _THIN for n in (61, 361))
_NODES = np.polynomial.legendre.leggauss(4)
#: Panels of quadrature over the sky, each half as wide as the last towards a narrow phase function's peak.
_HALVINGS = 22


def directional(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray,
                light_direction: np.ndarray) -> np.ndarray:
    """V at unit irradiance of parallel light that travels along `light_direction` (3,)."""
    light_direction = np.asarray(light_direction, float)
    phase = medium.phase().value(-(directions @ light_direction))[..., None]
    if medium.top() is None:
        return phase * veil(medium, eye, directions, depth)
    if medium.layered:
        return phase * _through_layers(medium, eye, directions, depth, light_direction)

    path = medium.daylight(light_direction, np.size(depth) * EVEN_CELLS)
    return phase * _dimmed(medium, eye, directions, depth, lambda points, sines, value: -value * path(points))


def dome(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, *, upper: bool) -> np.ndarray:
    """V at unit radiance from everywhere above the horizon (upper), or from everywhere below it.

    Light from below counts as clear. Skylight under a fog's top crosses fog as deep as straight above each
    point, divided by the sine of its elevation.
    """
    sines = np.clip(directions[..., 1], -1, 1)
    if not upper or medium.top() is None:
        share = clear_skylight(medium.phase(), sines if upper else -sines)
        return share[..., None] * veil(medium, eye, directions, depth)
    table = scipy.interpolate.RectBivariateSpline(_across(_DEPTHS), _along(_SINES),
                                np.log(np.maximum(skylight(medium.phase(), _DEPTHS), 1e-300)))

    def arriving(zenith, sines):
        return table.ev(_across(np.clip(zenith, 0, DEEPEST)), _along(sines))

    if medium.layered:
        return _sky_through_layers(medium, eye, directions, depth, arriving)
    values = [value for value, _, _ in _channels(medium)]
    paths = dict(zip(values, medium.skylight(values, np.size(depth) * EVEN_CELLS)))
    return _dimmed(medium, eye, directions, depth,
                   lambda points, sines, value: arriving(value * paths[value](points), sines))


def dome_arrival(medium: Any, points: np.ndarray) -> np.ndarray:
    """Transmittance (..., 3) of skylight to level surfaces at points (..., 3): 2 E3 of the depth above them."""
    if medium.top() is None:
        return np.ones((*np.shape(points)[:-1], 3))
    extinction = np.add(*medium.coefficients())
    values, channel = np.unique(extinction, return_inverse=True)
    paths = medium.skylight(np.maximum(values, 1e-300).tolist(), points[..., 0].size)
    through = [2 * scipy.special.expn(3, value * path(points)) for value, path in zip(values, paths)]
    return np.stack([through[k] for k in channel], axis=-1)


def veil(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """delta/kappa * (1 - exp(-tau)), (..., 3): V in light that is the same all along the ray."""
    path = medium.density_path(np.asarray(eye, float), eye + depth[..., None] * directions)
    result = np.zeros((*np.shape(depth), 3))
    for value, share, same in _channels(medium):
        result[..., same] = -np.expm1(-value * path)[..., None] * share
    return result


def _channels(medium: Any):
    """Extinction [1/m] > 0, single-scattering albedo of those channels that have it, and which they are."""
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    for value in np.unique(extinction[extinction > 0]):
        same = extinction == value
        yield float(value), scattering[same] / value, same


# --- level layers -------------------------------------------------------------------------------------------


def _through_layers(medium, eye, directions, depth, light_direction) -> np.ndarray:
    """delta/kappa times the share of sunlight, (..., 3), that layers dim before and after it is scattered."""
    ends = eye + depth[..., None] * directions
    path = medium.density_path(np.asarray(eye, float), ends)
    down = medium.daylight_path(np.stack([np.broadcast_to(eye, ends.shape), ends], -2), light_direction)
    result = np.zeros((*np.shape(depth), 3))
    for value, share, same in _channels(medium):
        logarithm = -value * down
        logarithm[..., 1] -= value * path
        result[..., same] = (value * path * _logarithmic_mean(logarithm)[..., 0])[..., None] * share
    return result


def _sky_through_layers(medium, eye, directions, depth, arriving) -> np.ndarray:
    """V of skylight: a table of its mean, weighted by exp(-tau), up to an optical depth along a ray."""
    path = medium.density_path(np.asarray(eye, float), eye + depth[..., None] * directions)
    above = float(medium.daylight_path(np.asarray(eye, float), np.array([0.0, -1.0, 0.0])))
    result = np.zeros((*np.shape(depth), 3))
    for value, share, same in _channels(medium):
        sines = _FINE_SINES[:, None]
        logarithm = arriving(value * above - _FINE_DEPTHS * sines, sines) - _FINE_DEPTHS
        sums = np.cumsum(np.diff(_FINE_DEPTHS) * _logarithmic_mean(logarithm), -1)
        mean = np.column_stack([logarithm[:, 0], np.log(sums / -np.expm1(-_FINE_DEPTHS[1:]))])
        spline = scipy.interpolate.RectBivariateSpline(_along(_FINE_SINES), _across(_FINE_DEPTHS), mean)
        tau = value * path
        found = np.exp(spline.ev(_along(np.clip(directions[..., 1], -1, 1)), _across(np.minimum(tau, DEEPEST))))
        result[..., same] = (found * -np.expm1(-tau))[..., None] * share
    return result


# --- light that is dimmed on its way ----------------------------------------------------------------------


def _dimmed(medium, eye, directions, depth, arriving) -> np.ndarray:
    """V of light of which exp(arriving(points (n, 3), sines (n,) of their rays, extinction)) reaches each point."""
    densest = float(np.add(*medium.coefficients()).max())
    shape, result = np.shape(depth), np.zeros((np.size(depth), 3))
    rays, ends = np.reshape(directions, (-1, 3)), np.reshape(depth, -1).astype(float)
    for first in range(0, len(ends), _RAYS):
        part = slice(first, first + _RAYS)
        edges = _cells(eye, rays[part], ends[part], densest, medium.top())
        path = medium.density_along(eye, rays[part], edges)
        # what reaches a point is asked for only where there is fog to scatter it
        foggy = np.pad(np.diff(path) > 0, ((0, 0), (1, 1)))
        foggy = foggy[:, 1:] | foggy[:, :-1]
        ray = np.nonzero(foggy)[0]
        points, sines = eye + edges[foggy][:, None] * rays[part][ray], np.clip(rays[part][ray, 1], -1, 1)
        for value, share, same in _channels(medium):
            tau = path * value
            logarithm = -tau
            logarithm[foggy] += arriving(points, sines, value)
            sums = (np.diff(tau, axis=-1) * _logarithmic_mean(logarithm)).sum(-1)
            result[part, same] = sums[:, None] * share
    return result.reshape(*shape, 3)


def _cells(eye, rays, ends, extinction, top) -> np.ndarray:
    """Distances (n, k) [m], rising, of cell borders where the ray is below the fog's top."""
    height = top - eye[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(rays[:, 1] != 0, height / rays[:, 1], np.inf)
    start = np.where((height < 0) & (rays[:, 1] < 0), np.minimum(crossing, ends), 0.0)
    end = np.where((height >= 0) & (rays[:, 1] > 0), np.minimum(crossing, ends), ends)
    end = np.where((height < 0) & (rays[:, 1] >= 0), start, end)
    length = np.maximum(end - start, 0.0)
    smallest = np.minimum(length / GROWING_CELLS, SMALLEST_CELL / max(extinction, 1e-300))
    # those that grow are fine near the eye in dense fog, the even ones follow what is uneven
    growth = np.log1p(np.maximum(length / np.maximum(smallest, 1e-300), 1.0))
    growing = np.expm1(np.linspace(0, 1, GROWING_CELLS + 1) * growth[:, None]) / np.expm1(growth)[:, None]
    even = np.broadcast_to(np.arange(1, EVEN_CELLS) / EVEN_CELLS, (len(length), EVEN_CELLS - 1))
    steps = np.sort(np.concatenate([growing, even], axis=1), axis=1)
    return start[:, None] + length[:, None] * steps


def _logarithmic_mean(logarithm: np.ndarray) -> np.ndarray:
    """Mean of exp over each cell, linear in the logarithm between its borders (..., k + 1) -> (..., k)."""
    higher = np.maximum(logarithm[..., 1:], logarithm[..., :-1])
    drop = np.abs(np.diff(logarithm, axis=-1))
    small = drop < 1e-6
    return np.exp(higher) * np.where(small, 1 - drop / 2, -np.expm1(-drop) / np.where(small, 1.0, drop))


# --- the sky's half of the sphere ---------------------------------------------------------------------------


#: The last phase function that was asked for, and its table: each view of a photograph asks anew.
_LAST: list[tuple[Any, np.ndarray]] = []


def clear_skylight(phase: Any, sines: np.ndarray) -> np.ndarray:
    """Share (...) of the phase function that falls on the sky, for rays whose elevation has these sines (...)."""
    return np.interp(sines, _SINES, _clear_skylight(phase))


def _clear_skylight(phase: Any) -> np.ndarray:
    """`skylight` without fog above, by `_SINES`."""
    for known, table in list(_LAST):
        if known is phase or known == phase:
            return table
    table = skylight(phase, np.zeros(1))[0]
    _LAST[:] = [(phase, table)]
    return table


def skylight(phase: Any, zenith: np.ndarray, sines: np.ndarray = _SINES) -> np.ndarray:
    """Phase-weighted share of the sky's light, (n, m), that a layer of optical depth `zenith` (n,) lets through.

    sines (m,): of the elevation of the ray that it is scattered into. For depth 0 the share of the sphere above
    the horizon: 1/2 for level rays.
    """
    azimuths, weights = _gauss(_halving(0, np.pi))
    across, weights = np.cos(azimuths), 2 * weights
    result = np.empty((len(zenith), len(sines)))
    for j, sine in enumerate(sines):
        # the phase function's peaks lie at the ray's own elevation and, behind, as far below the horizon
        peak = abs(sine)
        heights, shares = _gauss(np.unique(np.concatenate([_halving(0, peak), _halving(peak, 1)])))
        cosines = (heights * sine)[:, None] + np.outer(np.sqrt((1 - heights**2) * (1 - sine**2)), across)
        result[:, j] = np.exp(-zenith[:, None] / heights) @ (phase.value(cosines) @ weights * shares)
    return result


def _halving(low: float, high: float) -> np.ndarray:
    """Borders from low to high, twice as near to an end each."""
    half = 2.0 ** -np.arange(_HALVINGS, 0, -1)
    return np.concatenate([[low], low + (high - low) * half, (high - (high - low) * half)[::-1], [high]])


def _gauss(borders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights between neighbouring borders."""
    nodes, weights = _NODES
    low, length = borders[:-1, None], np.diff(borders)[:, None]
    return (low + length * (nodes + 1) / 2).ravel(), (length * weights / 2).ravel()


def _along(sines: np.ndarray) -> np.ndarray:
    return np.arcsinh(_TURN * sines)


def _across(depths: np.ndarray) -> np.ndarray:
    return np.log(depths + _THIN)
