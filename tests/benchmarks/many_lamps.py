"""Time of 200 lamps against that of 10, in one photograph of a megapixel: plan to composite, medians of three.

Asked for is a ratio of 5 at most. `make bench-lamps` runs it; it takes some minutes and stops with status 1 where the
ratio is larger. `--separate` makes each lamp a light of its own, as a person might write who knows no `lamps`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from pipeline.cli import main
from pipeline.imaging.maps import write_map
from pipeline.paths import Build

WIDTH, HEIGHT, HORIZON = 1216, 832, 400
BEFORE = ("resolve", "photograph", "camera", "geometry", "sun_direction", "illumination")
TIMED = ("plan", "emit", "render", "decompose", "composite")
FEW, MANY, MOST_RATIO = 10, 200, 5.0


def street(folder: Path, count: int, separate: bool) -> Build:
    """A street between houses, with `count` lamps from 4 to 150 m away."""
    build = Build(f"lamps_{count}", None, folder / "scenes", folder / "build")
    build.source.mkdir(parents=True)
    random = np.random.default_rng(7)
    write_map(build.source / "photograph.exr", random.uniform(0, 0.1, (HEIGHT, WIDTH, 3)).astype(np.float32))
    positions = np.stack([random.uniform(-9, 9, count), random.uniform(2, 7, count), -random.uniform(4, 150, count)], -1)
    if separate:
        lights = {f"lamp{i}": {"type": "point", "position": {"point": p}, "intensity": [5, 4, 3], "radius": 0.1}
                  for i, p in enumerate(positions.tolist())}
    else:
        lights = {"street": {"type": "lamps", "intensity": [5, 4, 3],
                             "positions": [{"point": p} for p in positions.tolist()]}}
    regions = {
        "sky": {"class": "sky", "pixels": [[0, 0], [WIDTH, 0], [WIDTH, HORIZON + 2], [0, HORIZON + 2]]},
        "ground": {"class": "support", "pixels": [[0, HORIZON + 2], [WIDTH, HORIZON + 2], [WIDTH, HEIGHT], [0, HEIGHT]]},
        "left": {"class": "vertical", "foot": [[0, 610], [560, 418]], "pixels": [[0, 0], [560, 330], [560, 418], [0, 610]]},
        "right": {"class": "vertical", "foot": [[1216, 610], [656, 418]],
                  "pixels": [[1216, 0], [656, 330], [656, 418], [1216, 610]]},
        "post": {"class": "vertical", "pixels": [[400, 150], [412, 150], [412, 560], [400, 560]]}}
    build.scene_file.write_text(json.dumps({
        "photograph": {"file": "photograph.exr"},
        "camera": {"horizontal_field_of_view": 65, "horizon": [[0, HORIZON], [WIDTH, HORIZON]], "height": 1.6},
        "depth": {"regions": regions, "sky_depth": 2000}, "lights": lights, "illumination": {"type": "manual"},
        "fog": {"type": "homogeneous", "visibility": 250}}))
    run(build, BEFORE)
    return build


def run(build: Build, stages: tuple[str, ...]) -> None:
    for stage in stages:
        with contextlib.redirect_stderr(io.StringIO()) as said:
            status = main([stage, "--scene", build.scene, "--scenes", str(build.scenes), "--build", str(build.builds)])
        if status:
            sys.exit(f"{stage}: {said.getvalue()}")


def seconds(build: Build) -> dict[str, float]:
    """Time of each stage, with nothing left of an earlier run."""
    for picture in [*build.runs.glob("*"), *build.pov.glob("*")]:
        picture.unlink()
    taken = {}
    for stage in TIMED:
        begin = time.perf_counter()
        run(build, (stage,))
        taken[stage] = time.perf_counter() - begin
    return taken


def benchmark(repeats: int, separate: bool) -> float:
    """Ratio of the medians; prints what they are made of."""
    with tempfile.TemporaryDirectory() as folder:
        builds = {count: street(Path(folder) / str(count), count, separate) for count in (FEW, MANY)}
        taken = {count: [] for count in builds}
        for _ in range(repeats):
            for count, build in builds.items():
                taken[count].append(seconds(build))
    total = {count: median(sum(one.values()) for one in runs) for count, runs in taken.items()}
    for count, runs in taken.items():
        parts = ", ".join(f"{stage} {median(one[stage] for one in runs):.1f}" for stage in TIMED)
        print(f"{count} lamps: {total[count]:.1f} s ({parts})")
    print(f"ratio {total[MANY] / total[FEW]:.2f}, at most {MOST_RATIO:g} is asked for")
    return total[MANY] / total[FEW]


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--repeats", type=int, default=3)
    options.add_argument("--separate", action="store_true")
    given = options.parse_args()
    sys.exit(benchmark(given.repeats, given.separate) > MOST_RATIO)
