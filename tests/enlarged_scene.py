"""A scene of the project with its photograph resampled to another size, and what is annotated in pixels with it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import cv2
from ruamel.yaml import YAML

SCENES = Path(__file__).parents[1] / "scenes"
#: Keys of scene files whose numbers are pixels of the photograph.
IN_PIXELS = {"pixels", "pixel", "foot", "tip", "shadow", "horizon", "corners", "edges", "lines", "above", "radius", "holes"}


def enlarged_scene(name: str, longer_side: int, folder: Path, **photograph: Any) -> None:
    """Writes the scene into `folder`; photograph: values of that section, such as working_size."""
    folder.mkdir(parents=True)
    scene = YAML(typ="safe").load(SCENES / name / "scene.yaml")
    picture = cv2.imread(str(SCENES / name / "photograph.jpg"))
    factor = longer_side / max(picture.shape[:2])
    size = tuple(round(side * factor) for side in picture.shape[1::-1])
    cv2.imwrite(str(folder / "photograph.jpg"), cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC),
                [cv2.IMWRITE_JPEG_QUALITY, 95])
    if (labels := SCENES / name / "labels.png").exists():
        cv2.imwrite(str(folder / "labels.png"),
                    cv2.resize(cv2.imread(str(labels)), size, interpolation=cv2.INTER_NEAREST))
    scene = _scaled(scene, factor)
    scene["photograph"] = {"file": "photograph.jpg", **photograph}
    if "depth" in scene:
        scene["depth"]["refine"] = {"radius": round(6 * factor)}
    (folder / "scene.yaml").write_text(json.dumps(scene, indent=1))  # JSON is YAML


def _scaled(value: Any, factor: float, in_pixels: bool = False) -> Any:
    if isinstance(value, dict):
        return {key: _scaled(one, factor, in_pixels or key in IN_PIXELS) for key, one in value.items()}
    if isinstance(value, list):
        return [_scaled(one, factor, in_pixels) for one in value]
    return value * factor if in_pixels and isinstance(value, (int, float)) else value


if __name__ == "__main__":
    scene, side, folder, *rest = sys.argv[1:]
    enlarged_scene(scene, int(side), Path(folder), **({"working_size": json.loads(rest[0])} if rest else {}))
