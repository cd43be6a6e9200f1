"""Fog that turns a clear photograph into a foggy one: extinction, albedo, asymmetry, gains of lights, exposure.

The paper's future work (Zhao et al. 2013, section 7): participating media from a real scene to another. The model of the
foggy photograph, linear, per pixel and channel c, is

    C_c = e_c (R_c T_c(kappa) + albedo_c sum_l gain_l V_lc(kappa, g)),

V at albedo 1; e_c is what the two photographs differ by in exposure and white balance. Near pixels fix e_c, far ones the
airlight e_c albedo_c gain_l, and how one goes over into the other kappa. For given kappa and g sums of products over the
pixels are all that is needed, so that the other parameters cost next to nothing (variable projection). Albedo and gains have
one factor in common, which no photograph tells: gains stay at 1 as far as an albedo of at most 1 allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import nlopt
import numpy as np

from pipeline.estimation.fog_response import Response

#: Standard deviations expected beforehand: photographs of one place differ by a stop or two and by some white balance, lights
#: are known to a half. Of an albedo, anything from 0 to 1, it is that of an even distribution.
EXPOSURE, WHITE_BALANCE, GAIN, ALBEDO = 1.5 * np.log(2), 0.2, 0.5, 0.29
#: Bounds of exposure and gains, as logarithms.
MOST_EXPOSURE, MOST_GAIN = 5 * np.log(2), np.log(20.0)
#: Expected error of a pixel: of its value, and of white; the latter is what is left of 8 bits and JPEG.
RELATIVE, OF_WHITE = 0.02, 0.004
#: Residuals are never believed to be smaller than this share of that.
LEAST_SPREAD = 0.1
#: Huber's and Cauchy's constants, 95 % efficient for normal errors. Huber, which has one minimum, comes first; a few of all
#: pixels take most rounds.
HUBER, CAUCHY, HUBER_ROUNDS, ROUNDS, ROUNDS_OF_ALL = 1.345, 2.385, 2, 5, 2
#: Extinctions at which a first minimum is looked for, and about how many pixels say where it is before all do.
SCANNED, FEW = 41, 4000
#: Most steps towards the other parameters' best, and a gain in twice the logarithm of the likelihood that is none.
STEPS, ENOUGH = 60, 1e-4
#: Twice the logarithm of the likelihood ratio at the ends of a 95 % interval of one parameter.
CHI_SQUARED = 3.84
#: To so much of 1 the gains' mean is kept while errors are told, and the albedo's distance to 1 at which it is held there.
GAUGE, AT_BOUND = 0.01, 1e-4
#: What is less than so many times as uncertain as beforehand is determined; of extinctions, up to this ratio.
DETERMINED, RATIO = 0.25, 4.0


@dataclass(frozen=True)
class Asked:
    """What is to be found besides extinction and exposure, and what the rest is: albedo (3,) and asymmetry."""

    albedo: np.ndarray
    asymmetry: float
    fit_albedo: bool = True
    fit_gains: bool = True
    fit_asymmetry: bool = False


@dataclass(frozen=True)
class Match:
    """extinction [1/m] with a 95 % interval, which ends nowhere where it ends with `range`; asymmetry; exposure (3,), a
    factor; albedo (3,); gains (L,); each with its standard error, of exposure and gains the relative one. An error of 0: was
    not asked for, or is held by its bound.

    spread: typical residual as a share of what is expected of a pixel. correlated: how many times as large the errors'
    variance is as if pixels were independent.
    """

    asked: Asked
    extinction: float
    interval: tuple[float, float]
    range: tuple[float, float]
    asymmetry: float
    asymmetry_error: float
    exposure: np.ndarray
    exposure_error: np.ndarray
    albedo: np.ndarray
    albedo_error: np.ndarray
    gains: np.ndarray
    gain_error: np.ndarray
    spread: float
    correlated: float

    @property
    def open_ends(self) -> tuple[bool, bool]:
        """Whether any thinner, and any denser fog would do as well."""
        return self.interval[0] <= self.range[0] * 1.0001, self.interval[1] >= self.range[1] / 1.0001

    @property
    def determined(self) -> dict[str, bool]:
        low, high = self.interval
        foggy = not self.open_ends[0]
        return {"visibility": foggy and not self.open_ends[1] and high < RATIO * low,
                "albedo": foggy and bool(self.albedo_error.max() < DETERMINED * ALBEDO),
                "exposure": bool(self.exposure_error.max() < DETERMINED * EXPOSURE),
                "asymmetry": foggy and bool(self.asymmetry_error < DETERMINED * ALBEDO)}

    @property
    def determined_gains(self) -> np.ndarray:
        return (self.gain_error < DETERMINED * GAIN) & (not self.open_ends[0])

    def picture(self, response: Response) -> np.ndarray:
        """The foggy picture (N, 3), linear, in the reference's exposure."""
        basis = response.at(np.log(self.extinction), self.asymmetry)
        mixture = np.concatenate([np.ones((3, 1)), self.albedo[:, None] * self.gains], 1) * self.exposure[:, None]
        return np.einsum("ck,knc->nc", mixture, basis)


def match(response: Response, reference: np.ndarray, tiles: np.ndarray, asked: Asked, systematic: float = 0.0) -> Match:
    """The fog of `reference` (N, 3), linear. tiles (N, 2): row and column of the part of the picture that a pixel belongs to;
    errors of parts that are no neighbours count as independent. systematic: standard error that the response itself brings into
    each result, as a share of it.
    """
    problem = _Problem(response, np.asarray(reference, float), asked)
    x, p = _located(response, reference, asked)
    for _ in range(ROUNDS_OF_ALL):
        weights, variance, bend = problem.robust(x, p)
        x, p = problem.refined(x, p, weights, variance, 0.02)
    spread = float(np.sqrt(variance))
    covariance = problem.covariance(x, p, weights, variance, tiles, bend)
    correlated = max(1.0, covariance[0][0, 0] / covariance[1][0, 0])
    variance *= correlated
    x, p = problem.refined(x, p, weights, variance, 0.02)
    p = problem.settled(x, p, weights)
    covariance = problem.covariance(x, p, weights, variance, tiles, bend)
    error = np.sqrt(np.maximum(*(np.diag(one) for one in covariance)))
    interval = problem.interval(x, p, weights, variance, max(float(error[0]), 1e-3), systematic)
    scale = np.concatenate([[1, 1, 1, 1, 1], p[3:6], np.ones(len(p) - 6)])
    error = np.where(error > 0, np.hypot(error, systematic * scale), 0.0)
    return Match(asked, float(np.exp(x[0])), interval, tuple(np.exp(problem.limits[:, 0])), float(x[1]), float(error[1]),
                 np.exp(p[:3]), error[2:5], p[3:6], error[5:8], np.exp(p[6:]), error[8:], spread, correlated)


def located(response: Response, reference: np.ndarray, asked: Asked) -> float:
    """Roughly, extinction [1/m] of the fog of `reference` (N, 3), for choosing where trial fogs are wanted."""
    return float(np.exp(_located(response, reference, asked)[0][0]))


def _located(response: Response, reference: np.ndarray, asked: Asked) -> tuple[np.ndarray, np.ndarray]:
    some = np.zeros(len(reference), bool)
    some[::max(1, len(reference) // FEW)] = True
    problem = _Problem(response.of_pixels(some), np.asarray(reference[some], float), asked)
    weights = problem.sigma(problem.reference) ** -2.0
    scan = np.linspace(*problem.limits[:, 0], SCANNED)
    found = [problem.inner((one, asked.asymmetry), weights, 1.0) for one in scan]
    least = int(np.argmin([cost for cost, _ in found]))
    x, p = problem.refined(np.array([scan[least], asked.asymmetry]), found[least][1], weights, 1.0, 0.3)
    for turn in range(ROUNDS):
        x, p = problem.refined(x, p, *problem.robust(x, p, turn >= HUBER_ROUNDS)[:2], 0.1 / (1 + turn))
    return x, p


class _Problem:
    """Unknowns x = (ln kappa, g) and p = (ln e (3), albedo (3), ln gain (L)). weights (N, 3): of the pixels' squares."""

    def __init__(self, response: Response, reference: np.ndarray, asked: Asked):
        self.response, self.reference = response, reference
        # a black picture has the clear one's white, some stops down
        white = max(float(np.percentile(reference, 95)), float(np.percentile(response.clear, 95)) * np.exp(-MOST_EXPOSURE), 1e-12)
        self.floor = OF_WHITE * white
        asymmetries = response.asymmetries[[0, -1]] if asked.fit_asymmetry else np.full(2, asked.asymmetry)
        self.limits = np.stack([np.log(response.extinctions[[0, -1]]), asymmetries], -1)
        count = response.lights
        self.start = np.concatenate([np.zeros(3), asked.albedo, np.zeros(count)])
        reach = np.concatenate([np.full(3, MOST_EXPOSURE), np.zeros(3), np.full(count, MOST_GAIN * asked.fit_gains)])
        self.bounds = np.array([self.start - reach, self.start + reach])
        if asked.fit_albedo:
            self.bounds[:, 3:6] = [[0.0], [1.0]]
        self.prior = np.diag(np.concatenate([np.zeros(6), np.full(count, GAIN**-2)]))
        # of the channels together, and by white balance apart
        self.prior[:3, :3] = np.linalg.inv(EXPOSURE**2 * np.ones((3, 3)) + WHITE_BALANCE**2 * np.eye(3))

    def sigma(self, values: np.ndarray) -> np.ndarray:
        """Expected error of pixels of these values."""
        return RELATIVE * np.maximum(values, 0) + self.floor

    def robust(self, x: np.ndarray, p: np.ndarray, redescending: bool = True) -> tuple[np.ndarray, float, float]:
        """Weights (N, 3) of squares by how far pixels are off at (x, p), their variance after that, and by what share of these
        weights a redescending loss is curved."""
        modelled = self.modelled(x, p)
        sigma = self.sigma(modelled)
        scaled = np.abs(self.reference - modelled) / sigma
        spread = max(1.4826 * float(np.median(scaled)), LEAST_SPREAD)
        scaled /= spread
        weight = 1 / (1 + (scaled / CAUCHY) ** 2) if redescending else HUBER / np.maximum(scaled, HUBER)
        return weight / sigma**2, spread**2, max(2 * float((weight**2).sum() / weight.sum()) - 1, 0.3)

    def basis(self, x) -> np.ndarray:
        return np.moveaxis(self.response.at(*x).astype(float), -1, 0)  # (3, 1 + L, N)

    def modelled(self, x, p: np.ndarray) -> np.ndarray:
        return np.einsum("ck,ckn->nc", _mixture(p)[0], self.basis(x))

    def inner(self, x, weights: np.ndarray, variance: float, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """Least cost at x, weighted squares over `variance` and what is expected beforehand, and the p that has it."""
        basis = self.basis(x)
        weighted = basis * weights.T[:, None]
        products, crossed = weighted @ basis.swapaxes(1, 2), (weighted @ self.reference.T[..., None])[..., 0]
        squared = float((weights * self.reference**2).sum())

        def cost(p: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
            theta, slopes = _mixture(p)
            along, off = (products @ theta[..., None])[..., 0], p - self.start
            value = ((theta * (along - 2 * crossed)).sum() + squared) / variance
            slope = np.einsum("ckp,ck->p", slopes, along - crossed) / variance + self.prior @ off
            return value + off @ self.prior @ off, slope, (slopes.swapaxes(1, 2) @ products @ slopes).sum(0) / variance + self.prior

        return _least(cost, self.start if start is None else start, self.bounds)

    def refined(self, x: np.ndarray, p: np.ndarray, weights: np.ndarray, variance: float, step: float
                ) -> tuple[np.ndarray, np.ndarray]:
        """The minimum within about `step` of x, where p is about the best, and the best there."""
        best = [np.inf, x, p]

        def cost(moved: np.ndarray, _) -> float:
            full = np.where(free, 0.0, x)
            full[free] = moved
            value, p = self.inner(full, weights, variance, best[2])
            if value < best[0]:
                best[:] = value, full, p
            return value

        free = np.ptp(self.limits, axis=0) > 0
        search = nlopt.opt(nlopt.LN_BOBYQA if free.sum() > 1 else nlopt.LN_SBPLX, int(free.sum()))
        search.set_lower_bounds(self.limits[0][free])
        search.set_upper_bounds(self.limits[1][free])
        search.set_initial_step(step)
        search.set_xtol_abs(step / 50)
        search.set_maxeval(40)
        search.set_min_objective(cost)
        try:
            search.optimize(np.clip(x, *self.limits)[free])
        except (nlopt.RoundoffLimited, RuntimeError):
            pass  # no further progress in float64: the best so far is the answer
        return best[1], best[2]

    def shares(self, x: np.ndarray, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Of each light in what the fog adds, (L,)."""
        glow = np.exp(p[6:]) * (weights.T[:, None] * self.basis(x)[:, 1:]).sum((0, 2))
        return glow / max(float(glow.sum()), 1e-300)

    def settled(self, x: np.ndarray, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """The same picture's p, with gains whose mean is 1 as far as albedos of at most 1 allow."""
        if not (np.ptp(self.bounds[:, 3:], axis=0) > 0).all():
            return p
        level = np.exp(self.shares(x, p, weights) @ p[6:])
        factor = min(level, 1 / max(float(p[3:6].max()), 1e-12))
        return np.concatenate([p[:3], p[3:6] * factor, p[6:] - np.log(factor)])

    def covariance(self, x: np.ndarray, p: np.ndarray, weights: np.ndarray, variance: float, tiles: np.ndarray,
                   bend: float) -> tuple[np.ndarray, np.ndarray]:
        """Of (ln kappa, g, p): as the tiles' residuals scatter, and as of independent pixels of this variance."""
        step = 1e-3
        slopes = [(self.modelled(x + move, p) - self.modelled(x - move, p)) / (2 * step) for move in step * np.eye(2)]
        jacobian = np.concatenate([np.stack(slopes, -1), np.einsum("ckp,ckn->ncp", _mixture(p)[1], self.basis(x))], -1)
        bounds = np.concatenate([self.limits, self.bounds], 1)
        found = np.concatenate([x, p])
        free = np.ptp(bounds, axis=0) > 0
        albedo = slice(5, 8)
        free[albedo] &= found[albedo] < 1 - AT_BOUND
        jacobian *= free
        prior = np.zeros((len(found), len(found)))
        prior[2:, 2:] = self.prior
        prior[0, 0] = prior[1, 1] = 1e-6
        prior[range(5, 8), range(5, 8)] = ALBEDO**-2
        if free[albedo].all() and free[8:].any():
            level = np.append(np.zeros(8), self.shares(x, p, weights))
            prior += np.outer(level, level) / GAUGE**2
        weighted = jacobian * weights[..., None]
        information = np.einsum("ncp,ncq->pq", weighted, jacobian) / variance
        residuals = self.reference - self.modelled(x, p)
        # sums over all two by two neighbouring tiles, a border of empty ones round them: what neighbours share counts by half
        scores = np.zeros((*(tiles.max(0) + 3), len(found)))
        np.add.at(scores, tuple(tiles.T + 1), (weighted * residuals[..., None]).sum(1) / variance)
        scores = (scores[1:, 1:] + scores[:-1, 1:] + scores[1:, :-1] + scores[:-1, :-1]).reshape(-1, len(found)) / 2
        # of few tiles, as many parameters can follow what is noise
        tiled = len(np.unique(tiles, axis=0))
        scores *= np.sqrt(tiled / max(tiled - free.sum(), 1)) / bend
        inverse = np.linalg.inv(information + prior + np.diag(np.where(free, 0.0, 1e12)))
        return inverse @ (scores.T @ scores + prior) @ inverse * np.outer(free, free), inverse * np.outer(free, free)

    def interval(self, x: np.ndarray, p: np.ndarray, weights: np.ndarray, variance: float, step: float,
                 systematic: float) -> tuple[float, float]:
        """Extinctions [1/m] between which the cost, by all else at its best, is at most CHI_SQUARED more than at x; and wider
        for what is systematic."""
        least = self.inner(x, weights, variance, p)[0]

        def worse(log_extinction: float) -> bool:
            return self.inner((log_extinction, x[1]), weights, variance, p)[0] - least > CHI_SQUARED

        ends = []
        for sign, limit in ((-1, self.limits[0, 0]), (1, self.limits[1, 0])):
            near, far, reach = x[0], x[0], step
            while far != limit and not worse(far):
                near, far, reach = far, float(np.clip(x[0] + sign * reach, *self.limits[:, 0])), 2 * reach
            if far == limit and not worse(far):
                ends.append(limit)
                continue
            for _ in range(8):
                middle = (near + far) / 2
                near, far = (near, middle) if worse(middle) else (middle, far)
            wider = np.hypot((near + far) / 2 - x[0], np.sqrt(CHI_SQUARED) * systematic)
            ends.append(float(np.clip(x[0] + sign * wider, *self.limits[:, 0])))
        return float(np.exp(ends[0])), float(np.exp(ends[1]))


def _mixture(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much of R T and of each V makes a channel, (3, 1 + L), and its derivatives (3, 1 + L, 6 + L)."""
    exposure, albedo, gains = np.exp(p[:3]), p[3:6], np.exp(p[6:])
    theta = exposure[:, None] * np.concatenate([np.ones((3, 1)), albedo[:, None] * gains], 1)
    slopes = np.zeros((*theta.shape, len(p)))
    channels, lights = np.arange(3), np.arange(len(gains))
    slopes[channels, :, channels] = theta
    slopes[channels, 1:, 3 + channels] = exposure[:, None] * gains
    slopes[:, 1 + lights, 6 + lights] = theta[:, 1:]
    return theta, slopes


def _least(cost: Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]], start: np.ndarray, bounds: np.ndarray
           ) -> tuple[float, np.ndarray]:
    """Least value of `cost` within bounds, and where, by damped Gauss-Newton steps. `cost` gives half its gradient along, and
    half of what its second derivatives are about."""
    p, damping = start, 1e-4
    value, slope, curvature = cost(p)
    for _ in range(STEPS):
        held = ((p <= bounds[0]) & (slope > 0)) | ((p >= bounds[1]) & (slope < 0)) | (bounds[0] == bounds[1])
        if held.all():
            break
        free = np.flatnonzero(~held)
        part = curvature[np.ix_(free, free)]
        steeper = part + np.diag(damping * np.diag(part) + 1e-12 * max(float(np.trace(part)), 1e-300))
        step = np.linalg.solve(steeper, slope[free])
        if slope[free] @ step < ENOUGH:
            break
        tried = p.copy()
        tried[free] -= step
        tried = np.clip(tried, *bounds)
        found = cost(tried)
        if found[0] < value:
            gain, damping = value - found[0], damping / 10
            p, (value, slope, curvature) = tried, found
            if gain < ENOUGH:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10
    return value, p
