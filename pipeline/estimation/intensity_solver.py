"""Intensities and albedos that solve an `intensity_problem.Problem` robustly, and their covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.optimize import nnls

from pipeline.estimation.albedo import DEFAULT_ALBEDO
from pipeline.estimation.intensity_problem import ANNOTATED_SPREAD, Problem

GREY_SPREAD = 0.25  # most that the log mean albedo of a room is taken to differ between channels
LIGHT_COLOUR_SPREAD = 0.3  # relative: tungsten beside daylight after white balance
# Neighbouring pixels share their errors: one observation is counted for this many reduced pixels.
CORRELATED_PIXELS = 25
CAUCHY = 2.385  # 95 % efficient at a normal error


@dataclass(frozen=True)
class Solution:
    intensity: np.ndarray  # (L, 3)
    log_albedo: np.ndarray  # (S, 3)
    residual: np.ndarray  # (N, 3)
    weight: np.ndarray  # (N, 3), of the last iteration


def solve(problem: Problem, starts: list[np.ndarray]) -> Solution:
    """Best of the local minima reached from `starts`."""
    reached = [_descend(problem, start) for start in starts]
    # One error scale for all, since each descent ended at its own.
    compared = [_cost(problem, s.intensity, s.log_albedo, 0.1)[0] for s in reached]
    return reached[int(np.argmin(compared))]


def _descend(problem: Problem, start: np.ndarray) -> Solution:
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
            weight = observation_weights(problem, together, scale)
            open_residual = residual + log_albedo[problem.segment]
            matrix, right, coupling, right_albedo, diagonal, _ = normal_equations(
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
    return Solution(intensity, log_albedo, residual, weight)


def _bounded_step(matrix: np.ndarray, right: np.ndarray, lowest: np.ndarray) -> np.ndarray:
    """Minimum of x'Ax/2 - b'x subject to x >= lowest, for A positive definite, as an NNLS problem."""
    if not len(right):
        return right
    unit = 1 / np.sqrt(np.diag(matrix))
    factor = np.linalg.cholesky(matrix * np.outer(unit, unit) + 1e-12 * np.eye(len(right))).T
    shifted = unit * (right - matrix @ lowest)
    return lowest + unit * nnls(factor, np.linalg.solve(factor.T, shifted))[0]


def _shading(problem: Problem, intensity: np.ndarray) -> np.ndarray:
    return np.maximum(np.einsum("nlc,lc->nc", problem.basis, intensity), 1e-4)


def observation_weights(problem: Problem, together: np.ndarray, scale: float) -> np.ndarray:
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


def normal_equations(problem, intensity, residual_without_albedo, weight):
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


def with_default_scale(problem: Problem, solution: Solution) -> Solution:
    """The solution with mean albedo 0.5, colour shared between light and albedo, and none above 0.95."""
    share = pixels_per_segment(problem)[:, None] / problem.pixels
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


def with_light_colour(problem: Problem, solution: Solution) -> Problem:
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


def pixels_per_segment(problem: Problem) -> np.ndarray:
    """Pixels of each segment, (S,); none for annotated patches, whose pixels belong to the others."""
    return np.bincount(problem.segment[: problem.pixels], minlength=len(problem.prior_albedo)).astype(float)


def intensity_covariance(problem: Problem, solution: Solution) -> np.ndarray:
    """Cluster-robust covariance of the intensities, (3, L, L): errors may be shared within a block."""
    open_residual = solution.residual + solution.log_albedo[problem.segment]
    matrix, _, coupling, _, diagonal, jacobian = normal_equations(
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
