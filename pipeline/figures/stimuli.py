"""Fig. 13 to 15: what a user study shows, and what people answered."""

from __future__ import annotations

from pathlib import Path

import cv2

from pipeline.figures import sheets
from pipeline.figures.sheets import Panel
from pipeline.study.description import DEFAULT, TRUTH, Stimulus, Study, read_study
from pipeline.study.results import write_results
from pipeline.study.stimuli import pictures

#: The carried study's, all of one scene: the first is shown by itself, all of them as ever denser fog.
SHOWN = ("street_moderate", "street", "street_thick")


def one_group(scenes: Path, builds: Path, path: Path) -> None:
    one = _stimuli(read_study(scenes / DEFAULT, scenes, builds))[0]
    shown = pictures(one)
    sheets.grid(path, [[Panel("clear", shown.clear), Panel("synthetic fog", shown.synthetic), Panel(_kind(one), shown.other)]])


def densities(scenes: Path, builds: Path, path: Path) -> None:
    stimuli = _stimuli(read_study(scenes / DEFAULT, scenes, builds))
    shown = [pictures(one) for one in stimuli]
    sheets.grid(path, [[Panel("clear", shown[0].clear)] + [Panel(f"synthetic, {one.density}", each.synthetic)
                                                            for one, each in zip(stimuli, shown)],
                       [Panel("", None)] + [Panel(f"{_kind(one)}, {one.density}", each.other)
                                                                         for one, each in zip(stimuli, shown)]])


def answers(scenes: Path, builds: Path, path: Path) -> None:
    """The chart of `make study-results`; of nobody where that was not asked for."""
    study = read_study(scenes / DEFAULT, scenes, builds)
    if not study.results(".png").exists():
        write_results(study, [])
    picture = cv2.imread(str(study.results(".png")), cv2.IMREAD_COLOR)[..., ::-1]
    sheets.grid(path, [[Panel("share of answers by group of stimuli", picture)]])


def _stimuli(study: Study) -> list[Stimulus]:
    known = {one.name: one for one in study.counted}
    return [known[name] for name in SHOWN]


def _kind(one: Stimulus) -> str:
    return TRUTH if one.kind == TRUTH else f"real {one.kind}"
