"""One fog of a scene made once more, with other settings, in a folder of its own: for measuring."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import chain
from pipeline.estimation.room_light import DIRECTIONS
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.planning.accuracy import relative_error
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


def measured_error(build: Build, name: str) -> dict[str, float]:
    """Errors of the trial just made: of single pixels, and of what these share with the maps by the trial made once more with
    all that is known of a room."""
    made = of(build, name)
    error, plan = read_json(made.maps)["estimated_error"], read_json(made.plan)
    # of what is in closed form throughout nothing is checked
    found = {key: (error or {}).get(key, 0.0) for key in ("relative_error", "transmittance", "in_scattering")}
    if not error or not error["shared"]:
        return found
    few = picture(build, name)
    run(build, name, {**read_json(made.input("render")), **plan["fineness"], "room_directions": DIRECTIONS}, fresh=False)
    own = np.sqrt(max(found["relative_error"] ** 2 - error["shared"] ** 2, 0.0))
    return {**found, "relative_error": float(np.hypot(own, relative_error(few, picture(build, name))))}


def picture(build: Build, name: str) -> np.ndarray:
    """What the trial made of the photograph, (n, 3) of all pixels that show no lamp."""
    made, shown = of(build, name), read_map(build.surfaces)[..., 1] < 0
    return (np.maximum(read_map(build.photograph), 0) * read_map(made.transmittance) + read_map(made.in_scattering()))[shown]


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
