"""Intensities of interior lights, from a photograph and one clear render of each light.

Karsch et al. 2011 ("Rendering Synthetic Objects into Legacy Photographs") fit light parameters so that
a render over the estimated geometry matches the photograph, with albedo from an intrinsic
decomposition. Here the model at pixel p of segment s, per channel, is

    log I_p = a_s + log(sum_l w_l B_lp) + error,      w_l >= 0,

with a_s the log albedo of a segment (geometry face x albedo, see `albedo`), w_l the intensity of light
l and B_l the irradiance/pi, interreflection included, that light l gives at unit intensity. We differ
from Karsch et al. in solving albedo and intensities together, so that an error of the albedo guess is
not read as light, and in weighting residuals by a Cauchy loss against what the geometry leaves out.

Scale: (w, a) and (c w, a - log c) give the same photograph. An annotated albedo, an emitter's radiance
or a given intensity fixes c; failing all, the mean albedo of the photograph is taken as 0.5. Colour has
the same ambiguity per channel, settled half by neutral light (photographs are white-balanced) and half
by a grey mean albedo.

Interreflection depends on albedo, which depends on intensity: the caller renders the bases with
`IntensityFit.surface_albedo`, solves again with `start=fit.intensity`, and stops when the intensities
settle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.albedo import (
    DEFAULT_ALBEDO, HIGHEST_ALBEDO, LOWEST_ALBEDO, mean_albedo_per_surface)
from pipeline.estimation.intensity_problem import MEASURED_SPREAD, first_guesses, set_up
from pipeline.estimation.intensity_solver import (
    intensity_covariance, pixels_per_segment, solve, with_default_scale, with_light_colour)
from pipeline.estimation.observations import (
    EstimationMaps, check_input, reduce_for_estimation, usable_pixels, without_invalid)
from pipeline.estimation.separability import light_remarks, separability

__all__ = ["EstimationMaps", "IntensityFit", "estimate_intensities", "reduce_for_estimation"]

DEFAULT_ALBEDO_SPREAD = 0.35  # sd of log mean albedo among rooms: 0.35 to 0.7 lie within one


@dataclass(frozen=True)
class IntensityFit:
    """Intensities with all that says how far to trust them.

    intensity, standard_error: (L, 3), in the unit of the basis; the error is infinite for a light that
    reaches no usable pixel. albedo: (H, W, 3) in [0.02, 0.98]. segment: (H, W) int32, -1 unused, with
    segment_albedo (S, 3). surface_albedo: face index -> mean albedo (3,).
    residual_median, residual_p90: of |model/photograph - 1| over usable pixels and channels.
    condition_number: of the fit in relative intensities, the common scale taken as known to 10 %.
    correlation: (L, L) of the relative errors under the same premise. inseparable: light index pairs.
    """

    light_names: tuple[str, ...]
    intensity: np.ndarray
    standard_error: np.ndarray
    albedo: np.ndarray
    segment: np.ndarray
    segment_albedo: np.ndarray
    surface_albedo: dict[int, np.ndarray]
    usable_fraction: float
    residual_median: float
    residual_p90: float
    condition_number: float
    correlation: np.ndarray
    inseparable: tuple[tuple[int, int], ...]
    scale_source: str
    messages: tuple[str, ...]


def estimate_intensities(
    maps: EstimationMaps,
    light_names: Sequence[str],
    *,
    given: Mapping[int, np.ndarray] | None = None,
    measured: Mapping[int, np.ndarray] | None = None,
    at_least: Mapping[int, np.ndarray] | None = None,
    start: np.ndarray | None = None,
    max_side: int = 160,
) -> IntensityFit:
    """Intensity of every light, per channel, and the albedo of every surface.

    given: light index -> intensity (3,), kept as it is. measured: light index -> radiance (3,) of its
    unclipped emitter pixels (area lights, basis at unit radiance). at_least: light index -> intensity
    (3,) that a clipped emitter shows it to exceed. start: (L, 3), the result of an earlier round.
    max_side [pixel]: size at which the fit is made. Raises InputError when the photograph holds nothing
    to fit; a fit that rests on assumptions says so in `messages`.
    """
    names = tuple(light_names)
    given, measured, at_least = (
        {light: np.asarray(value, float) for light, value in (known or {}).items()}
        for known in (given, measured, at_least)
    )
    check_input(maps, names, given, measured, at_least)
    maps = without_invalid(maps)
    small = reduce_for_estimation(maps, max_side)
    usable, messages = usable_pixels(small), []
    if not usable.any():
        return _without_photograph(maps, names, given, measured)

    problem, contribution, unit = set_up(small, usable, given, measured, at_least, messages)
    scale_source = problem.scale_source
    seen = contribution > 0
    solution = solve(problem, first_guesses(problem, start, contribution, unit))
    if scale_source == "default albedo 0.5":
        solution = with_default_scale(problem, solution)
    problem = with_light_colour(problem, solution)
    solution = solve(problem, [solution.intensity])
    if scale_source == "default albedo 0.5":
        solution = with_default_scale(problem, solution)
        messages.append(
            "nothing fixes the scale of albedo against intensity: the mean albedo was taken as 0.5, so that "
            f"all intensities share an error of about {DEFAULT_ALBEDO_SPREAD:.0%}; annotate the albedo of "
            "one surface"
        )

    to_unit = np.divide(unit, contribution, out=np.zeros_like(contribution), where=seen)[:, None]
    intensity = solution.intensity * to_unit
    error = np.sqrt(np.maximum(np.diagonal(intensity_covariance(problem, solution), 0, 1, 2).T, 0)) * to_unit
    if scale_source == "default albedo 0.5":
        error = np.hypot(error, DEFAULT_ALBEDO_SPREAD * intensity)
    for light in np.flatnonzero(~seen):
        known = given.get(light, measured.get(light, at_least.get(light)))
        intensity[light], error[light] = (0, np.inf) if known is None else (known, np.inf)
        if light in given or light in measured:
            error[light] = 0 if light in given else MEASURED_SPREAD * known
            continue
        fallback = "0" if known is None else "the least that its clipped emitter allows"
        messages.append(
            f"light '{names[light]}' reaches no usable pixel, so its intensity was set to {fallback}; give "
            "its intensity by hand"
        )
    for light, value in given.items():
        intensity[light], error[light] = value, 0

    correlation, condition, pairs = separability(problem, solution, seen)
    messages += light_remarks(names, intensity, error, given, measured, at_least, seen, pairs, correlation)
    count = len(problem.face_of_segment)
    for stated, fitted in zip(np.exp(problem.prior_albedo[count:]), np.exp(solution.log_albedo[count:])):
        if not 0.85 < fitted.mean() / stated.mean() < 1.18:
            messages.append(
                f"the annotated albedo {np.round(stated, 2).tolist()} contradicts the lights, which ask for "
                f"{np.round(fitted, 2).tolist()} there: check it, and the lamps' strengths"
            )
    segment_albedo = np.exp(solution.log_albedo[:count])
    segment_albedo = np.clip(segment_albedo, LOWEST_ALBEDO, HIGHEST_ALBEDO)
    albedo, segment, surface_albedo = _albedo_maps(maps, problem, segment_albedo, intensity)
    if scale_source != "default albedo 0.5":
        share = np.mean(solution.log_albedo[problem.segment[: problem.pixels]].max(-1) > 0)
        if share > 0.05:
            messages.append(
                f"{share:.0%} of the surfaces would reflect more light than they get: a light is missing, or "
                f"the {scale_source} that fixes the scale is too low"
            )
    relative = np.abs(np.expm1(-solution.residual[: problem.pixels]))
    return IntensityFit(
        light_names=names,
        intensity=intensity,
        standard_error=error,
        albedo=albedo,
        segment=segment,
        segment_albedo=segment_albedo,
        surface_albedo=surface_albedo,
        usable_fraction=float(usable.mean()),
        residual_median=float(np.median(relative)),
        residual_p90=float(np.percentile(relative, 90)),
        condition_number=condition,
        correlation=correlation,
        inseparable=pairs,
        scale_source=scale_source,
        messages=tuple(messages),
    )


def _without_photograph(maps, names, given, measured) -> IntensityFit:
    """The fit when no pixel can be used: only what the person or the emitters say."""
    known = {**measured, **given}
    missing = [name for light, name in enumerate(names) if light not in known]
    if missing:
        reached = (maps.basis.sum(0) > 0).all(-1).mean()
        raise InputError(
            f"no pixel of the photograph can be used to estimate lights (clipped {maps.clipped.mean():.0%}, "
            f"brightest {maps.photograph.max():.3g}, reached by the lights {reached:.0%})",
            remedy="use a photograph that is neither black nor clipped, check that the lights face the room, "
            f"or give the intensity of {', '.join(missing)}",
        )
    intensity = np.array([known[light] for light in range(len(names))])
    spread = np.array([[0.0 if light in given else MEASURED_SPREAD] for light in range(len(names))])
    nothing = np.zeros((0, 3))
    return IntensityFit(
        light_names=names,
        intensity=intensity,
        standard_error=spread * intensity,
        albedo=np.full(maps.photograph.shape, DEFAULT_ALBEDO),
        segment=np.full(maps.surface.shape, -1, np.int32),
        segment_albedo=nothing,
        surface_albedo=mean_albedo_per_surface(nothing, [], [], maps.surface),
        usable_fraction=0.0,
        residual_median=0.0,
        residual_p90=0.0,
        condition_number=1.0,
        correlation=np.eye(len(names)),
        inseparable=(),
        scale_source="given intensity" if given else "emitter pixel",
        messages=("no pixel of the photograph can be used: nothing was fitted, and albedo is taken as 0.5",),
    )


def _albedo_maps(maps, problem, albedo_of_segment, intensity):
    """Albedo (H, W, 3), segment (H, W) and mean albedo by face.

    Where the photograph can be read, albedo is radiance over shading; elsewhere it is the segment's,
    or the mean of the face.
    """
    pixels = pixels_per_segment(problem)[: len(albedo_of_segment)]
    surface_albedo = mean_albedo_per_surface(albedo_of_segment, problem.face_of_segment, pixels, maps.surface)
    height, width = maps.surface.shape
    segment = cv2.resize(problem.segments, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    albedo = np.full(maps.photograph.shape, DEFAULT_ALBEDO)
    for face, mean in surface_albedo.items():
        albedo[maps.surface == face] = mean
    albedo[segment >= 0] = albedo_of_segment[segment[segment >= 0]]
    shading = np.einsum("lhwc,lc->hwc", maps.basis, intensity)
    readable = (shading > 0).all(-1) & ~maps.clipped & (maps.emitter < 0) & (maps.surface >= 0)
    albedo[readable] = maps.photograph[readable] / shading[readable]
    return np.clip(albedo, LOWEST_ALBEDO, HIGHEST_ALBEDO), segment, surface_albedo
