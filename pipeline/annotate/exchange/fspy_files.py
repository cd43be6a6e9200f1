"""fSpy's cameras: its project files (.fspy), its exported JSON, and that JSON of a camera of ours.

A project is a head of sixteen bytes (four letters, version, length of the state, length of the picture; little-endian),
the state as JSON and the picture. The state holds the solved camera, as the export has it, and the lines that were drawn, in
parts of the picture's width and height from its top-left corner.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.annotate.exchange.drawings import json_of, pairs
from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, centre_of, yaw_pitch_roll
from pipeline.geometry.fspy import camera_from_fspy

HEAD = struct.Struct("<4sIII")
MAGIC, VERSION = b"fspy", 1
#: Metres, by what fSpy calls its units of a reference distance.
METRES = {"Millimeters": 1e-3, "Centimeters": 1e-2, "Meters": 1.0, "Kilometers": 1e3, "Inches": 0.0254, "Feet": 0.3048,
          "Miles": 1609.344}
_SOLVE = "open it in fSpy, see that it shows a camera, and save it again"


@dataclass(frozen=True)
class Matched:
    """A camera that fSpy found; lines: (n, 2, 2) [pixel] by our axes, as they were drawn.

    metres: whether its height is known to be in metres, rather than in whatever unit fSpy was left at.
    """

    camera: Camera
    lines: dict[str, list]
    metres: bool = False


def is_project(content: bytes) -> bool:
    return content[:4] == MAGIC


def is_export(found: dict) -> bool:
    return "cameraTransform" in found or "viewTransform" in found


def read_project(content: bytes) -> Matched:
    """Raises InputError for a damaged project and one without a camera."""
    if len(content) < HEAD.size:
        raise InputError("is cut off", remedy="copy it again")
    _, version, length, picture = HEAD.unpack_from(content)
    if version != VERSION:
        raise InputError(f"is of version {version}", remedy=f"save it by an fSpy that writes version {VERSION}")
    if length + picture + HEAD.size > len(content):
        raise InputError("is cut off", remedy="copy it again")
    state = json_of(content[HEAD.size:HEAD.size + length])
    parameters = state.get("cameraParameters")
    if not isinstance(parameters, dict):
        raise InputError("holds no camera", remedy=_SOLVE)
    camera, base = read_export(parameters).camera, state.get("calibrationSettingsBase")
    unit = _get(base, "referenceDistanceUnit")
    metre = METRES.get(unit) if isinstance(unit, str) and _get(base, "referenceDistanceAxis") else None
    return Matched(replace(camera, position=camera.position * (metre or 1.0)), _lines(state, camera), metre is not None)


def read_export(parameters: dict) -> Matched:
    """The camera by the axis that is up in fSpy: z, as it is by default, or y. Raises InputError as `camera_from_fspy`."""
    try:
        return Matched(camera_from_fspy(parameters), {})
    except InputError as by_z:
        try:
            return Matched(camera_from_fspy(parameters, up="y"), {})
        except InputError:
            raise by_z from None


def _lines(state: dict, camera: Camera) -> dict[str, list]:
    """Lines of the vanishing points by the axis that each runs along in our world; none where two run along one."""
    base, two = state.get("controlPointsStateBase"), state.get("controlPointsState2VP")
    found: dict[str, list] = {}
    for held in (_get(base, "firstVanishingPoint"), _get(two, "secondVanishingPoint")):
        segments = _get(held, "lineSegments")
        lines = [pairs([[_get(p, "x"), _get(p, "y")] for p in one]) if isinstance(one, list) else None
                 for one in (segments if isinstance(segments, list) else [])]
        if len(lines) != 2 or any(line is None or len(line) != 2 for line in lines):
            return {}
        pixels = np.array(lines) * [camera.width, camera.height]
        axis = _axis(camera, pixels)
        if axis is None or axis in found:
            return {}
        found[axis] = pixels.tolist()
    return found if _get(_get(state, "globalSettings"), "calibrationMode") == "TwoVanishingPoints" else {}


def _axis(camera: Camera, segments: np.ndarray) -> str | None:
    """The world axis whose vanishing point all segments (n, 2, 2) run towards, to a degree."""
    for number, axis in enumerate("xyz"):
        point = camera.intrinsic_matrix @ camera.world_from_camera.T[:, number]
        along = segments[:, 1] - segments[:, 0]
        # from the middle towards the vanishing point, which may be at infinity
        towards = point[:2] - segments.mean(1) * point[2]
        lengths = np.linalg.norm(along, axis=1) * np.linalg.norm(towards, axis=1)
        cross = along[:, 0] * towards[:, 1] - along[:, 1] * towards[:, 0]
        if (lengths > 0).all() and (np.abs(cross) < np.sin(np.radians(1.0)) * lengths).all():
            return axis
    return None


def _get(value: Any, key: str) -> Any:
    return value.get(key) if isinstance(value, dict) else None


def description(matched: Matched, scale: float = 1.0) -> dict[str, Any]:
    """The scene file's `camera` of it: by its lines where they were drawn, else by its angles.

    scale: of the photograph against the picture that fSpy had.
    """
    camera = matched.camera
    offset = camera.principal_point - centre_of(camera.width, camera.height)
    found: dict[str, Any] = {"height": float(camera.position[1])}
    if np.abs(offset).max() > 0.5:
        found["principal_point"] = (camera.principal_point * scale).tolist()
    if matched.lines and "principal_point" not in found:
        return found | {"lines": {axis: (np.array(lines) * scale).tolist() for axis, lines in sorted(matched.lines.items())}}
    yaw, pitch, roll = yaw_pitch_roll(camera.world_from_camera)
    angle = 2 * np.degrees(np.arctan(camera.width / 2 / camera.focal_length))
    return found | {"horizontal_field_of_view": float(angle), "yaw": yaw, "pitch": pitch, "roll": roll}


def exported(camera: Camera) -> dict[str, Any]:
    """fSpy's JSON of a camera, z being up in its world; `camera_from_fspy` has the conventions."""
    to_fspy = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    transform = np.eye(4)
    transform[:3, :3] = to_fspy @ camera.world_from_camera @ np.diag([1.0, -1.0, -1.0])
    transform[:3, 3] = to_fspy @ camera.position
    half = max(camera.width, camera.height) / 2
    off = (camera.principal_point - centre_of(camera.width, camera.height)) / half
    return {
        "principalPoint": {"x": float(off[0]), "y": -float(off[1])},
        "viewTransform": {"rows": np.linalg.inv(transform).tolist()},
        "cameraTransform": {"rows": transform.tolist()},
        "horizontalFieldOfView": 2 * float(np.arctan(camera.width / 2 / camera.focal_length)),
        "verticalFieldOfView": 2 * float(np.arctan(camera.height / 2 / camera.focal_length)),
        "relativeFocalLength": float(camera.focal_length / half),
        "imageWidth": camera.width, "imageHeight": camera.height,
    }
