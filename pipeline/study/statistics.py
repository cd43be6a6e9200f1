"""What the answers say: counts, intervals and exact tests of each stimulus, pure functions of the answers.

Which side is the true one is drawn by a fair coin for each trial, so that someone who cannot tell picks the true one with
probability 1/2 whatever his habit is: answers are compared with a binomial distribution, without any approximation. A
trial whose time was over has no answer; it is counted apart and takes no part in shares and tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from pipeline.study.answers import Answers
from pipeline.study.description import Stimulus

#: Of the intervals.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Tally:
    """Answers to one stimulus, or to all. share: of the answers, that picked the true one; NaN without any.

    low, high: its Wilson interval (Wilson 1927). p: that chance is as far from 1/2 or farther, exact and two-sided.
    p_holm: the same corrected for the number of stimuli (Holm 1979). median_milliseconds: of trials with an answer.
    """

    name: str
    scene: str
    fog: str
    density: str
    true_is: str
    shown: int
    picked_true: int
    picked_synthetic: int
    timed_out: int
    share: float
    low: float
    high: float
    p: float
    p_holm: float
    picked_a: int
    median_milliseconds: float

    @property
    def answered(self) -> int:
        return self.picked_true + self.picked_synthetic


def wilson(successes: int, trials: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Interval of a share, of which so many of so many trials were; (0, 1) without any."""
    if not trials:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def chance(successes: int, trials: int) -> float:
    """Probability that guesses are as far from half or farther, on either side; 1 without any."""
    return float(binomtest(successes, trials, 0.5).pvalue) if trials else 1.0


def holm(p: Sequence[float]) -> list[float]:
    """p of several tests, each raised so that one of all being below a level by chance is no likelier than the level."""
    values = np.asarray(p, float)
    order = np.argsort(values, kind="stable")
    raised = np.minimum(1.0, np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1)))
    corrected = np.empty_like(values)
    corrected[order] = raised
    return corrected.tolist()


def tally(stimuli: Sequence[Stimulus], participants: Sequence[Answers]) -> list[Tally]:
    """Of each stimulus that counts, in the study's order."""
    found = [_of(one, participants) for one in stimuli]
    # a stimulus without answers is no test
    tested = [one for one in found if one["picked_true"] + one["picked_synthetic"]]
    for one, corrected in zip(tested, holm([one["p"] for one in tested])):
        one["p_holm"] = corrected
    return [Tally(**one) for one in found]


def pooled(tallies: Sequence[Tally], participants: Sequence[Answers]) -> Tally:
    """Of all stimuli together."""
    trials = [trial for one in participants for trial in one.counted]
    return Tally(**_counted("all", "", "", "", "", trials) | {"shown": sum(one.shown for one in tallies)})


def _of(stimulus: Stimulus, participants: Sequence[Answers]) -> dict[str, Any]:
    trials = [trial for one in participants for trial in one.counted if trial.stimulus == stimulus.name]
    return _counted(stimulus.name, stimulus.build.scene, stimulus.fog, stimulus.density, stimulus.kind, trials)


def _counted(name: str, scene: str, fog: str, density: str, true_is: str, trials: list) -> dict[str, Any]:
    answered = [one for one in trials if one.answer is not None]
    right = sum(one.right for one in answered)
    low, high = wilson(right, len(answered))
    p = chance(right, len(answered))
    return {"name": name, "scene": scene, "fog": fog, "density": density, "true_is": true_is, "shown": len(trials),
            "picked_true": right, "picked_synthetic": len(answered) - right, "timed_out": len(trials) - len(answered),
            "share": right / len(answered) if answered else float("nan"), "low": low, "high": high, "p": p, "p_holm": p,
            "picked_a": sum(one.answer == "A" for one in answered),
            "median_milliseconds": float(np.median([one.milliseconds for one in answered])) if answered else float("nan")}


def as_row(one: Tally) -> dict[str, Any]:
    """For a table or JSON: None where there is no number."""
    return {key: None if isinstance(value, float) and np.isnan(value) else value for key, value in asdict(one).items()}
