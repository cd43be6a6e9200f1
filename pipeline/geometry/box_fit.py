"""Least squares of a box over its clicks, how far to trust it, and what to click where it stays open."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from pipeline.errors import InputError
from pipeline.geometry.axis_box import (
    FACE_INDEX, FACES, ROOM_NAMES, SIZES, AxisBox, corner_names, edge_names, faces_named, turn_about_y)
from pipeline.geometry.box_clicks import Clicks, FaceModel


@dataclass(frozen=True)
class BoxFit:
    """A fitted box and how far to trust it.

    residuals: distance [pixel] of each annotation from the fit (an edge: RMS of its two points).
    rms: over all clicked points [pixel]. uncertainty: standard deviation [m] of each fitted face's
    coordinate for clicks that are off by 1 pixel in u and v; fixed and assumed faces are absent.
    assumed: faces that stand where a default puts them. warnings: what a person should look at.
    """

    box: AxisBox
    residuals: dict[str, float]
    rms: float
    uncertainty: dict[str, float]
    assumed: tuple[str, ...] = ()
    warnings: list[str] = field(default_factory=list)


def fit_clicks(clicks: Clicks, model: FaceModel, *, yaw: float, fit_yaw: bool, room: bool) -> BoxFit:
    """Nonlinear least squares of the model's unknowns (and of the yaw) in pixels."""
    words = {i: ROOM_NAMES.get(face, face) if room else face for i, face in enumerate(FACES)}
    free = model.matrix.any(axis=1)
    untouched = [i for i in range(6) if free[i] and not _reaches(model, clicks.touched(), i)]
    if untouched:
        raise _open_faces([words[i] for i in untouched], _suggestion(untouched, room, words, clicks))

    yaws = np.arange(-85.0, 86.0, 10.0) if fit_yaw else np.array([yaw])
    solved = [_solve(clicks, model, start, fit_yaw) for start in yaws]
    # the named corners tell the right turn from those by 90 degrees, where the sizes come out negative
    solved.sort(key=lambda s: (bool((np.diff(_pairs(model.values(s[0])), axis=1) <= 0).any()), s[2]))
    unknowns, yaw, _ = solved[0]

    faces = model.values(unknowns)
    residual, by_face, by_yaw = clicks.residuals(faces, yaw)
    jacobian = by_face @ model.matrix
    scale = max(
        np.linalg.norm(turn_about_y(yaw) @ faces[:3] - clicks.camera.position),
        np.linalg.norm(turn_about_y(yaw) @ faces[3:] - clicks.camera.position),
        1e-12,
    )
    # the yaw as an arc length at the box, in the metres of the other unknowns
    covariance = _covariance(np.c_[jacobian, by_yaw * (57.3 / scale)] if fit_yaw else jacobian, scale)
    face_deviation = np.array(
        [np.sqrt(row @ covariance[: len(row), : len(row)] @ row) for row in model.matrix]
    )
    # one pixel moves such a face by more than the box is away: the clicks say nothing about it
    undetermined = [i for i in range(6) if free[i] and not face_deviation[i] < scale]
    if undetermined:
        raise _open_faces(
            [words[i] for i in undetermined],
            _best_addition(clicks, model, unknowns, yaw, fit_yaw, scale, room)
            or _suggestion(undetermined, room, words, clicks),
        )
    _refuse_inverted(clicks, faces, words, room)
    return _report(
        clicks, faces, yaw, residual, {words[i]: float(face_deviation[i]) for i in range(6) if free[i]}, scale
    )


def _reaches(model: FaceModel, touched: set[int], face: int) -> bool:
    """Whether some touched face moves with `face` (itself, or its opposite at a known distance)."""
    return any((model.matrix[face] * model.matrix[other]).any() for other in touched)


def _pairs(faces: np.ndarray) -> np.ndarray:
    return np.stack([faces[:3], faces[3:]], 1)


def _solve(clicks: Clicks, model: FaceModel, yaw: float, fit_yaw: bool) -> tuple[np.ndarray, float, float]:
    """(unknowns, yaw [degree], sum of squares [pixel^2]) from the start at `yaw`."""
    count = model.matrix.shape[1]
    start = clicks.back_projected(model, yaw)
    if not count and not fit_yaw:
        return start, yaw, float((clicks.residuals(model.offset, yaw)[0] ** 2).sum())

    def split(x):
        return model.values(x[:count]), x[count] if fit_yaw else yaw

    def slopes(x):
        _, by_face, by_yaw = clicks.residuals(*split(x))
        return np.c_[by_face @ model.matrix, by_yaw] if fit_yaw else by_face @ model.matrix

    result = scipy.optimize.least_squares(
        lambda x: clicks.residuals(*split(x))[0],
        np.r_[start, yaw] if fit_yaw else start,
        jac=slopes,
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=200,
    )
    return result.x[:count], float(result.x[count]) if fit_yaw else yaw, 2 * float(result.cost)


def _covariance(jacobian: np.ndarray, scale: float) -> np.ndarray:
    """Covariance of the unknowns for unit variance of each residual; huge where J has no rank.

    Singular values below 1e-9 of the largest are rounding; they count as 1e-9 of it, whose covariance
    exceeds `scale` by far for any photograph.
    """
    if not jacobian.shape[1]:
        return np.zeros((0, 0))
    padded = np.pad(jacobian, ((0, max(0, jacobian.shape[1] - len(jacobian))), (0, 0)))
    _, values, directions = np.linalg.svd(padded, full_matrices=False)
    floor = min(1e-9 * values[0], 1e-6 / scale) + 1e-300
    return directions.T @ np.diag(np.maximum(values, floor) ** -2.0) @ directions


def _report(
    clicks: Clicks,
    faces: np.ndarray,
    yaw: float,
    residual: np.ndarray,
    uncertainty: dict[str, float],
    scale: float,
) -> BoxFit:
    count = len(clicks.corner_labels)
    corner_distance = np.hypot(*residual[: 2 * count].reshape(-1, 2).T)
    edge_distance = residual[2 * count :].reshape(-1, 2)
    residuals = dict(zip(clicks.corner_labels, corner_distance.tolist()))
    residuals |= dict(zip(clicks.edge_labels, np.sqrt((edge_distance**2).mean(1)).tolist()))
    squares = np.concatenate([corner_distance**2, edge_distance.ravel() ** 2])
    rms = float(np.sqrt(squares.mean())) if len(squares) else 0.0
    warnings = []
    limit = 0.01 * np.hypot(clicks.camera.width, clicks.camera.height)
    if rms > limit:
        worst = max(residuals, key=residuals.get)
        warnings.append(
            f"the fit misses the clicks by {rms:.1f} px RMS (over 1 % of the diagonal, {limit:.1f} px);"
            f" '{worst}' is off by {residuals[worst]:.1f} px: check it, and the camera"
        )
    for name, deviation in uncertainty.items():
        if deviation > 0.02 * scale:
            warnings.append(
                f"the {name} face is known to +-{deviation:.2g} m for clicks good to 1 px:"
                " add a corner that shows it better, or a known size"
            )
    return BoxFit(
        AxisBox(faces[:3].copy(), faces[3:].copy(), float(yaw)),
        residuals,
        rms,
        uncertainty,
        warnings=warnings,
    )


def _best_addition(clicks, model, unknowns, yaw, fit_yaw, scale, room) -> str | None:
    """The unclicked corner that would determine the box best, or None if no single one does."""
    faces, best = model.values(unknowns), (np.inf, None)
    for name in corner_names(room):
        chosen = np.array(faces_named(name, 3))
        if any((chosen == other).all() for other in clicks.corner_faces):
            continue
        pixel, depth = clicks.camera.project(turn_about_y(yaw) @ faces[chosen])
        if not depth > 0:
            continue
        more = Clicks(
            clicks.camera,
            clicks.corner_labels + [name],
            np.vstack([clicks.corner_faces, chosen]),
            np.vstack([clicks.corner_pixels, pixel]),
            clicks.edge_labels,
            clicks.edge_faces,
            clicks.edge_pixels,
        )
        _, by_face, by_yaw = more.residuals(faces, yaw)
        jacobian = by_face @ model.matrix
        covariance = _covariance(np.c_[jacobian, by_yaw * (57.3 / scale)] if fit_yaw else jacobian, scale)
        worst = np.sqrt(np.diag(covariance).max())
        if worst < min(scale, best[0]):
            best = worst, name
    return best[1] and f"add corner {best[1]}"


def _suggestion(faces: list[int], room: bool, words: dict[int, str], clicks: Clicks) -> str:
    """Corners and edges on the given faces, as a remedy."""
    clicked = {frozenset(c) for c in clicks.corner_faces.tolist()}
    corners = [
        name
        for name in corner_names(room)
        for chosen in [set(faces_named(name, 3))]
        if chosen & set(faces) and frozenset(chosen) not in clicked
    ]
    # most open faces first; in a room the front ones are behind the camera
    corners.sort(key=lambda name: (room and "front" in name, -len(set(faces_named(name, 3)) & set(faces))))
    ways = [f"add corner {' or '.join(corners[:2])}"]
    if room:
        edges = [name for name in edge_names(True) if words[faces[0]] in name.split("_")]
        edges.sort(key=lambda name: ("front" in name, "back" not in name))
        ways += [f"edge {edges[0]}", f"the known {words[faces[0]]} [m]"]
    else:
        ways += [f"a known {SIZES[faces[0] % 3]} [m]"]
    return ", ".join(ways[:-1]) + " or " + ways[-1]


def _open_faces(names: list[str], remedy: str) -> InputError:
    one = len(names) == 1
    sizes = [size for axis, size in enumerate(SIZES) if any(FACE_INDEX[name] % 3 == axis for name in names)]
    return InputError(
        f"the annotations do not determine the {', '.join(names)} face{'' if one else 's'}"
        f" ({' and '.join(sizes)})",
        remedy=remedy,
    )


def _refuse_inverted(clicks: Clicks, faces: np.ndarray, words: dict[int, str], room: bool) -> None:
    for axis, size in enumerate(SIZES):
        lower, upper = faces[axis], faces[axis + 3]
        if upper - lower > 1e-9 * max(abs(upper), abs(lower), 1e-300):
            continue
        labels = clicks.corner_labels + clicks.edge_labels
        chosen = list(clicks.corner_faces) + list(clicks.edge_faces)
        conflict = [[k for k, f in zip(labels, chosen) if side in f] for side in (axis, axis + 3)]
        conflict = [
            f"{words[side]} ({', '.join(k)})" if k else f"{words[side]} ({faces[side]:.3g} m, fixed)"
            for side, k in zip((axis, axis + 3), conflict)
        ]
        raise InputError(
            f"the {size} comes out as {upper - lower:.3g} m: {' and '.join(conflict)} conflict",
            remedy=(
                f"check that {words[axis]} and {words[axis + 3]} are not swapped, and the known"
                " lengths and the camera's height"
                if room
                else f"check that {words[axis]} and {words[axis + 3]} are not swapped, and what"
                " supports the box"
            ),
        )
