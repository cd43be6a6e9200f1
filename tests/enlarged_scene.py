"""A scene of the project with its photograph resampled to another size, and what is annotated in pixels with it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ruamel.yaml import YAML

from pipeline.imaging.maps import read_map, write_map

SCENES = Path(__file__).parents[1] / "scenes"
#: Pixels round a step of depth that count as its crop.
CROP = 24
#: Light that is not seen: relative errors count from here on.
DARK = 0.02
#: Keys of scene files whose numbers are pixels of the photograph.
IN_PIXELS = {"pixels", "pixel", "foot", "tip", "shadow", "horizon", "corners", "edges", "lines", "above", "radius", "holes"}


def enlarged_scene(name: str, longer_side: int, folder: Path, **photograph: Any) -> None:
    """Writes the scene into `folder`; photograph: values of that section, such as working_size."""
    folder.mkdir(parents=True)
    scene = YAML(typ="safe").load(SCENES / name / "scene.yaml")
    source = SCENES / name / scene["photograph"]["file"]
    linear = source.suffix == ".exr"
    picture = read_map(source) if linear else cv2.imread(str(source))
    factor = longer_side / max(picture.shape[:2])
    size = tuple(round(side * factor) for side in picture.shape[1::-1])
    enlarged = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC)
    if linear:
        write_map(folder / "photograph.exr", np.maximum(enlarged, 0), {})
    else:
        cv2.imwrite(str(folder / "photograph.jpg"), enlarged, [cv2.IMWRITE_JPEG_QUALITY, 95])
    if (labels := SCENES / name / "labels.png").exists():
        cv2.imwrite(str(folder / "labels.png"),
                    cv2.resize(cv2.imread(str(labels)), size, interpolation=cv2.INTER_NEAREST))
    scene = _scaled(scene, factor)
    scene["photograph"] = {"file": f"photograph{'.exr' if linear else '.jpg'}", **photograph}
    if "depth" in scene:
        scene["depth"]["refine"] = {"radius": round(6 * factor)}
    (folder / "scene.yaml").write_text(json.dumps(scene, indent=1))  # JSON is YAML


def round_edges(depth: np.ndarray) -> np.ndarray:
    """Pixels (H, W) within CROP of a step of depth (H, W)."""
    around = np.ones((3, 3), np.uint8)
    steps = cv2.dilate(depth, around) > 1.05 * cv2.erode(depth, around)
    return cv2.dilate(steps.astype(np.uint8), np.ones((2 * CROP + 1, 2 * CROP + 1), np.uint8)) > 0


def relative_error(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """(H, W): of each pixel's worst channel, by its brightest, or by DARK of the map's bright parts."""
    scale = np.maximum(theirs.max(-1, keepdims=True), DARK * np.percentile(theirs, 99))
    return (np.abs(ours - theirs) / scale).max(-1)


def _scaled(value: Any, factor: float, in_pixels: bool = False) -> Any:
    if isinstance(value, dict):
        return {key: _scaled(one, factor, in_pixels or key in IN_PIXELS) for key, one in value.items()}
    if isinstance(value, list):
        return [_scaled(one, factor, in_pixels) for one in value]
    return value * factor if in_pixels and isinstance(value, (int, float)) else value


if __name__ == "__main__":
    scene, side, folder, *rest = sys.argv[1:]
    enlarged_scene(scene, int(side), Path(folder), **({"working_size": json.loads(rest[0])} if rest else {}))
