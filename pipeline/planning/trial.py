"""One fog of a scene made once more, with other settings, in a folder of its own: for measuring."""

from __future__ import annotations

import importlib
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.rendering.fineness import Fineness, as_json
from pipeline.scene.artefacts import read_json, working, write_json

STAGES = ("plan", "emit", "render", "decompose", "composite")
#: Of these, what enlarges the maps of a large photograph; all else works at its working size.
FULL_SIZE = {"composite"}
#: What a fog's stages read of the scene file.
INPUTS = ("fog", "fog_files", "gains", "render")


@dataclass(frozen=True)
class Trial(Build):
    """A fog's build whose results go to a folder `name` of the scene's build, and nowhere else."""

    name: str = field(default="trial", kw_only=True)

    @property
    def out(self) -> Path:
        return self.shared / "trials" / (self.fog or "default") / self.name


@dataclass(frozen=True)
class Outcome:
    """seconds by stage [s]; foggy (n, 3): pixels that show no lamp."""

    seconds: dict[str, float]
    foggy: np.ndarray

    @property
    def total(self) -> float:
        return sum(self.seconds.values())


def of(build: Build, name: str) -> Trial:
    return Trial(build.scene, build.fog, build.scenes, build.builds, working(build).reduced, name=name)


def run(build: Build, name: str, settings: dict[str, Any], fresh: bool = True) -> Outcome:
    """Makes the fog with render settings changed as `settings` says, in seconds [s] of cold caches."""
    trial = of(build, name)
    if fresh:
        shutil.rmtree(trial.out, ignore_errors=True)
    for part in INPUTS:
        stated = read_json(build.input(part))
        write_json(trial.input(part), {**stated, **settings} if part == "render" else stated)
    shutil.copyfile(build.lines, trial.lines)
    seconds = {}
    for stage in STAGES:
        module = importlib.import_module(f"pipeline.stages.{stage}")
        start = time.monotonic()
        module.run(trial.full if stage in FULL_SIZE else trial)
        seconds[stage] = time.monotonic() - start
    return Outcome(seconds, foggy(trial))


def foggy(build: Build) -> np.ndarray:
    """The pixels (n, 3) of a fog's result that show no lamp, at the photograph's own size."""
    return read_map(build.foggy(".exr"))[~shows_lamp(build.full)]


def shows_lamp(build: Build) -> np.ndarray:
    """(H, W) of the build's images."""
    return read_map(build.surfaces)[..., 1] >= 0


def settings_of(fineness: Fineness) -> dict[str, Any]:
    """Render settings that state all of it."""
    return as_json(fineness)
