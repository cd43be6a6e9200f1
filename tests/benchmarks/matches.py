"""How well `make match` finds a fog that is known: references of two scenes, as another camera setting would have taken them.

`make bench-match` runs it: some minutes a scene for the trial fogs, then seconds a reference. References are 8-bit JPEGs of
our own foggy photographs at other visibilities, exposures and white balances, and of what was rendered into building's own
model, whose fog no composite made. Scenes are copied first: theirs are not written to.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.imaging.colour import linear_to_srgb
from pipeline.imaging.maps import read_map
from pipeline.paths import PROJECT, Build
from pipeline.scene.artefacts import read_json

WARM = (1.2, 1.0, 0.8)


@dataclass(frozen=True)
class Case:
    """A reference: the scene's fog at this visibility [m], or the rendered truth of a named fog; EV and white balance."""

    visibility: float
    stops: float = 0.0
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    truth: str | None = None


CASES = {
    "building": [Case(80), Case(80, 1, WARM), Case(80, -1), Case(300, 0.5, WARM), Case(1e5), Case(5),
                 Case(80, truth="default"), Case(300, truth="moderate"), Case(40, truth="thick")],
    "bathroom": [Case(12), Case(12, 1, WARM), Case(12, -1), Case(5, 0.5, WARM), Case(1e4), Case(0.5)]}


def reference(case: Case, scene: str, scenes: Path, build: Path, path: Path) -> None:
    """Writes the photograph in fog."""
    if case.truth:
        picture = read_map(scenes / scene / "truth" / f"{case.truth}.exr")
    else:
        make(scene, scenes, build, f"fog.visibility={case.visibility!r}")
        picture = read_map(Build(scene, None, scenes, build).foggy(".exr"))
    picture = np.clip(picture * 2.0**case.stops * case.balance, 0, 1)
    cv2.imwrite(str(path), np.round(255 * linear_to_srgb(picture)).astype(np.uint8)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])


def make(scene: str, scenes: Path, build: Path, *stated: str) -> str:
    command = ["make", "-s", f"scene={scene}", f"SCENES={scenes}", f"BUILD={build}", *stated]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"error: {' '.join(command)}: {(done.stderr or done.stdout).strip()[-400:]}")
    return done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(CASES), choices=list(CASES))
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="match-") as folder:
        scenes, build = Path(folder) / "scenes", Path(folder) / "build"
        for scene in asked.scenes:
            shutil.copytree(PROJECT / "scenes" / scene, scenes / scene)
            for index, case in enumerate(CASES[scene]):
                name = f"reference_{index}.jpg"
                reference(case, scene, scenes, build, scenes / scene / name)
                start = time.monotonic()
                make(scene, scenes, build, "match", f"reference={name}", f"to=matched_{index}")
                found = read_json(Build(scene, None, scenes, build).match / "match.json")
                print(line(scene, case, found, time.monotonic() - start), flush=True)


def line(scene: str, case: Case, found: dict, seconds: float) -> str:
    metres, stops, balance = found["visibility_m"], found["exposure_ev"], found["white_balance"]
    value, (low, high) = metres["value"], metres["interval_95"]
    off = "not determined" if value is None else f"{value:8.2f} m, kappa {100 * (case.visibility / value - 1):+6.2f} %"
    ends = " to ".join("open" if end is None else f"{end:.4g}" for end in (low, high))
    wanted = np.array(case.balance) / np.exp(np.log(case.balance).mean())
    light = "exposure not determined" if stops["value"] is None else (
        f"EV {stops['value']:+.2f} ({case.stops + np.log2(case.balance).mean():+.2f}), balance off by"
        f" {100 * np.abs(np.array(balance['value']) / wanted - 1).max():.1f} %")
    kind = f"rendered {case.truth}" if case.truth else "composite"
    return (f"{scene} {kind} {case.visibility:g} m {case.stops:+g} EV{' warm' if case.balance == WARM else ''}: {off} ({ends});"
            f" {light}; unexplained {100 * found['unexplained_share']:.1f} %; {seconds:.0f} s")


if __name__ == "__main__":
    main()
