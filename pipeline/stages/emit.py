"""Plan -> pov/*.pov, one complete scene a run."""

from __future__ import annotations

from pipeline.imaging.atomic import replacing
from pipeline.paths import Build
from pipeline.rendering.emit import Templates, emit, write_side_files
from pipeline.rendering.runs import planned_runs
from pipeline.scene.artefacts import read_fog, read_json, read_placed, write_json


def run(build: Build) -> None:
    scene, medium, templates = read_placed(build), read_fog(build), Templates(build.source)
    build.pov.mkdir(parents=True, exist_ok=True)
    wanted = []
    for planned in planned_runs(read_json(build.plan)):
        text = emit(planned, scene, templates, medium=medium)
        wanted.append(f"{planned.id}.pov")
        with replacing(build.pov / wanted[-1]) as name:
            name.write_text(text, encoding="utf-8")
    if wanted:
        wanted += write_side_files(build.pov, medium)
    for old in [*build.pov.glob("*.pov"), *build.pov.glob("*.df3")]:
        if old.name not in wanted:
            old.unlink()
    write_json(build.pov / "emitted.json", wanted)
