"""What the page draws over the photograph: lines and points in pixels of the photograph at its full size.

The same lines as the report's overlay draws (`imaging/overlay_view.py`, `imaging/overlay_lines.py`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from pipeline.annotate.preview.placing import Placed
from pipeline.annotate.preview.problems import Parts
from pipeline.errors import InputError
from pipeline.geometry.boxes import AxisBox
from pipeline.geometry.camera import Camera, yaw_pitch_roll
from pipeline.geometry.planes import AXES
from pipeline.geometry.vanishing_points import vanishing_point
from pipeline.imaging.overlay_lines import cast_window, edges_of, post_in_the_sun, shaft_edges, sun_arrow
from pipeline.imaging.overlay_outdoors import region_outlines
from pipeline.imaging.overlay_view import COINCIDENT, ViewLines
from pipeline.plugins.annotations import Outline, Position
from pipeline.plugins.base import Light
from pipeline.plugins.lights.sun import Sun
from pipeline.plugins.lights.sunlight import Sunlight

Point = list[float]
Polyline = list[Point]
#: Lines are followed so far beyond the photograph's border [share of its longer side].
MARGIN = 0.25
#: Share of the longer side that the axes and a post in the sun take.
AXES_SHARE = 0.2
#: Vanishing points farther off than this [times the longer side] are parallel lines to a person.
FARTHEST_POINT = 1e4
#: Diagonal of the 36 x 24 mm frame that equivalent focal lengths refer to [mm].
FULL_FRAME = float(np.hypot(36.0, 24.0))


@dataclass(frozen=True)
class Shown:
    """Overlay geometry as plain numbers, lists and dicts, which JSON can hold; what is not known yet is None or empty.

    All points are [u, v] in pixels of the photograph at its full size, polylines lists of points (a closed one repeats no
    point). Lines end `MARGIN` beyond the photograph's border.

    size: the photograph's [width, height].
    focal_length: [pixel]; focal_length_35mm: equivalent [mm], by the diagonal; field_of_view: [degree] across the width.
    principal_point; camera_source: what told the camera ("vanishing points", "horizon", "angles", "fspy").
    camera_residual: RMS distance of the lines' ends from a common camera [pixel]. scale_known: whether anything tells the
    scale; if not, lengths are those of a camera 1 m above the floor.
    position: the camera's [x, y, z] in metres; yaw_pitch_roll: [degree].
    horizon: two ends. vanishing_points: by axis; None where the axis' lines are parallel in the photograph.
    lines: of each annotated segment {"axis", "index", "pixels": its two ends, "towards": the same side of the line from its
    middle to the vanishing point, "residual": distance of its ends from that line [pixel]}.
    axes: arrows along x, y, z on the floor by name; axes_length: of each [m].
    wireframes: of each shape its seen edges, hidden: the hidden ones. rooms: names of those seen from inside.
    faces: outlines of each shape's faces by SHAPE.FACE, as far as they are in the picture, for choosing a plane.
    corners: of each shape {corner: {"clicked", "fitted", "residual": [pixel]}}; residuals: RMS by shape [pixel].
    lamps: outlines by light; bulbs: points by light; beams: arrows of spots.
    windows, patches, cast, shafts: by LIGHT.OPENING: outline; outlines; the window's light where it falls; edges.
    suns: by light {"direction": [x, y, z], in which the light travels, "elevation", "azimuth": [degree], "status", "overlap":
    by window, "arrow": two ends or None, "post", "post_shadow", "post_ray": outdoors, two ends each}.
    regions: by name {"class", "depth": median [m] or None, "outlines", "middle": where a name fits, "foot": polyline or None}.
    patches_of_light: marked for the estimate, by NAME[INDEX] {"kind": shadowed | sunlit | albedo, "outline"}.
    """

    size: list[int]
    focal_length: float | None = None
    focal_length_35mm: float | None = None
    field_of_view: float | None = None
    principal_point: Point | None = None
    camera_source: str | None = None
    camera_residual: float | None = None
    scale_known: bool = False
    position: list[float] | None = None
    yaw_pitch_roll: list[float] | None = None
    horizon: Polyline | None = None
    vanishing_points: dict[str, Point | None] = field(default_factory=dict)
    lines: list[dict[str, Any]] = field(default_factory=list)
    axes: dict[str, Polyline] = field(default_factory=dict)
    axes_length: float | None = None
    wireframes: dict[str, list[Polyline]] = field(default_factory=dict)
    hidden: dict[str, list[Polyline]] = field(default_factory=dict)
    rooms: list[str] = field(default_factory=list)
    faces: dict[str, Polyline] = field(default_factory=dict)
    corners: dict[str, dict[str, dict[str, Any]]] = field(default_factory=dict)
    residuals: dict[str, float] = field(default_factory=dict)
    lamps: dict[str, list[Polyline]] = field(default_factory=dict)
    bulbs: dict[str, list[Point]] = field(default_factory=dict)
    beams: dict[str, Polyline] = field(default_factory=dict)
    windows: dict[str, Polyline] = field(default_factory=dict)
    patches: dict[str, list[Polyline]] = field(default_factory=dict)
    cast: dict[str, list[Polyline]] = field(default_factory=dict)
    shafts: dict[str, list[Polyline]] = field(default_factory=dict)
    suns: dict[str, dict[str, Any]] = field(default_factory=dict)
    regions: dict[str, dict[str, Any]] = field(default_factory=dict)
    patches_of_light: dict[str, dict[str, Any]] = field(default_factory=dict)


def shown(parts: Parts, placed: Placed, size: tuple[int, int]) -> Shown:
    """size: the photograph's width and height [pixel]."""
    values: dict[str, Any] = {"size": list(size), "patches_of_light": _patches_of_light(parts)}
    drawn = (parts.camera.lines if parts.camera is not None else None) or {}
    if placed.camera is None:
        return Shown(**values, lines=_lines(drawn, {}, {}), vanishing_points=_points_of_lines(drawn, size))
    camera = placed.camera
    farthest = 1e3 if placed.depth is None else float(placed.depth[np.isfinite(placed.depth)].max(initial=1.0))
    view = ViewLines(camera, MARGIN * max(size), farthest)
    points = _vanishing_points(camera)
    values |= _camera(camera, placed.facts) | {
        "scale_known": parts.scale_known, "vanishing_points": points, "horizon": _listed(view.horizon()),
        "lines": _lines(drawn, points, placed.facts.get("residuals_pixel", {}))}
    values |= _shapes(parts, placed, view)
    for name, light in placed.lights.items():
        _add_light(values, name, light, placed, view)
    if placed.regions is not None:
        values["regions"] = _regions(parts, placed, camera)
    foot = _free_place(placed)
    if foot is not None:
        length = AXES_SHARE * max(size) * view.in_camera(foot)[2] / camera.focal_length
        one = view.axis_length(foot, length)
        axes = {name: view.segment(foot, foot + one * axis) for name, axis in zip("xyz", np.eye(3))}
        values |= {"axes_length": one, "axes": {name: _listed(ends) for name, ends in axes.items() if ends is not None}}
        for name, light in placed.lights.items():
            if isinstance(light, Sunlight) and name in placed.suns and light.direction[1] < 0:
                lines = post_in_the_sun(foot, length, np.asarray(light.direction))
                values["suns"][name] |= {key: _listed(view.segment(*line))
                                         for key, line in zip(("post", "post_shadow", "post_ray"), lines)}
    return Shown(**values)


def _listed(points: np.ndarray | None) -> Polyline | None:
    """Plain numbers, of a hundredth of a pixel."""
    return None if points is None else np.round(np.asarray(points, float), 2).tolist()


def _camera(camera: Camera, facts: dict[str, Any]) -> dict[str, Any]:
    return {"focal_length": camera.focal_length,
            "focal_length_35mm": camera.focal_length * FULL_FRAME / float(np.hypot(camera.width, camera.height)),
            "field_of_view": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.focal_length))),
            "principal_point": _listed(camera.principal_point), "camera_source": facts.get("source"),
            "camera_residual": facts.get("residual_rms_pixel"), "position": np.asarray(camera.position, float).tolist(),
            "yaw_pitch_roll": list(yaw_pitch_roll(camera.world_from_camera))}


def _vanishing_points(camera: Camera) -> dict[str, Point | None]:
    matrix = camera.intrinsic_matrix @ np.asarray(camera.world_from_camera).T
    return {axis: _finite(matrix[:, k], (camera.width, camera.height)) for axis, k in AXES.items()}


def _points_of_lines(drawn: dict[str, list], size: tuple[int, int]) -> dict[str, Point | None]:
    """Of each axis with two lines, while nothing tells the camera yet."""
    found = {}
    for axis, segments in drawn.items():
        try:
            found[axis] = _finite(vanishing_point(np.asarray(segments, float)), size)
        except InputError:
            pass
    return found


def _finite(point: np.ndarray, size: tuple[int, int]) -> Point | None:
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = point[:2] / point[2]
    return _listed(pixel) if np.isfinite(pixel).all() and np.abs(pixel).max() < FARTHEST_POINT * max(size) else None


def _lines(drawn: dict[str, list], points: dict[str, Point | None], residuals: dict[str, Any]) -> list[dict[str, Any]]:
    result = []
    for axis, segments in drawn.items():
        off = residuals.get(axis)
        for index, segment in enumerate(segments):
            ends, point = np.asarray(segment, float), points.get(axis)
            towards = None
            if point is not None:
                middle = ends.mean(0)
                along = (np.asarray(point) - middle) / max(float(np.linalg.norm(np.asarray(point) - middle)), 1e-9)
                towards = _listed(middle + np.outer((ends - middle) @ along, along))
            result.append({"axis": axis, "index": index, "pixels": _listed(ends), "towards": towards,
                           "residual": None if off is None or index >= len(off) else float(off[index])})
    return result


def _shapes(parts: Parts, placed: Placed, view: ViewLines) -> dict[str, Any]:
    seen: dict[str, list] = {}
    hidden: dict[str, list] = {}
    faces, corners = {}, {}
    depth = None if placed.depth is None else cv2.dilate(placed.depth.astype(np.float32), np.ones((3, 3), np.uint8))
    for name, shape in placed.shapes.items():
        pieces = [piece for a, b in edges_of(shape.faces().values()) for piece in view.edge(a, b, depth)]
        seen[name] = [_listed(_ends(pixels)) for is_seen, pixels in pieces if is_seen]
        hidden[name] = [_listed(_ends(pixels)) for is_seen, pixels in pieces if not is_seen]
        for face, outline in shape.faces().items():
            inside = view.polygon(outline)
            if len(inside):
                faces[f"{name}.{face}"] = _listed(inside)
        corners[name] = _corners(parts.shapes[name], shape, placed.camera)
    return {"wireframes": seen, "hidden": hidden, "faces": faces, "corners": {k: v for k, v in corners.items() if v},
            "rooms": [name for name, shape in placed.shapes.items() if not shape.casts_shadow],
            "residuals": {name: one["rms"] for name, one in placed.residuals.items()}}


def _ends(pixels: np.ndarray) -> np.ndarray:
    """A straight piece's two ends."""
    return pixels[[0, -1]]


def _corners(drawn, shape, camera: Camera) -> dict[str, dict[str, Any]]:
    box = getattr(shape, "box", None)
    if box is None and hasattr(shape, "lower"):
        box = AxisBox(np.asarray(shape.lower, float), np.asarray(shape.upper, float))
    found = {}
    for corner, pixel in (getattr(drawn, "corners", {}) if isinstance(box, AxisBox) else {}).items():
        fitted = camera.project(box.corner(corner))[0]
        if np.isfinite(fitted).all():
            found[corner] = {"clicked": _listed(pixel), "fitted": _listed(fitted),
                             "residual": float(np.linalg.norm(fitted - pixel))}
    return found


def _add_light(values: dict[str, Any], name: str, light: Light, placed: Placed, view: ViewLines) -> None:
    """Outlines, windows, shafts and the arrow of one light."""
    for key in ("lamps", "bulbs", "beams", "windows", "patches", "cast", "shafts", "suns"):
        values.setdefault(key, {})
    sun = placed.suns.get(name)
    if sun is not None:
        x, y, z = sun["sun_direction"]
        values["suns"][name] = {
            "direction": [float(x), float(y), float(z)], "elevation": float(np.degrees(np.arcsin(np.clip(-y, -1, 1)))),
            "azimuth": float(np.degrees(np.arctan2(-x, z))), "status": sun["status"],
            "overlap": {key: one["overlap"] for key, one in sun.get("openings", {}).items()}, "arrow": None}
    if isinstance(light, Sun):
        for key, opening in light.openings.items():
            window, patches = opening.window.polygon, [patch.polygon for patch in opening.patches]
            called = f"{name}.{key}"
            values["windows"][called] = _listed(view.polygon(window))
            values["patches"][called] = _outlines(view, patches)
            values["shafts"][called] = [_listed(ends) for _, edges in shaft_edges(window, patches, key)
                                        for a, b in edges if (ends := view.segment(a, b)) is not None]
            if sun is not None:
                direction = np.asarray(light.direction, float)
                values["cast"][called] = _outlines(view, [one for one in cast_window(window, direction, patches) if len(one) >= 3])
                values["suns"][name]["arrow"] = values["suns"][name]["arrow"] or _listed(
                    view.segment(*sun_arrow(window, patches, direction)))
        return
    marks = [value for _, value in light if isinstance(value, (Outline, Position))]
    marks += [one for _, value in light if isinstance(value, list) for one in value if isinstance(one, Position)]
    outlines = [value.polygon for value in marks if isinstance(value, Outline) and value.points is not None]
    points = [value.vector for value in marks if isinstance(value, Position) and value.point is not None]
    if outlines:
        values["lamps"][name] = _outlines(view, outlines)
    if points:
        values["bulbs"][name] = [_listed(view.pixels(view.in_camera(point))) for point in points if view.sees(point[None])]
    if len(points) == 2 and hasattr(light, "target") and (beam := view.segment(*points)) is not None:
        values["beams"][name] = _listed(beam)
        values["bulbs"][name] = values["bulbs"][name][:1]


def _outlines(view: ViewLines, polygons: Iterable[np.ndarray]) -> list[Polyline]:
    return [_listed(pixels) for polygon in polygons if len(pixels := view.polygon(polygon))]


def _regions(parts: Parts, placed: Placed, camera: Camera) -> dict[str, dict[str, Any]]:
    found = placed.regions
    scale = np.array([camera.width, camera.height]) / [placed.view.width, placed.view.height]
    result = {}
    for index, outlines, middle, _, count in region_outlines(found.labels.astype(np.int32), len(found.regions)):
        region = found.regions[index]
        described = parts.depth.regions.get(region.name) if parts.depth is not None else None
        median = float(np.median(found.depth[region.at][region.mask])) if region.mask.any() else None
        result[region.name] = {
            "class": region.kind, "depth": median, "outlines": [_listed(outline * scale) for outline in outlines],
            "middle": _listed(middle * scale), "foot": described.foot if described is not None else None}
    return result


def _patches_of_light(parts: Parts) -> dict[str, dict[str, Any]]:
    """Outlines that a person marked for the estimate of the light."""
    result = {}
    for kind, key in (("shadowed", "shadowed"), ("sunlit", "sunlit"), ("albedo", "albedos")):
        for index, one in enumerate(getattr(parts.illumination, key, [])):
            outline = one.pixels
            if outline is None:
                turn = np.linspace(0, 2 * np.pi, 25)[:-1]
                outline = _listed(np.asarray(one.pixel) + one.radius * np.stack([np.cos(turn), np.sin(turn)], 1))
            result[f"{key}[{index}]"] = {"kind": kind, "outline": outline}
    return result


def _free_place(placed: Placed) -> np.ndarray | None:
    """Point (3,) [m] of the floor or ground round which most of it is seen."""
    if placed.depth is None:
        return None
    depth = np.where(np.isfinite(placed.depth), placed.depth, np.inf)
    points = placed.camera.position + np.where(np.isfinite(depth), depth, 0)[..., None] * placed.view.directions(
        placed.view.pixel_centres())
    floor = np.isfinite(depth) & (np.abs(points[..., 1]) < COINCIDENT * np.where(np.isfinite(depth), depth, 0))
    if not floor.any():
        return None
    room = cv2.distanceTransform(np.pad(floor.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return points.reshape(-1, 3)[int(np.argmax(room))]
