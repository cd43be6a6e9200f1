"""Fig. 13 to 15: what a user study shows, and what people answered."""

from __future__ import annotations

import shutil
from pathlib import Path

from pipeline.imaging.atomic import replacing
from pipeline.imaging.display import write_png
from pipeline.study import stimuli
from pipeline.study.description import DEFAULT, Stimulus, Study, read_study
from pipeline.study.results import write_results

#: The carried study's, all of one scene: the first is shown by itself, all of them as ever denser fog.
SHOWN = ("street_moderate", "street", "street_thick")


def one_group(scenes: Path, builds: Path, path: Path) -> None:
    one = _shown(_study(scenes, builds))[0]
    write_png(path, stimuli.one_stimulus(one, stimuli.pictures(one)))


def densities(scenes: Path, builds: Path, path: Path) -> None:
    shown = _shown(_study(scenes, builds))
    write_png(path, stimuli.densities(shown, [stimuli.pictures(one) for one in shown]))


def answers(scenes: Path, builds: Path, path: Path) -> None:
    """The chart of `make study-results`; of nobody where that was not asked for."""
    study = _study(scenes, builds)
    if not study.results(".png").exists():
        write_results(study, [])
    with replacing(path) as name:
        shutil.copyfile(study.results(".png"), name)


def _study(scenes: Path, builds: Path) -> Study:
    return read_study(scenes / DEFAULT, scenes, builds)


def _shown(study: Study) -> list[Stimulus]:
    known = {one.name: one for one in study.counted}
    return [known[name] for name in SHOWN]
