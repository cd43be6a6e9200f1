"""How long the preview of a photograph that is being annotated takes, at a megapixel, and how far sliders are off.

`make bench-preview` runs it on four scenes, their photographs resampled to one megapixel and their annotations with them:
two rooms and two open-air ones. It prints median and worst of several repeats, in seconds of the wall clock and (in
brackets) of processors, POV-Ray's among them, and the RMS difference of pictures, in codes of 255: of sliders led over to
another fog against the same draft made for that fog.
"""

from __future__ import annotations

import argparse
import copy
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ruamel.yaml import YAML

from pipeline.annotate.preview.preview import Preview
from pipeline.annotate.preview.sliders import altered
from pipeline.plugins.registry import registry
from tests.enlarged_scene import SCENES, enlarged_scene

NAMES = ("bathroom", "sunroom", "building", "street")
#: What a person may change between two previews: keys of a pixel, moved by one [pixel] a repeat.
MOVED: dict[str, list[tuple]] = {
    "bathroom": [("shapes", "platform", "corners", "front_left_top"), ("lights", "mirror_lamp", "outline", "pixels", 0),
                 ("lights", "sun", "openings", "window", "patches", 0, "pixels", 1), ("camera", "lines", "x", 0, 0)],
    "sunroom": [("lights", "garden", "outline", "pixels", 1), ("lights", "sun", "openings", "window", "window", "pixels", 0),
                ("shapes", "room", "edges", "floor_left", 1), ("camera", "lines", "z", 1, 1)],
    "building": [("camera", "horizon", 0), ("depth", "regions", "left_house", "foot", 1),
                 ("sun_direction", "shadows", 0, "shadow"), ("illumination", "sunlit", 0, "pixels", 0)],
    "street": [("camera", "horizon", 0), ("depth", "regions", "tower", "foot", 1), ("depth", "regions", "bin", "pixels", 0),
               ("illumination", "shadowed", 0, "pixels", 0)]}
#: Values of sliders; those of visibility are times the scene's.
VISIBILITIES, OTHERS = (0.25, 0.5, 0.8, 1.25, 2.0, 4.0), ({"g": -0.2}, {"g": 0.4}, {"g": 0.85}, {"albedo": [0.9, 0.8, 0.7]},
                                                           {"height": 2.0})


def moved(data: dict[str, Any], keys: tuple, step: float) -> dict[str, Any]:
    changed = copy.deepcopy(data)
    node = changed
    for key in keys[:-1]:
        node = node[key]
    node[keys[-1]] = [node[keys[-1]][0] + step, node[keys[-1]][1] + step / 2]
    return changed


def timed(call: Callable[[], Any]) -> tuple[Any, float, float]:
    """What it gives, seconds of the wall clock and of processors."""
    begin, used = time.perf_counter(), os.times()[:4]
    found = call()
    return found, time.perf_counter() - begin, sum(os.times()[:4]) - sum(used)


def told(times: list[tuple[float, float]]) -> str:
    wall, used = np.array(times).T
    return f"{np.median(wall):.3f} / {wall.max():.3f} ({np.median(used):.2f})"


def measured(name: str, folder: Path, repeats: int, pictures: Path | None) -> dict[str, str]:
    scale = _longer_side(name)
    enlarged_scene(name, scale, folder / "scenes" / name)
    data = YAML(typ="safe").load(folder / "scenes" / name / "scene.yaml")
    preview = Preview(folder / "scenes", name, folder / f"preview_{name}")
    row = {"scene": name}
    (_, problems), wall, used = timed(lambda: preview.geometry(data))
    row["first geometry"] = f"{wall:.2f} ({used:.2f})"
    _, wall, used = timed(lambda: preview.estimate(data))
    row["first estimate"] = f"{wall:.2f} ({used:.2f})"
    changes = [moved(data, MOVED[name][k % len(MOVED[name])], 1.0 + k // len(MOVED[name])) for k in range(repeats)]
    row["geometry"] = told([timed(lambda: preview.geometry(change))[1:] for change in changes])
    row["estimate"] = told([timed(lambda: preview.estimate(change))[1:] for change in changes])
    preview.estimate(data)
    _finished(preview)
    fog = data["fog"]
    values = [{"visibility": fog["visibility"] * factor} for factor in VISIBILITIES] + list(OTHERS)
    row["slider"] = told([timed(lambda: preview.foggy(value))[1:] for value in values for _ in range(3)])
    gains = [{light: 0.5} for light in data["lights"]]
    row["gain"] = told([timed(lambda: preview.foggy({}, gain))[1:] for gain in gains for _ in range(2)])
    led = [preview.foggy(value) for value in values]
    size = led[0].shape[1::-1]
    medium = registry("media")[fog["type"]].model_validate(fog)
    off = []
    for index, (value, picture) in enumerate(zip(values, led)):
        preview.estimate({**data, "fog": altered(medium, value).model_dump(mode="json")})
        exact = preview.foggy()
        off.append(float(np.sqrt(((picture.astype(float) - exact) ** 2).mean())))
        if pictures is not None:
            cv2.imwrite(str(pictures / f"{name}_{index}.png"), np.hstack([picture, exact])[..., ::-1])
    row["visibility off"] = ", ".join(f"{one:.1f}" for one in off[:len(VISIBILITIES)])
    row["g, albedo, height off"] = ", ".join(f"{one:.1f}" for one in off[len(VISIBILITIES):])
    row["size"] = "{}x{}".format(*size)
    preview.close()
    return row


def _longer_side(name: str) -> int:
    file = SCENES / name / YAML(typ="safe").load(SCENES / name / "scene.yaml")["photograph"]["file"]
    height, width = cv2.imread(str(file), cv2.IMREAD_UNCHANGED).shape[:2] if file.suffix != ".exr" else _exr_size(file)
    return round((1e6 / (height * width)) ** 0.5 * max(height, width))


def _exr_size(file: Path) -> tuple[int, int]:
    from pipeline.imaging.maps import read_map

    return read_map(file).shape[:2]


def _finished(preview: Preview) -> None:
    """Waits until sliders have all that they are led over by."""
    end = time.monotonic() + 60
    while preview._made is not None and not preview._made.sliders.complete and time.monotonic() < end:
        time.sleep(0.05)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=8)
    parser.add_argument("--scenes", default=" ".join(NAMES))
    parser.add_argument("--pictures", type=Path, help="folder for pictures: sliders' beside those made for the fog")
    options = parser.parse_args()
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    print(f"median / worst of {options.repeats} [s], of processors in brackets; load {os.getloadavg()[0]:.1f}"
          f" on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        for name in options.scenes.split():
            if not (SCENES / name / YAML(typ="safe").load(SCENES / name / "scene.yaml")["photograph"]["file"]).exists():
                print(f"{name}: no photograph; run make photos")
                continue
            for key, value in measured(name, Path(folder), options.repeats, options.pictures).items():
                print(f"  {key:24} {value}", flush=True)


if __name__ == "__main__":
    main()
