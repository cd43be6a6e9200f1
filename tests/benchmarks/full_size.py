"""Time and memory of a photograph of 24 megapixels against those of half a megapixel, of the same scene and quality.

`make bench-full-size` runs it on the photographs of building and bathroom, enlarged: every stage in a process of its own,
as Make does. It stops with status 1 where the large one takes more than three times as long or more than 3 GB. `--check`
works the large photograph out at its own size, too, and says how far off the enlarged maps are round edges; that takes
many minutes and much memory, so give a smaller `--megapixels` to it.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from tests.conftest import CHAIN
from tests.enlarged_scene import enlarged_scene, relative_error, round_edges

SCENES, SMALL, MOST_RATIO, MOST_BYTES = ("building", "bathroom"), 0.5, 3.0, 3e9


def longer_side(scene: str, megapixels: float) -> int:
    height, width = cv2.imread(f"scenes/{scene}/photograph.jpg").shape[:2]
    return round((megapixels * 1e6 / (height * width)) ** 0.5 * max(height, width))


def run(build: Build) -> tuple[dict[str, float], float]:
    """Seconds by stage, and the most memory of any [byte]; a fog's stages in one process, as make has it."""
    seconds, memory = {}, 0.0
    clean = {key: value for key, value in os.environ.items() if not key.startswith("FOG_")}
    for stage in CHAIN[:CHAIN.index("plan") + 1]:
        begin = time.perf_counter()
        child = subprocess.Popen([sys.executable, "-m", "pipeline", stage, "--scene", build.scene, "--scenes",
                                  str(build.scenes), "--build", str(build.builds)], stderr=subprocess.PIPE,
                                 env={**clean, "FOG_AHEAD": "report"})
        said = child.stderr.read()
        _, status, used = os.wait4(child.pid, 0)
        if status:
            sys.exit(f"{stage}: {said.decode()}")
        seconds["plan to report" if stage == "plan" else stage] = time.perf_counter() - begin
        memory = max(memory, 1024.0 * used.ru_maxrss)
    return seconds, memory


def errors(ours: Build, theirs: Build, pictures: Path | None = None) -> dict[str, tuple[float, float]]:
    """By map: median and 99th percentile of relative errors within a crop round steps of depth.

    pictures: where the worst crop of each map goes, ours, theirs, and the error, white from 20 % on.
    """
    where, found = round_edges(read_map(theirs.depth)), {}
    for name in ("foggy", "transmittance", "in_scattering"):
        one, other = (read_map(build.out / f"{name}.exr") for build in (ours, theirs))
        error = relative_error(one, other)
        found[name] = float(np.median(error[where])), float(np.percentile(error[where], 99))
        if pictures:
            _worst_crop(pictures / f"{pictures.name}_{name}.png", one, other, error * where)
    return found


def _worst_crop(path: Path, ours: np.ndarray, theirs: np.ndarray, error: np.ndarray, size: int = 256) -> None:
    share = cv2.boxFilter((error > 0.1).astype(np.float32), -1, (size // 2, size // 2))
    top, left = (int(min(max(at - size // 2, 0), max(many - size, 0)))
                 for at, many in zip(np.unravel_index(share.argmax(), share.shape), share.shape))
    crop = np.s_[top:top + size, left:left + size]
    white = max(float(np.percentile(theirs[crop], 99.5)), 1e-30)
    shown = [(np.clip(part[crop] / white, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)[..., ::-1] for part in (ours, theirs)]
    wrong = (np.clip(error[crop] / 0.2, 0, 1) * 255).astype(np.uint8)[..., None].repeat(3, -1)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), cv2.resize(np.concatenate([*shown, wrong], 1), None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--megapixels", type=float, default=24)
    parser.add_argument("--check", action="store_true", help="also against the photograph worked out at its own size")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of the worst crops")
    asked = parser.parse_args()
    failed = False
    for scene in asked.scenes:
        with tempfile.TemporaryDirectory() as root:
            builds = {}
            for name, megapixels, settings in (("small", SMALL, {}), ("large", asked.megapixels, {}),
                                               *([("whole", asked.megapixels, {"working_size": None})] * asked.check)):
                builds[name] = Build(name, None, Path(root), Path(root) / "build")
                enlarged_scene(scene, longer_side(scene, megapixels), builds[name].source, **settings)
                seconds, memory = run(builds[name])
                total = sum(seconds.values())
                print(f"{scene}, {megapixels:g} megapixels{', at its own size' * (name == 'whole')}: {total:.1f} s,"
                      f" at most {memory / 1e9:.2f} GB; "
                      + ", ".join(f"{stage} {one:.1f}" for stage, one in seconds.items()), flush=True)
                if name == "small":
                    reference = total
                elif name == "large":
                    print(f"  {total / reference:.2f} times the time; at most {MOST_RATIO:g} are asked for", flush=True)
                    failed |= total > MOST_RATIO * reference or memory > MOST_BYTES
            if asked.check:
                for name, (median, most) in errors(
                        builds["large"], builds["whole"], asked.pictures and asked.pictures / scene).items():
                    print(f"  {name} round edges: median {median:.2%}, 99 % within {most:.1%}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
