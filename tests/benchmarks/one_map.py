"""One of a fog's maps alone, from the plan to the map, in a process of its own: what it takes without the other.

    python -m tests.benchmarks.one_map V cornell build/bench

writes V.npy or T.npy (H, W, 3) into the folder `alone` of the scene's build.
"""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pipeline.paths import PROJECT, Build
from pipeline.rendering import povray
from pipeline.rendering.emit import Templates, emit, write_side_files
from pipeline.rendering.runs import from_json
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import read_fog, read_json

#: Kinds of the runs that each map is made of.
KINDS = {"V": {"in_scattering"}, "T": {"transmittance", "irradiance"}}


def file_of(build: Build, name: str) -> Path:
    return build.out / "alone" / f"{name}.npy"


def make(build: Build, name: str) -> None:
    """Emits, renders and works out V or T by the build's plan, with nothing of it rendered before."""
    scattered, medium, templates = Scattered(build), read_fog(build), Templates(build.source)
    plan, settings, jobs = read_json(build.plan), read_json(build.input("render")), []
    runs = [one for one in map(from_json, plan["runs"]) if one.kind in KINDS[name]]
    build.pov.mkdir(parents=True, exist_ok=True)
    # as the stages do it: what needs no render is worked out meanwhile
    beside = ThreadPoolExecutor(1)
    begun = beside.submit(scattered.beforehand, plan["lights"], False) if name == "V" else None
    for run in runs:
        jobs.append((build.pov / f"{run.id}.pov", build.runs / f"{run.id}.exr", run.width, run.height))
        jobs[-1][0].write_text(emit(run, scattered.scene, templates, medium=medium), encoding="utf-8")
    if runs:
        write_side_files(build.pov, medium)
        povray.render_together(jobs, threads=settings["threads"], timeout=settings["timeout"], told=lambda *_: None)
    if begun:
        begun.result()
    if name == "T":
        made = scattered.transmittance(plan["lights"])
    else:
        made = sum(scattered.by(light) for light in plan["lights"])
    file_of(build, name).parent.mkdir(exist_ok=True)
    np.save(file_of(build, name), made.astype(np.float32))


if __name__ == "__main__":
    make(Build(sys.argv[2], None, PROJECT / "scenes", Path(sys.argv[3])), sys.argv[1])
