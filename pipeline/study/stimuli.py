"""The three pictures of a stimulus, made alike so that nothing but the fog tells them apart.

All three start from linear light, are averaged to the same size in it, multiplied by the same factor (1 unless the
photograph is a float file whose unit is not white), and encoded as sRGB and then as the same kind of JPEG without
metadata. What went before differs: a composite is made from the photograph's file, of whose compression fog hides the
most; a real photograph has had a camera's own processing; a rendered truth has had none.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging import photograph as photographs
from pipeline.imaging.display import FLOAT_KINDS, display_exposure, displayed, write_png
from pipeline.imaging.maps import read_map
from pipeline.imaging.strip import A_ROW, strip
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json
from pipeline.scene.truths import is_of
from pipeline.study.description import TRUTH, Stimulus, Study

#: Longer side [pixel] of what is shown, at most.
LONGEST = 900
#: Width [pixel] of a picture on a sheet.
PANEL = 520
#: By how much the sides' ratio of a real photograph may differ from that of the clear one.
RATIO = 0.01


@dataclass(frozen=True)
class Pictures:
    """sRGB (H, W, 3) uint8 of one size: `other` is the real photograph or the rendered truth."""

    clear: np.ndarray
    synthetic: np.ndarray
    other: np.ndarray


def pictures(stimulus: Stimulus) -> Pictures:
    """What a person sees of a stimulus. Its foggy photograph must have been made (`make study` sees to it)."""
    build = stimulus.build
    foggy = build.foggy(".exr")
    if not foggy.exists():
        fog = f" fog={build.fog}" if build.fog else ""
        raise InputError("no such file", place=str(foggy), remedy=f"run: make scene={build.scene}{fog}")
    clear = read_map(build.photograph)
    synthetic = read_map(foggy, clear.shape[:2])
    other = _truth(stimulus, clear.shape[:2]) if stimulus.kind == TRUTH else _photograph(stimulus, clear.shape[:2])
    size = common_size(clear.shape[:2], other.shape[:2])
    exposure = display_exposure(clear) if read_json(build.photograph_facts)["suffix"] in FLOAT_KINDS else 1.0
    return Pictures(*(displayed(photographs.averaged(one, size[::-1]), exposure) for one in (clear, synthetic, other)))


def common_size(clear: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    """(height, width) [pixel] of clear's proportions that asks neither picture for more pixels than it has."""
    scale = min(1.0, LONGEST / max(clear), max(other) / max(clear))
    return max(1, round(clear[0] * scale)), max(1, round(clear[1] * scale))


def _photograph(stimulus: Stimulus, size: tuple[int, int]) -> np.ndarray:
    radiance = photographs.read(stimulus.other).radiance
    (height, width), (rows, columns) = size, radiance.shape[:2]
    if abs(columns / rows / (width / height) - 1) > RATIO:
        raise InputError(f"{stimulus.name}: {stimulus.other} has {columns}x{rows} pixels, the clear photograph {width}x{height}",
                         place=stimulus.place, remedy="crop it so that both have the same sides' ratio and show the same")
    return radiance


def _truth(stimulus: Stimulus, size: tuple[int, int]) -> np.ndarray:
    """A rendered truth of just this fog and this photograph's pixels."""
    build = stimulus.build
    remake = f"run: make study-truth scene={build.scene} fogs={stimulus.fog}"
    if not is_of(stimulus.other, stimulus.medium):
        raise InputError(f"{stimulus.name}: {stimulus.other} is the truth of another fog than '{stimulus.fog}' is now",
                         place=stimulus.place, remedy=remake)
    values = read_map(stimulus.other)
    if values.shape[:2] != size:
        raise InputError(f"{stimulus.name}: {stimulus.other} has {values.shape[1]}x{values.shape[0]} pixels, the photograph"
                         f" {size[1]}x{size[0]}", place=stimulus.place, remedy=remake)
    return values


def one_stimulus(stimulus: Stimulus, shown: Pictures) -> np.ndarray:
    """Zhao et al. 2013, Fig. 13: clear, synthetic and real or true, side by side, (H, W, 3) uint8."""
    return strip([(_panel(shown.clear), ["clear", f"scene {stimulus.build.scene}"]),
                  (_panel(shown.synthetic), ["synthetic fog", stimulus.density]),
                  (_panel(shown.other), [_kind(stimulus), stimulus.density])])


def densities(stimuli: list[Stimulus], shown: list[Pictures]) -> np.ndarray:
    """Zhao et al. 2013, Fig. 14: one clear photograph; beside it synthetic fogs, and below each the real or true one."""
    if len(stimuli) > A_ROW - 1:
        parts = [densities(stimuli[k:k + A_ROW - 1], shown[k:k + A_ROW - 1]) for k in range(0, len(stimuli), A_ROW - 1)]
        return _stacked(parts)
    clear = _panel(shown[0].clear)
    # a real photograph of slightly other proportions made its own stimulus so
    synthetic, other = ([cv2.resize(_panel(getattr(one, which)), clear.shape[1::-1], interpolation=cv2.INTER_AREA) for one in shown]
                        for which in ("synthetic", "other"))
    above = [(clear, ["clear", f"scene {stimuli[0].build.scene}"]),
             *((picture, ["synthetic fog", one.density]) for picture, one in zip(synthetic, stimuli))]
    below = [(np.full_like(clear, 255), ["", ""]), *((picture, [_kind(one), one.density]) for picture, one in zip(other, stimuli))]
    return _stacked([strip(above), strip(below)], 0)


def _panel(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    method = cv2.INTER_AREA if width > PANEL else cv2.INTER_CUBIC
    return cv2.resize(picture, (PANEL, max(1, round(height * PANEL / width))), interpolation=method)


def _kind(stimulus: Stimulus) -> str:
    return "rendered truth" if stimulus.kind == TRUTH else "real photograph"


def _stacked(sheets: list[np.ndarray], gap: int = 16) -> np.ndarray:
    width = max(one.shape[1] for one in sheets)
    return np.concatenate([np.pad(one, ((0, gap), (0, width - one.shape[1]), (0, 0)), constant_values=255) for one in sheets])


def sheet(study: Study, shown: dict[str, Pictures]) -> np.ndarray:
    """All stimuli that count, scene after scene: Fig. 13 and 14 of any study, (H, W, 3) uint8."""
    by_scene: dict[Build, list[Stimulus]] = {}
    for one in study.counted:
        by_scene.setdefault(Build(one.build.scene, None, one.build.scenes, one.build.builds), []).append(one)
    return _stacked([densities(ones, [shown[one.name] for one in ones]) if len(ones) > 1 else one_stimulus(ones[0], shown[ones[0].name])
                     for ones in by_scene.values()])


def write_sheet(study: Study, shown: dict[str, Pictures]) -> Path:
    write_png(study.sheet, sheet(study, shown))
    return study.sheet
