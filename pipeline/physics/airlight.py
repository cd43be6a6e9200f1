"""In-scattering V of sunlight, skylight and bulbs along eye rays, without shadows: closed forms and quadrature.

All functions take `medium` (coefficients, density_path, density_along, daylight_path, top, phase), the eye (3,)
[m], unit `directions` (..., 3) and radial `depth` (...) [m], and return V (..., 3) at unit strength of the light.
Phase functions take the cosine between propagation directions.

Where the light's own way is clear, V = p * delta/kappa * (1 - exp(-tau)) whatever the density does along the ray
(delta/kappa is the same everywhere). Where the fog has a top the light is dimmed on its way down, and the ray
is cut into cells in which the logarithm of what arrives is taken as linear: exact for homogeneous slabs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

#: Cells along a ray where light is dimmed on its way, and the smallest of them in optical depths.
CELLS, SMALLEST_CELL = 64, 0.02
#: Rays at once: a few arrays of CELLS float64 each, some tens of megabytes.
_RAYS = 16384
#: Optical depth straight up and sine of the ray's elevation of the table of dimmed skylight.
_ZENITH_DEPTHS = np.concatenate([[0.0], np.geomspace(1e-3, 60.0, 48)])
_SINES = np.linspace(-1, 1, 41)


def directional(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray,
                light_direction: np.ndarray) -> np.ndarray:
    """V at unit irradiance of parallel light that travels along `light_direction` (3,)."""
    cosine = -(directions @ np.asarray(light_direction, float))
    phase = medium.phase().value(cosine)
    if medium.top() is None:
        return phase[..., None] * veil(medium, eye, directions, depth)

    def arriving(points, rays, extinction):
        return -extinction * medium.daylight_path(points, light_direction)

    return phase[..., None] * _dimmed(medium, eye, directions, depth, arriving)


def dome(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray, *, upper: bool) -> np.ndarray:
    """V at unit radiance from everywhere above the horizon (upper), or from everywhere below it.

    Light from below counts as clear. Skylight under a fog's top crosses fog as deep as straight above each
    point, divided by the sine of its elevation.
    """
    phase = medium.phase()
    if not upper or medium.top() is None:
        share = np.interp(directions[..., 1], _SINES, sky_share(phase))
        return (share if upper else 1 - share)[..., None] * veil(medium, eye, directions, depth)
    table = np.log(np.maximum(_dimmed_sky(phase), 1e-300))
    down = np.array([0.0, -1.0, 0.0])

    def arriving(points, rays, extinction):
        zenith = np.minimum(extinction * medium.daylight_path(points, down), _ZENITH_DEPTHS[-1])
        return _bilinear(table, zenith, np.broadcast_to(rays[:, None, 1], zenith.shape))

    return _dimmed(medium, eye, directions, depth, arriving)


def dome_arrival(medium: Any, points: np.ndarray) -> np.ndarray:
    """Transmittance (..., 3) of skylight to level surfaces at points (..., 3): 2 E3 of the depth above them."""
    if medium.top() is None:
        return np.ones((*np.shape(points)[:-1], 3))
    extinction = np.add(*medium.coefficients())
    zenith = medium.daylight_path(points, np.array([0.0, -1.0, 0.0]))[..., None] * extinction
    sines, weights = np.polynomial.legendre.leggauss(24)
    sines, weights = (sines + 1) / 2, weights / 2
    return sum(2 * w * s * np.exp(-zenith / s) for s, w in zip(sines, weights))


def veil(medium: Any, eye: np.ndarray, directions: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """delta/kappa * (1 - exp(-tau)), (..., 3): V in light that is the same all along the ray."""
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    path = medium.density_path(np.asarray(eye, float), eye + depth[..., None] * directions)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        albedo = np.where(extinction > 0, scattering / np.where(extinction > 0, extinction, 1), 0.0)
    return -np.expm1(-path * extinction) * albedo


# --- light that is dimmed on its way ----------------------------------------------------------------------


def _dimmed(medium, eye, directions, depth, arriving) -> np.ndarray:
    """V of light of which exp(arriving(points (n, k, 3), rays (n, 3), extinction)) reaches each point."""
    absorption, scattering = medium.coefficients()
    extinction = absorption + scattering
    shape, result = np.shape(depth), np.zeros((np.size(depth), 3))
    rays, ends = np.reshape(directions, (-1, 3)), np.reshape(depth, -1).astype(float)
    for first in range(0, len(ends), _RAYS):
        part = slice(first, first + _RAYS)
        edges = _cells(eye, rays[part], ends[part], float(extinction.max()), medium.top())
        path = medium.density_along(eye, rays[part], edges)
        points = eye + edges[..., None] * rays[part][:, None]
        for value in np.unique(extinction[extinction > 0]):
            tau = path * value
            logarithm = arriving(points, rays[part], value) - tau
            sums = (np.diff(tau, axis=-1) * _logarithmic_mean(logarithm)).sum(-1)
            same = extinction == value
            result[part, same] = sums[:, None] * (scattering[same] / value)
    return result.reshape(*shape, 3)


def _cells(eye, rays, ends, extinction, top) -> np.ndarray:
    """Distances (n, CELLS + 1) [m], rising, of cell borders where the ray is below the fog's top."""
    height = top - eye[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = np.where(rays[:, 1] != 0, height / rays[:, 1], np.inf)
    start = np.where((height < 0) & (rays[:, 1] < 0), np.minimum(crossing, ends), 0.0)
    end = np.where((height >= 0) & (rays[:, 1] > 0), np.minimum(crossing, ends), ends)
    end = np.where((height < 0) & (rays[:, 1] >= 0), start, end)
    length = np.maximum(end - start, 0.0)
    smallest = np.minimum(length / CELLS, SMALLEST_CELL / max(extinction, 1e-300))
    # geometric from the smallest cell on, so that near ones are fine in dense fog and far ones still end the ray
    growth = np.log1p(np.maximum(length / np.maximum(smallest, 1e-300), 1.0))
    steps = np.expm1(np.linspace(0, 1, CELLS + 1) * growth[:, None]) / np.expm1(growth)[:, None]
    return start[:, None] + length[:, None] * steps


def _logarithmic_mean(logarithm: np.ndarray) -> np.ndarray:
    """Mean of exp over each cell, linear in the logarithm between its borders (..., k + 1) -> (..., k)."""
    higher = np.maximum(logarithm[..., 1:], logarithm[..., :-1])
    drop = np.abs(np.diff(logarithm, axis=-1))
    small = drop < 1e-6
    return np.exp(higher) * np.where(small, 1 - drop / 2, -np.expm1(-drop) / np.where(small, 1.0, drop))


# --- the sky's half of the sphere ---------------------------------------------------------------------------


def _scattering_angles() -> tuple[np.ndarray, np.ndarray]:
    """Angles and solid-angle weights (sin included, without the azimuth's 2 pi), fine towards 0 and pi."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    borders = np.concatenate([[0.0], np.pi / 2 * 2.0 ** np.arange(-16, 1)])
    low, high = borders[:-1, None], borders[1:, None]
    angles = ((low + high) / 2 + (high - low) / 2 * nodes).ravel()
    shares = ((high - low) / 2 * weights).ravel() * np.sin(angles)
    return np.concatenate([angles, np.pi - angles]), np.concatenate([shares, shares])


def sky_share(phase: Any) -> np.ndarray:
    """Share of the phase-weighted sphere above the horizon by the ray's _SINES of elevation; 1/2 for level rays."""
    angles, weights = _scattering_angles()
    density = phase.value(np.cos(angles)) * weights
    above = _azimuth_above(angles, _SINES[:, None])
    return (density * above).sum(-1) / density.sum()


def _azimuth_above(angles: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Share of the cone of `angles` round a ray of this sine of elevation that lies above the horizon."""
    cosine = np.sqrt(np.maximum(1 - sine**2, 0))
    level, swing = np.cos(angles) * sine, np.sin(angles) * cosine
    ratio = np.clip(np.where(swing > 1e-12, -level / np.maximum(swing, 1e-12), -np.sign(level) * 2), -1, 1)
    return np.arccos(ratio) / np.pi


def _dimmed_sky(phase: Any) -> np.ndarray:
    """Phase-weighted skylight (zenith depth, sine of elevation) that a layer above lets through."""
    angles, weights = _scattering_angles()
    density = phase.value(np.cos(angles)) * weights
    azimuths = (np.arange(48) + 0.5) * np.pi / 48
    result = np.zeros((len(_ZENITH_DEPTHS), len(_SINES)))
    for j, sine in enumerate(_SINES):
        cosine = np.sqrt(max(1 - sine**2, 0))
        height = (np.cos(angles) * sine)[:, None] + np.outer(np.sin(angles) * cosine, np.cos(azimuths))
        up = height > 1e-9
        for i, zenith in enumerate(_ZENITH_DEPTHS):
            through = np.where(up, np.exp(-zenith / np.where(up, height, 1.0)), 0.0).mean(-1)
            result[i, j] = (density * through).sum() / density.sum()
    return result


def _bilinear(table: np.ndarray, zenith: np.ndarray, sine: np.ndarray) -> np.ndarray:
    row = np.clip(np.searchsorted(_ZENITH_DEPTHS, zenith, side="right") - 1, 0, len(_ZENITH_DEPTHS) - 2)
    across = (zenith - _ZENITH_DEPTHS[row]) / (_ZENITH_DEPTHS[row + 1] - _ZENITH_DEPTHS[row])
    place = (np.clip(sine, -1, 1) + 1) / 2 * (len(_SINES) - 1)
    column = np.clip(place.astype(int), 0, len(_SINES) - 2)
    along = place - column
    return ((1 - across) * ((1 - along) * table[row, column] + along * table[row, column + 1])
            + across * ((1 - along) * table[row + 1, column] + along * table[row + 1, column + 1]))
