"""Sun and sky from shadowed and sunlit patches of known albedo (Liu et al. 2009; Zhao et al. 2013, eq. 6).

With the BRDF of a diffuse surface, albedo / pi, the paper's equations are, for a level patch that sees all of the sky,
I_shadowed = albedo * L_sky and I_sunlit = I_shadowed + albedo / pi * E_sun * cos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

#: Pixels farther from a patch's median than so many robust standard deviations are something else.
OUTLIERS = 3.0
#: Fewer pixels than this say nothing of a patch.
FEWEST_PIXELS = 9
#: A sun that adds less than this share of the patch's own spread is no sun.
LEAST_SUN = 0.05


@dataclass(frozen=True)
class Patch:
    """Pixels of one surface: radiance (n, 3), clipped (n,), its albedo (3,) and unit normal (3,).

    sky_visibility: share of the sky above its own plane that nothing hides.
    """

    name: str
    radiance: np.ndarray
    clipped: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    sky_visibility: float = 1.0


@dataclass(frozen=True)
class DaylightFit:
    """sky: radiance (3,); sun: irradiance facing it (3,), 0 under an overcast sky; their standard errors; notes."""

    sky: np.ndarray
    sun: np.ndarray
    sky_error: np.ndarray
    sun_error: np.ndarray
    patches: dict[str, dict[str, object]]
    messages: list[str] = field(default_factory=list)


def patch_radiance(patch: Patch) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Robust mean radiance (3,) of a patch, its standard error (3,) and the pixels used; None of too few.

    Clipped pixels and those whose luminance is farther than OUTLIERS robust deviations (1.4826 MAD) from the
    median are left out: a leaf, a painted line, a person.
    """
    usable = patch.radiance[~patch.clipped & np.isfinite(patch.radiance).all(1)].astype(float)
    if len(usable) < FEWEST_PIXELS:
        return None
    luminance = usable @ [0.2126, 0.7152, 0.0722]
    median = np.median(luminance)
    spread = 1.4826 * np.median(np.abs(luminance - median))
    kept = usable[np.abs(luminance - median) <= max(OUTLIERS * spread, 1e-9)]
    # neighbouring pixels share their texture: count one in nine as independent
    return kept.mean(0), kept.std(0) / np.sqrt(max(len(kept) / 9, 1)), len(kept)


def fit_daylight(shadowed: Sequence[Patch], sunlit: Sequence[Patch], sun_direction: np.ndarray | None,
                 ground: np.ndarray, scale: float = 1.0) -> DaylightFit | str:
    """Sky and sun, or the reason why there is no answer.

    sun_direction (3,): in which sunlight travels; None for an overcast sky, without `sunlit`. ground (3,): radiance
    of the ground, which lights upright patches from below. scale: the paper's s, on the sky's radiance.
    """
    facts: dict[str, dict[str, object]] = {}
    messages: list[str] = []

    def estimates(patches, of_patch):
        values, errors = [], []
        for patch in patches:
            measured = patch_radiance(patch)
            if measured is None:
                messages.append(f"{patch.name} has fewer than {FEWEST_PIXELS} pixels that are not clipped; left out")
                continue
            mean, error, count = measured
            value, gain = of_patch(patch, mean)
            values.append(value)
            errors.append(error * gain)
            facts[patch.name] = {"radiance": mean.tolist(), "pixels": count}
        return _combined(np.array(values), np.array(errors)) if values else None

    def from_shadow(patch, mean):
        up = (1 + patch.normal[1]) / 2
        gain = scale / (patch.albedo * max(up * patch.sky_visibility, 1e-6))
        return np.maximum(mean - patch.albedo * (1 - up) * ground, 0) * gain, gain

    sky = estimates(shadowed, from_shadow)
    if sky is None:
        return "no shadowed patch has enough pixels that are not clipped"
    if not sunlit or sun_direction is None:
        return DaylightFit(sky[0], np.zeros(3), sky[1], np.zeros(3), facts, messages)

    def from_sun(patch, mean):
        cosine = float(-(patch.normal @ sun_direction))
        up = (1 + patch.normal[1]) / 2
        by_sky = patch.albedo * (up * patch.sky_visibility * sky[0] / scale + (1 - up) * ground)
        gain = np.pi / (patch.albedo * max(cosine, 1e-6))
        if cosine <= 0.01:
            messages.append(f"{patch.name} does not face the sun; left out")
            return np.full(3, np.nan), gain
        return (mean - by_sky) * gain, gain

    sun = estimates(sunlit, from_sun)
    if sun is None or not np.isfinite(sun[0]).all():
        return "no sunlit patch faces the sun with enough pixels that are not clipped"
    if (sun[0] < 0).any():
        if sun[0].max() <= 0:
            return ("the sunlit patches are darker than the shadowed ones; exchange them, or leave out the light of type"
                    " sunlight under an overcast sky")
        messages.append("in one channel the sunlit patches are darker than the shadowed ones; the sun has none of it")
    return DaylightFit(sky[0], np.maximum(sun[0], 0), sky[1], sun[1], facts, messages)


def _combined(values: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Median over patches (n, 3), and its standard error: of the pixels, or of the patches where they disagree."""
    known = np.isfinite(values).all(1)
    values, errors = values[known], errors[known]
    if not len(values):
        return np.full(3, np.nan), np.full(3, np.nan)
    within = np.sqrt((errors**2).sum(0)) / len(values)
    between = values.std(0, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.zeros(3)
    return np.median(values, 0), np.maximum(within, between)
