"""JSON artefacts between stages, and the placed scene read back from them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.imaging import photograph as photographs
from pipeline.imaging.atomic import replacing
from pipeline.paths import Build, inside
from pipeline.plugins.base import Plugin, registry
from pipeline.rendering.emit import PlacedScene


def write_json(path: Path, value: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as name:
        name.write_text(_text(value), encoding="utf-8")


def write_json_if_changed(path: Path, value: Any) -> bool:
    """Keeps the file and its time stamp where nothing changed, so that Make redoes nothing."""
    if path.exists() and path.read_text(encoding="utf-8") == _text(value):
        return False
    write_json(path, value)
    return True


def read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({error})", place=str(path),
                         remedy="remove the build folder of the scene and run make again") from None


def _text(value: Any) -> str:
    return json.dumps(value, indent=1, default=_plain) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    raise TypeError(f"{type(value).__name__} has no place in JSON")


def camera_to_json(camera: Camera) -> dict[str, Any]:
    return {"width_pixel": camera.width, "height_pixel": camera.height, "focal_length_pixel": camera.focal_length,
            "principal_point_pixel": camera.principal_point, "position_m": camera.position,
            "world_from_camera": camera.world_from_camera}


def read_camera(build: Build) -> Camera:
    data = read_json(build.camera)
    return Camera(data["width_pixel"], data["height_pixel"], data["focal_length_pixel"],
                  np.array(data["principal_point_pixel"]), np.array(data["world_from_camera"]),
                  np.array(data["position_m"]))


def plugin_from_json(kind: str, data: dict[str, Any]) -> Plugin:
    """The plugin that was written by `model_dump`."""
    return registry(kind)[data["type"]].model_validate(data)


def read_placed(build: Build) -> PlacedScene:
    """Camera, shapes and lights in world metres, the sun with its direction."""
    data = read_json(build.geometry)
    directions = read_json(build.sun_direction)["suns"] if build.sun_direction.exists() else {}
    lights = {}
    for name, light in data["lights"].items():
        if name in directions:
            light = {**light, "direction": directions[name]["sun_direction"]}
        lights[name] = plugin_from_json("lights", light)
    shapes = {name: plugin_from_json("shapes", shape) for name, shape in data["shapes"].items()}
    return PlacedScene(read_camera(build), shapes, lights)


def read_fog(build: Build):
    return plugin_from_json("media", read_json(build.input("fog")))


def read_photograph(build: Build) -> photographs.Photograph:
    settings = read_json(build.input("photograph"))
    return photographs.read(inside(build, settings["file"]), settings["colour_space"],
                            int(settings["max_megapixels"] * 1e6))


def fog_metadata(build: Build, medium) -> dict:
    """What a map's EXR says of the fog it was made with."""
    absorption, scattering = medium.coefficients()
    phase = medium.phase().model_dump(mode="json")
    return {"fog:scene": build.scene, "fog:name": build.fog or "default", "fog:medium": medium.type,
            "fog:absorption_coefficient_per_m": [float(x) for x in absorption],
            "fog:scattering_coefficient_per_m": [float(x) for x in scattering],
            "fog:phase_function": str(phase.pop("type")),
            **{f"fog:{k}": v for k, v in phase.items() if isinstance(v, (int, float))}}
