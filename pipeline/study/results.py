"""Answers of a study -> results.csv, results.json and, with matplotlib, results.png and results.svg (Fig. 15)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from pipeline.imaging.atomic import replacing
from pipeline.scene.artefacts import write_json
from pipeline.study import figure
from pipeline.study.answers import Answers
from pipeline.study.description import Study
from pipeline.study.statistics import CONFIDENCE, Tally, as_row, pooled, tally


def write_results(study: Study, participants: Sequence[Answers], left_out: Sequence[str] = (), *, simulated: bool = False) -> bool:
    """Writes all of them into the study's folder; False where matplotlib is missing, and so are the pictures."""
    tallies = tally(study.counted, participants)
    whole = pooled(tallies, participants)
    study.folder.mkdir(parents=True, exist_ok=True)
    _write_table(study.results(".csv", simulated), [*tallies, whole], simulated)
    write_json(study.results(".json", simulated), {
        "format": "fog-study-results", "version": 1, "simulated": simulated,
        "note": figure.SIMULATED if simulated else None if participants else figure.NOBODY,
        "title": study.title, "study": study.digest, "participants": len(participants),
        "unfinished": sum(len(one.counted) < len(study.counted) for one in participants),
        "interval": f"Wilson, {CONFIDENCE:g}", "test": "exact binomial against 1/2, two-sided; p_holm over stimuli",
        "left_out": list(left_out), "stimuli": [as_row(one) for one in tallies], "all": as_row(whole)})
    try:
        figure.draw(tallies, whole, len(participants), study.title, [study.results(".png", simulated), study.results(".svg", simulated)],
                    simulated=simulated, left_out=len(left_out))
    except ImportError:
        return False
    return True


def _write_table(path: Path, tallies: Sequence[Tally], simulated: bool) -> None:
    rows = [{**as_row(one), "simulated": simulated} for one in tallies]
    with replacing(path) as name, open(name, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
