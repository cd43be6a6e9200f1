"""What the error of a foggy photograph is: one number, by one rule, wherever the project speaks of it."""

from __future__ import annotations

import numpy as np

#: Share of the picture's root mean square below which a difference is relative to that, and not to the pixel's own value.
DARKEST = 0.01


def relative_error(found: np.ndarray, true: np.ndarray, weights: np.ndarray | None = None) -> float:
    """Relative error of linear pixels `found` against `true`, both (n, 3), lamps left out.

    The larger of two root mean squares over pixels and channels: of the difference over that of the picture, which a
    lamp's surroundings decide, and of the difference over each value itself, which the dark parts decide. weights (n,):
    what each pixel stands for.
    """
    if not np.size(true):
        return 0.0
    found, true = np.asarray(found, float), np.asarray(true, float)
    weights = np.ones(len(true)) if weights is None else np.asarray(weights, float)
    weights = weights / weights.sum()

    def root_mean_square(values: np.ndarray) -> float:
        return float(np.sqrt(weights @ (values**2).mean(-1)))

    level = root_mean_square(true)
    if not level > 0:
        return root_mean_square(found)
    difference = found - true
    return max(root_mean_square(difference) / level,
               root_mean_square(difference / np.maximum(true, DARKEST * level)))


#: Draws with replacement that tell how uncertain an estimate from few pixels is.
RESAMPLED = 400
#: Quantile of the draws that `at_most` is: of few pixels, 0.98 of the draws bound some 95 % of the true errors (measured).
CONFIDENCE = 0.98
#: What a few pixels do not show of errors that single pixels make up.
TAILS = 1.3


def error_estimate(radiance: np.ndarray, found: tuple[np.ndarray, np.ndarray], true: tuple[np.ndarray, np.ndarray],
                   weights: np.ndarray, shared: float = 0.0) -> dict[str, float]:
    """What single pixels say of the whole picture's error.

    radiance (n, 3) of the clear photograph; found, true: T and V (n, 3) each; weights (n,): what each pixel stands for.
    shared: what both are off by together, so that the pixels cannot tell it.
    `relative_error` is their own with that, `at_most` what the whole picture's stays below by a bootstrap of them.
    """
    pictures = [radiance * t + v for t, v in (found, true)]
    random, n = np.random.default_rng(1), len(weights)
    draws = [random.integers(0, n, n) for _ in range(RESAMPLED)]
    errors = [relative_error(pictures[0][one], pictures[1][one], weights[one]) for one in draws]
    at_most = TAILS * float(np.quantile(errors, CONFIDENCE))
    return {"relative_error": float(np.hypot(relative_error(*pictures, weights), shared)),
            "at_most": float(np.hypot(at_most, shared)), "shared": shared,
            "transmittance": relative_error(found[0], true[0], weights),
            "in_scattering": relative_error(found[1], true[1], weights), "pixels": n}
