"""Solid things that stand in for a photograph's depth: as few as its error allows, for the shadows they throw.

Ground is one polygon, an upright region a slab with the region's outline, and only what comes from a depth map
a mesh, decimated until its depth would be off by more than a stated share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import fast_simplification
import numpy as np
import shapely

from pipeline.geometry.camera import Camera
from pipeline.geometry.meshes import mesh_hits
from pipeline.geometry.regions import Region, RegionDepth, depth_along

#: Outlines are simplified by this many pixels: shadows in fog are softer.
OUTLINE_TOLERANCE = 1.5
#: An upright region without a stated thickness is so deep, as a share of its width.
THICKNESS_SHARE = 1 / 3
#: Neighbours whose depths differ by more than this share belong to different things.
DEPTH_STEP = 1.15
#: Of the longer side: pixels a step of a depth map's grid before it is decimated.
GRID = 160
#: Share of the rays whose depth must be right to the tolerance.
RIGHT_RAYS = 0.95


@dataclass(frozen=True)
class Solid:
    """Triangles (m, 3) over vertices (n, 3) [m]; error: 95th percentile of its relative depth error, if known."""

    vertices: np.ndarray
    triangles: np.ndarray
    error: float | None = None


def stand_in(camera: Camera, found: RegionDepth, sky_depth: float, tolerance: float = 0.01) -> dict[str, Solid]:
    """Solids by the names of their regions; regions that are sky, hidden or out of reach have none."""
    solids: dict[str, Solid] = {}
    near = found.depth[np.isfinite(found.depth) & (found.depth < 0.999 * sky_depth)]
    reach = float(near.max()) if near.size else sky_depth
    grounds = [region for region in found.regions if region.kind == "support" and region.mask.any()]
    if grounds:
        solids[grounds[0].name] = _ground(camera, reach)
    for region in found.regions:
        if region.kind == "vertical" and region.mask.any():
            solid = _slab(camera, region, found, sky_depth)
        elif region.kind == "map":
            solid = _mesh(camera, region, found.depth, sky_depth, tolerance)
        else:
            continue
        if solid is not None:
            solids[region.name] = solid
    return solids


def _ground(camera: Camera, reach: float) -> Solid:
    x, _, z = camera.position
    corners = np.array([[x - reach, 0, z - reach], [x + reach, 0, z - reach], [x + reach, 0, z + reach],
                        [x - reach, 0, z + reach]])
    return Solid(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def _slab(camera: Camera, region: Region, found: RegionDepth, sky_depth: float) -> Solid | None:
    """The region's outline on its planes, extruded away from the eye along the ground."""
    parts: list[np.ndarray] = []
    for outline in _outlines(region.mask):
        flat = shapely.Polygon(outline[0], outline[1:])
        if not flat.is_valid:
            flat = shapely.make_valid(flat)
        for polygon in shapely.get_parts(flat):
            if polygon.geom_type == "Polygon" and polygon.area > 2:
                parts += [np.asarray(t.exterior.coords)[:3] for t in
                          shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))]
    if not parts:
        return None
    pixels, triangles = np.unique(np.concatenate(parts).round(3), axis=0, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    inside = np.clip(np.round(pixels - 0.5).astype(int), 0, [camera.width - 1, camera.height - 1])
    distance = depth_along(camera, region, camera.directions(pixels), (inside[:, 1], inside[:, 0]), sky_depth)
    front = camera.position + np.minimum(distance, sky_depth)[:, None] * camera.directions(pixels)
    width = float(np.linalg.norm((front.max(0) - front.min(0))[[0, 2]]))
    thickness = THICKNESS_SHARE * width if region.thickness is None else region.thickness
    if thickness <= 0:
        return Solid(front, triangles)
    away = front.mean(0) - camera.position
    away = np.array([away[0], 0.0, away[2]])
    back = front + thickness * away / max(np.linalg.norm(away), 1e-9)
    count = len(front)
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    rim, times = np.unique(edges, axis=0, return_counts=True)
    rim = rim[times == 1]
    sides = np.concatenate([np.column_stack([rim, rim[:, 0] + count]),
                            np.column_stack([rim[:, 1], rim[:, 1] + count, rim[:, 0] + count])])
    return Solid(np.concatenate([front, back]), np.concatenate([triangles, triangles + count, sides]))


def _outlines(mask: np.ndarray) -> list[list[np.ndarray]]:
    """Outlines [pixel] of each connected part, its holes after it, simplified."""
    # twice as large, so that a line one pixel wide keeps an area
    doubled = cv2.resize(mask.astype(np.uint8), None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    contours, tree = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    result: dict[int, list[np.ndarray]] = {}
    for index, (contour, node) in enumerate(zip(contours, tree[0] if tree is not None else ())):
        if len(contour) < 3:
            continue
        simple = cv2.approxPolyDP(contour, 2 * OUTLINE_TOLERANCE, True)[:, 0].astype(float)
        if len(simple) >= 3:
            outer = index if node[3] < 0 else node[3]
            result.setdefault(int(outer), []).insert(0 if node[3] < 0 else len(result.get(outer, [])),
                                                     (simple + 0.5) / 2)
    return list(result.values())


def _mesh(camera: Camera, region: Region, depth: np.ndarray, sky_depth: float, tolerance: float) -> Solid | None:
    stride = max(1, int(np.ceil(max(depth.shape) / GRID)))
    rows, columns = np.arange(0, depth.shape[0], stride), np.arange(0, depth.shape[1], stride)
    at = np.ix_(rows, columns)
    some, known = depth[at], region.mask[at] & (depth[at] < 0.999 * sky_depth)
    rays = camera.directions(camera.pixel_centres()[at])
    points = camera.position + some[..., None] * rays
    index = np.arange(some.size).reshape(some.shape)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], -1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    of_corner = some.ravel()[triangles]
    whole = known.ravel()[triangles].all(1) & (of_corner.max(1) < DEPTH_STEP * of_corner.min(1))
    triangles = triangles[whole]
    if not len(triangles):
        return None
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices, triangles = points.reshape(-1, 3)[used], triangles.reshape(-1, 3)
    truth = np.linalg.norm(vertices - camera.position, axis=1)
    probe = np.linspace(0, len(used) - 1, min(len(used), 600)).astype(int)
    directions = (vertices[probe] - camera.position) / truth[probe, None]
    best = Solid(vertices, triangles, 0.0)
    for reduction in (0.98, 0.95, 0.9, 0.8, 0.6, 0.3):
        fewer_vertices, fewer = fast_simplification.simplify(
            vertices.astype(np.float32), triangles.astype(np.int32), target_reduction=reduction)
        if len(fewer) < 4:
            continue
        hit = mesh_hits(camera.position, directions, fewer_vertices, fewer)
        off = np.where(np.isfinite(hit), np.abs(hit / truth[probe] - 1), np.inf)
        error = float(np.quantile(off, RIGHT_RAYS))
        if error <= tolerance:
            best = Solid(fewer_vertices.astype(float), fewer.astype(int), error)
            break
    return best


def regions_of(solids: dict[str, Solid], regions: Sequence[Region]) -> dict[str, str]:
    """Which solid stands in for each region: all ground is one."""
    ground = next((r.name for r in regions if r.kind == "support" and r.name in solids), None)
    return {r.name: r.name if r.name in solids else ground for r in regions
            if r.name in solids or (r.kind == "support" and ground)}
