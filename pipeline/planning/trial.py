"""One fog of a scene made once more, with other settings, in a folder of its own: for measuring."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline import chain
from pipeline.paths import Build
from pipeline.scene.artefacts import FOG_STAGES, read_json, working, write_json

#: What a fog's stages read of the scene file.
INPUTS = ("fog", "fog_files", "gains", "render", "composite")


@dataclass(frozen=True)
class Trial(Build):
    """A fog's build whose results go to a folder `name` of the scene's build, and nowhere else."""

    name: str = field(default="trial", kw_only=True)

    @property
    def out(self) -> Path:
        return self.shared / "trials" / (self.fog or "default") / self.name


def of(build: Build, name: str) -> Trial:
    return Trial(build.scene, build.fog, build.scenes, build.builds, working(build).reduced, name=name)


def run(build: Build, name: str, settings: dict[str, Any], fresh: bool = True, fog: dict[str, Any] | None = None,
        stages: Sequence[str] = FOG_STAGES) -> dict[str, float]:
    """Makes the fog with render settings changed as `settings` says; seconds [s] by stage.

    fresh: removes what an earlier trial of this name left, so that every render is made. fog: another one, of no files, as
    the fog's input states it.
    """
    trial = of(build, name)
    if fresh:
        shutil.rmtree(trial.out, ignore_errors=True)
    for part in INPUTS:
        stated = read_json(build.input(part))
        write_json(trial.input(part), {**stated, **settings} if part == "render" else stated)
    if fog is not None:
        write_json(trial.input("fog"), fog)
        write_json(trial.input("fog_files"), {})
    shutil.copyfile(build.lines, trial.lines)
    seconds: dict[str, float] = {}
    chain.run(trial, stages, done=seconds.__setitem__)
    return seconds
