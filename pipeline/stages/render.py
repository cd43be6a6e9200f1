"""pov/*.pov -> runs/*.exr. A run whose text was rendered before is not rendered again."""

from __future__ import annotations

import sys

from pipeline.paths import Build
from pipeline.rendering import povray
from pipeline.rendering.runs import from_json
from pipeline.scene.artefacts import read_json, write_json


def run(build: Build) -> None:
    settings = read_json(build.input("render"))
    planned = [from_json(data) for data in read_json(build.plan)["runs"]]
    seconds = {}
    for number, one in enumerate(planned, 1):
        seconds[one.id] = povray.render(
            build.pov / f"{one.id}.pov", build.runs / f"{one.id}.exr", one.width, one.height,
            threads=settings["threads"], timeout=settings["timeout"])
        state = f"{seconds[one.id]:.1f} s" if seconds[one.id] else "unchanged"
        print(f"  [{number}/{len(planned)}] {one.id}: {state}", file=sys.stderr, flush=True)
    keep = {one.id for one in planned}
    for old in build.runs.glob("*") if build.runs.exists() else []:
        if old.stem not in keep and old.suffix in (".exr", ".sha256", ".log"):
            old.unlink()
    write_json(build.runs_done, {"seconds": seconds})
