"""Cuboids from clicked corners: the room, and the proxies of the furniture in it.

A cuboid proxy follows Zheng et al. 2012 as Zhao et al. 2013, section 5.1, use them: a box whose edges
follow the axes of the room (Manhattan), placed by the corners that can be seen. The clicks are fitted
by least squares of their distances in the photograph [pixel].

Names, by the world's axes: left = -x, right = +x, bottom or floor = -y, top or ceiling = +y,
back = -z, front = +z (towards the viewer). A corner is called by three faces (`front_left_bottom`),
an edge by two (`back_left` is vertical, `floor_back` runs along x); the words may come in any order.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import AXES

# Faces are counted lower x, y, z, then upper x, y, z: face i lies across axis i % 3.
FACES = ("left", "bottom", "back", "right", "top", "front")
_INDEX = {name: i for i, name in enumerate(FACES)} | {"floor": 1, "ceiling": 4}
_ROOM_NAMES = {"bottom": "floor", "top": "ceiling"}
SIZES = ("width", "height", "depth")  # along x, y, z of the box


def _corner_name(x: str, y: str, z: str, room: bool) -> str:
    return f"{z}_{x}_{_ROOM_NAMES[y] if room else y}"


def corner_names(room: bool = False) -> list[str]:
    """The eight corners: front or back, left or right, bottom or top (rooms: floor or ceiling)."""
    return [
        _corner_name(x, y, z, room)
        for z, x, y in product(("front", "back"), ("left", "right"), ("bottom", "top"))
    ]


def edge_names(room: bool = False) -> list[str]:
    """The twelve edges; floor and ceiling edges begin with their height."""
    level = [_ROOM_NAMES[name] if room else name for name in ("bottom", "top")]
    return [f"{y}_{side}" for y in level for side in ("left", "right", "front", "back")] + [
        f"{z}_{x}" for z in ("front", "back") for x in ("left", "right")
    ]


def _faces_named(name: str, count: int, room: bool = False) -> list[int]:
    """Face indices, sorted by axis, of a corner (count = 3) or an edge (count = 2)."""
    words = name.split("_")
    faces = sorted({_INDEX[word] for word in words if word in _INDEX}, key=lambda i: i % 3)
    if len(words) != count or len({face % 3 for face in faces}) != count:
        kind, known = ("corner", corner_names) if count == 3 else ("edge", edge_names)
        raise InputError(f"unknown {kind} '{name}'", remedy=f"use one of {', '.join(known(room))}")
    return faces


@dataclass(frozen=True)
class AxisBox:
    """A cuboid [m]: lower (3,) and upper (3,) corner in a frame turned by yaw [degree] about the y axis.

    The frame shares the world's origin; with yaw = 0 it is the world's. Positive yaw turns to the right
    (clockwise from above), like the camera's.
    """

    lower: np.ndarray
    upper: np.ndarray
    yaw: float = 0.0

    @property
    def world_from_box(self) -> np.ndarray:
        """(3, 3) rotation; its columns are the box's x, y and z directions in the world."""
        return _turn(self.yaw)

    @property
    def size(self) -> np.ndarray:
        """(3,) [m]: width, height, depth along the box's own x, y, z."""
        return np.asarray(self.upper) - self.lower

    @property
    def centre(self) -> np.ndarray:
        """(3,) world [m]."""
        return self.world_from_box @ ((np.asarray(self.lower) + self.upper) / 2)

    def corner(self, name: str) -> np.ndarray:
        """(3,) world [m]."""
        return self.world_from_box @ np.concatenate([self.lower, self.upper])[_faces_named(name, 3)]

    def corners(self, room: bool = False) -> dict[str, np.ndarray]:
        """World points (3,) [m] of the eight corners by name; `room` says floor and ceiling."""
        return {name: self.corner(name) for name in corner_names(room)}

    def faces(self, room: bool = False) -> dict[str, np.ndarray]:
        """World polygons (4, 3) [m] of the six faces by name.

        Counter-clockwise from outside (normals out of the box), for a `room` from inside.
        """
        values = np.concatenate([self.lower, self.upper])
        turn, result = self.world_from_box, {}
        for face, name in enumerate(FACES):
            axis, (i, j) = face % 3, ((face + 1) % 3, (face + 2) % 3)
            chosen = np.empty((4, 3), int)
            chosen[:, axis] = face
            chosen[:, i] = [i, i + 3, i + 3, i]
            chosen[:, j] = [j, j, j + 3, j + 3]
            outward = face >= 3  # i, j, axis are right-handed: the loop is seen so from +axis
            loop = chosen if outward != room else chosen[::-1]
            # corners one by one, as `corner` makes them: faces then share theirs to the last bit
            result[_ROOM_NAMES.get(name, name) if room else name] = np.array([turn @ values[c] for c in loop])
        return result

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether world `points`, (..., 3), lie in the box or on it."""
        local = np.asarray(points, float) @ self.world_from_box
        return ((local >= self.lower) & (local <= self.upper)).all(-1)


class Support(NamedTuple):
    """The face of a box that touches something: its `side` across `axis` lies at `coordinate` [m].

    ("y", "lower", 0.0) stands on the floor, ("y", "lower", 0.75) on a table of that height,
    ("y", "upper", 2.5) hangs from a ceiling, ("x", "lower", -2.0) stands at the left wall x = -2.
    """

    axis: Literal["x", "y", "z"]
    side: Literal["lower", "upper"]
    coordinate: float


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


def fit_room(
    camera: Camera,
    corners: dict[str, np.ndarray] | None = None,
    edges: dict[str, np.ndarray] | None = None,
    known: dict[str, float] | None = None,
    *,
    behind: float = 1.0,
) -> BoxFit:
    """The room whose corners and edges were clicked; its floor is y = 0 and its walls face the axes.

    corners: {name: (2,) pixel}. edges: {name: (2, 2) pixels}, two points anywhere along that edge.
    known: {left | right | back | front | ceiling: coordinate [m]}; the ceiling's is the room's height.
    behind [m]: a front wall that nothing determines is put so far behind the camera.
    Raises InputError for an unknown name, a floor point above the horizon (or a ceiling point below),
    a wall that the annotations leave open, or walls in the wrong order.
    """
    known = dict(known or {})
    allowed = ("left", "right", "back", "front", "ceiling")
    for name in known:
        if name not in allowed:
            raise InputError(f"known wall '{name}' does not exist", remedy=f"use one of {', '.join(allowed)}")
    if not behind > 0:
        raise InputError(f"front wall {behind:g} m behind the camera", remedy="state a distance above 0")
    fixed = {1: 0.0} | {_INDEX[name]: float(value) for name, value in known.items()}
    clicks = _Clicks.of(camera, corners or {}, edges or {}, room=True)
    assumed: tuple[str, ...] = ()
    front = _INDEX["front"]
    if front not in fixed and front not in clicks.touched():
        fixed[front] = float(camera.position[2]) + behind
        assumed = ("front",)
    model = _Model.with_fixed(fixed, {})
    fit = _fit(clicks, model, yaw=0.0, fit_yaw=False, room=True)
    warnings = list(fit.warnings)
    if not fit.box.contains(camera.position):
        x, y, z = camera.position
        warnings.append(
            f"the camera at ({x:.3g}, {y:.3g}, {z:.3g}) m stands outside the room, which it then sees through"
            " a wall: check the names of the annotations, the known walls and the camera's height"
        )
    return replace(fit, assumed=assumed, warnings=warnings)


def fit_cuboid(
    camera: Camera,
    corners: dict[str, np.ndarray],
    support: Support | tuple[str, str, float],
    *,
    yaw: float | Literal["fit"] = 0.0,
    known: dict[str, float] | None = None,
    name: str = "box",
) -> BoxFit:
    """The cuboid proxy of an object, from its visible corners and the plane that it touches.

    corners: {name: (2,) pixel}. support: as `Support`. yaw [degree]: turn about y; "fit" finds it
    between -90 and 90, for a box with a horizontal support. known: {width | height | depth: size [m]}
    along the box's own x, y, z. `name` stands in messages.
    Raises InputError where the clicks leave a face open (it says which corner to add), where the box
    comes out inverted (it says which corners conflict), or for an unknown name.
    """
    support = Support(*support)
    if support.axis not in AXES or support.side not in ("lower", "upper"):
        raise InputError(
            f"{name}: support ({support.axis}, {support.side}) is unknown",
            remedy="state axis x, y or z and side lower or upper",
        )
    if yaw != 0 and support.axis != "y":
        raise InputError(
            f"{name}: a box turned by yaw {yaw} cannot stand flat against a wall",
            remedy="support it by its lower or upper y face, or leave yaw at 0",
        )
    sizes = {}
    for size, value in (known or {}).items():
        if size not in SIZES or not value > 0:
            raise InputError(
                f"{name}: known size '{size}': {value}",
                remedy="use width, height or depth with a length above 0 m",
            )
        sizes[SIZES.index(size)] = float(value)
    model = _Model.with_fixed({AXES[support.axis] + 3 * (support.side == "upper"): support.coordinate}, sizes)
    try:
        clicks = _Clicks.of(camera, corners, {}, room=False)
        return _fit(clicks, model, yaw=0.0 if yaw == "fit" else float(yaw), fit_yaw=yaw == "fit", room=False)
    except InputError as error:
        raise InputError(f"{name}: {error.problem}", remedy=error.remedy, place=error.place) from None


def _turn(yaw: float) -> np.ndarray:
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def _turn_slope(yaw: float) -> np.ndarray:
    """Derivative of `_turn` per degree."""
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.radians(1.0) * np.array([[-s, 0, -c], [0, 0, 0], [c, 0, -s]])


@dataclass(frozen=True)
class _Model:
    """Face coordinates (6,) as a linear function of the unknowns: matrix @ unknowns + offset."""

    matrix: np.ndarray  # (6, n)
    offset: np.ndarray  # (6,)

    @classmethod
    def with_fixed(cls, fixed: dict[int, float], sizes: dict[int, float]) -> "_Model":
        rows, offset = np.eye(6), np.zeros(6)
        for face, value in fixed.items():
            rows[face], offset[face] = 0, value
        for axis, size in sizes.items():
            upper_from_lower = axis + 3 not in fixed
            source, target = (axis, axis + 3) if upper_from_lower else (axis + 3, axis)
            rows[target], offset[target] = rows[source], offset[source] + (
                size if upper_from_lower else -size
            )
        used = [i for i in range(6) if rows[:, i].any()]
        return cls(rows[:, used], offset)

    def values(self, unknowns: np.ndarray) -> np.ndarray:
        return self.matrix @ unknowns + self.offset


@dataclass(frozen=True)
class _Clicks:
    """Annotations of one box, as arrays."""

    camera: Camera
    corner_labels: list[str]
    corner_faces: np.ndarray  # (C, 3)
    corner_pixels: np.ndarray  # (C, 2)
    edge_labels: list[str]
    edge_faces: np.ndarray  # (E, 2)
    edge_pixels: np.ndarray  # (E, 2, 2)

    @classmethod
    def of(cls, camera: Camera, corners: dict, edges: dict, room: bool) -> "_Clicks":
        for label, pixels, shape in [(k, p, (2,)) for k, p in corners.items()] + [
            (k, p, (2, 2)) for k, p in edges.items()
        ]:
            if np.shape(pixels) != shape or not np.isfinite(np.asarray(pixels, float)).all():
                what = "one pixel [u, v]" if shape == (2,) else "two pixels [[u, v], [u, v]]"
                raise InputError(f"'{label}' is {np.asarray(pixels).tolist()}", remedy=f"give {what}")
        clicks = cls(
            camera,
            list(corners),
            np.array([_faces_named(k, 3, room) for k in corners], int).reshape(-1, 3),
            np.array(list(corners.values()), float).reshape(-1, 2),
            list(edges),
            np.array([_faces_named(k, 2, room) for k in edges], int).reshape(-1, 2),
            np.array(list(edges.values()), float).reshape(-1, 2, 2),
        )
        for label, faces in zip(clicks.corner_labels, clicks.corner_faces):
            if sum((faces == other).all() for other in clicks.corner_faces) > 1:
                raise InputError(
                    f"corner '{label}' is given twice under different names", remedy="remove one"
                )
        for label, (a, b) in zip(clicks.edge_labels, clicks.edge_pixels):
            if np.hypot(*(b - a)) < 1:
                raise InputError(
                    f"edge '{label}' has both points at ({a[0]:g}, {a[1]:g})",
                    remedy="click two points well apart along that edge",
                )
        if room:
            clicks._check_horizon()
        return clicks

    def touched(self) -> set[int]:
        """Faces that some annotation names."""
        return set(self.corner_faces.ravel()) | set(self.edge_faces.ravel())

    def _check_horizon(self) -> None:
        """No point of the floor is seen above the horizon, none of the ceiling below."""
        listed = [
            (k, f, p[None]) for k, f, p in zip(self.corner_labels, self.corner_faces, self.corner_pixels)
        ]
        listed += list(zip(self.edge_labels, self.edge_faces, self.edge_pixels))
        for label, faces, pixels in listed:
            for level, sign, side, other in ((1, 1, "above", "below"), (4, -1, "below", "above")):
                rise = self.camera.directions(pixels)[:, 1] * sign
                if level in faces and (rise >= 0).any():
                    u, v = pixels[np.argmax(rise)]
                    surface = "floor" if level == 1 else "ceiling"
                    raise InputError(
                        f"'{label}' at ({u:g}, {v:g}) lies {side} the camera's horizon, where there is"
                        f" no {surface}",
                        remedy=f"move it {other} the horizon, or check the camera" "'s pitch and roll",
                    )

    def edge_axes(self) -> np.ndarray:
        """(E,) axis along which each edge runs."""
        return 3 - (self.edge_faces % 3).sum(1)

    def residuals(self, faces: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (R,) [pixel] and their slopes by faces, (R, 6) [pixel/m], and yaw, (R,) [pixel/degree].

        Two per corner (u, v), then two per edge (signed distance of each point from the edge's line).
        """
        camera, turn, slope = self.camera, _turn(yaw), _turn_slope(yaw)
        to_camera = np.asarray(camera.world_from_camera).T
        count = len(self.corner_labels)

        local = faces[self.corner_faces]  # (C, 3)
        seen = (local @ turn.T - camera.position) @ to_camera.T
        # a step of the solver may put a corner behind the camera; a small depth keeps it finite and costly
        depth = np.maximum(seen[:, 2], 1e-3 * np.linalg.norm(seen, axis=1) + 1e-12)
        pixels = camera.focal_length * seen[:, :2] / depth[:, None] + camera.principal_point
        by_seen = np.zeros((count, 2, 3))
        by_seen[:, 0, 0] = by_seen[:, 1, 1] = camera.focal_length / depth
        by_seen[:, :, 2] = -camera.focal_length * seen[:, :2] / depth[:, None] ** 2
        by_local = by_seen @ (to_camera @ turn)
        by_face = np.zeros((count, 2, 6))
        np.put_along_axis(by_face, np.repeat(self.corner_faces[:, None], 2, 1), by_local, 2)
        by_yaw = np.einsum("cij,cj->ci", by_seen, local @ (to_camera @ slope).T)

        line_residual, line_by_face, line_by_yaw = self._edge_residuals(faces, turn, slope)
        return (
            np.concatenate([(pixels - self.corner_pixels).ravel(), line_residual]),
            np.concatenate([by_face.reshape(-1, 6), line_by_face]),
            np.concatenate([by_yaw.ravel(), line_by_yaw]),
        )

    def _edge_residuals(self, faces, turn, slope):
        """As `residuals`, of the edges alone.

        The image of an edge is the line where the plane through the camera and the edge, of normal
        (point on edge - camera) x edge direction, cuts the photograph.
        """
        camera, to_camera = self.camera, np.asarray(self.camera.world_from_camera).T
        inverse = np.linalg.inv(camera.intrinsic_matrix)
        rows, by_face, by_yaw = [], [], []
        for pair, axis, clicked in zip(self.edge_faces, self.edge_axes(), self.edge_pixels):
            local = np.zeros(3)
            local[pair % 3] = faces[pair]
            homogeneous = np.c_[clicked, np.ones(2)] @ inverse.T  # rays in the camera frame
            along = to_camera @ turn[:, axis]
            normal = np.cross(to_camera @ (turn @ local - camera.position), along)
            d_normal = {face: np.cross(to_camera @ turn[:, face % 3], along) for face in pair}
            d_normal["yaw"] = np.cross(to_camera @ slope @ local, along) + np.cross(
                to_camera @ (turn @ local - camera.position), to_camera @ slope[:, axis]
            )
            # in the image plane at distance 1 the line's direction across is normal[:2]; f makes it pixels
            steep = np.hypot(*normal[:2]) + 1e-300
            value = camera.focal_length * (homogeneous @ normal) / steep
            gradient = {
                k: camera.focal_length * (homogeneous @ d) / steep - value * (normal[:2] @ d[:2]) / steep**2
                for k, d in d_normal.items()
            }
            block = np.zeros((2, 6))
            for face in pair:
                block[:, face] = gradient[face]
            rows.append(value)
            by_face.append(block)
            by_yaw.append(gradient["yaw"])
        if not rows:
            return np.zeros(0), np.zeros((0, 6)), np.zeros(0)
        return np.concatenate(rows), np.concatenate(by_face), np.concatenate(by_yaw)

    def back_projected(self, model: _Model, yaw: float) -> np.ndarray:
        """Unknowns that bring the box nearest to the clicked rays [m]: linear, so no start is needed.

        A corner should lie on its ray: two perpendicular distances vanish. An edge should lie in the
        plane of its direction and the ray of each of its points: one distance vanishes per point.
        """
        turn = _turn(yaw)
        normals, chosen = [], []
        for ray, faces in zip(self.camera.directions(self.corner_pixels), self.corner_faces):
            for across in np.linalg.svd(ray[None])[2][1:]:
                normals.append(across)
                chosen.append(faces)
        for pixels, faces, axis in zip(self.edge_pixels, self.edge_faces, self.edge_axes()):
            for ray in self.camera.directions(pixels):
                across = np.cross(ray, turn[:, axis])
                normals.append(across / (np.linalg.norm(across) + 1e-300))
                chosen.append(faces)
        rows = np.zeros((len(normals), 6))
        for row, normal, faces in zip(rows, normals, chosen):
            row[faces] = (normal @ turn)[faces % 3]
        target = np.array([normal @ self.camera.position for normal in normals]) - rows @ model.offset
        return np.linalg.lstsq(rows @ model.matrix, target, rcond=1e-9)[0]


def _fit(clicks: _Clicks, model: _Model, *, yaw: float, fit_yaw: bool, room: bool) -> BoxFit:
    """Nonlinear least squares of the model's unknowns (and of the yaw) in pixels."""
    words = {i: _ROOM_NAMES.get(face, face) if room else face for i, face in enumerate(FACES)}
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
        np.linalg.norm(_turn(yaw) @ faces[:3] - clicks.camera.position),
        np.linalg.norm(_turn(yaw) @ faces[3:] - clicks.camera.position),
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


def _reaches(model: _Model, touched: set[int], face: int) -> bool:
    """Whether some touched face moves with `face` (itself, or its opposite at a known distance)."""
    return any((model.matrix[face] * model.matrix[other]).any() for other in touched)


def _pairs(faces: np.ndarray) -> np.ndarray:
    return np.stack([faces[:3], faces[3:]], 1)


def _solve(clicks: _Clicks, model: _Model, yaw: float, fit_yaw: bool) -> tuple[np.ndarray, float, float]:
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

    result = least_squares(
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


def _best_addition(clicks, model, unknowns, yaw, fit_yaw, scale, room) -> str | None:
    """The unclicked corner that would determine the box best, or None if no single one does."""
    faces, best = model.values(unknowns), (np.inf, None)
    for name in corner_names(room):
        chosen = np.array(_faces_named(name, 3))
        if any((chosen == other).all() for other in clicks.corner_faces):
            continue
        pixel, depth = clicks.camera.project(_turn(yaw) @ faces[chosen])
        if not depth > 0:
            continue
        more = _Clicks(
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


def _suggestion(faces: list[int], room: bool, words: dict[int, str], clicks: _Clicks) -> str:
    """Corners and edges on the given faces, as a remedy."""
    clicked = {frozenset(c) for c in clicks.corner_faces.tolist()}
    corners = [
        name
        for name in corner_names(room)
        for chosen in [set(_faces_named(name, 3))]
        if chosen & set(faces) and frozenset(chosen) not in clicked
    ]
    # most open faces first; in a room the front ones are behind the camera
    corners.sort(key=lambda name: (room and "front" in name, -len(set(_faces_named(name, 3)) & set(faces))))
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
    sizes = [size for size, axis in zip(SIZES, range(3)) if any(_INDEX[name] % 3 == axis for name in names)]
    return InputError(
        f"the annotations do not determine the {', '.join(names)} face{'' if one else 's'}"
        f" ({' and '.join(sizes)})",
        remedy=remedy,
    )


def _refuse_inverted(clicks: _Clicks, faces: np.ndarray, words: dict[int, str], room: bool) -> None:
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


def _report(
    clicks: _Clicks,
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
