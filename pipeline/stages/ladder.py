"""Foggy photographs of several fogs -> ladder.png: the clear one and they side by side, as Zhao et al. 2013, Fig. 14.

Each fog was composed before (`make ladder` sees to it); nothing is rendered here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.errors import InputError, nearest
from pipeline.imaging.display import FLOAT_KINDS, display_exposure, displayed, shrunk, write_png
from pipeline.imaging.maps import read_map
from pipeline.imaging.strip import WIDEST, strip
from pipeline.paths import Build
from pipeline.physics.visibility import visibility, visibility_class
from pipeline.plugins.base import Medium
from pipeline.scene.artefacts import plugin_from_json, read_json, scene_place


def run(build: Build, names: Sequence[str]) -> Path:
    """Writes ladder.png of these fogs, in this order, and returns its path."""
    media = _media(build)
    clear = read_map(build.photograph)
    exposure = display_exposure(clear) if read_json(build.photograph_facts)["suffix"] in FLOAT_KINDS else 1.0

    def picture(linear: np.ndarray) -> np.ndarray:
        return displayed(shrunk(linear, WIDEST), exposure)

    panels = [(picture(clear), ["clear", "the photograph"])]
    for name in names:
        path = Build(build.scene, name, build.scenes, build.builds).foggy(".exr")
        if not path.exists():
            raise InputError("no such file", place=str(path), remedy=f"run: make ladder scene={build.scene}")
        panels.append((picture(read_map(path)), _caption(name, media[name])))
    write_png(build.ladder, strip(panels))
    return build.ladder


def fogs_of(build: Build, asked: Sequence[str]) -> list[str]:
    """Names of the fogs to show: those asked for, else all named ones, the thinnest first."""
    media = _media(build)
    if not media:
        raise InputError(f"{build.scene} names no fogs", place=scene_place(build, "fog"),
                         remedy="add some below 'fogs:', such as light: {type: homogeneous, visibility: 800}")
    for name in asked:
        if name not in media:
            raise InputError(f"no fog is called '{name}'", place=scene_place(build, "fogs"),
                             remedy=f"use some of {', '.join(media)}{nearest(name, list(media))}")
    return list(dict.fromkeys(asked)) or sorted(media, key=lambda name: -_visibility(media[name]))


def _media(build: Build) -> dict[str, Medium]:
    return {name: plugin_from_json("media", described) for name, described in read_json(build.input("fogs")).items()}


def _visibility(medium: Medium) -> float:
    return visibility(sum(medium.coefficients()))


def _caption(name: str, medium: Medium) -> list[str]:
    """Its name and visibility, and what weather services call that; of uneven fog where it is as dense as stated."""
    metres = _visibility(medium)
    number = "no fog" if not np.isfinite(metres) else f"{metres:.0f} m" if metres >= 10 else f"{metres:.2g} m"
    kind = "" if medium.type == "homogeneous" else f", {medium.type}"
    return [f"{name}: {number}", f"{visibility_class(metres)}{kind}"]
