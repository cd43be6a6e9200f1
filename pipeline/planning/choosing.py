"""Picks the cheapest fineness that is accurate enough, or the most accurate one that is quick enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from pipeline.planning.demands import Demands
from pipeline.planning.model import Calibration, error_of, seconds_of
from pipeline.rendering.fineness import AREA, INTEGRATED, Fineness

#: Relative error of the foggy photograph that each quality stands for.
TOLERANCE = {"draft": 0.05, "normal": 0.01, "final": 0.002}
#: Levels of each knob, coarse to fine; those of a group cost and err together.
GROUPS: list[dict[str, list[Any]]] = [
    {"in_scattering_size": [48, 64, 96, 128, 192, 256, 384, 512], "glow_tolerance": [0.1, 0.05, 0.02, 0.005, 0.002]},
    {"shadow_size": [24, 32, 48, 64, 96, 128, 192, 256], "samples": [4, 6, 8, 12, 16, 24, 32, 48, 72, 96],
     "shadow_lights": [2, 3, 4, 5, 8]},
    {"shaft_samples": [6, 12, 24, 48, 72, 144, 256]},
    {"room_directions": [32, 64, 128]},
    {"transmittance": [INTEGRATED, AREA], "transmittance_size": [96, 160, 256, 20000]},
]
FINEST = Fineness(**{knob: levels[-1] for group in GROUPS for knob, levels in group.items()})
#: Share of what is asked that the model may use up: what it says is for scenes at large, not for this one.
MARGIN = 0.8
#: Optical depths between two samples; their double from a tolerance of COARSE on. A midpoint rule is off by h^2/24.
OPTICAL_STEP, COARSE = 1 / 3, 0.03
#: T and V are products too, if not what a tolerance is asked for: each may be off by so many times as much as the picture,
#: but not by more than SHOWS where less is asked of that: steps in V's shadows would show.
MOST_OF_MAPS, SHOWS = 3.0, 0.0125


@dataclass(frozen=True)
class Choice:
    """tolerance: asked relative error, None for a budget; seconds [s] and error as the model expects them."""

    fineness: Fineness
    tolerance: float | None
    seconds: float
    error: float


def choose(demand: Demands, settings: dict[str, Any], constants: Calibration) -> Choice:
    """By a scene's render settings: `budget` [s] or `tolerance` or `quality`; knobs that they state are taken as stated."""
    tolerance = settings["tolerance"] or TOLERANCE[settings["quality"]]
    budget = settings["budget"] if settings["tolerance"] is None else None

    step = OPTICAL_STEP if budget is not None or tolerance < COARSE else 2 * OPTICAL_STEP

    def measured(fineness: Fineness) -> tuple[float, float]:
        own = replace(fineness, optical_step=step).stated(settings)
        return seconds_of(demand, own, constants), error_of(demand, own, constants) ** 2

    # seconds of the groups add up, and so do their squared errors
    finest = measured(FINEST)
    seconds, error, fronts = np.array([finest[0]]), np.array([finest[1]]), []
    for group in GROUPS:
        fronts.append(_front(group, measured))
        own = np.array([one[:2] for one in fronts[-1]]) - finest
        seconds, error = ((total[:, None] + one).ravel() for total, one in ((seconds, own[:, 0]), (error, own[:, 1])))
    if budget is not None:
        enough, wanted = seconds <= budget, (error, seconds)
        if not enough.any():
            enough, wanted = np.full(len(seconds), True), (seconds, error)
    else:
        of_t = np.add.outer(np.zeros([len(one) for one in fronts[:-1]]), [one[1] for one in fronts[-1]]).ravel() - finest[1]
        of_maps = max(tolerance, min(MOST_OF_MAPS * tolerance, SHOWS))
        enough = (_within(error, MARGIN * tolerance) & _within(error - of_t, of_maps * demand.share())
                  & _within(of_t, of_maps * demand.surfaces))
        wanted = seconds, error
    best = np.flatnonzero(enough)[np.lexsort([one[enough] for one in wanted[::-1]])[0]]
    chosen: dict[str, Any] = {}
    for front, index in zip(fronts, np.unravel_index(best, [len(one) for one in fronts])):
        chosen |= front[index][2]
    fineness = Fineness(**chosen, optical_step=step).stated(settings)
    return Choice(fineness, None if budget is not None else tolerance, seconds_of(demand, fineness, constants),
                  error_of(demand, fineness, constants))


def _within(squared: np.ndarray, limit: float) -> np.ndarray:
    """Whether squared errors are below a limit; where none is, as near to the least as a half of the limit lets."""
    return squared <= max(limit**2, float(squared.min()) + (limit / 2) ** 2)


def _front(group: dict[str, list[Any]], measured: Callable[[Fineness], tuple[float, float]]
           ) -> list[tuple[float, float, dict[str, Any]]]:
    """Seconds, squared error and levels of a group's knobs that no others beat in both, other knobs at their finest."""
    found = []
    for levels in product(*group.values()):
        part = dict(zip(group, levels))
        found.append((*measured(replace(FINEST, **part)), part))
    front, best = [], float("inf")
    for one in sorted(found, key=lambda one: one[:2]):
        if one[1] < best:
            best = one[1]
            front.append(one)
    return front
