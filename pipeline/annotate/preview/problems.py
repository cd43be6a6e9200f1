"""What is wrong with a scene, or still to be drawn, each thing with its place: all parts are checked one by one, so that one
that is broken hides no other."""

from __future__ import annotations

import copy
import functools
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from pydantic import TypeAdapter, ValidationError

from pipeline.errors import InputError
from pipeline.plugins.base import Model
from pipeline.scene.load import complaints
from pipeline.scene.model import scene_model

Place = tuple[str | int, ...]
Severity = Literal["error", "warning"]

#: What a scene lacks at first, and what to draw then.
NEXT = {
    "camera": "draw 'lines' along edges that run left-right, upwards or front-back, or the 'horizon'",
    "lights": "outline a lamp, a window or a patch of sunlight, or add a sky",
    "fog": "choose a fog and its visibility [m]",
    "shapes": "outline the floor and the walls of a room, or, in the open air, regions",
    "photograph": "give the photograph's 'file'"}


@dataclass(frozen=True)
class Problem:
    """place: keys and indices in the scene, () for all of it; message: what is wrong; remedy: what to do about it.

    severity: "error" of what no fog can be made with, "warning" of what is still to be drawn, or worth a look.
    """

    place: Place
    message: str
    remedy: str
    severity: Severity = "error"

    @classmethod
    def of(cls, error: InputError, place: Place, severity: Severity = "error") -> Problem:
        return cls(place, error.problem, error.remedy, severity)


@dataclass
class Parts:
    """The parts of a scene that are as they should be, by themselves. None or missing: not there, or broken.

    scale_known: whether anything tells the scale; else the camera is 1 m above the floor.
    """

    photograph: Model | None = None
    camera: Model | None = None
    scale_known: bool = True
    depth: Model | None = None
    shapes: dict[str, Model] = field(default_factory=dict)
    lights: dict[str, Model] = field(default_factory=dict)
    illumination: Model | None = None
    sun_direction: Model | None = None
    fog: Model | None = None
    exporter: Model | None = None
    broken: set[Place] = field(default_factory=set)


@functools.cache
def _model() -> type[Model]:
    return scene_model()


@functools.cache
def _adapter(part: str, one: bool = False) -> TypeAdapter:
    """Of a part of the scene, or of one thing by name in it."""
    annotation = _model().model_fields[part].annotation
    return TypeAdapter(get_args(annotation)[1] if one else annotation)


def checked(data: Any) -> tuple[Parts, list[Problem]]:
    """The parts of a scene's data that can be used, and what is wrong with all others or missing."""
    data = data if isinstance(data, dict) else {}
    parts, problems = Parts(), _problems(data)
    for name in ("photograph", "camera", "depth", "illumination", "sun_direction", "fog", "exporter"):
        default = _model().model_fields[name].get_default(call_default_factory=True)
        value = data.get(name, default)
        if isinstance(value, (dict, Model)):
            setattr(parts, name, _usable(_adapter(name), value))
    camera = data.get("camera")
    if parts.camera is None and isinstance(camera, dict):
        parts.camera = _usable(_adapter("camera"), {**camera, "height": 1.0, "known_length": None})
        parts.scale_known = parts.camera is None
    for name in ("shapes", "lights"):
        group = data.get(name)
        for key, value in group.items() if isinstance(group, dict) else ():
            one = _usable(_adapter(name, True), value)
            if one is None or not isinstance(key, str):
                parts.broken.add((name, key))
            else:
                getattr(parts, name)[key] = one
    return parts, problems


def _usable(adapter: TypeAdapter, value: Any) -> Any:
    try:
        return adapter.validate_python(copy.deepcopy(value))
    except (ValidationError, RecursionError):
        return None


def _problems(data: dict[str, Any]) -> list[Problem]:
    """What the scene file's model says, all of it."""
    try:
        _model().model_validate(copy.deepcopy(data))
        return []
    except RecursionError:
        return [Problem((), "values are nested too deeply", "write them less deeply")]
    except ValidationError as error:
        found = []
        for place, message, remedy, missing in complaints(error, data, _model()):
            if missing and len(place) == 1:
                message, remedy = f"'{place[0]}' is missing", NEXT.get(place[0], remedy)
            found.append(Problem(place, message, remedy, "warning" if missing or _is_open(place, message) else "error"))
        if "lights" in data and data["lights"] == {}:
            found = [one for one in found if one.place != ("lights",)]
            found.append(Problem(("lights",), "there is no light yet", NEXT["lights"], "warning"))
        return found


def _is_open(place: Place, message: str) -> bool:
    """Whether a mistake is that something was not drawn yet."""
    return place == ("camera",) and message.endswith("no scale") or message.endswith(
        ("neither 'shapes' nor 'depth' is there", "nothing says how far anything is"))
