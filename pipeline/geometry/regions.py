"""Depth from regions of the photograph: support, vertical and sky (Hoiem et al. 2007; Zhao et al. 2013, Fig. 7).

Support lies on the level ground y = 0, vertical regions stand upright on it, and the sky is as far as fog reaches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane

#: A wall reaches so many times as far as the farthest point of its foot.
FARTHEST_BEYOND_FOOT = 2.0
#: Components of a painted label below this many pixels join their surroundings.
FEWEST_PIXELS = 12


@dataclass(frozen=True)
class Region:
    """A region as it is described, and, once placed, the planes (point, normal) that it lies on.

    kind: support | vertical | sky | map. mask: (H, W) where it was drawn. foot: (n, 2) [pixel]. Lengths in metres.
    """

    name: str
    kind: str
    mask: np.ndarray
    foot: np.ndarray | None = None
    depth: float | None = None
    near: float | None = None
    far: float | None = None
    thickness: float | None = None
    planes: tuple[Plane, ...] = ()


@dataclass(frozen=True)
class RegionDepth:
    """labels (H, W): index into `regions` of what each pixel shows; depth (H, W) [m] along the ray."""

    labels: np.ndarray
    depth: np.ndarray
    regions: tuple[Region, ...]
    messages: list[str] = field(default_factory=list)


def polygon_mask(shape: tuple[int, int], outline: np.ndarray, holes: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Pixels (H, W) whose centres lie inside an outline (n, 2) [pixel] and in none of the holes."""
    mask = np.zeros(shape, np.uint8)
    # 8 bits after the point; the centre of the first pixel is (0.5, 0.5) of ours and (0, 0) of OpenCV's
    for polygon, value in [(outline, 1), *((hole, 0) for hole in holes)]:
        fixed = np.round((np.asarray(polygon, float) - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(mask, [fixed], value, lineType=cv2.LINE_8, shift=8)
    return mask > 0


def painted(labels: np.ndarray, colour: np.ndarray, apart: bool) -> list[np.ndarray]:
    """Masks (H, W) of a colour (3,) in a painted picture (H, W, 3) uint8, biggest first; `apart`: one a patch."""
    mask = (labels == colour).all(-1)
    if not apart:
        return [mask] if mask.any() else []
    count, patches, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    order = 1 + np.argsort(-facts[1:, cv2.CC_STAT_AREA], kind="stable")
    return [patches == k for k in order if facts[k, cv2.CC_STAT_AREA] >= FEWEST_PIXELS]


def depth_of_regions(camera: Camera, regions: Sequence[Region], sky_depth: float,
                     known: np.ndarray | None = None) -> RegionDepth:
    """What each pixel shows, and how far it is, by regions of which later ones lie over earlier ones.

    known: (H, W) [m] radial depth from elsewhere where it is finite, for what no region covers.
    Raises InputError where nothing covers more than a few pixels, and where a region's depth cannot be told.
    """
    shape = (camera.height, camera.width)
    labels, messages = np.full(shape, -1, np.int32), []
    for index, region in enumerate(regions):
        labels[region.mask] = index
    regions = list(regions)
    if known is not None and (free := (labels < 0) & np.isfinite(known)).any():
        labels[free] = len(regions)
        regions.append(Region("map", "map", free))
    uncovered = labels < 0
    if uncovered.mean() > 0.02:
        row, column = np.argwhere(uncovered)[len(np.argwhere(uncovered)) // 2]
        raise InputError(f"no region covers {uncovered.mean():.1%} of the photograph, for example pixel"
                         f" [{column}, {row}]", remedy="draw regions over all of it, or give a depth 'map'")
    if uncovered.any():  # slits between outlines
        nearest = cv2.distanceTransformWithLabels(uncovered.astype(np.uint8), cv2.DIST_L2, 5,
                                                  labelType=cv2.DIST_LABEL_PIXEL)[1]
        of_pixel = np.zeros(nearest.max() + 1, np.int32)
        of_pixel[nearest[~uncovered]] = labels[~uncovered]
        labels[uncovered] = of_pixel[nearest[uncovered]]
    placed = tuple(replace(region, mask=labels == index) for index, region in enumerate(regions))
    placed = tuple(_placed(camera, region, placed, messages) for region in placed)
    depth = np.empty(shape)
    directions = camera.directions(camera.pixel_centres())
    for region in placed:
        if region.mask.any():
            part = depth_along(camera, region, directions[region.mask], np.nonzero(region.mask), sky_depth, known)
            depth[region.mask] = np.clip(part, 1e-3, sky_depth)
        else:
            messages.append(f"region {region.name} is hidden by later ones, or outside the photograph")
    return RegionDepth(labels, depth, placed, messages)


def depth_along(camera: Camera, region: Region, directions: np.ndarray, where, sky_depth: float,
                known: np.ndarray | None = None) -> np.ndarray:
    """Radial depth (n,) [m] of one region along rays (n, 3), the pixels `where` (rows, columns) of the photograph."""
    if region.kind == "sky":
        return np.full(len(directions), sky_depth)
    if region.kind == "map":
        return known[where]
    if region.near is not None:
        rows = np.nonzero(region.mask.any(1))[0]
        bottom, top = rows.max(), rows.min()
        share = (where[0] - top) / max(bottom - top, 1)
        return 1 / (share / region.near + (1 - share) / region.far)
    distances = [_to_plane(camera.position, directions, plane) for plane in region.planes]
    if region.kind == "support":
        return np.minimum(distances[0], sky_depth)
    # a folded front: the piece of the foot line over which the pixel stands
    found = distances[0] if len(distances) == 1 else np.choose(_piece(camera, region, directions), distances)
    if region.foot is None:
        return found
    # a wall seen at a grazing angle ends before its plane reaches the horizon
    feet = [np.linalg.norm(ground_point(camera, pixel) - camera.position) for pixel in region.foot]
    return np.minimum(found, FARTHEST_BEYOND_FOOT * max(feet))


def _piece(camera: Camera, region: Region, directions: np.ndarray) -> np.ndarray:
    """Which segment (n,) of the foot line stands in each ray's vertical plane, the end ones going on."""
    feet = np.array([plane.point for plane in region.planes][1:]) - camera.position
    bearing = np.arctan2(directions[:, 0], -directions[:, 2])
    borders = np.arctan2(feet[:, 0], -feet[:, 2])
    middle = np.arctan2(*(np.mean(feet[:, [0, 2]], 0) * [1, -1]))
    turned = (bearing - middle + np.pi) % (2 * np.pi) - np.pi
    borders = (borders - middle + np.pi) % (2 * np.pi) - np.pi
    first = _bearing_of_first(camera, region, middle)
    if first > borders[0]:  # the foot line runs from right to left
        return np.clip((turned[:, None] < borders).sum(1), 0, len(region.planes) - 1)
    return np.clip((turned[:, None] > borders).sum(1), 0, len(region.planes) - 1)


def _bearing_of_first(camera: Camera, region: Region, middle: float) -> float:
    start = region.planes[0].point - camera.position
    return (np.arctan2(start[0], -start[2]) - middle + np.pi) % (2 * np.pi) - np.pi


def _to_plane(eye: np.ndarray, directions: np.ndarray, plane: Plane) -> np.ndarray:
    """Distance along rays to a plane, inf where they run away from it."""
    approach = directions @ plane.normal
    with np.errstate(divide="ignore"):
        distance = ((plane.point - eye) @ plane.normal) / np.where(approach == 0, np.nan, approach)
    return np.where(distance > 0, distance, np.inf)


def ground_point(camera: Camera, pixel: np.ndarray) -> np.ndarray | None:
    """Where the ray through a pixel meets the ground y = 0, (3,) [m]; None at and above the horizon."""
    ray = camera.directions(np.asarray(pixel, float))
    return None if ray[1] > -1e-6 else camera.position - ray * (camera.position[1] / ray[1])


def _placed(camera: Camera, region: Region, regions: Sequence[Region], messages: list[str]) -> Region:
    """The region with its planes."""
    if region.kind == "support" and region.near is None:
        return replace(region, planes=(Plane.across("y", 0.0),))
    if region.kind != "vertical" or not region.mask.any():
        return region
    if region.foot is not None:
        points = [ground_point(camera, pixel) for pixel in region.foot]
        for pixel, point in zip(region.foot, points):
            if point is None:
                raise InputError(f"{region.name}: its foot [{pixel[0]:g}, {pixel[1]:g}] lies above the horizon",
                                 remedy="put it on the ground, or give the region's 'depth' [m]")
        planes = tuple(Plane(a, _upright(b - a, region.name)) for a, b in zip(points[:-1], points[1:]))
        return replace(region, planes=planes)
    rows, columns = np.nonzero(region.mask)
    centre = camera.directions(np.array([columns.mean() + 0.5, rows.mean() + 0.5]))
    if region.depth is not None:
        point = camera.position + region.depth * centre
    else:
        point = ground_point(camera, _lowest(region, regions))
        if point is None:
            raise InputError(f"{region.name} nowhere reaches below the horizon",
                             remedy="give its 'depth' [m], or a 'foot' on the ground")
    # upright and across the line of sight, so that the whole region is about as far
    towards = np.array([centre[0], 0.0, centre[2]])
    if np.linalg.norm(towards) < 1e-6:
        towards = np.array([0.0, 0.0, -1.0])
    return replace(region, planes=(Plane(point, towards / np.linalg.norm(towards)),))


def _lowest(region: Region, regions: Sequence[Region]) -> np.ndarray:
    """Pixel (2,) where a region stands on the ground: the lowest below which support begins, else its lowest."""
    support = np.zeros(region.mask.shape, bool)
    for other in regions:
        if other.kind == "support":
            support |= other.mask
    below = np.zeros_like(support)
    below[:-1] = support[1:]
    touching = region.mask & below
    rows, columns = np.nonzero(touching if touching.any() else region.mask)
    lowest = rows.max()
    return np.array([np.median(columns[rows == lowest]) + 0.5, lowest + 1.0])


def _upright(along: np.ndarray, name: str) -> np.ndarray:
    normal = np.array([along[2], 0.0, -along[0]])
    length = np.linalg.norm(normal)
    if length < 1e-9:
        raise InputError(f"{name}: two points of its foot are one", remedy="give points apart on the ground")
    return normal / length
