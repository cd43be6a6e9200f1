"""Which figure shows what (Zhao et al. 2013, Fig. 1 to 15), drawn from build folders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.figures import framework, sheets, stimuli, timing
from pipeline.figures.pictures import Pictures
from pipeline.figures.sheets import Panel
from pipeline.figures.validation import error_curves
from pipeline.paths import Build
from pipeline.scene.artefacts import read_json


@dataclass(frozen=True)
class Figure:
    """caption: what it shows; made_from: (scene, fog) of the builds that it reads; draw(scenes, builds, path)."""

    name: str
    caption: str
    made_from: tuple[tuple[str, str | None], ...]
    draw: Callable[[Path, Path, Path], None]


def _pictures(scenes: Path, builds: Path, scene: str) -> Pictures:
    return Pictures(Build(scene, None, scenes, builds))


def teaser(scenes: Path, builds: Path, path: Path) -> None:
    panels = []
    for scene in ("bathroom", "building"):
        one = _pictures(scenes, builds, scene)
        panels += [Panel(f"{scene}, clear", one.photograph()), Panel("with synthetic fog", one.foggy())]
    sheets.grid(path, [panels])


def interior(scenes: Path, builds: Path, path: Path) -> None:
    one = _pictures(scenes, builds, "bathroom")
    sheets.grid(path, [[Panel("photograph", one.photograph()), Panel("transmittance map T", one.transmittance()),
                        Panel("volume map V", one.in_scattering()), Panel("result", one.foggy())]])


def sun_direction(scenes: Path, builds: Path, path: Path) -> None:
    one = _pictures(scenes, builds, "bathroom")
    name, found = next(iter(read_json(one.build.sun_direction)["suns"].items()))
    start = found.get("farthest_start")
    sheets.grid(path, [
        [Panel("window (red), its patch (green)", one.cast(None)),
         Panel("cast along the farthest start", one.cast(np.array(start)) if start else None),
         Panel("cast along the direction found", one.cast(np.array(found["sun_direction"])))],
        [Panel("volume of the sunlight", one.shaft()), Panel("its V, brightened", one.in_scattering(name)),
         Panel("result", one.foggy())]])


def exterior(scenes: Path, builds: Path, path: Path) -> None:
    one = _pictures(scenes, builds, "building")
    sheets.grid(path, [
        [Panel("photograph", one.photograph()), Panel("regions: upright, ground, sky", one.annotated()),
         Panel("depth, near dark", one.depth())],
        [Panel("transmittance map T", one.transmittance()), Panel("volume map V", one.in_scattering()),
         Panel("result", one.foggy())]])


def _beside_ibpm(scene: str) -> Callable[[Path, Path, Path], None]:
    def draw(scenes: Path, builds: Path, path: Path) -> None:
        one = _pictures(scenes, builds, scene)
        panels = [Panel("photograph", one.photograph())]
        for method, title in (("ibpm", "IBPM, fitted"), ("ours", "ours")):
            file = one.build.compare / f"{method}.png"
            picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
            if picture is None:
                raise InputError("was not made", place=str(file), remedy=f"run make compare scene={scene}")
            panels.append(Panel(title, picture[..., ::-1]))
        sheets.grid(path, [panels])
    return draw


def _validation(which: str) -> Callable[[Path, Path, Path], None]:
    def draw(scenes: Path, builds: Path, path: Path) -> None:
        file = builds / "validation" / f"{which}.png"
        picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
        if picture is None:
            raise InputError("was not made", place=str(file), remedy="run make validation")
        third = picture.shape[1] // 3
        titles = ("ground truth", "composite", "difference, five times")
        sheets.grid(path, [[Panel(title, picture[:, k * third:(k + 1) * third, ::-1]) for k, title in enumerate(titles)]])
    return draw


FIGURES = [
    Figure("fig01", "An interior and an exterior, clear and with fog that was rendered from one photograph and a few"
           " annotations.", (("bathroom", None), ("building", None)), teaser),
    Figure("fig02", "The framework: from a photograph and its annotations to geometry and light, to the maps T and V, to"
           " the foggy photograph C = R T + V. All images are intermediate results.", (("bathroom", None),), framework.draw),
    Figure("fig05", "Fog in an interior.", (("bathroom", None),), interior),
    Figure("fig06", "The sun's direction from a window and the patch that it throws: nlopt minimises the angles between"
           " their corners less the overlap of the patch and the window as cast. The sun scatters only in the hull of"
           " both.", (("bathroom", None),), sun_direction),
    Figure("fig07", "Fog in an exterior. Depth comes from regions of ground, upright things and sky.",
           (("building", None),), exterior),
    Figure("fig08", "Homogeneous fog in the Cornell box against a ground truth by quadrature, which shares nothing with"
           " the pipeline.", (), _validation("fig8")),
    Figure("fig09", "The same for fog that thins out with height.", (), _validation("fig9")),
    Figure("fig10", "Mean square error of the composite, values clipped to [0, 1], against absorption, scattering and"
           " the extinction of height fog. `exact but midpoint`: what is left where all is exact but the lamp's"
           " midpoint stands for its area, as in the paper.", (), error_curves),
    Figure("fig11", "An interior by image-based participating media (IBPM, Lopez-Moreno et al. 2008), its one airlight and its"
           " density fitted (to the model in fog where `make truth` made that, else to our own result), and ours: without"
           " lights of their own nothing glows and no sunlight stands in the room.", (("bathroom", None),), _beside_ibpm("bathroom")),
    Figure("fig12", "The same for street lamps at night.", (("lamps", None),), _beside_ibpm("lamps")),
    Figure("fig13", "Stimuli of a user study: clear, synthetic fog, and fog rendered into the scene's own model. Where a"
           " person has a real photograph in fog, `make study` takes that.", (("building", "moderate"),), stimuli.one_group),
    Figure("fig14", "The same for thinner and thicker fog.", (("building", "moderate"), ("building", None), ("building", "thick")),
           stimuli.densities),
    Figure("fig15", "What people took for the real one. Nobody's answers are invented: without any the figure says so.",
           (), stimuli.answers),
    Figure("table1", "Seconds of each stage in one run, with nothing made before (cold) and for another fog of the same"
           " scene, beside the paper's.", (), timing.draw),
]


def draw(name: str, scenes: Path, builds: Path, folder: Path) -> Path:
    """One figure as PNG; where something that it shows is missing, the sheet says what."""
    one = next((figure for figure in FIGURES if figure.name == name), None)
    if one is None:
        raise InputError(f"no figure is called '{name}'", place="command line",
                         remedy=f"choose {', '.join(figure.name for figure in FIGURES)}")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    absent = [f"{scene}{f', fog {fog}' if fog else ''}" for scene, fog in one.made_from
              if not Build(scene, fog, scenes, builds).report.exists()]
    if absent:
        sheets.missing(path, f"not drawn: {'; '.join(absent)} was not made")
        return path
    try:
        one.draw(scenes, builds, path)
    except InputError as error:
        sheets.missing(path, f"not drawn: {error}")
    return path
