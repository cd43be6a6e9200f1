"""The equations of `intensities`: observations in scaled units, and what is known beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.optimize import nnls

from pipeline.estimation.albedo import DEFAULT_ALBEDO, albedo_segments, log_reflectance
from pipeline.estimation.observations import DARKEST

SEGMENT_SPREAD = 0.6  # sd of a surface's log albedo: black rubber to white paint within two
ANNOTATED_SPREAD = 0.01  # relative: an annotated albedo wins over what the surfaces suggest
# relative: an unclipped emitter pixel is the radiance, and wins over an annotated albedo
MEASURED_SPREAD = 0.004
# Neighbouring pixels share their errors: standard errors are taken from blocks of this side
# (cluster-robust covariance).
BLOCK_SIDE = 8


@dataclass(frozen=True)
class Problem:
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


def set_up(small, usable, given, measured, at_least, messages) -> tuple[Problem, np.ndarray, float]:
    """The problem of the `usable` pixels (h, w), the mean of each light's basis (L,), and of the photograph.

    The two means are the scaled units. What is left out is said in `messages`.
    """
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
    problem = Problem(
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


def first_guesses(problem, start, contribution, unit) -> list[np.ndarray]:
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
