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
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy import ndimage, sparse
from scipy.optimize import nnls

from pipeline.errors import InputError
from pipeline.estimation.albedo import (
    DEFAULT_ALBEDO,
    HIGHEST_ALBEDO,
    LOWEST_ALBEDO,
    albedo_segments,
    log_reflectance,
    mean_albedo_per_surface,
)

DEFAULT_ALBEDO_SPREAD = 0.35  # sd of log mean albedo among rooms: 0.35 to 0.7 lie within one
GREY_SPREAD = 0.25  # most that the log mean albedo of a room is taken to differ between channels
SEGMENT_SPREAD = 0.6  # sd of a surface's log albedo: black rubber to white paint within two
ANNOTATED_SPREAD = 0.01  # relative: an annotated albedo wins over what the surfaces suggest
MEASURED_SPREAD = 0.004  # relative: an unclipped emitter pixel is the radiance, and wins over an annotated albedo
LIGHT_COLOUR_SPREAD = 0.3  # relative: tungsten beside daylight after white balance
MODEL_ERROR = 0.05  # relative error of a render over boxes below which residuals say nothing
# Neighbouring pixels share their errors. One observation is counted for this many reduced pixels in
# the fit; standard errors are taken from blocks of this side (cluster-robust covariance).
CORRELATED_PIXELS, BLOCK_SIDE = 25, 8
CAUCHY = 2.385  # 95 % efficient at a normal error
INSEPARABLE = -0.95
DARKEST = 0.004  # of the photograph's 99th percentile: below it, 8-bit sRGB has under two levels


@dataclass(frozen=True)
class EstimationMaps:
    """What is known at each pixel.

    photograph: (H, W, 3) linear. basis: (L, H, W, 3) irradiance/pi of each light at unit intensity.
    surface: (H, W) int32 face index, -1 none. emitter: (H, W) int32 light index, -1 none.
    clipped: (H, W) bool. annotated: pairs of mask (H, W) bool and albedo (3,).
    """

    photograph: np.ndarray
    basis: np.ndarray
    surface: np.ndarray
    emitter: np.ndarray
    clipped: np.ndarray
    annotated: tuple[tuple[np.ndarray, np.ndarray], ...] = ()


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


def reduce_for_estimation(maps: EstimationMaps, max_side: int = 160) -> EstimationMaps:
    """The same maps at no more than `max_side` pixels a side.

    Radiance is averaged over area; a reduced pixel is clipped if any of its pixels is, shows an
    emitter if any does, is annotated if more than half is; faces are taken from the nearest pixel.
    """
    height, width = maps.surface.shape
    scale = max_side / max(height, width)
    if scale >= 1:
        return maps
    size = (max(1, round(width * scale)), max(1, round(height * scale)))

    def mean(image):
        return cv2.resize(np.ascontiguousarray(image, np.float32), size, interpolation=cv2.INTER_AREA)

    def nearest(labels):
        return cv2.resize(labels.astype(np.int32), size, interpolation=cv2.INTER_NEAREST_EXACT)

    emitter = nearest(maps.emitter)
    for light in np.unique(maps.emitter[maps.emitter >= 0]):
        emitter[mean(maps.emitter == light) > 0] = light
    return EstimationMaps(
        photograph=mean(maps.photograph).astype(float),
        basis=np.stack([mean(of_light) for of_light in maps.basis]).astype(float),
        surface=nearest(maps.surface),
        emitter=emitter,
        clipped=mean(maps.clipped) > 0,
        annotated=tuple((mean(mask) > 0.5, albedo) for mask, albedo in maps.annotated),
    )


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
    _check(maps, names, given, measured, at_least)
    maps = _without_invalid(maps)
    small = reduce_for_estimation(maps, max_side)
    usable, messages = _usable(small), []
    if not usable.any():
        return _without_photograph(maps, names, given, measured)

    problem, contribution, unit = _problem(small, usable, given, measured, at_least, messages)
    scale_source = problem.scale_source
    seen = contribution > 0
    solution = _solve(problem, _starts(problem, start, contribution, unit))
    if scale_source == "default albedo 0.5":
        solution = _default_scale(problem, solution)
    problem = _with_light_colour(problem, solution)
    solution = _solve(problem, [solution.intensity])
    if scale_source == "default albedo 0.5":
        solution = _default_scale(problem, solution)
        messages.append(
            "nothing fixes the scale of albedo against intensity: the mean albedo was taken as 0.5, so that "
            f"all intensities share an error of about {DEFAULT_ALBEDO_SPREAD:.0%}; annotate the albedo of "
            "one surface"
        )

    to_unit = np.divide(unit, contribution, out=np.zeros_like(contribution), where=seen)[:, None]
    intensity = solution.intensity * to_unit
    error = np.sqrt(np.maximum(np.diagonal(_covariance(problem, solution), 0, 1, 2).T, 0)) * to_unit
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

    correlation, condition, pairs = _separability(problem, solution, seen)
    messages += _remarks(names, intensity, error, given, measured, at_least, seen, pairs, correlation)
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


# --- input ---------------------------------------------------------------------------------------


def _check(maps, names, given, measured, at_least) -> None:
    shape = maps.surface.shape
    if not names:
        raise InputError("the scene has no lights", remedy="annotate at least one lamp, window or sun patch")
    if maps.basis.shape != (len(names), *shape, 3) or maps.photograph.shape != (*shape, 3):
        raise ValueError(f"basis {maps.basis.shape}, photograph {maps.photograph.shape}, surface {shape}")
    if not np.isfinite(maps.basis).all() or (maps.basis < 0).any():
        raise ValueError("a basis render holds values that are negative or not finite")
    for what, known in (("intensity", given), ("radiance", measured), ("least intensity", at_least)):
        for light, value in known.items():
            if value.shape != (3,) or not np.isfinite(value).all() or (value < 0).any():
                raise InputError(
                    f"{what} {value.tolist()} of light '{names[light]}' is no colour",
                    remedy="give three finite numbers, none below 0",
                )
    for _, albedo in maps.annotated:
        albedo = np.asarray(albedo, float)
        if albedo.shape != (3,) or not ((albedo > 0) & (albedo <= 1)).all():
            raise InputError(
                f"annotated albedo {albedo.tolist()}", remedy="give three numbers above 0, at most 1"
            )


def _without_invalid(maps: EstimationMaps) -> EstimationMaps:
    """The maps with pixels that are not numbers counted as clipped, and negative radiance as none."""
    finite = np.isfinite(maps.photograph).all(-1)
    photograph = np.where(finite[..., None], np.maximum(np.nan_to_num(maps.photograph), 0), 0)
    return replace(maps, photograph=photograph, clipped=maps.clipped | ~finite)


def _usable(maps: EstimationMaps) -> np.ndarray:
    """Pixels that show a lit, unclipped surface, (h, w); the bloom beside an emitter is left out."""
    beside_emitter = ndimage.binary_dilation(maps.emitter >= 0)
    usable = ~maps.clipped & ~beside_emitter & (maps.surface >= 0) & (maps.basis.sum(0) > 0).all(-1)
    lightness = maps.photograph.mean(-1)
    if not usable.any():
        return usable
    return usable & (lightness > DARKEST * np.percentile(lightness[usable], 99))


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


# --- the problem ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Problem:
    """N observations, L lights, S segments, in scaled units: photograph and each B_l have mean 1."""

    log_photograph: np.ndarray  # (N, 3)
    basis: np.ndarray  # (N, L, 3)
    segment: np.ndarray  # (N,)
    members: sparse.csr_matrix  # (S, N), 1 where the pixel is of the segment
    reliability: np.ndarray  # (N, 3), 0 to 1
    block: np.ndarray  # (N,)
    pixels: int  # the first so many of N; the others are annotated patches, each its own segment
    prior_albedo: np.ndarray  # (S, 3), log
    albedo_precision: np.ndarray  # (S,)
    prior_intensity: np.ndarray  # (L, 3)
    intensity_precision: np.ndarray  # (L, 3)
    lower: np.ndarray  # (L, 3)
    fixed: np.ndarray  # (L,) bool
    segments: np.ndarray  # (h, w)
    face_of_segment: np.ndarray  # (S,)
    scale_source: str


@dataclass(frozen=True)
class _Solution:
    intensity: np.ndarray  # (L, 3)
    log_albedo: np.ndarray  # (S, 3)
    residual: np.ndarray  # (N, 3)
    weight: np.ndarray  # (N, 3), of the last iteration


def _problem(small, usable, given, measured, at_least, messages):
    photograph, lights = small.photograph, len(small.basis)
    unit = float(photograph[usable].mean())
    contribution = small.basis[:, usable].mean((1, 2))
    safe = np.where(contribution > 0, contribution, 1)
    basis = small.basis / safe[:, None, None, None]
    # A channel may be empty (sodium light has no blue): the floor keeps its logarithm finite, and the
    # reliability, the relative error of 8-bit values near black, keeps it from mattering.
    relative = photograph / unit
    floored = np.maximum(relative, DARKEST)
    log_photograph = np.log(floored)
    reliability = np.maximum((relative / (relative + 0.05)) ** 2, 1e-3)
    # Pixels at the border of a face mix two albedos and sit where the geometry is least certain.
    same = ndimage.minimum_filter(small.surface, 3) == ndimage.maximum_filter(small.surface, 3)
    reliability = reliability * np.where(same, 1, 0.1)[..., None]

    to_scaled = (safe / unit)[:, None]
    first = np.full((lights, 3), 1 / DEFAULT_ALBEDO / max(1, np.count_nonzero(contribution)))
    log_basis = np.log(np.maximum(basis, 1e-3))
    guess = np.log(np.maximum(np.einsum("lhwc,lc->hwc", basis, first), 1e-3))
    lit = contribution > 0
    reflectance = log_reflectance(log_photograph, log_basis[lit], small.surface, usable, guess)
    segments, faces = albedo_segments(reflectance, small.surface, usable)
    patches, known_albedo = _annotations(small, usable, messages)
    anchors = len(patches)

    prior_albedo = np.concatenate([np.full((len(faces), 3), np.log(DEFAULT_ALBEDO)), np.log(known_albedo)])
    albedo_precision = np.repeat([SEGMENT_SPREAD**-2.0, ANNOTATED_SPREAD**-2.0], [len(faces), anchors])
    # The wide default only splits evenly what the photograph cannot tell apart.
    prior, precision = first.copy(), np.full((lights, 3), 0.25 * DEFAULT_ALBEDO**2)
    precision[~lit] = 1.0
    lower, fixed = np.zeros((lights, 3)), ~lit
    prior[~lit] = 0
    for light, value in at_least.items():
        lower[light] = value * to_scaled[light] if lit[light] else 0
    for light, value in measured.items():
        if lit[light]:
            prior[light] = value * to_scaled[light]
            precision[light] = 1 / (MEASURED_SPREAD * np.maximum(prior[light], 0.02)) ** 2
            lower[light] = np.minimum(lower[light], prior[light])
    for light, value in given.items():
        if lit[light]:
            prior[light] = lower[light] = value * to_scaled[light]
        fixed[light] = True
    if any(lit[light] and (value > 0).all() for light, value in measured.items() if light not in given):
        source = "emitter pixel"
    elif anchors:
        source = "annotated albedo"
    elif any(lit[light] and (value > 0).all() for light, value in given.items()):
        source = "given intensity"
    else:
        source = "default albedo 0.5"

    rows, columns = np.nonzero(usable)
    blocks = rows // BLOCK_SIDE * (usable.shape[1] // BLOCK_SIDE + 1) + columns // BLOCK_SIDE
    segment = np.concatenate([segments[usable], len(faces) + np.arange(anchors)])
    count = len(segment)
    patch_radiance = np.array([relative[patch].mean(0) for patch in patches]).reshape(-1, 3)
    patch_basis = np.array([basis[:, patch].mean(1) for patch in patches]).reshape(-1, lights, 3)
    problem = _Problem(
        log_photograph=np.concatenate([log_photograph[usable], np.log(np.maximum(patch_radiance, DARKEST))]),
        basis=np.concatenate([np.moveaxis(basis[:, usable], 0, 1), patch_basis]),
        segment=segment,
        members=sparse.csr_matrix((np.ones(count), (segment, np.arange(count))), (len(prior_albedo), count)),
        reliability=np.concatenate([reliability[usable], np.ones((anchors, 3))]),
        block=np.concatenate([blocks, blocks.max() + 1 + np.arange(anchors)]),
        pixels=len(rows),
        prior_albedo=prior_albedo,
        albedo_precision=albedo_precision,
        prior_intensity=prior,
        intensity_precision=precision,
        lower=lower,
        fixed=fixed,
        segments=segments,
        face_of_segment=faces,
        scale_source=source,
    )
    return problem, contribution, unit


def _annotations(small, usable, messages) -> tuple[np.ndarray, np.ndarray]:
    """Masks (A, h, w) of the annotated patches that can be used, and their albedos (A, 3).

    The albedo is the patch's mean. One observation stands for the whole patch, mean radiance over mean
    shading: exact whatever the texture, where a robust fit would choose between tile and grout.
    """
    masks, albedos = [], []
    for number, (mask, albedo) in enumerate(small.annotated, 1):
        if (mask & usable).any():
            masks.append(mask & usable)
            albedos.append(albedo)
        else:
            messages.append(f"annotated albedo {number} covers no usable pixel and was left out")
    return np.array(masks).reshape(-1, *usable.shape).astype(bool), np.array(albedos, float).reshape(-1, 3)


def _starts(problem, start, contribution, unit) -> list[np.ndarray]:
    """First guesses (L, 3): all lights alike, and the earlier round or linear NNLS at albedo 0.5."""
    if start is not None:
        other = np.asarray(start, float) * (np.where(contribution > 0, contribution, 0) / unit)[:, None]
    else:
        weight = 1 / np.exp(problem.log_photograph)
        other = np.stack(
            [
                nnls(problem.basis[..., c] * weight[:, c, None], np.full(len(weight), 1 / DEFAULT_ALBEDO))[0]
                for c in range(3)
            ],
            -1,
        )
    return [problem.prior_intensity, other]


def _with_light_colour(problem: _Problem, solution: _Solution) -> _Problem:
    """The problem with each light's colour held weakly to the colour of all light together.

    One observation of 30 %: it decides only for lights that the photograph barely shows.
    """
    total = solution.intensity.sum(0)
    cast = total / max(total.mean(), 1e-9)
    strength = solution.intensity @ cast / (cast @ cast)
    own = ~problem.fixed & (problem.intensity_precision.max(1) < 1)
    prior, precision = problem.prior_intensity.copy(), problem.intensity_precision.copy()
    prior[own] = (strength[:, None] * cast)[own]
    spread = LIGHT_COLOUR_SPREAD * np.maximum(prior, 0.02 * total.mean())
    precision[own] = 1 / np.maximum(spread[own], 1e-6) ** 2
    return replace(problem, prior_intensity=prior, intensity_precision=precision)


# --- the solve -----------------------------------------------------------------------------------


def _shading(problem: _Problem, intensity: np.ndarray) -> np.ndarray:
    return np.maximum(np.einsum("nlc,lc->nc", problem.basis, intensity), 1e-4)


def _weights(problem: _Problem, together: np.ndarray, scale: float) -> np.ndarray:
    """Weight (N, 3) of each squared log residual: Cauchy for pixels, constant for annotated patches."""
    weight = np.full(len(problem.segment), ANNOTATED_SPREAD**-2.0)
    weight[: problem.pixels] = 1 / (scale**2 * (1 + together / CAUCHY**2) * CORRELATED_PIXELS)
    return problem.reliability * weight[:, None]


def _cost(problem, intensity, log_albedo, scale):
    """Objective, log residuals (N, 3), and the pixels' squared residuals over `scale`."""
    residual = problem.log_photograph - np.log(_shading(problem, intensity)) - log_albedo[problem.segment]
    together = (problem.reliability * residual**2)[: problem.pixels].mean(1) / scale**2
    data = 1.5 * CAUCHY**2 * np.log1p(together / CAUCHY**2).sum() / CORRELATED_PIXELS
    data += 0.5 * (residual[problem.pixels :] ** 2).sum() / ANNOTATED_SPREAD**2
    prior = 0.5 * (problem.albedo_precision[:, None] * (log_albedo - problem.prior_albedo) ** 2).sum()
    of_lights = problem.intensity_precision * (intensity - problem.prior_intensity) ** 2
    prior += 0.5 * of_lights[~problem.fixed].sum()
    return data + prior, residual, together


def _normal_equations(problem, intensity, residual_without_albedo, weight):
    """Gauss-Newton system of the intensities with the albedos eliminated.

    Returns (matrix (3, L, L), right side (3, L), per-segment G (S, L, 3), right side (S, 3) and
    diagonal (S, 3) for the albedos, and the Jacobian (N, L, 3)).
    """
    jacobian = problem.basis / _shading(problem, intensity)[:, None]
    weighted = weight[:, None] * jacobian
    lights = intensity.shape[0]
    coupling = (problem.members @ weighted.reshape(len(weight), -1)).reshape(-1, lights, 3)
    diagonal = problem.members @ weight + problem.albedo_precision[:, None]
    right_albedo = problem.members @ (weight * residual_without_albedo)
    right_albedo += problem.albedo_precision[:, None] * problem.prior_albedo
    matrix = np.einsum("nlc,nkc->clk", weighted, jacobian, optimize=True)
    matrix -= np.einsum("slc,skc->clk", coupling / diagonal[:, None], coupling, optimize=True)
    right = np.einsum("nlc,nc->cl", weighted, residual_without_albedo, optimize=True)
    right -= np.einsum("slc,sc->cl", coupling, right_albedo / diagonal)
    return matrix, right, coupling, right_albedo, diagonal, jacobian


def _solve(problem: _Problem, starts: list[np.ndarray]) -> _Solution:
    """Best of the local minima reached from `starts`."""
    reached = [_descend(problem, start) for start in starts]
    # One error scale for all, since each descent ended at its own.
    compared = [_cost(problem, s.intensity, s.log_albedo, 0.1)[0] for s in reached]
    return reached[int(np.argmin(compared))]


def _descend(problem: _Problem, start: np.ndarray) -> _Solution:
    """Iteratively reweighted, bounded Gauss-Newton with the albedos eliminated in closed form.

    The error scale starts wide, where the loss is almost quadratic and has one minimum, and narrows to
    the residuals' own MAD, where outliers lose their say (graduated non-convexity).
    """
    free = ~problem.fixed
    intensity = np.where(problem.fixed[:, None], problem.prior_intensity, np.maximum(start, problem.lower))
    residual = problem.log_photograph - np.log(_shading(problem, intensity))
    count = problem.albedo_precision[:, None] + problem.members @ np.ones_like(residual)
    log_albedo = problem.members @ residual + problem.albedo_precision[:, None] * problem.prior_albedo
    log_albedo /= count
    scale = 0.5
    for _ in range(12):
        cost, residual, together = _cost(problem, intensity, log_albedo, scale)
        for _ in range(4):
            weight = _weights(problem, together, scale)
            open_residual = residual + log_albedo[problem.segment]
            matrix, right, coupling, right_albedo, diagonal, _ = _normal_equations(
                problem, intensity, open_residual, weight
            )
            step = np.zeros_like(intensity)
            for c in range(3):
                step[free, c] = _bounded_step(
                    matrix[c][np.ix_(free, free)] + np.diag(problem.intensity_precision[free, c]),
                    right[c][free]
                    + problem.intensity_precision[free, c] * (problem.prior_intensity - intensity)[free, c],
                    (problem.lower - intensity)[free, c],
                )
            target = (right_albedo - np.einsum("slc,lc->sc", coupling, step)) / diagonal
            before = cost
            for fraction in (1, 0.5, 0.25, 0.06):
                trial = np.maximum(intensity + fraction * step, problem.lower)
                trial_albedo = log_albedo + fraction * (target - log_albedo)
                trial_cost, trial_residual, trial_together = _cost(problem, trial, trial_albedo, scale)
                if trial_cost < cost:
                    intensity, log_albedo, cost = trial, trial_albedo, trial_cost
                    residual, together = trial_residual, trial_together
                    break
            if before - cost < 1e-5 * max(before, 1e-12):
                break
        reliable = problem.reliability[: problem.pixels].min(1) > 0.05
        if not reliable.any():
            break
        mad = 1.4826 * np.median(np.abs(residual[: problem.pixels][reliable]))
        narrower = max(0.02, mad, scale / 2)
        if abs(narrower - scale) < 0.02 * scale:
            break
        scale = min(scale, narrower)
    return _Solution(intensity, log_albedo, residual, weight)


def _bounded_step(matrix: np.ndarray, right: np.ndarray, lowest: np.ndarray) -> np.ndarray:
    """Minimum of x'Ax/2 - b'x subject to x >= lowest, for A positive definite, as an NNLS problem."""
    if not len(right):
        return right
    unit = 1 / np.sqrt(np.diag(matrix))
    factor = np.linalg.cholesky(matrix * np.outer(unit, unit) + 1e-12 * np.eye(len(right))).T
    shifted = unit * (right - matrix @ lowest)
    return lowest + unit * nnls(factor, np.linalg.solve(factor.T, shifted))[0]


def _default_scale(problem: _Problem, solution: _Solution) -> _Solution:
    """The solution with mean albedo 0.5, colour shared between light and albedo, and none above 0.95."""
    share = _pixels(problem)[:, None] / problem.pixels
    albedo = np.exp(solution.log_albedo)
    light = np.log(np.maximum(solution.intensity.sum(0), 1e-6))
    of_albedo = np.log((share * albedo).sum(0))
    # Strongly coloured light is commoner than a room whose mean albedo is far from grey.
    colour = of_albedo + light - (of_albedo + light).mean()
    shift = of_albedo - of_albedo.mean() - np.clip(colour / 2, -GREY_SPREAD, GREY_SPREAD)
    shifted = albedo * np.exp(-shift)
    shift += np.log((share * shifted).sum(0).mean() / DEFAULT_ALBEDO)
    of_pixel = problem.segment[: problem.pixels]
    bright = np.percentile(np.exp(solution.log_albedo - shift).max(-1)[of_pixel], 95)
    shift += max(0, np.log(bright / 0.95))
    free = ~problem.fixed
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(solution.intensity > 0, problem.lower / solution.intensity, 0)[free]
    shift = np.maximum(shift, np.log(np.maximum(needed.max(0, initial=0), 1e-9)))
    return replace(
        solution, intensity=solution.intensity * np.exp(shift), log_albedo=solution.log_albedo - shift
    )


def _pixels(problem: _Problem) -> np.ndarray:
    """Pixels of each segment, (S,); none for annotated patches, whose pixels belong to the others."""
    return np.bincount(problem.segment[: problem.pixels], minlength=len(problem.prior_albedo)).astype(float)


# --- trust ---------------------------------------------------------------------------------------


def _covariance(problem: _Problem, solution: _Solution) -> np.ndarray:
    """Cluster-robust covariance of the intensities, (3, L, L): errors may be shared within a block."""
    open_residual = solution.residual + solution.log_albedo[problem.segment]
    matrix, _, coupling, _, diagonal, jacobian = _normal_equations(
        problem, solution.intensity, open_residual, solution.weight
    )
    blocks = np.unique(problem.block, return_inverse=True)[1]
    by_block = sparse.csr_matrix((np.ones(len(blocks)), (blocks, np.arange(len(blocks)))))
    mean_jacobian = coupling / diagonal[:, None]
    # A patch has no residual of its own, yet the render errs there as much as elsewhere.
    residual = solution.residual.copy()
    residual[problem.pixels :] = 1.4826 * np.median(np.abs(residual[: problem.pixels]))
    scores = (solution.weight * residual)[:, None] * (jacobian - mean_jacobian[problem.segment])
    sums = (by_block @ scores.reshape(len(scores), -1)).reshape(-1, *jacobian.shape[1:])
    meat = np.einsum("blc,bkc->clk", sums, sums)
    meat += np.einsum("slc,s,skc->clk", mean_jacobian, problem.albedo_precision, mean_jacobian)
    prior = np.einsum("lc,lk->clk", problem.intensity_precision, np.eye(meat.shape[1]))
    covariance = np.zeros_like(meat)
    free = np.ix_(~problem.fixed, ~problem.fixed)
    for c in range(3):
        inverse = np.linalg.pinv((matrix + prior)[c][free], hermitian=True)
        covariance[c][free] = inverse @ (meat + prior)[c][free] @ inverse
    return covariance


def _separability(problem: _Problem, solution: _Solution, seen: np.ndarray):
    """Correlation of relative intensities (L, L), condition number, and the pairs that go together.

    The common scale counts as known to 10 %, since its uncertainty moves all lights alike and would
    hide that two of them trade against each other. Two lights are inseparable when their errors, all
    other lights free or all others held, are correlated below -0.95: then their ratio is uncertain by
    more than about 60 % while their sum is not.
    """
    lights = len(seen)
    free = np.flatnonzero(~problem.fixed)
    correlation = np.eye(lights)
    if not len(free):
        return correlation, 1.0, ()
    scale = max(MODEL_ERROR, 1.4826 * float(np.median(np.abs(solution.residual))))
    weight = _weights(problem, np.zeros(problem.pixels), scale)
    total = solution.intensity.sum(0)
    relative = np.maximum(solution.intensity, 0.05 * np.maximum(total, 1e-9))
    matrix, *_, jacobian = _normal_equations(problem, solution.intensity, solution.residual, weight)
    information = np.einsum("clk,lc,kc->lk", matrix, relative, relative)[np.ix_(free, free)] / 3
    share = np.einsum("nlc,lc->l", jacobian, relative)[free] / len(jacobian) / 3
    information += np.outer(share, share) / 0.1**2
    # A measured emitter is an observation of its own light; the other priors are not evidence.
    observed = problem.intensity_precision.mean(1) * relative.mean(1) ** 2
    observed = np.where(observed >= 0.25 / MEASURED_SPREAD**2, observed, 0.25)[free]
    information += np.diag(observed)
    covariance = np.linalg.inv(information)
    deviation = np.sqrt(np.diag(covariance))
    correlation[np.ix_(free, free)] = covariance / np.outer(deviation, deviation)
    np.fill_diagonal(correlation, 1)
    spread = np.sqrt(np.diag(information))
    held = -information / np.outer(spread, spread)
    together = np.minimum(correlation[np.ix_(free, free)], held)
    pairs = tuple(
        (int(free[i]), int(free[j]))
        for i in range(len(free))
        for j in range(i + 1, len(free))
        if together[i, j] < INSEPARABLE
    )
    return correlation, float(np.sqrt(np.linalg.cond(information))), pairs


def _remarks(names, intensity, error, given, measured, at_least, seen, pairs, correlation) -> list[str]:
    """One line for each thing a person should know of the lights."""
    remarks = [
        f"lights '{names[i]}' and '{names[j]}' light the visible surfaces alike (correlation "
        f"{correlation[i, j]:.2f}) and cannot be told apart: their sum is fitted and shared between them; "
        "annotate the albedo of a surface that only one of them lights, or give the intensity of one by hand"
        for i, j in pairs
    ]
    paired = {light for pair in pairs for light in pair}
    for light in np.flatnonzero(seen):
        if light in given or light in paired:
            continue
        if not intensity[light].any():
            remarks.append(f"the photograph shows no light from '{names[light]}': its intensity is 0")
        elif error[light].mean() > 0.5 * intensity[light].mean():
            remarks.append(
                f"the intensity of '{names[light]}', {intensity[light].mean():.3g}, is uncertain by "
                f"{error[light].mean():.2g}: it adds little to what is seen; give it by hand if it matters"
            )
        least = at_least.get(light, np.zeros(3))
        if ((least > 0) & (intensity[light] <= least * 1.001)).any():
            remarks.append(
                f"the intensity of '{names[light]}' stands at the least that its clipped emitter allows, "
                "more than the surfaces ask for: check its position and size, or annotate an albedo"
            )
        if light in measured and measured[light].any():
            ratio = intensity[light].mean() / measured[light].mean()
            if not 0.8 < ratio < 1.25:
                remarks.append(
                    f"the surfaces ask for {ratio:.2g} times the radiance that '{names[light]}' shows: check "
                    "the annotated albedo, or whether its emitter pixels are clipped"
                )
    return remarks


# --- albedo back at the photograph's size --------------------------------------------------------


def _albedo_maps(maps, problem, albedo_of_segment, intensity):
    """Albedo (H, W, 3), segment (H, W) and mean albedo by face.

    Where the photograph can be read, albedo is radiance over shading; elsewhere it is the segment's,
    or the mean of the face.
    """
    pixels = _pixels(problem)[: len(albedo_of_segment)]
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
