"""Solid things that stand in for a photograph's depth: as few as its error allows, for the shadows they throw.

Level ground is one polygon, an upright region a slab with the region's outline, and only what comes from a depth map
a mesh, of triangles as large as a stated share of error in depth allows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from shapely.ops import split

from pipeline.geometry.camera import Camera
from pipeline.geometry.meshes import mesh_hits
from pipeline.geometry.regions import Region, RegionDepth, depth_along, torn

#: Outlines are simplified by so many pixels, or so much of the longer side: shadows in fog are softer.
OUTLINE_TOLERANCE, OUTLINE_SHARE = 1.5, 1 / 500
#: An upright region without a stated thickness is so deep, as a share of its width.
THICKNESS_SHARE = 1 / 3
#: A depth map is followed in at most so many steps a side; a power of two.
GRID = 128
#: Share of the rays whose depth must be right to the tolerance.
RIGHT_RAYS = 0.95
#: Rays by which a mesh's depth is compared to the map's.
PROBES = 1500
#: What hides a thing is nearer by this factor.
HIDES = 1.05
#: Share of depth, of `sky_depth`, from which on nothing stands in.
OUT_OF_REACH = 0.999


@dataclass(frozen=True)
class Solid:
    """Triangles (m, 3) over vertices (n, 3) [m]; error: 95th percentile of a mesh's relative depth error, if finite."""

    vertices: np.ndarray
    triangles: np.ndarray
    error: float | None = None


def stand_in(camera: Camera, found: RegionDepth, sky_depth: float, tolerance: float = 0.01) -> dict[str, Solid]:
    """Solids by the names of their regions; regions that are sky, hidden or out of reach have none."""
    solids: dict[str, Solid] = {}
    near = found.depth[found.depth < OUT_OF_REACH * sky_depth]
    reach = float(near.max()) if near.size else sky_depth
    level = next((region for region in found.regions if _is_level(region)), None)
    for region in found.regions:
        if region is level:
            solid = _ground(camera, reach)
        elif region.mask.any() and (region.kind == "vertical" or region.near is not None):
            solid = _slab(camera, _completed(camera, region, found), sky_depth)
        elif region.kind == "map":
            solid = _mesh(camera, region, found, sky_depth, tolerance)
        else:
            continue
        if solid is not None:
            solids[region.name] = solid
    return solids


def _is_level(region: Region) -> bool:
    return region.kind == "support" and region.near is None and bool(region.mask.any())


def _ground(camera: Camera, reach: float) -> Solid:
    x, _, z = camera.position
    corners = np.array([[x - reach, 0, z - reach], [x + reach, 0, z - reach], [x + reach, 0, z + reach],
                        [x - reach, 0, z + reach]])
    return Solid(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def _completed(camera: Camera, region: Region, found: RegionDepth) -> Region:
    """An upright region with what nearer upright things hide of it: within its convex hull it goes on behind them.

    A house with a hole in the shape of the tree before it would let the sun through there.
    """
    if region.kind != "vertical":
        return region
    rows, columns = np.nonzero(region.mask)
    hull = cv2.convexHull(np.stack([columns, rows], 1).astype(np.int32))
    inside = cv2.fillConvexPoly(np.zeros(region.mask.shape, np.uint8), hull, 1) > 0
    others = np.array([other.kind in ("vertical", "map") for other in found.regions])
    hidden = np.nonzero(inside & ~region.mask & others[found.labels[region.at]])
    where = (hidden[0] + (region.at[0].start or 0), hidden[1] + (region.at[1].start or 0))
    own = depth_along(camera, region, camera.directions(np.stack(where[::-1], -1) + 0.5), where, np.inf)
    nearer = found.depth[where] < own / HIDES
    mask = region.mask.copy()
    mask[hidden[0][nearer], hidden[1][nearer]] = True
    return replace(region, mask=mask)


def _slab(camera: Camera, region: Region, sky_depth: float) -> Solid:
    """The region's outline on its planes, each connected part extruded away from the eye along the ground."""
    vertices, triangles, count = [], [], 0
    for polygon in _polygons(region, max(OUTLINE_TOLERANCE, OUTLINE_SHARE * max(camera.width, camera.height))):
        pixels, corners = _flat(camera, region, polygon)
        directions = camera.directions(pixels)
        distance = depth_along(camera, region, directions, None, sky_depth)
        front = camera.position + np.minimum(distance, sky_depth)[:, None] * directions
        if region.kind == "vertical":
            front, corners = _extruded(front, corners, camera.position, region.thickness)
        vertices.append(front)
        triangles.append(corners + count)
        count += len(front)
    return Solid(np.concatenate(vertices), np.concatenate(triangles))


def _extruded(front: np.ndarray, triangles: np.ndarray, eye: np.ndarray, thickness: float | None
              ) -> tuple[np.ndarray, np.ndarray]:
    """A flat mesh with a back behind it and sides between; thickness None: by its width."""
    if thickness is None:
        thickness = THICKNESS_SHARE * float(np.linalg.norm(np.ptp(front[:, [0, 2]], axis=0)))
    if thickness <= 0:
        return front, triangles
    away = front.mean(0) - eye
    away = np.array([away[0], 0.0, away[2]])
    back = front + thickness * away / max(np.linalg.norm(away), 1e-9)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    rim, times = np.unique(edges, axis=0, return_counts=True)
    rim, count = rim[times == 1], len(front)
    sides = np.concatenate([np.column_stack([rim, rim[:, 0] + count]),
                            np.column_stack([rim[:, 1], rim[:, 1] + count, rim[:, 0] + count])])
    return np.concatenate([front, back]), np.concatenate([triangles, triangles + count, sides])


def _flat(camera: Camera, region: Region, polygon: shapely.Polygon) -> tuple[np.ndarray, np.ndarray]:
    """A part of a region in triangles (m, 3) over pixels (n, 2), none of which crosses a fold of its front."""
    pieces = [polygon]
    for fold in _folds(camera, region, polygon.bounds):
        pieces = [part for piece in pieces for part in split(piece, fold).geoms]
    parts = [np.asarray(t.exterior.coords)[:3] for piece in pieces
             for t in shapely.get_parts(shapely.constrained_delaunay_triangles(piece))]
    pixels, triangles = np.unique(np.concatenate(parts).round(3), axis=0, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    return pixels, triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(1)]


def _polygons(region: Region, coarsest: float) -> Iterator[shapely.Polygon]:
    """Outlines [pixel] of each connected part with its holes, simplified as far as much of it stays."""
    # twice as large, so that a line one pixel wide keeps an area; the contour runs through its outer pixels' centres
    doubled = cv2.resize(np.pad(region.mask, 1).astype(np.uint8), None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST)
    contours, tree = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    corner = np.array([region.at[1].start or 0, region.at[0].start or 0]) - 1.0
    for index, (outer, node) in enumerate(zip(contours, tree[0])):
        if node[3] >= 0:
            continue
        inner = [contours[k] for k in np.flatnonzero(tree[0, :, 3] == index)]
        whole = shapely.Polygon(outer[:, 0]).area - sum(shapely.Polygon(hole[:, 0]).area for hole in inner)
        for tolerance in (2 * coarsest, coarsest / 2, 1.0, 0.0):
            flat = _simple(outer, inner, tolerance)
            # thin things lose most of themselves
            if sum(polygon.area for polygon in flat) > 0.5 * whole:
                for polygon in flat:
                    in_pixels = shapely.transform(polygon, lambda xy: (xy + 0.5) / 2 + corner)
                    yield in_pixels.buffer(0.25, join_style="mitre")
                break


def _simple(outer: np.ndarray, inner: list[np.ndarray], tolerance: float) -> list[shapely.Polygon]:
    """A contour and its holes with fewer corners; more than one polygon where it crosses itself by that."""
    rings = [cv2.approxPolyDP(ring, tolerance, True)[:, 0].astype(float) for ring in (outer, *inner)]
    if len(rings[0]) < 3:
        return []
    flat = shapely.Polygon(rings[0], [ring for ring in rings[1:] if len(ring) >= 3])
    flat = flat if flat.is_valid else shapely.make_valid(flat)
    return [p for p in shapely.get_parts(shapely.get_parts(flat)) if p.geom_type == "Polygon" and p.area > 0]


def _folds(camera: Camera, region: Region, bounds: tuple[float, ...]) -> Iterator[shapely.LineString]:
    """Images [pixel] of the upright edges at which a folded front turns, longer than the bounds."""
    for plane in region.planes[1:]:
        foot, above = camera.project(np.array([plane.point, plane.point + [0, 0.1 * camera.position[1], 0]]))[0]
        along = above - foot
        if np.isfinite(along).all() and np.linalg.norm(along) > 0:
            corners = np.array(bounds).reshape(2, 2)
            length = np.abs(corners - foot).sum() + np.ptp(corners, axis=0).sum()
            along *= length / np.linalg.norm(along)
            yield shapely.LineString([foot - along, foot + along])


def _mesh(camera: Camera, region: Region, found: RegionDepth, sky_depth: float, tolerance: float) -> Solid | None:
    """The depth map over a region in triangles as large as the tolerance allows, none across a tear.

    Squares of a grid that one plane or two follow are two triangles, others are divided. A simplifier of meshes would
    shrink the rims that tears leave, and lose a third of the rays.
    """
    if min(region.mask.shape) < 2:
        return None
    depth = np.where(region.mask, found.depth[region.at], np.nan)
    depth = np.where(depth < OUT_OF_REACH * sky_depth, depth, np.nan)
    rows, columns = (np.round(np.linspace(0, n - 1, 2 ** int(np.log2(min(n - 1, GRID))) + 1)).astype(int)
                     for n in depth.shape)
    corner = np.array([region.at[1].start or 0, region.at[0].start or 0]) + 0.5
    directions = camera.directions(np.stack(np.meshgrid(columns, rows), -1) + corner)
    some = depth[np.ix_(rows, columns)]
    # in the photograph's plane the inverse of planar depth is linear over a triangle
    inverse = 1 / (some * (directions @ camera.world_from_camera[:, 2]))
    blocks = _blocks(inverse, torn(some, 0), torn(some, 1), tolerance / 2)
    if not len(blocks):
        return None
    top, left, size = blocks.T
    index = np.arange(some.size).reshape(some.shape)
    a, b, c, d = index[top, left], index[top, left + size], index[top + size, left + size], index[top + size, left]
    used, triangles = np.unique(np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]), return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    vertices = camera.position + some.ravel()[used, None] * directions.reshape(-1, 3)[used]
    row, column = _probes(blocks, rows, columns)
    truth = depth[row, column]
    hit = mesh_hits(camera.position, camera.directions(np.stack([column, row], -1) + corner), vertices, triangles)
    off = np.abs(hit / truth - 1)[np.isfinite(truth)]
    error = float(np.quantile(off, RIGHT_RAYS, method="higher")) if off.size else np.inf
    return Solid(vertices, triangles, error if np.isfinite(error) else None)


def _blocks(inverse: np.ndarray, down: np.ndarray, across: np.ndarray, tolerance: float) -> np.ndarray:
    """Squares (n, 3) of a grid, as top, left and size, over which two triangles follow the inverse of planar depth.

    inverse (2^k + 1, 2^l + 1), NaN where unknown; down, across: tears between its rows, and between its columns.
    """
    size = min(inverse.shape) - 1
    top, left = (np.arange(0, n - 1, size) for n in inverse.shape)
    open_blocks = np.stack(np.meshgrid(top, left, indexing="ij"), -1).reshape(-1, 2)
    found = []
    while size:
        steps = np.arange(size + 1)
        y, x = open_blocks[:, 0, None, None] + steps[:, None], open_blocks[:, 1, None, None] + steps
        values = inverse[y, x]
        rent = down[y[:, :-1], x].any((1, 2)) | across[y, x[..., :-1]].any((1, 2))
        whole = np.isfinite(values).all((1, 2)) & ~rent
        a, b, c, d = (values[:, i, j, None, None] for i, j in ((0, 0), (0, -1), (-1, -1), (-1, 0)))
        v, u = steps[:, None] / size, steps / size
        plain = np.where(u >= v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))
        with np.errstate(invalid="ignore"):
            right = (np.abs(plain - values) <= tolerance * values).all((1, 2))
        done = whole & (right | (size == 1))
        found.append(np.column_stack([open_blocks[done], np.full(done.sum(), size)]))
        size //= 2
        quarters = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * size
        open_blocks = (open_blocks[~done, None] + quarters).reshape(-1, 2)
    return np.concatenate(found)


def _probes(blocks: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (n,) of pixels inside the blocks, as many in each as there is of its area."""
    top, left, size = blocks.T
    area = np.cumsum(size**2)
    at = np.searchsorted(area, (np.arange(PROBES) + 0.5) / PROBES * area[-1])
    # scattered over each block by multiples of irrational numbers
    share = (np.arange(PROBES)[:, None] * [0.7548776662, 0.5698402910]) % 1
    ends = [(edges[start[at]], edges[start[at] + size[at]]) for edges, start in ((rows, top), (columns, left))]
    row, column = (np.round(low + share[:, k] * (high - low)).astype(int) for k, (low, high) in enumerate(ends))
    return row, column


def regions_of(solids: dict[str, Solid], regions: Sequence[Region]) -> dict[str, str]:
    """Which solid stands in for each region: all level ground is one."""
    ground = next((r.name for r in regions if _is_level(r) and r.name in solids), None)
    return {r.name: r.name if r.name in solids else ground for r in regions
            if r.name in solids or (_is_level(r) and ground)}
