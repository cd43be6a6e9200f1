"""A study of the tiny scene, whose pictures are noise: its page and its answers need no render."""

from __future__ import annotations

import copy
from pathlib import Path

import imagecodecs
import numpy as np

from pipeline.study.answers import ANSWERS, VERSION
from pipeline.study.description import Study, read_study
from pipeline.study.stimuli import Pictures
from tests.conftest import write_tiny

STUDY = """\
title: Which is <the> "real" & true one?
seconds: 15
practice:
  first: {scene: tiny, real: photos/real.png}
stimuli:
  plain: {scene: tiny, real: photos/real.png}
  dense: {scene: tiny, fog: thick, real: photos/real.png, density: heavy <b>fog</b>}
  told: {scene: tiny, fog: thick, truth: true}
"""


def write_study(root: Path, text: str = STUDY) -> Path:
    """scenes/tiny, scenes/photos/real.png, a truth, and scenes/study.yaml, whose path it returns."""
    scenes = root / "scenes"
    if not (scenes / "tiny").exists():
        write_tiny(scenes / "tiny")
        (scenes / "photos").mkdir()
        codes = np.random.default_rng(1).integers(100, 200, (18, 24, 3), np.uint8)
        (scenes / "photos" / "real.png").write_bytes(imagecodecs.png_encode(codes))
        (scenes / "tiny" / "truth").mkdir()
        (scenes / "tiny" / "truth" / "thick.exr").write_bytes(b"not looked at yet")
    (scenes / "study.yaml").write_text(text)
    return scenes / "study.yaml"


def made(root: Path, text: str = STUDY) -> Study:
    return read_study(write_study(root, text), root / "scenes", root / "build")


def noise(study: Study, size: tuple[int, int] = (60, 80)) -> dict[str, Pictures]:
    """Pictures (h, w, 3) of each stimulus, the same clear one for all, as for fogs of one scene."""
    luck = np.random.default_rng(2)

    def picture():
        return np.broadcast_to(luck.integers(0, 256, (1, 1, 3), np.uint8), (*size, 3)) // 2 + luck.integers(0, 120, (*size, 3), np.uint8)

    clear = picture()
    return {one.name: Pictures(clear, picture(), picture()) for one in study.stimuli}


def answers(study: Study, participant: str = "ABCD-EFGH", right: bool = True) -> dict:
    """One participant's file, who always picks the true one, or never does."""
    trials = [{"order": order, "practice": one.practice, "stimulus": one.name, "scene": "tiny", "fog": one.fog,
               "density": one.density, "true_is": one.kind, "true_side": "A", "answer": "A" if right else "B", "timed_out": False,
               "milliseconds": 1000 * order, "hidden_milliseconds": 0, "times_hidden": 0, "reloads": 0, "viewport": [360, 740],
               "shown": [171, 128], "pixel_ratio": 2} for order, one in enumerate(study.stimuli, 1)]
    return copy.deepcopy({"format": ANSWERS, "version": VERSION, "study": study.digest, "page": "0123456789abcdef",
                          "participant": participant, "seconds_allowed": 15, "trials": trials})
