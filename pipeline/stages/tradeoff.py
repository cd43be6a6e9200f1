"""Time against error of one scene's knobs and plans -> tradeoff.csv, tradeoff.png."""

from __future__ import annotations

import sys

from pipeline.errors import InputError
from pipeline.paths import Build
from pipeline.planning import tradeoff
from pipeline.scene.artefacts import read_json


def run(build: Build) -> None:
    if read_json(build.plan)["fog_is_clear"]:
        raise InputError("the fog is clear: nothing to measure", place=str(build.scene_file), remedy="pick a denser fog")
    rows = tradeoff.tradeoff(build)
    plans = [row for row in rows if row["kind"] == "plan"]
    for row in plans:
        met = [other["seconds"] for other in rows if other["relative_error"] <= row["level"]]
        print(f"tolerance {row['level']:g}: {row['relative_error']:.2%} in {row['seconds']:.1f} s,"
              f" {row['seconds'] / min(met, default=row['seconds']):.2f} times the quickest that meets it")
    try:
        tradeoff.draw(rows, f"{build.scene}, fog {build.fog or 'default'}", build.out / "tradeoff.png")
    except ImportError:
        print("note: no picture without matplotlib; run make setup-figures", file=sys.stderr)
