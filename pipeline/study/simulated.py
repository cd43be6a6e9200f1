"""Participants that no person is behind, to see what the results look like; all that comes of them says SIMULATED."""

from __future__ import annotations

import random

from pipeline.study.answers import ANSWERS, SIMULATED, VERSION, Answers, checked
from pipeline.study.description import Study

#: Probability that the time runs out, and participants at most.
LATE, MOST = 0.03, 10_000


def participants(study: Study, count: int, seed: int) -> list[Answers]:
    """So many who guess: each answer is a coin's, its time anything that is allowed."""
    luck = random.Random(seed)
    return [checked(_one(study, number, luck), study, f"simulated participant {number}") for number in range(1, count + 1)]


def _one(study: Study, number: int, luck: random.Random) -> dict:
    stimuli = [*(one for one in study.stimuli if one.practice), *study.counted]
    practised = len(stimuli) - len(study.counted)
    stimuli[practised:] = luck.sample(stimuli[practised:], len(study.counted))
    trials = []
    for order, one in enumerate(stimuli, 1):
        late = luck.random() < LATE
        trials.append({
            "order": order, "practice": one.practice, "stimulus": one.name, "scene": one.build.scene, "fog": one.fog,
            "density": one.density, "true_is": one.kind, "true_side": luck.choice("AB"),
            "answer": None if late else luck.choice("AB"), "timed_out": late,
            "milliseconds": round(1000 * study.seconds * (1 if late else luck.random())), "hidden_milliseconds": 0,
            "times_hidden": 0, "reloads": 0, "viewport": [0, 0], "shown": [0, 0], "pixel_ratio": 1.0})
    return {"format": ANSWERS, "version": VERSION, "study": study.digest, "page": "0" * 16,
            "participant": f"{SIMULATED}{number}", "seconds_allowed": float(study.seconds), "trials": trials}
