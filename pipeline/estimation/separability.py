"""Which lights a fit tells apart, and what a person should know of each light."""

from __future__ import annotations

import numpy as np

from pipeline.estimation.intensity_problem import MEASURED_SPREAD, Problem
from pipeline.estimation.intensity_solver import Solution, normal_equations, observation_weights

MODEL_ERROR = 0.05  # relative error of a render over boxes below which residuals say nothing
INSEPARABLE = -0.95


def separability(problem: Problem, solution: Solution, seen: np.ndarray):
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
    weight = observation_weights(problem, np.zeros(problem.pixels), scale)
    total = solution.intensity.sum(0)
    relative = np.maximum(solution.intensity, 0.05 * np.maximum(total, 1e-9))
    matrix, *_, jacobian = normal_equations(problem, solution.intensity, solution.residual, weight)
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


def light_remarks(names, intensity, error, given, measured, at_least, seen, pairs, correlation) -> list[str]:
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
