"""Focal length, principal point and rotation from vanishing points, in closed form."""

from __future__ import annotations

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.planes import AXES

AXIS_WORDS = {"x": "left-right", "y": "vertical", "z": "front-back"}
_PARALLEL = 0.1  # pixel: lines that a common direction fits this well have their vanishing point at infinity


def axis_label(axis: str) -> str:
    return f"'{axis}' ({AXIS_WORDS[axis]})"


def are_parallel(segments: np.ndarray) -> bool:
    """Whether a common direction explains all segments to `_PARALLEL`."""
    along = segments[:, 1] - segments[:, 0]
    _, _, directions = np.linalg.svd(along)
    return bool(np.abs(along @ directions[1]).max() / 2 < _PARALLEL)


def draw_instead(parallel: list[str], drawn: dict) -> str:
    missing = [axis for axis in AXES if axis not in drawn]
    if parallel:
        return (
            f"{' and '.join(map(axis_label, parallel))} run parallel in the photograph: draw lines along"
            f" {' or '.join(map(axis_label, missing)) or 'edges'} that visibly converge, or give a focal"
            " length or field of view"
        )
    return "draw longer segments that converge more visibly, or give a focal length or field of view"


def focal_length_of(points: dict, parallel: list[str], frame: np.ndarray, centre: np.ndarray) -> float:
    """Focal length [pixel] from the right angles between axes: (v_i - c).(v_j - c) + f^2 w_i w_j = 0."""
    if len(points) < 2:
        axis = next(iter(points))
        raise InputError(
            f"lines along {axis_label(axis)} alone leave the focal length open",
            remedy="draw lines along a second axis too, or give a focal length or field of view",
        )
    usable = [axis for axis in points if axis not in parallel]
    if len(usable) < 2:
        raise InputError(
            f"lines along {' and '.join(map(axis_label, parallel))} are parallel in the photograph, so the"
            " focal length stays open",
            remedy=draw_instead(parallel, points),
        )
    normalised = {axis: np.linalg.solve(frame, points[axis]) for axis in usable}
    middle = np.linalg.solve(frame, np.r_[centre, 1])[:2]
    products, weights, pairs = [], [], []
    for i, first in enumerate(usable):
        for second in usable[i + 1 :]:
            v, w = (p / np.linalg.norm(p) for p in (normalised[first], normalised[second]))
            products.append((v[:2] - middle * v[2]) @ (w[:2] - middle * w[2]))
            weights.append(v[2] * w[2])
            pairs.append((first, second))
    square = -np.dot(weights, products) / np.dot(weights, weights)
    if not square > 0:
        first, second = pairs[int(np.argmax(np.multiply(weights, products)))]
        raise InputError(
            f"lines along {axis_label(first)} and {axis_label(second)} cannot be at right angles from any"
            " camera: their vanishing points lie on the same side of the principal point",
            remedy="check that each line is drawn along the axis it is named for, draw longer"
            " segments, or give a focal length or field of view",
        )
    return float(np.sqrt(square)) * frame[0, 0]


def principal_point_of(points: dict, parallel: list[str], frame: np.ndarray) -> np.ndarray:
    """Principal point [pixel]: where the altitudes of the triangle of vanishing points meet."""
    if len(points) < 3 or parallel:
        missing = [axis for axis in AXES if axis not in points] or parallel
        raise InputError(
            "estimating the principal point needs lines that converge along all three axes;"
            f" {' and '.join(map(axis_label, missing))} {'are' if len(missing) > 1 else 'is'}"
            f" {'parallel in the photograph' if missing == parallel else 'missing'}",
            remedy="draw them, or leave the principal point out",
        )
    x, y, z = (point[:2] / point[2] for point in (np.linalg.solve(frame, points[axis]) for axis in AXES))
    altitudes = np.array([y - z, z - x, x - y])
    altitudes /= np.linalg.norm(altitudes, axis=1, keepdims=True)
    found = np.linalg.lstsq(altitudes, np.einsum("ij,ij->i", altitudes, [x, y, z]), rcond=None)[0]
    return (frame @ np.r_[found, 1])[:2]


def rotation_of_one_axis(
    axis: str, point: np.ndarray, focal_length: float, centre: np.ndarray, assumptions: list[str]
) -> np.ndarray:
    """camera_from_world (3, 3) from one vanishing point: no roll, or for vertical lines no yaw."""
    along = np.r_[(point[:2] - centre * point[2]) / focal_length, point[2]]
    along /= np.linalg.norm(along)
    draw = "draw lines along " + " or ".join(axis_label(other) for other in AXES if other != axis)
    if axis == "y":
        assumptions.append("yaw 0: vertical lines do not tell it")
        y = along if along[1] < 0 else -along
        x = np.cross(y, [0, 0, -1.0])  # without yaw it lies across the vertical plane of the view
        if np.linalg.norm(x) < 1e-6:
            raise InputError(
                f"lines along {axis_label(axis)} meet at the principal point: the camera looks straight up or"
                " down, and which way round stays open",
                remedy=draw,
            )
        x /= np.linalg.norm(x)
        return upright(np.stack([x, y, np.cross(x, y)], 1))
    assumptions.append(f"roll 0: one vanishing point, {axis_label(axis)}, does not tell it")
    y = np.cross([1.0, 0, 0], along)  # without roll it lies across the photograph's rows
    if np.linalg.norm(y) < 1e-6:
        raise InputError(
            f"lines along {axis_label(axis)} are level and parallel to the photograph, so the camera's"
            " pitch stays open",
            remedy=draw,
        )
    y /= np.linalg.norm(y)
    x, z = (along, np.cross(along, y)) if axis == "x" else (np.cross(y, along), along)
    return upright(np.stack([x, y, z], 1))


def upright(camera_from_world: np.ndarray) -> np.ndarray:
    """The same axes with y up in the photograph, x to the right, z to the viewer, determinant +1."""
    x, y, z = camera_from_world.T
    y = y if y[1] < 0 else -y
    # right-handed either way: x and z change sign together
    x, z = (x, np.cross(x, y)) if x[0] - np.cross(x, y)[2] > 0 else (-x, np.cross(-x, y))
    return np.stack([x, y, z], 1)
