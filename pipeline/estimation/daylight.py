"""Sun and sky from shadowed and sunlit patches of known albedo (Liu et al. 2009; Zhao et al. 2013, eq. 6).

With the BRDF of a diffuse surface, albedo / pi, the paper's equations are, for a level patch that sees all of the sky,
I_shadowed = albedo * L_sky and I_sunlit = I_shadowed + albedo / pi * E_sun * cos. Houses and trees hide a part of the
sky and throw back light of their own: I_shadowed = albedo * (share * L_sky + reflected). A stated albedo counts as
exact: the standard errors are those of the pixels and of patches that disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.errors import InputError

#: Pixels farther from a patch's median than so many robust standard deviations are something else...
OUTLIERS = 3.0
#: ...unless they are as near as this share of it: a photograph's codes are steps of 1 to 3 %.
ALIKE = 0.03
#: Fewer pixels than this say nothing of a patch.
FEWEST_PIXELS = 9
#: Where more than this share of a surface is clipped, what is left does not tell how bright it is.
MOST_CLIPPED = 0.4
#: A patch is cut into so many blocks a side, whose means tell how far texture averages out; the worst counts, for
#: texture may be coarser than the smaller blocks.
BLOCKS = (6, 4, 3)
FEWEST_BLOCKS = 6
#: Patches that differ by more than this share of their median do not show the same light.
DISAGREEMENT = 0.5
#: Below this elevation over a patch (10 degrees) a degree of the sun's direction changes its strength by 10 %.
GRAZING = 0.17
#: A patch that sees less than this share of the sky does not tell of it.
LEAST_SKY = 0.02
#: A sun that facing it gives less than this share of the sky's pi * L is none that a photograph could show.
LEAST_SUN = 0.01
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class Patch:
    """Pixels of one surface: radiance (n, 3), clipped (n,), its albedo (3,) and unit normal (3,).

    places: (n, 2) [pixel], where they are. sky: share of the irradiance pi * L that a uniform sky leaves on it.
    reflected: radiance (3,) of everything else that it sees, times its share.
    """

    name: str
    radiance: np.ndarray
    clipped: np.ndarray
    places: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    sky: float
    reflected: np.ndarray


@dataclass(frozen=True)
class Measured:
    """A patch's radiance (3,) and its standard error (3,), by so many pixels."""

    patch: Patch
    radiance: np.ndarray
    error: np.ndarray
    pixels: int


@dataclass(frozen=True)
class DaylightFit:
    """sky: radiance (3,); sun: irradiance facing it (3,), 0 under an overcast sky; their standard errors; notes."""

    sky: np.ndarray
    sun: np.ndarray
    sky_error: np.ndarray
    sun_error: np.ndarray
    patches: dict[str, dict[str, object]]
    messages: list[str] = field(default_factory=list)


def patch_radiance(patch: Patch) -> Measured:
    """Robust mean radiance of a patch. Raises InputError where too few pixels are left.

    Pixels whose luminance is farther than OUTLIERS robust deviations (1.4826 MAD) from the median are left out: a
    leaf, a painted line, a person. Clipped pixels within them are the patch's own brightest: as many of its darkest
    go with them, or the mean would be too dark.
    """
    known = np.isfinite(patch.radiance).all(1)
    radiance, clipped, places = patch.radiance[known].astype(float), patch.clipped[known], patch.places[known]
    if len(radiance) < FEWEST_PIXELS:
        raise InputError(f"{patch.name} has fewer than {FEWEST_PIXELS} pixels", remedy="outline more of the surface")
    luminance = radiance @ LUMINANCE
    median = np.median(luminance)
    spread = 1.4826 * np.median(np.abs(luminance - median))
    own = np.abs(luminance - median) <= max(OUTLIERS * spread, ALIKE * abs(median))
    burnt = int((own & clipped).sum())
    kept = np.flatnonzero(own & ~clipped)
    if burnt > MOST_CLIPPED * own.sum() or clipped.mean() > 0.5:
        raise InputError(f"{clipped.mean():.0%} of {patch.name} is clipped", remedy="outline a darker surface")
    kept = kept[np.argsort(luminance[kept], kind="stable")[burnt:]]
    if len(kept) < FEWEST_PIXELS // 2:
        raise InputError(f"{patch.name} has hardly any pixels that are alike and not clipped",
                         remedy="outline more of the surface")
    # the error of a trimmed mean is that of the winsorized pixels (Tukey and McLaughlin 1963)
    winsorized = np.clip(radiance[own], radiance[kept].min(0), radiance[kept].max(0))
    error = _error_of_mean(winsorized, places[own]) * (own.sum() / len(kept))
    return Measured(patch, radiance[kept].mean(0), error, len(kept))


def _error_of_mean(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Standard error (3,) of the mean of pixels (n, 3) at (n, 2): by blocks, for texture ties neighbours together."""
    places = places - places.min(0)
    found = []
    for count in BLOCKS:
        size = np.maximum(2, np.ceil((places.max(0) + 1) / count))
        _, block = np.unique(places // size, axis=0, return_inverse=True)
        weights = np.bincount(block.ravel()).astype(float)
        if len(weights) < FEWEST_BLOCKS:
            continue
        off = np.stack([np.bincount(block.ravel(), channel) for channel in (values - values.mean(0)).T], 1)
        found.append(np.sqrt((off**2).sum(0) * len(weights) / (len(weights) - 1)) / weights.sum())
    # a patch too small for blocks is as uncertain as one pixel
    return np.max(found, 0) if found else values.std(0, ddof=1)


def fit_daylight(shadowed: Sequence[Patch], sunlit: Sequence[Patch], sun_direction: np.ndarray | None,
                 scale: float = 1.0) -> DaylightFit:
    """Sky and sun. Raises InputError where the patches leave no answer.

    sun_direction (3,): in which sunlight travels; None for an overcast sky, without `sunlit`. scale: the
    paper's s, on the sky's radiance.
    """
    messages: list[str] = []
    in_shade = [m for m in _measured(shadowed, messages) if _sees_sky(m.patch, messages)]
    if not in_shade:
        raise InputError(f"no shadowed patch can be used: {'; '.join(messages)}",
                         remedy="outline evenly coloured ground in the shade")
    values, errors = [], []
    for m in in_shade:
        from_things = m.patch.albedo * m.patch.reflected
        if (from_things >= m.radiance).any():
            messages.append(f"what lies round {m.patch.name} would alone make it as bright as it is; its albedo is too high")
        gain = 1 / (m.patch.albedo * m.patch.sky)
        values.append(np.maximum(m.radiance - from_things, 0) * gain)
        errors.append(m.error * gain)
    # as the patches show it; the paper's s makes the light of it
    sky, sky_error = _agreed("sky", in_shade, values, errors, messages)
    if sun_direction is None:
        return DaylightFit(scale * sky, np.zeros(3), scale * sky_error, np.zeros(3), _facts(in_shade), messages)

    facing = [m for m in _measured(sunlit, messages) if _faces(m.patch, sun_direction, messages)]
    if not facing:
        raise InputError(f"no sunlit patch can be used: {'; '.join(messages)}" if sunlit else "no sunlit patches",
                         remedy="outline evenly coloured ground in the sun, or leave out the light of type sunlight"
                                " under an overcast sky")
    values, errors, shares = [], [], []
    for m in facing:
        gain = np.pi / (m.patch.albedo * _cosine(m.patch, sun_direction))
        values.append((m.radiance - m.patch.albedo * (m.patch.sky * sky + m.patch.reflected)) * gain)
        errors.append(m.error * gain)
        shares.append(m.patch.albedo * m.patch.sky * gain)
    sun, sun_error = _agreed("sun", facing, values, errors, messages)
    # what is wrong with the sky is wrong in every sunlit patch alike
    sun_error = np.hypot(sun_error, np.mean(shares, 0) * sky_error)
    _judge(sun, sun_error, sky, messages)
    return DaylightFit(scale * sky, np.maximum(sun, 0), scale * sky_error, sun_error, _facts([*in_shade, *facing]),
                       messages)


def _judge(sun: np.ndarray, error: np.ndarray, sky: np.ndarray, messages: list[str]) -> None:
    """Says what is strange about the sun (3,) that was found, and refuses one that takes light away."""
    brightness, least = sun @ LUMINANCE, max(2 * error @ LUMINANCE, LEAST_SUN * np.pi * sky @ LUMINANCE)
    if brightness < -least:
        raise InputError("the sunlit patches are darker than the shadowed ones",
                         remedy="exchange them, or leave out the light of type sunlight under an overcast sky")
    if brightness < least:
        messages.append("the sunlit patches are hardly brighter than the shadowed ones: this may be an overcast sky,"
                        " without a light of type sunlight")
    elif (sun < 0).any():
        messages.append("in one channel the sunlit patches are darker than the shadowed ones; the sun has none of it")


def _measured(patches: Sequence[Patch], messages: list[str]) -> list[Measured]:
    found = []
    for patch in patches:
        try:
            found.append(patch_radiance(patch))
        except InputError as error:
            messages.append(f"{error.problem}; left out")
    return found


def _cosine(patch: Patch, sun_direction: np.ndarray) -> float:
    return float(-(patch.normal @ sun_direction))


def _sees_sky(patch: Patch, messages: list[str]) -> bool:
    if patch.sky >= LEAST_SKY:
        return True
    messages.append(f"{patch.name} sees nothing of the sky; left out")
    return False


def _faces(patch: Patch, sun_direction: np.ndarray, messages: list[str]) -> bool:
    """Whether the sun lights the patch, not only grazes it."""
    cosine = _cosine(patch, sun_direction)
    if cosine <= 0.01:
        messages.append(f"{patch.name} does not face the sun; left out")
        return False
    if cosine < GRAZING:
        messages.append(f"the sun stands {np.degrees(np.arcsin(cosine)):.1f} degrees over {patch.name}: each degree of"
                        f" its direction changes its strength by {np.pi / 180 / cosine:.0%}")
    return True


def _agreed(what: str, measured: Sequence[Measured], values: Sequence[np.ndarray], errors: Sequence[np.ndarray],
            messages: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Median over patches (n, 3), and its standard error: of the pixels, or of the patches where they disagree."""
    if len(values) == 1:
        return values[0], errors[0]
    stacked = np.array(values)
    median, luminance = np.median(stacked, 0), stacked @ LUMINANCE
    least, most = int(np.argmin(luminance)), int(np.argmax(luminance))
    if luminance[most] - luminance[least] > DISAGREEMENT * abs(median @ LUMINANCE):
        messages.append(
            f"the patches disagree about the {what}: {measured[least].patch.name} says {luminance[least]:.3g},"
            f" {measured[most].patch.name} {luminance[most]:.3g}; check their albedo, sky_visibility and shade")
    within = np.sqrt((np.array(errors) ** 2).sum(0)) / len(values)
    between = stacked.std(0, ddof=1) / np.sqrt(len(values))
    return median, np.maximum(within, between)


def _facts(measured: Sequence[Measured]) -> dict[str, dict[str, object]]:
    return {m.patch.name: {"radiance": m.radiance.tolist(), "standard_error": m.error.tolist(), "pixels": m.pixels,
                           "outlined_pixels": len(m.patch.radiance), "sky_share": m.patch.sky,
                           "reflected": m.patch.reflected.tolist()} for m in measured}
