"""Cameras matched in fSpy (fspy.io), from its export "Camera parameters as JSON".

What the file holds: `cameraTransform` takes a camera frame with x right, y up and z backwards to
fSpy's world; `principalPoint` is in an image frame with y up, 0 in the middle and the longer side
from -1 to 1; angles are radians. fSpy's world has no fixed up axis: it is the axis that was assigned
to the vertical lines. As set for Blender, and by default, that is z, and a world point (x, y, z) is
our (x, z, -y); with up = "y" the axes are ours already. Our floor is y = 0, hence fSpy's origin
belongs on the floor.
"""

from __future__ import annotations

import json
from typing import Any, Literal

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, rotation, yaw_pitch_roll

_EXPORT = "export it again in fSpy with File > Export > Camera parameters as JSON"
_OURS_FROM_FSPY = {"y": np.eye(3), "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}


def camera_from_fspy(
    exported: bytes | dict, *, up: Literal["y", "z"] = "z", camera_height: float | None = None
) -> Camera:
    """The camera of fSpy's exported parameters, in this project's axes.

    exported: the contents of the file, or what its JSON says. up: fSpy's axis of the vertical lines.
    camera_height [m]: rescales the world so that the camera is that high; None takes fSpy's unit as a
    metre (its reference distance must be set). The world is turned by quarter turns about y until the
    camera looks within 45 degrees of -z.
    Raises InputError for contents that are no JSON, missing or contradictory parameters, a camera that
    is not upright, or one that is not above the floor.
    """
    if up not in _OURS_FROM_FSPY:
        raise InputError(f"fSpy up axis '{up}'", remedy="state y or z")
    parameters = _parsed(exported) if isinstance(exported, bytes) else exported
    if not isinstance(parameters, dict):
        raise InputError("holds no fSpy camera", remedy=_EXPORT)
    width, height = (_number(parameters, key) for key in ("imageWidth", "imageHeight"))
    if not (width >= 1 and height >= 1 and width % 1 == 0 and height % 1 == 0):
        raise InputError(f"image size is {width:g} x {height:g}", remedy=_EXPORT)
    angle = _number(parameters, "horizontalFieldOfView")
    if not 0 < angle < np.pi:
        raise InputError(f"horizontalFieldOfView is {angle:g} rad, not between 0 and pi", remedy=_EXPORT)
    focal_length = width / 2 / np.tan(angle / 2)
    half = max(width, height) / 2
    if "relativeFocalLength" in parameters:
        relative = _number(parameters, "relativeFocalLength")
        # the two are one number in fSpy; another program's rounding may leave a permille
        if abs(relative * half - focal_length) > 0.01 * focal_length:
            raise InputError(
                f"relativeFocalLength {relative:g} contradicts horizontalFieldOfView {angle:g} rad, which"
                f" makes it {focal_length / half:g}",
                remedy=_EXPORT,
            )
    centre = parameters.get("principalPoint")
    if not isinstance(centre, dict):
        raise InputError("principalPoint is missing", remedy=_EXPORT)
    principal_point = np.array(
        [
            width / 2 + half * _number(centre, "x", "principalPoint."),
            height / 2 - half * _number(centre, "y", "principalPoint."),
        ]
    )

    transform = _camera_transform(parameters)
    turn = _OURS_FROM_FSPY[up] @ transform[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    position = _OURS_FROM_FSPY[up] @ transform[:3, 3]
    yaw, _, roll = yaw_pitch_roll(turn)
    if abs(roll) > 60:
        raise InputError(
            f"with {up} up the camera has a roll of {roll:.0f} degrees",
            remedy="state"
            f" up: {'y' if up == 'z' else 'z'}, or assign fSpy's {up} axis to the vertical lines, upwards",
        )
    if not position[1] > 0:
        raise InputError(
            f"the camera is at height {position[1]:.3g} with {up} up, not above the floor",
            remedy="put fSpy's origin on the floor, or state the other up axis",
        )
    if camera_height is not None:
        if not camera_height > 0:
            raise InputError(f"camera height is {camera_height:g} m", remedy="state a height above 0")
        position = position * (camera_height / position[1])
    quarter = rotation(-90.0 * round(yaw / 90)) @ rotation(0.0).T
    return Camera(
        int(width), int(height), float(focal_length), principal_point, quarter @ turn, quarter @ position
    )


def _parsed(exported: bytes) -> Any:
    try:
        return json.loads(exported.decode("utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError):
        raise InputError("is not JSON (an .fspy project is not either)", remedy=_EXPORT) from None


def _number(parameters: dict, key: str, within: str = "") -> float:
    value = parameters.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        problem = "is missing" if key not in parameters else f"is {value!r}, not a number"
        raise InputError(f"{within}{key} {problem}", remedy=_EXPORT)
    return float(value)


def _camera_transform(parameters: dict) -> np.ndarray:
    """(4, 4) world from camera; its inverse, viewTransform, is used if it alone is there."""
    for key in ("cameraTransform", "viewTransform"):
        if key in parameters:
            break
    else:
        raise InputError("cameraTransform is missing", remedy=_EXPORT)
    try:
        transform = np.array(parameters[key]["rows"], float)
    except (TypeError, KeyError, ValueError):
        transform = np.zeros(0)
    if transform.shape != (4, 4) or not np.isfinite(transform).all():
        raise InputError(f"{key}.rows is not a 4 x 4 matrix of numbers", remedy=_EXPORT)
    turn = transform[:3, :3]
    # JSON carries all digits of fSpy's own doubles, and other writers a few of them
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turn) < 0:
        raise InputError(f"{key} is not a rotation and a translation", remedy=_EXPORT)
    u, _, v = np.linalg.svd(turn)
    transform[:3, :3] = u @ v
    return transform if key == "cameraTransform" else np.linalg.inv(transform)
