"""pov/*.pov -> runs/*.exr. A run whose text was rendered before is not rendered again."""

from __future__ import annotations

import sys

from pipeline.paths import Build
from pipeline.rendering import povray
from pipeline.rendering.runs import planned_runs
from pipeline.scene.artefacts import read_json, write_json


def run(build: Build) -> None:
    settings = read_json(build.input("render"))
    planned = planned_runs(read_json(build.plan))
    # the longest first, so that it is not what remains
    planned.sort(key=lambda one: -one.width * one.height * one.samples)
    seconds: dict[str, float] = {}

    def told(index: int, taken: float) -> None:
        seconds[planned[index].id] = taken
        state = f"{taken:.1f} s" if taken else "unchanged"
        print(f"  [{len(seconds)}/{len(planned)}] {planned[index].id}: {state}", file=sys.stderr, flush=True)

    povray.render_together([(build.pov / f"{one.id}.pov", build.runs / f"{one.id}.exr", one.width, one.height)
                            for one in planned], threads=settings["threads"], timeout=settings["timeout"], told=told)
    keep = {one.id for one in planned}
    for old in build.runs.glob("*") if build.runs.exists() else []:
        if old.stem not in keep and old.suffix in (".exr", ".sha256", ".log"):
            old.unlink()
    write_json(build.runs_done, {"seconds": seconds})
