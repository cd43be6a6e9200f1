"""Planes, the points of the photograph that lie on them, and planar polygons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera

AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Plane:
    """All points p with normal . (p - point) = 0; point (3,) [m], normal (3,) of unit length."""

    point: np.ndarray
    normal: np.ndarray

    @classmethod
    def across(cls, axis: str, coordinate: float) -> "Plane":
        """The plane `axis` = coordinate [m], e.g. across("y", 0) for the floor."""
        normal = np.eye(3)[AXES[axis]]
        return cls(coordinate * normal, normal)

    @classmethod
    def through(cls, points: np.ndarray) -> "Plane":
        """The plane of least squares through `points`, (N, 3), N >= 3.

        The normal is turned so that its largest component is positive.
        Raises InputError where the points lie on one line.
        """
        points = np.asarray(points, float)
        centre = points.mean(0)
        _, spread, directions = np.linalg.svd(points - centre, full_matrices=True)
        if len(points) < 3 or spread[1] <= 1e-9 * spread[0]:
            raise InputError(
                f"{len(points)} points on one line span no plane",
                remedy="give three points that are not on a line",
            )
        normal = directions[2]
        return cls(centre, normal * np.sign(normal[np.argmax(np.abs(normal))]))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance (...) [m] of `points`, (..., 3); positive on the normal's side."""
        return (np.asarray(points, float) - self.point) @ self.normal

    def seen_at(self, camera: Camera, pixels: np.ndarray, *, name: str = "the plane") -> np.ndarray:
        """World points (..., 3) [m] where the rays through `pixels`, (..., 2), meet the plane.

        `name` stands in messages, e.g. "the floor". Raises InputError where the camera is on the plane
        or a ray runs beside it or away from it, naming the first such pixel.
        """
        pixels = np.asarray(pixels, float)
        height = self.distance(camera.position)
        if abs(height) <= 1e-9 * max(1.0, np.abs(camera.position).max()):
            raise InputError(
                f"the camera lies on {name}, which it therefore sees edge-on",
                remedy="give the camera a height, or the plane another coordinate",
            )
        directions = camera.directions(pixels)
        approach = directions @ self.normal
        # a ray within 1e-9 rad of the plane meets it a billion camera heights away: the horizon itself
        misses = approach * -np.sign(height) <= 1e-9
        if misses.any():
            u, v = pixels[misses].reshape(-1, 2)[0]
            raise InputError(
                f"pixel ({u:g}, {v:g}) lies on or beyond the horizon of {name}: its ray never"
                " meets it in front of the camera",
                remedy=f"move the point to where {name} is visible, or check the camera's angles",
            )
        return camera.position + directions * (-height / approach)[..., None]


def polygon_area_vector(points: np.ndarray) -> np.ndarray:
    """Area [m^2] times unit normal, (3,), of a planar polygon (N, 3) (Newell's method).

    The normal sees the points run counter-clockwise.
    """
    points = np.asarray(points, float)
    relative = points - points[0]
    return np.cross(relative, np.roll(relative, -1, 0)).sum(0) / 2


def polygon_area(points: np.ndarray) -> float:
    """Area of a planar polygon, (N, 3) [m^2] or (N, 2) [pixel^2]; non-convex ones included."""
    return float(np.linalg.norm(polygon_area_vector(_in_space(points))))


def diagonals_crossing(points: np.ndarray) -> np.ndarray | None:
    """Where the diagonals (3,) [m] of a convex quadrilateral (4, 3) meet; None of any other polygon (N, 3)."""
    if len(points) != 4:
        return None
    one, other = points[2] - points[0], points[3] - points[1]
    normal = np.cross(one, other)
    squared = normal @ normal
    if not squared > 0:
        return None
    along, across = (np.cross(points[1] - points[0], v) @ normal / squared for v in (other, one))
    return points[0] + along * one if 0 < along < 1 and 0 < across < 1 else None


def polygon_midpoint(points: np.ndarray) -> np.ndarray:
    """Middle (3,) [m] of a planar polygon (N, 3): where the diagonals of a convex quadrilateral meet, else its centroid.

    Zhao et al. 2013, section 4.2, take the former for a light source.
    """
    points = np.asarray(points, float)
    crossing = diagonals_crossing(points)
    if crossing is not None:
        return crossing
    relative = points - points[0]
    normal = polygon_area_vector(points)
    parts = np.cross(relative[1:-1], relative[2:]) @ normal
    return points[0] + (parts[:, None] * (relative[1:-1] + relative[2:])).sum(0) / (3 * parts.sum())


def polygon_normal(points: np.ndarray) -> np.ndarray:
    """Unit normal (3,) of a planar polygon, (N, 3), that sees the points run counter-clockwise."""
    vector = polygon_area_vector(points)
    length = np.linalg.norm(vector)
    if length == 0:
        raise InputError(
            "a polygon of no area has no normal", remedy="give three points that are not on a line"
        )
    return vector / length


def polygon_centroid(points: np.ndarray) -> np.ndarray:
    """Centre of area, (2,) or (3,), of a planar polygon; it may lie outside a non-convex one."""
    points = np.asarray(points, float)
    relative = _in_space(points - points[0])
    fans = np.cross(relative[1:-1], relative[2:]) @ polygon_normal(relative)
    centre = fans @ (relative[1:-1] + relative[2:]) / (3 * fans.sum())
    return points[0] + centre[: points.shape[1]]


def clean_polygon(
    points: np.ndarray, *, name: str = "polygon", towards: np.ndarray | None = None, orient: bool = True
) -> np.ndarray:
    """A simple polygon from what was clicked: (N, 2) pixels or (N, 3) world points, N >= 3.

    Repeated neighbours (a double click, a closing point) are dropped. With `orient`, the points run
    clockwise in the photograph, or counter-clockwise as seen from `towards`, (3,), (from the positive
    side of the normal's largest component if None), so that a polygon and its reverse are the same
    cycle; the first point stays first.
    Raises InputError naming the polygon for fewer than three distinct points, points on a line, edges
    that cross, world points off a common plane (by over 1 % of their extent), values not finite.
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(
            f"{name}: points have shape {points.shape}", remedy="give a list of [u, v] pixel pairs"
        )
    if not np.isfinite(points).all():
        bad = points[~np.isfinite(points).all(1)][0].tolist()
        raise InputError(f"{name}: point {bad} is not finite", remedy="give plain numbers")
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    # closer than a millionth of the polygon is a repeated click, whatever the unit
    kept: list[np.ndarray] = []
    for point in points:
        if not kept or np.linalg.norm(point - kept[-1]) > 1e-6 * extent:
            kept.append(point)
    while len(kept) > 1 and np.linalg.norm(kept[-1] - kept[0]) <= 1e-6 * extent:
        kept.pop()
    points = np.array(kept)
    if len(points) < 3:
        raise InputError(
            f"{name}: {len(points)} distinct points, and a polygon needs 3",
            remedy="add points round the outline",
        )
    plane = Plane.through(_in_space(points)) if not _on_one_line(points) else None
    if plane is None:
        raise InputError(
            f"{name}: all {len(points)} points lie on one line", remedy="add a point off that line"
        )
    if points.shape[1] == 3 and np.abs(plane.distance(points)).max() > 0.01 * extent:
        off = np.abs(plane.distance(points)).max()
        raise InputError(
            f"{name}: points are up to {off:.3g} m off a common plane",
            remedy="give points of one flat surface",
        )
    ring = shapely.LinearRing(_flattened(points, plane))
    if not ring.is_simple:
        raise InputError(
            f"{name}: its edges cross {_crossing(points, plane)}",
            remedy="list the points in order round the outline",
        )
    if not orient:
        return points
    vector = polygon_area_vector(_in_space(points))
    if points.shape[1] == 2:
        forwards = vector[2] > 0  # v points down: positive area runs clockwise on the screen
    elif towards is None:
        forwards = vector @ plane.normal > 0
    else:
        forwards = vector @ (np.asarray(towards, float) - points.mean(0)) > 0
    return points if forwards else np.concatenate([points[:1], points[:0:-1]])


def _in_space(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points, float)
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def _on_one_line(points: np.ndarray) -> bool:
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return bool(spread[1] <= 1e-9 * spread[0])


def _flattened(points: np.ndarray, plane: Plane) -> np.ndarray:
    """(N, 2) coordinates within the plane."""
    if points.shape[1] == 2:
        return points
    across = np.linalg.svd(plane.normal[None])[2][1:]
    return (points - plane.point) @ across.T


def _crossing(points: np.ndarray, plane: Plane) -> str:
    flat = _flattened(points, plane)
    edges = [shapely.LineString([a, b]) for a, b in zip(flat, np.roll(flat, -1, 0))]
    count = len(edges)
    for i in range(count):
        for j in range(i + 2, count - (i == 0)):
            if edges[i].intersects(edges[j]):
                return f"(edge from point {i + 1} and edge from point {j + 1})"
    return "(an edge runs back along its neighbour)"


def is_convex(corners: np.ndarray) -> bool:
    """Whether a planar polygon (n, 3) turns one way at all corners."""
    along = np.roll(corners, -1, 0) - corners
    turns = np.cross(np.roll(along, 1, 0), along) @ polygon_area_vector(corners)
    return bool((turns >= -1e-12 * np.abs(turns).max(initial=0)).all())


def fan(count: int) -> np.ndarray:
    """Triangles (count - 2, 3) of a convex polygon, as indices of its corners."""
    return np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], -1)
