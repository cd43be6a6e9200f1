"""Direction of the sunlight from windows and the sun patches they throw (Zhao et al. 2013, section 5.1).

`sun_direction` is a unit vector that points FROM the sun INTO the scene: the way sunlight travels.

The paper's objective, minimised over d_sun, sums over the windows i

    sum_j arccos(d_sun . d_j)  -  area(S_i and A_i) / area(S_i or A_i)

with d_j from vertex j of the window to the corresponding vertex of its patch, S_i the window cast
along d_sun onto the patch's planes and A_i the annotated patch, both as seen in the photograph. The
sum of radians and a ratio is kept as published. Where we had to decide:

- Correspondence: people start anywhere and go either way round. With as many corners in the patch as
  in the window, the start and the sense in which the directions agree best are taken. Else, or when
  they agree poorly (furniture hides a corner, the patch climbs a wall), only corners that agree on a
  direction are matched; each of the others counts as a constant, `UNMATCHED`, so that alternatives
  with different numbers of matches can be compared. Corners cast from (nearly) where they land, as at
  a door's threshold, show no direction and are left unmatched too. With no match at all the two
  centroids stand in for one pair of corners.
- Frame: the photograph's frame clips neither S nor A, unless the patch has a vertex on the frame.
  There the photograph ended, not the sunlight: both are clipped, and vertices on the frame match no
  corner of the window. What lies behind the camera is always clipped.
- Folds: where a patch continues on another face, the cast onto one face ends at the other.
- Directions along which the cast never meets the patch's plane overlap by 0. That is also the limit as
  the cast recedes to infinity, so the objective stays continuous, and the angles keep it sloping.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import nlopt
import numpy as np

from pipeline.errors import InputError
from pipeline.estimation.spherical import Chart, angles_between, mean_direction
from pipeline.estimation.sun_patches import (
    MATCH_ANGLE, Opening, OpeningFit, Pairs, View, joint_matchings, perturbed)
from pipeline.geometry.camera import Camera

__all__ = ["Opening", "OpeningFit", "SunEstimate", "estimate_sun_direction", "perturbed"]

# Cost of a window corner without a match, as if it were off by twice the angle at which matching ends.
UNMATCHED = 2 * MATCH_ANGLE
# Another direction explains the annotation as well if its objective is this close (a tenth of an
# overlap, or 1.4 degrees on each of four corners) and it lies further away than AMBIGUOUS_ANGLE.
NEARLY_EQUAL = 0.1
AMBIGUOUS_ANGLE = np.radians(4.0)
# Beyond these the annotation contradicts itself, and no arrow drawn from it means anything.
LARGEST_RMS = 15.0  # degree
LEAST_OVERLAP = 0.1
# Light nearer than this to the window's plane passes less than 2 % of the window's area.
GRAZING = np.radians(1.0)
# What a minimum near a known direction may take.
NEAR_EVALUATIONS = 60
Status = Literal["determined", "ambiguous", "impossible"]


@dataclass(frozen=True)
class SunEstimate:
    """The way sunlight travels, (3,), and how far to trust it.

    objective: value of the paper's objective (unmatched corners included). confidence: half-angle
    [degree] of the cone that holds 95 % of the directions re-estimated under annotation noise.
    alternatives: directions (3,) that explain the annotation nearly as well, best first. messages: why the
    status is what it is, one line each; notes: what was decided about the annotation on the way.
    farthest_start: of the directions (3,) from which the minimisations began, the one farthest from the result.
    """

    sun_direction: np.ndarray
    objective: float
    status: Status
    confidence: float
    openings: tuple[OpeningFit, ...]
    alternatives: tuple[np.ndarray, ...] = ()
    messages: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    farthest_start: np.ndarray | None = None


def estimate_sun_direction(camera: Camera, openings: Sequence[Opening], *, starts: int = 6, seed: int = 0,
                           noise: float = 2.0, resamples: int = 40, near: np.ndarray | None = None) -> SunEstimate:
    """The sun direction that best explains the annotated patches (Zhao et al. 2013, section 5.1).

    starts: local minimisations, begun at the best of many candidate directions. The confidence comes
    from re-estimating under `noise` [pixel] of Gaussian error on every vertex, `resamples` times, with
    random numbers from `seed`: at its optimum the objective has a kink wherever d_sun equals some
    d_j, so that a Jacobian there says nothing. 0 resamples skip it, and the confidence is NaN.
    near (3,): a direction found for nearly the same annotation, of which the minimum round it alone is wanted.
    Raises InputError for degenerate polygons, openings without a patch or without a name of their
    own, and patches wholly behind the camera. A well-formed annotation that contradicts itself is
    no error but has status 'impossible'.
    """
    if not openings:
        raise InputError("no window with a sun patch is annotated",
                         remedy="annotate a window and its patch, or set the sun direction by hand")
    names = [o.name for o in openings]
    if repeated := {n for n in names if names.count(n) > 1}:
        raise InputError(f"openings share the name {sorted(repeated)[0]!r}", remedy="give each its own name")
    views = [View(camera, opening) for opening in openings]
    rng = np.random.default_rng(seed)

    optima: list[_Optimum] = []
    begun: list[np.ndarray] = []
    objectives = [_Objective(views, matching) for matching in joint_matchings(views)]
    if near is not None:
        objective = min(objectives, key=lambda one: one(near))
        direction, value = _minimise(objective, near, step=0.01, tolerance=1e-4, evaluations=NEAR_EVALUATIONS)
        optima, begun, objectives = [(value, direction, objective)], [near], []
    for objective in objectives:
        for start in _start_directions(objective, starts, rng):
            direction, value = _minimise(objective, start)
            optima.append((value, direction, objective))
            begun.append(start)
    value, direction, objective = best = min(optima, key=lambda optimum: optimum[0])
    farthest = max(begun, key=lambda start: angles_between(start, direction))

    fits = tuple(view.fit(direction, pairs) for view, pairs in zip(views, objective.matching))
    alternatives = _alternatives(optima, best)
    messages = [m for view, fit in zip(views, fits) for m in _contradictions(view, fit, direction)]
    if direction[1] >= 0:
        below = np.degrees(np.arcsin(min(direction[1], 1.0)))
        messages.insert(0, f"the sun would shine from {below:.1f} degrees below the horizon; "
                           "check which patch belongs to which window")
    status: Status = "impossible" if messages else "ambiguous" if alternatives else "determined"
    if status == "ambiguous":
        away = np.degrees(angles_between(direction, alternatives[0]))
        messages.append(f"a direction {away:.1f} degrees away explains {_named(names)} nearly as well; "
                        "annotate a further window, or all corners of the patch")
    confidence = _confidence(objective, direction, noise, resamples, rng)
    notes = tuple(note for view, pairs in zip(views, objective.matching) for note in view.notes(pairs))
    return SunEstimate(direction, value, status, confidence, fits, alternatives, tuple(messages), notes, farthest)


class _Objective:
    """The paper's objective over unit vectors for one correspondence of vertices."""

    def __init__(self, views: Sequence[View], matching: Sequence[Pairs]):
        self.views, self.matching = views, matching
        self.rays = np.concatenate([v.directions(m) for v, m in zip(views, matching)])
        self.unmatched = sum(UNMATCHED * (len(v.window) - len(m)) for v, m in zip(views, matching))

    def __call__(self, direction: np.ndarray) -> float:
        return self.mismatch(direction) - sum(view.overlap(direction) for view in self.views)

    def mismatch(self, direction: np.ndarray) -> float:
        """The angle term [radian], unmatched corners included."""
        return float(angles_between(self.rays, direction).sum() + self.unmatched)

    def if_partly_hidden(self, direction: np.ndarray) -> float:
        """The objective of patches of which furniture may hide any part: they need only be covered."""
        return self.mismatch(direction) - sum(view.contained(direction) for view in self.views)


_Optimum = tuple[float, np.ndarray, _Objective]  # value, direction, and under which correspondence


def _start_directions(objective: _Objective, starts: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The best `starts` of: the observed directions, their mean, nlopt's global search, random ones."""
    mean = mean_direction(objective.rays)
    coarse, _ = _minimise(objective, mean, nlopt.GN_DIRECT_L, reach=np.pi / 3, evaluations=150)
    scattered = [Chart(mean).direction(x) for x in rng.normal(scale=0.3, size=(16, 2))]
    chosen: list[np.ndarray] = []
    for direction in sorted([mean, coarse, *objective.rays[:32], *scattered], key=objective):
        if len(chosen) < max(starts, 1) and all(angles_between(direction, c) > np.radians(1) for c in chosen):
            chosen.append(direction)
    return chosen


def _minimise(objective: _Objective, start: np.ndarray, algorithm: int = nlopt.LN_SBPLX, *,
              reach: float = np.pi / 2, step: float = 0.05, tolerance: float = 1e-6,
              evaluations: int = 400) -> tuple[np.ndarray, float]:
    """Minimum within `reach` of `start`, and its value; reach, first step and tolerance in radians.

    Without derivatives, because the angles have kinks, most often just where the minimum is.
    """
    chart, best = Chart(start), (objective(start), start)

    def evaluate(x, gradient):
        nonlocal best
        direction = chart.direction(x)
        value = objective(direction)
        if value < best[0]:
            best = value, direction
        return value

    search = nlopt.opt(algorithm, 2)
    search.set_lower_bounds([-reach] * 2)
    search.set_upper_bounds([reach] * 2)
    search.set_initial_step(step)
    search.set_xtol_abs(tolerance)
    search.set_maxeval(evaluations)
    search.set_min_objective(evaluate)
    try:
        search.optimize([0.0, 0.0])
    except nlopt.RoundoffLimited:
        pass  # No further progress in float64: the best point so far is the answer.
    return best[1], best[0]


def _alternatives(optima: Sequence[_Optimum], best: _Optimum) -> tuple[np.ndarray, ...]:
    """Distinct directions that explain the annotation nearly as well and are possible in themselves.

    Besides other local optima these are points of a flat valley around the best one, as a patch much
    smaller than the cast window leaves: it fits anywhere inside. Where corners are unmatched, the missing
    part of the patch may be hidden, and a small overlap is no evidence against another correspondence.
    """
    value, direction, objective = best
    chart = Chart(direction)
    turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    valley = [chart.direction(1.01 * AMBIGUOUS_ANGLE * np.array([np.cos(t), np.sin(t)])) for t in turns]
    excess = [(objective(d) - value, d) for d in valley]
    hidden = objective.if_partly_hidden(direction)
    for other_value, other, other_objective in optima:
        further = other_value - value
        if objective.unmatched and other_objective.unmatched:
            further = min(further, other_objective.if_partly_hidden(other) - hidden)
        excess.append((further, other))
    chosen: list[np.ndarray] = []
    for further, other in sorted(excess, key=lambda pair: pair[0]):
        if (further < NEARLY_EQUAL and other[1] < 0
                and all(_entering(view, other) > GRAZING and view.overlap(other) > LEAST_OVERLAP
                        for view in objective.views)
                and all(angles_between(other, d) > AMBIGUOUS_ANGLE for d in [direction, *chosen])):
            chosen.append(other)
    return tuple(chosen[:3])


def _entering(view: View, direction: np.ndarray) -> float:
    """Angle [radian] at which light enters the room through the window's plane; negative when it leaves."""
    inward = view.window_plane[:3] * _room_side(view)
    return float(np.arctan2(inward @ direction, np.linalg.norm(np.cross(inward, direction))))


def _room_side(view: View) -> float:
    """Which side (+1 or -1) of the window's plane is the room: the one from which it was photographed."""
    return float(np.sign(view.camera.position @ view.window_plane[:3] - view.window_plane[3]) or 1.0)


def _contradictions(view: View, fit: OpeningFit, direction: np.ndarray) -> Iterator[str]:
    heights = (view.vertices @ view.window_plane[:3] - view.window_plane[3]) * _room_side(view)
    entering = _entering(view, direction)
    if heights.mean() <= 0:
        yield (f"the patch of window {view.name!r} lies on the far side of the window, seen from the camera; "
               "check the window's plane and which patch belongs to it")
    elif entering < -GRAZING:
        yield f"sunlight would leave the room through window {view.name!r}; check its plane and its patch"
    elif entering <= GRAZING:
        yield f"sunlight would run parallel to window {view.name!r}, and none would enter; check its plane"
    if fit.rms > LARGEST_RMS:
        yield (f"corners of window {view.name!r} disagree with the direction by {fit.rms:.1f} degrees RMS "
               f"(at most {LARGEST_RMS:g}); check which patch belongs to it")
    if fit.overlap < LEAST_OVERLAP:
        yield (f"window {view.name!r}, cast along the direction, overlaps its patch by "
               f"{100 * fit.overlap:.0f} % of their union (at least {100 * LEAST_OVERLAP:.0f} % needed); "
               "check the patch's outline and plane")


def _confidence(objective: _Objective, direction: np.ndarray, noise: float, resamples: int,
                rng: np.random.Generator) -> float:
    """95 % half-angle [degree] of directions re-estimated from vertices moved by `noise` [pixel]."""
    angles = []
    for _ in range(resamples):
        redrawn = [View(view.camera, perturbed(view.camera, view.opening, noise, rng), view.on_frame)
                   for view in objective.views]
        moved, _ = _minimise(_Objective(redrawn, objective.matching), direction, tolerance=2e-3, step=0.02)
        angles.append(np.degrees(angles_between(moved, direction)))
    return float(np.percentile(angles, 95)) if angles else float("nan")


def _named(names: Sequence[str]) -> str:
    return ("window " if len(names) == 1 else "windows ") + ", ".join(repr(n) for n in names)
