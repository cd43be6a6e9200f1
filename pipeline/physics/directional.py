"""Directional light in homogeneous fog, in closed form.

The phase function is constant along an eye ray, and the optical depth to the eye and to the window
are both linear in the distance s along the ray, so that all that is left to integrate over a sunlit
segment is exp(-(constant + gradient * s)).
"""

from __future__ import annotations

import numpy as np

from pipeline.errors import InputError


def attenuated_path_integral(start: np.ndarray, end: np.ndarray, optical_depth: np.ndarray,
                             gradient: np.ndarray) -> np.ndarray:
    """Integral of exp(-(optical_depth + gradient * s)) ds from `start` to `end` [m].

    For a ray x(s) = x0 + s v in fog of extinction kappa, with w(x) the `window_distance`,
    optical_depth = kappa w(x0) and gradient = kappa (1 + dw/ds) [1/m]. All four broadcast, in
    float64. The gradient may have either sign or vanish. An interval with end <= start is empty and
    gives 0; `end` may be infinite, which gives infinity unless the gradient is positive.
    """
    start, end, optical_depth, gradient = np.broadcast_arrays(
        *(np.asarray(a, float) for a in (start, end, optical_depth, gradient)))
    # Measured from the brighter end the exponent only grows: nothing overflows before the result does.
    brighter = np.where(gradient >= 0, start, end)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        length = np.where(end > start, end - start, 0.0)
        exponent = np.abs(gradient) * length
        mean = np.where(exponent > 0, -np.expm1(-exponent) / exponent, 1.0)
        shrunk = np.where(np.isinf(length) & (gradient != 0), 1 / np.abs(gradient), length * mean)
        least = optical_depth + np.where(gradient == 0, 0.0, gradient * brighter)
        return np.where(length > 0, np.exp(-least) * shrunk, 0.0)


def window_distance(points: np.ndarray, window_point: np.ndarray, window_normal: np.ndarray,
                    sun_direction: np.ndarray) -> np.ndarray:
    """Distance [m] that sunlight has travelled from the window's plane to `points`, (..., 3); (...).

    Linear in position; negative outside, where the sun has yet to reach the window.
    sun_direction is the unit vector in which sunlight travels. The window's normal, of any length
    and either sign, must not be at right angles to it (InputError).
    """
    normal = np.asarray(window_normal, float)
    rate = float(normal @ np.asarray(sun_direction, float))
    if abs(rate) <= 1e-9 * np.linalg.norm(normal):
        raise InputError("the sun shines parallel to the window's plane, so that no light enters",
                         remedy="check the window's plane and the sun direction")
    return (np.asarray(points, float) - window_point) @ normal / rate
