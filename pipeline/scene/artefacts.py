"""JSON artefacts between stages, and the placed scene read back from them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.imaging import photograph as photographs
from pipeline.imaging.atomic import replacing
from pipeline.imaging.glare import Glare
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build, inside
from pipeline.plugins.base import Plugin
from pipeline.plugins.registry import registry
from pipeline.scene.placed import PlacedScene

#: Of a density grid or a painted label image.
MAX_FILE_BYTES = 512 * 2**20
#: Share of a pixel that a lamp's glare covers.
THIN = 1e-4
#: Counts up when a file between stages gets another meaning; a build of another number is made anew.
FORMAT = 3
#: Stages that work at the photograph's own size; all others work at its working size.
FULL_SIZE = {"photograph", "camera", "composite", "report", "export"}
#: Stages of a fog up to its foggy photograph.
FOG_STAGES = ("plan", "emit", "render", "decompose", "composite")
SURFACES = {"fog:content": "R: face index; G: visible light's index; B: region's index; -1: none"}
EDGES = {"fog:content": "R: share of the front layer; G: its depth; B: depth behind it [m]"}
EDGE_COLOURS = {"front": {"fog:content": "radiance of the front layer"},
                "behind": {"fog:content": "radiance behind the front layer"}}
REMAKE = "remove the scene's build folder and run make again"


class Artefact(dict):
    """A JSON object of the build folder: a key that another version did not write is said in one line."""

    def __init__(self, stated: dict, path: Path):
        super().__init__(stated)
        self.path = path

    def __missing__(self, key):
        raise InputError(f"holds no '{key}': another version of the pipeline wrote it", place=str(self.path),
                         remedy=REMAKE)


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
        return json.loads(path.read_text(encoding="utf-8"), object_hook=lambda stated: Artefact(stated, path))
    except FileNotFoundError:
        raise InputError("no such file", place=str(path),
                         remedy="run the stages before this one, or all of them: make scene=NAME") from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({error})", place=str(path),
                         remedy=REMAKE) from None


def scene_place(build: Build, *keys: str) -> str:
    """FILE:LINE of a key of the scene file, for messages of later stages."""
    line = read_json(build.lines).get(".".join(keys)) if build.lines.exists() else None
    return f"{build.scene_file}:{line}" if line else f"{build.scene_file} ({'.'.join(keys)})"


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
    return {"width_pixel": camera.width, "height_pixel": camera.height,
            "focal_length_pixel": camera.focal_length,
            "principal_point_pixel": camera.principal_point, "position_m": camera.position,
            "world_from_camera": camera.world_from_camera}


def read_camera(build: Build) -> Camera:
    data = dict(read_json(build.camera))
    try:
        return Camera(data["width_pixel"], data["height_pixel"], data["focal_length_pixel"],
                      np.array(data["principal_point_pixel"]), np.array(data["world_from_camera"]),
                      np.array(data["position_m"]))
    except (KeyError, TypeError) as error:
        raise InputError(f"holds no camera ({error})", place=str(build.camera), remedy=REMAKE) from None


def image_camera(build: Build) -> Camera:
    """The camera of the build's images."""
    camera = read_camera(build)
    return camera.resized(*image_size(build)) if build.reduced else camera


def working(build: Build) -> Build:
    """The build whose images have the working size; the same for a photograph that is no larger than that."""
    return replace(build, reduced="working_width_pixel" in read_json(build.photograph_facts))


def for_stage(build: Build, stage: str) -> Build:
    """The build as a stage is given it."""
    return build.full if stage in FULL_SIZE else working(build)


def image_size(build: Build) -> tuple[int, int]:
    """Width and height [pixel] of the build's images."""
    facts, which = read_json(build.photograph_facts), "working_" if build.reduced else ""
    return facts[f"{which}width_pixel"], facts[f"{which}height_pixel"]


def annotation_scale(build: Build) -> np.ndarray:
    """Factor (2,) from the photograph's pixels, in which all is annotated, to those of the build's images."""
    return np.divide(image_size(build), image_size(build.full))


def plugin_from_json(kind: str, data: dict[str, Any]) -> Plugin:
    """The plugin that was written by `model_dump`; InputError where another version wrote it."""
    try:
        return registry(kind)[data["type"]].model_validate(data)
    except (KeyError, TypeError, ValidationError):
        stated = data.get("type") if isinstance(data, dict) else data
        raise InputError(f"{kind} of type '{stated}' are not as this version of the pipeline writes them",
                         place="build folder", remedy=REMAKE) from None


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
    exporter = plugin_from_json("exporters", read_json(build.input("exporter")))
    return PlacedScene(image_camera(build), shapes, lights, exporter, data.get("outdoors", False),
                       data.get("sky_depth_m", 1.0))


def read_strengths(build: Build) -> dict[str, np.ndarray]:
    """Strength (3,) of every light, in its own unit, as the fog sees it: estimated or given, times gain."""
    gains = read_json(build.input("gains"))
    return {name: np.multiply(light["strength"], gains[name])
            for name, light in read_json(build.illumination)["lights"].items()}


def read_fog(build: Build):
    """The fog, with the contents of the files in the scene's folder that it is made from."""
    return plugin_from_json("media", read_json(build.input("fog"))).loaded(
        lambda name: read_file(build, name))


def read_file(build: Build, name: str) -> bytes:
    """Contents of a file of the scene's folder."""
    path = inside(build, name)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"has {path.stat().st_size} bytes", place=str(path),
                             remedy=f"keep it below {MAX_FILE_BYTES} bytes")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", place=str(path),
                         remedy="correct the file's name in the scene file") from None


@dataclass(frozen=True)
class Edges:
    """Pixels that show two things at once: a share `alpha` (H, W) of what is in front, the rest of what is behind.

    front_depth, behind_depth (H, W) [m]; front, behind (H, W, 3) radiance, which mix to the photograph.
    """

    alpha: np.ndarray
    front_depth: np.ndarray
    behind_depth: np.ndarray
    front: np.ndarray
    behind: np.ndarray

    @property
    def mixed(self) -> np.ndarray:
        return (self.alpha < 1) & (self.front_depth != self.behind_depth)

    def with_glare(self, glare: Glare, photograph: np.ndarray) -> Edges:
        """The same with lamps' light as a layer in front that covers next to nothing, and so leaves V as it is."""
        on = glare.light >= 0
        alpha, front_depth, behind_depth = self.alpha.copy(), self.front_depth.copy(), self.behind_depth.copy()
        front, behind = self.front.copy(), self.behind.copy()
        # of a pixel that shows two things already the larger one is what is behind the lamp
        behind_depth[on] = np.where(alpha[on] > 0.5, front_depth[on], behind_depth[on])
        alpha[on], front_depth[on] = THIN, glare.distance[on]
        front[on] = glare.radiance[on] / THIN
        behind[on] = np.maximum(photograph[on] - glare.radiance[on], 0) / (1 - THIN)
        return Edges(alpha, front_depth, behind_depth, front, behind)


def write_edges(build: Build, edges: Edges) -> None:
    write_map(build.edges, np.stack([edges.alpha, edges.front_depth, edges.behind_depth], -1), EDGES)
    write_map(build.edge_colours("front"), edges.front, EDGE_COLOURS["front"])
    write_map(build.edge_colours("behind"), edges.behind, EDGE_COLOURS["behind"])


def read_edges(build: Build) -> Edges | None:
    """None where every pixel shows one thing."""
    if not build.edges.exists():
        return None
    alpha, front, behind = np.moveaxis(read_map(build.edges).astype(float), -1, 0)
    return Edges(alpha, front, behind, *(read_map(build.edge_colours(side)).astype(float)
                                         for side in ("front", "behind")))


def read_photograph(build: Build) -> photographs.Photograph:
    settings = read_json(build.input("photograph"))
    photograph = photographs.read(inside(build, settings["file"]), settings["colour_space"],
                                  int(settings["max_megapixels"] * 1e6))
    return photograph if settings["size"] is None else photographs.resampled(photograph, settings["size"])


def fog_metadata(build: Build, medium) -> dict:
    """What a map's EXR says of the fog it was made with."""
    absorption, scattering = medium.coefficients()
    phase = medium.phase().model_dump(mode="json")
    return {"fog:scene": build.scene, "fog:name": build.fog or "default", "fog:medium": medium.type,
            "fog:absorption_coefficient_per_m": [float(x) for x in absorption],
            "fog:scattering_coefficient_per_m": [float(x) for x in scattering],
            "fog:phase_function": str(phase.pop("type")),
            **{f"fog:{k}": v for k, v in phase.items() if isinstance(v, (int, float))}}
