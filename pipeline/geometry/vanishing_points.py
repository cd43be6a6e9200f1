"""The camera from lines drawn along parallel edges of the photograph.

Images of parallel lines meet in a vanishing point, which is where the ray along them leaves the
photograph: v ~ K R^T axis. Two orthogonal ones fix the rotation and the focal length, three also the
principal point (Zhao et al. 2013, below eq. 7; Hartley & Zisserman 2004, sections 8.6 to 8.8).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, centre_of
from pipeline.geometry.camera_start import (
    are_parallel, axis_label, draw_instead, focal_length_of, principal_point_of, rotation_of_one_axis,
    upright)
from pipeline.geometry.planes import AXES, Plane


@dataclass(frozen=True)
class CameraEstimate:
    """A camera from annotated lines, and how far to trust it.

    residual_rms [pixel]: RMS distance of the end points from the line through their segment's midpoint
    and the vanishing point that the camera gives its axis. residuals: that distance per axis and segment.
    focal_length_sigma [pixel], principal_point_sigma (2,) [pixel]: standard deviation for end points
    that are off by 1 pixel in u and v; None for what was given, not estimated.
    vanishing_points: homogeneous (3,) per world axis, x, y and z. assumptions, warnings: for a person.
    """

    camera: Camera
    residual_rms: float
    residuals: dict[str, np.ndarray]
    focal_length_sigma: float | None
    principal_point_sigma: np.ndarray | None
    vanishing_points: dict[str, np.ndarray]
    assumptions: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def vanishing_point(segments: np.ndarray, *, name: str = "the lines") -> np.ndarray:
    """Homogeneous point (3,) [pixel], of unit length, at which `segments`, (N, 2, 2) [pixel], meet.

    Minimises the squared distances of the end points from the lines through each segment's midpoint
    and the point, which is the maximum-likelihood estimate for equally uncertain end points (Liebowitz
    & Zisserman 1998). The third coordinate vanishes for lines that are parallel in the photograph.
    Raises InputError for fewer than two segments, one without length, or all of them on one line.
    """
    segments = _checked_segments(segments, name, at_least=2)
    centre = segments.reshape(-1, 2).mean(0)
    scale = np.abs(segments - centre).max()
    ends = np.concatenate([(segments - centre) / scale, np.ones(segments.shape[:2] + (1,))], -1)
    lines = np.cross(ends[:, 0], ends[:, 1])
    _, values, directions = np.linalg.svd(lines / np.linalg.norm(lines, axis=1).max())
    if values[1] < 1e-9 * values[0]:
        raise InputError(
            f"{name}: all {len(segments)} segments lie on one line, which fixes no vanishing point",
            remedy="draw the second along another, parallel edge",
        )
    around, point = directions[:2], directions[2]

    def moved(step):
        return (point + step @ around) / np.linalg.norm(point + step @ around)

    result = least_squares(
        lambda step: _misses(ends, moved(step)), np.zeros(2), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    back = np.array([[scale, 0, centre[0]], [0, scale, centre[1]], [0, 0, 1]])
    found = back @ moved(result.x)
    return found / np.linalg.norm(found)


def calibrate(
    *,
    width: int,
    height: int,
    lines: dict[str, np.ndarray],
    principal_point: np.ndarray | Literal["estimate"] | None = None,
    focal_length: float | None = None,
    camera_height: float = 1.0,
) -> CameraEstimate:
    """The camera that sees `lines` along the world's axes.

    lines: {x | y | z: segments (N, 2, 2) [pixel]}, x left-right, y vertical, z front-back; their
    direction along the edge does not matter. principal_point [pixel]: the centre if None; "estimate"
    needs all three axes to converge. focal_length [pixel]: estimated from two or three converging axes
    if None; where given, one axis will do (the missing angle: no roll; yaw 0 for vertical lines), and
    further axes may have a single segment. camera_height [m]: the camera stands over the origin.

    The camera is taken to be upright and turned less than 90 degrees from -z: of the sign choices that
    the lines leave, y is up in the photograph, x runs to the right and z comes towards the viewer.
    Raises InputError for lines that do not determine this, naming the axis and what to draw instead.
    """
    estimate_centre = isinstance(principal_point, str)
    if estimate_centre and principal_point != "estimate":
        raise InputError(f"principal point '{principal_point}'", remedy="give [u, v] or 'estimate'")
    if focal_length is not None and not (np.isfinite(focal_length) and focal_length > 0):
        raise InputError(f"focal length is {focal_length} px", remedy="give a length above 0 or leave it out")
    segments = _checked_lines(lines, one_is_enough=focal_length is not None)
    points = {axis: vanishing_point(s, name=axis_label(axis)) for axis, s in segments.items() if len(s) > 1}
    # normalised so that a point's three coordinates are of one magnitude
    frame = np.array(
        [[np.hypot(width, height), 0, width / 2], [0, np.hypot(width, height), height / 2], [0, 0, 1]]
    )
    parallel = [axis for axis in points if are_parallel(segments[axis])]

    centre = centre_of(width, height)
    if estimate_centre:
        centre = principal_point_of(points, parallel, frame)
    elif principal_point is not None:
        centre = np.asarray(principal_point, float)
    free_focal = focal_length is None
    if free_focal:
        focal_length = focal_length_of(points, parallel, frame, centre)

    assumptions: list[str] = []
    if len(segments) == 1:
        axis = next(iter(segments))
        camera_from_world = rotation_of_one_axis(axis, points[axis], focal_length, centre, assumptions)
        deviation, centre_deviation = None, None
    else:
        camera_from_world, focal_length, centre, deviation, centre_deviation = _refine(
            segments, points, focal_length, centre, free_focal, estimate_centre
        )
        camera_from_world = upright(camera_from_world)
    if free_focal and not deviation < focal_length:
        raise InputError(
            f"the lines along {' and '.join(map(axis_label, segments))} leave the focal length open"
            f" ({focal_length:.0f} +- {deviation:.2g} px for clicks good to 1 px)",
            remedy=draw_instead(parallel, segments),
        )

    camera = Camera(
        width, height, float(focal_length), centre, camera_from_world.T, np.array([0.0, camera_height, 0.0])
    )
    projected = {axis: camera.intrinsic_matrix @ camera_from_world[:, k] for axis, k in AXES.items()}
    residuals = {
        axis: np.abs(_misses(_homogeneous(s), projected[axis])) / np.sqrt(2) for axis, s in segments.items()
    }
    rms = float(np.sqrt(np.mean(np.concatenate(list(residuals.values())) ** 2)))
    return CameraEstimate(
        camera,
        rms,
        residuals,
        deviation,
        centre_deviation,
        projected,
        assumptions,
        _warnings(camera, rms, residuals, deviation, estimate_centre),
    )


def scale_from_known_length(
    camera: Camera, plane: Plane, pixels: np.ndarray, length: float, *, name: str = "the plane"
) -> float:
    """Metres per unit of a world whose scale is open, from a length [m] between two points on a plane.

    camera and plane are in that world's unit (say, of a camera at height 1, floor at 0); `pixels`,
    (2, 2), are the ends of the known length. `scaled` applies the factor; a known camera height gives
    it too, as height / camera.position[1].
    Raises InputError for a length that is not above 0, coincident points, or points off the plane.
    """
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"known length on {name} is {length} m", remedy="give a length above 0")
    first, second = plane.seen_at(camera, pixels, name=name)
    apart = float(np.linalg.norm(second - first))
    if np.hypot(*np.subtract(*np.asarray(pixels, float))) < 1:
        raise InputError(
            f"both ends of the known length on {name} are at the same pixel",
            remedy="click the two ends of the length",
        )
    return length / apart


def scaled(camera: Camera, factor: float) -> Camera:
    """The same camera in a world whose lengths are `factor` times as large; the photograph stays."""
    return Camera(
        camera.width,
        camera.height,
        camera.focal_length,
        camera.principal_point,
        camera.world_from_camera,
        np.asarray(camera.position) * factor,
    )


def _homogeneous(segments: np.ndarray) -> np.ndarray:
    return np.concatenate([segments, np.ones(segments.shape[:2] + (1,))], -1)


def _misses(ends: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(N,) residuals of segments with homogeneous `ends`, (N, 2, 3), against a vanishing point.

    Each is sqrt(2) times the distance of either end from the line through midpoint and `point`: the
    two ends' squares together, and of the same variance as one coordinate of an end.
    """
    line = np.cross(ends.mean(1), point)
    # a midpoint on the vanishing point itself has no line, and misses nothing
    return np.sqrt(2) * (line * ends[:, 0]).sum(1) / (np.hypot(line[:, 0], line[:, 1]) + 1e-300)


def _checked_segments(segments: np.ndarray, name: str, at_least: int) -> np.ndarray:
    segments = np.asarray(segments, float)
    if (
        segments.size
        and (segments.ndim != 3 or segments.shape[1:] != (2, 2))
        or not np.isfinite(segments).all()
    ):
        raise InputError(
            f"{name}: segments of shape {segments.shape}", remedy="give a list of [[u, v], [u, v]]"
        )
    if len(segments) < at_least:
        raise InputError(
            f"{name}: {len(segments)} segment{'s'[len(segments) == 1:]}, and at least {at_least} are needed",
            remedy="draw along another edge parallel to that axis",
        )
    for number, (a, b) in enumerate(segments, 1):
        if np.hypot(*(b - a)) < 1:
            raise InputError(
                f"{name}: segment {number} from ({a[0]:g}, {a[1]:g}) to ({b[0]:g}, {b[1]:g}) has no length",
                remedy="drag it along the whole edge",
            )
    return segments


def _checked_lines(lines: dict, one_is_enough: bool) -> dict[str, np.ndarray]:
    unknown = set(lines) - set(AXES)
    if unknown:
        raise InputError(
            f"lines along '{min(unknown)}'",
            remedy="use the axes x (left-right), y (vertical), z" " (front-back)",
        )
    if not lines:
        raise InputError("no lines are drawn", remedy="draw two or more along each of two axes")
    # with a known focal length one axis needs two segments, another may add its share with one
    enough = one_is_enough and any(len(s) > 1 for s in lines.values())
    return {
        axis: _checked_segments(lines[axis], f"lines along {axis_label(axis)}", 1 if enough else 2)
        for axis in AXES
        if axis in lines
    }


def _refine(segments, points, focal_length, centre, free_focal: bool, free_centre: bool):
    """Rotation, and focal length and principal point where free, that fit all segments at once.

    Returns (camera_from_world, focal_length, centre, sigma of the focal length, sigma of the centre).
    """
    ends = {axis: _homogeneous(s) for axis, s in segments.items()}

    def unpack(x):
        focal = focal_length * np.exp(x[3]) if free_focal else focal_length
        return focal, centre + focal_length * x[-2:] if free_centre else centre

    def residuals(x, start):
        focal, middle = unpack(x)
        axes = Rotation.from_rotvec(x[:3]).as_matrix() @ start
        image = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
        return np.concatenate([_misses(ends[axis], image @ axes[:, AXES[axis]]) for axis in ends])

    # the axis that most segments support stays, the others are tried all the way round it
    main = max(points, key=lambda axis: len(segments[axis]))
    along = np.r_[(points[main][:2] - centre * points[main][2]) / focal_length, points[main][2]]
    base = Rotation.align_vectors(along[None] / np.linalg.norm(along), np.eye(3)[AXES[main]][None])[
        0
    ].as_matrix()
    turns = [
        base @ Rotation.from_rotvec(np.eye(3)[AXES[main]] * angle).as_matrix()
        for angle in np.radians(np.arange(0.0, 180.0, 3.0))
    ]
    size = 3 + free_focal + 2 * free_centre
    start = min(turns, key=lambda turn: (residuals(np.zeros(size), turn) ** 2).sum())
    result = least_squares(
        residuals,
        np.zeros(size),
        args=(start,),
        jac="3-point",
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    _, values, directions = np.linalg.svd(result.jac)
    spread = np.full(size, np.inf)
    if len(values) == size:
        with np.errstate(divide="ignore", over="ignore"):
            spread = np.sqrt(((directions / values[:, None]) ** 2).sum(0))
    focal, middle = unpack(result.x)
    rotation = Rotation.from_rotvec(result.x[:3]).as_matrix() @ start
    return (
        rotation,
        focal,
        middle,
        float(spread[3] * focal) if free_focal else None,
        spread[-2:] * focal_length if free_centre else None,
    )


def _warnings(
    camera: Camera, rms: float, residuals: dict, deviation: float | None, estimated_centre: bool
) -> list[str]:
    warnings = []
    diagonal = np.hypot(camera.width, camera.height)
    if rms > 0.003 * diagonal:
        axis = max(residuals, key=lambda a: residuals[a].max())
        warnings.append(
            f"the lines miss a common camera by {rms:.1f} px RMS (over 0.3 % of the diagonal); segment"
            f" {int(residuals[axis].argmax()) + 1} along {axis_label(axis)} is off by"
            f" {residuals[axis].max():.1f} px"
        )
    if deviation is not None and deviation > 0.1 * camera.focal_length:
        warnings.append(
            f"the focal length {camera.focal_length:.0f} px is known to +-{deviation:.0f} px only, for"
            " clicks good to 1 px: draw longer lines that converge more, or give a field of view"
        )
    if estimated_centre and not (
        0 <= camera.principal_point[0] <= camera.width and 0 <= camera.principal_point[1] <= camera.height
    ):
        warnings.append(
            f"the estimated principal point ({camera.principal_point[0]:.0f},"
            f" {camera.principal_point[1]:.0f}) lies outside the photograph"
        )
    return warnings
