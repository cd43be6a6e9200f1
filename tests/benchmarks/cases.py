"""What is measured: time [s] of processes that find nothing rendered, and how far off what they made is."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.paths import PROJECT, Build
from pipeline.planning import trial
from pipeline.planning.calibrate import quiet
from pipeline.reporting.manifest import stage_seconds
from pipeline.scene.artefacts import read_json, write_json
from tests.benchmarks import mitsuba_map, one_map, truth

#: Scenes and what is overridden in them.
SCENES = {"cornell": [f"photograph.size={truth.SIZE}", "quality=draft"], "bathroom": [], "building": []}
#: The light whose gain is changed.
RELIT = {"bathroom": "sun", "building": "sun"}
#: Pixels made as finely as it takes that a fog's error is told by, the same for every quality; its own check has fewer.
CHECKED = 300
QUALITIES = ("draft", "normal", "final")
#: Paths a pixel that Mitsuba is measured at: enough for its error to fall with their square root.
PATHS = {"V": (16, 64), "T": (4, 16)}


@dataclass(frozen=True)
class Measured:
    """seconds [s] of wall time; processor [s]: what all cores worked meanwhile; errors by name, relative."""

    seconds: float
    processor: float
    errors: dict[str, float] = field(default_factory=dict)


#: Something to be measured: cases by their names.
Work = Callable[[int], dict[str, Measured]]


def works(folder: Path, mitsuba: dict[str, str] | None, only: str) -> dict[str, Work]:
    """Everything whose name holds `only`, prepared in `folder`; each is called with the number of the round."""
    names = {f"cornell {name}": ("cornell", name, None) for name in "VT"}
    if mitsuba:
        names |= {f"cornell {name} Mitsuba {count}": ("cornell", name, count) for name in "VT" for count in PATHS[name]}
    names |= {f"{scene} {quality}": (scene, quality, None) for scene in RELIT for quality in QUALITIES}
    chosen = {name: what for name, what in names.items() if only in name}
    builds = {scene: prepared(scene, folder) for scene in dict.fromkeys(what[0] for what in chosen.values())}
    found: dict[str, Work] = {}
    if "cornell" in builds:
        true, exported = truth.Truth(folder), builds["cornell"].export("bench")
        if mitsuba:
            mitsuba_map.export(builds["cornell"], exported)
    for name, (scene, what, count) in chosen.items():
        if scene != "cornell":
            found[name] = _fog_work(builds[scene], what)
        elif count is None:
            found[name] = _map_work(name, builds[scene], what, true)
        else:
            found[name] = _mitsuba_work(name, exported, what, count, mitsuba["variant"], true)
    return found


def prepared(scene: str, folder: Path) -> Build:
    """The scene's light found and its default fog planned, by make, which redoes what is out of date."""
    build = Build(scene, None, PROJECT / "scenes", folder)
    print(f"{scene}: light and plan", file=sys.stderr, flush=True)
    command = ["make", "-s", f"scene={scene}", f"BUILD={folder}", *SCENES[scene], str(build.plan)]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True,
                          env={k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "FOG_"))})
    if done.returncode:
        raise InputError((done.stderr.strip().splitlines() or ["it failed"])[-1], place=f"make scene={scene}",
                         remedy=f"run: {' '.join(command)}")
    return build


def _map_work(name: str, build: Build, what: str, true: truth.Truth) -> Work:
    def measured(number: int) -> dict[str, Measured]:
        clear(build, maps=False)
        seconds = timed("tests.benchmarks.one_map", what, build.scene, str(build.builds))
        return {name: Measured(*seconds, true.errors(what, np.load(one_map.file_of(build, what))))}
    return measured


def _mitsuba_work(name: str, exported: Path, what: str, count: int, variant: str, true: truth.Truth) -> Work:
    def measured(number: int) -> dict[str, Measured]:
        seconds = timed("tests.benchmarks.mitsuba_map", what, str(exported), variant, str(count), str(number))
        picture = np.load(mitsuba_map.file_of(exported, what, count))
        return {name: Measured(*seconds, true.errors(what, picture, without_eye=what == "T"))}
    return measured


def _fog_work(build: Build, quality: str) -> Work:
    """All stages of a fog; at the quality that a person gets, also what is redone for another gain of a light.

    Errors: by CHECKED pixels, worked out beforehand, and what the fog's own check says.
    """
    print(f"{build.scene} {quality}: error", file=sys.stderr, flush=True)
    with quiet():
        trial.run(build, "bench", {"quality": quality, "checked_pixels": CHECKED})
    checked = _estimated(trial.of(build, "bench"))

    def measured(number: int) -> dict[str, Measured]:
        clear(build)
        settings, gains = read_json(build.input("render")), read_json(build.input("gains"))
        write_json(build.input("render"), {**settings, "quality": quality})
        taken, stages = _stages(build, "plan"), stage_seconds(build)
        stated = _estimated(build)
        errors = {"checked": checked["relative_error"], "estimated": stated["relative_error"], "at_most": stated["at_most"]}
        name = f"{build.scene} {quality}"
        found = {f"{name}, all": Measured(*taken, errors),
                 f"{name}, rendering": Measured(stages["render"] + stages["decompose"], 0.0, errors)}
        if quality == "normal":
            write_json(build.input("gains"), {**gains, RELIT[build.scene]: 0.5 * gains[RELIT[build.scene]]})
            found[f"{name}, relit"] = Measured(*_stages(build, "decompose"))
            write_json(build.input("gains"), gains)
        return found
    return measured


def _estimated(build: Build) -> dict[str, float]:
    return read_json(build.maps)["estimated_error"]


def clear(build: Build, maps: bool = True) -> None:
    """Removes what was rendered, and with `maps` all that the stages made of it, the plan too."""
    for folder in (build.pov, build.runs):
        shutil.rmtree(folder, ignore_errors=True)
    if maps:
        for path in [build.plan, build.maps, build.transmittance, *build.out.glob("in_scattering*.exr"),
                     *build.out.glob("foggy.*")]:
            path.unlink(missing_ok=True)


def _stages(build: Build, first: str) -> np.ndarray:
    """A fog's stages from this one to the composite, as make has them done: in one process."""
    return timed("pipeline", first, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds),
                 ahead="composite")


def timed(module: str, *arguments: str, ahead: str = "") -> np.ndarray:
    """Wall time and processor time [s], (2,), of a Python process of its own, from its start to its end.

    ahead: the last of the stages to which a stage goes on.
    """
    environment = {**{k: v for k, v in os.environ.items() if not k.startswith("FOG_")}, "FOG_AHEAD": ahead}
    start = np.array([time.monotonic(), _worked()])
    done = subprocess.run([sys.executable, "-m", module, *arguments], cwd=PROJECT, env=environment, text=True,
                          stdin=subprocess.DEVNULL, capture_output=True)
    taken = np.array([time.monotonic(), _worked()]) - start
    if done.returncode:
        raise InputError((done.stderr.strip().splitlines() or ["it failed"])[-1], place=f"{module} {' '.join(arguments)}",
                         remedy="run the scene by itself with make")
    return taken


def _worked() -> float:
    """Processor time [s] of all processes that ended, theirs included."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
