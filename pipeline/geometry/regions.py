"""Depth from regions of the photograph: support, vertical and sky (Hoiem et al. 2007; Zhao et al. 2013, Fig. 7).

Support lies on the level ground y = 0, vertical regions stand upright on it, and the sky is as far as fog reaches.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import shapely
from scipy import ndimage

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane
from pipeline.side_by_side import side_by_side

#: A wall reaches so many times as far as the farthest point of its foot, and a thing as the point where it stands.
FARTHEST_BEYOND_FOOT = 2.0
#: Components of a painted label below this many pixels join their surroundings.
FEWEST_PIXELS = 12
#: What may lie between regions, as a share of the photograph, and take the depth of what is beside it.
MOST_UNCOVERED = 0.02
#: Horizontal part of a unit line of sight below which it looks down on things, or up to them.
STEEP = 0.5
#: Neighbours in a depth map whose depths differ by more than this share may belong to different things.
DEPTH_STEP = 1.15
#: Pixels at once.
_BLOCK = 1_000_000


class RegionError(InputError):
    """A mistake in the description of one region; `region` is its name."""

    def __init__(self, region: str, problem: str, remedy: str):
        super().__init__(f"{region}: {problem}", remedy=remedy)
        self.region = region


@dataclass(frozen=True)
class Region:
    """A region as it is described, and, once placed, what is seen of it and the planes that it lies on.

    kind: support | vertical | sky | map. mask: (h, w) where it was drawn, in the rows and columns `at` of the
    photograph. foot: (n, 2) [pixel], once placed (n, 3) [m]. Lengths in metres; near and
    far at the lower and upper edge of what was drawn. A `painted` patch has no description of its own. porous: what
    lies behind shows through it.
    """

    name: str
    kind: str
    mask: np.ndarray
    at: tuple[slice, slice] = np.s_[:, :]
    foot: np.ndarray | None = None
    depth: float | None = None
    near: float | None = None
    far: float | None = None
    thickness: float | None = None
    porous: bool = False
    painted: bool = False
    planes: tuple[Plane, ...] = ()

    @property
    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows (n,) and columns (n,) in the photograph."""
        rows, columns = np.nonzero(self.mask)
        return rows + (self.at[0].start or 0), columns + (self.at[1].start or 0)


@dataclass(frozen=True)
class RegionDepth:
    """labels (H, W): index into `regions` of what each pixel shows; depth (H, W) [m] along the ray."""

    labels: np.ndarray
    depth: np.ndarray
    regions: tuple[Region, ...]
    messages: list[str] = field(default_factory=list)


def polygon_mask(shape: tuple[int, int], outline: np.ndarray, holes: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Pixels (H, W) whose centres lie inside an outline (n, 2) [pixel] and in none of the holes.

    Inside is what an odd number of edges surrounds. What is thinner than a pixel is drawn a pixel wide.
    """
    mask = _inside(shape, np.asarray(outline, float))
    for hole in holes:
        mask &= ~_inside(shape, np.asarray(hole, float))
    drawn = shapely.Polygon(outline)
    if shapely.make_valid(drawn).area < drawn.length / 2:
        line = mask.astype(np.uint8)
        # 8 bits after the point; the centre of the first pixel is (0.5, 0.5) of ours and (0, 0) of OpenCV's
        cv2.polylines(line, [np.round((np.asarray(outline, float) - 0.5) * 256).astype(np.int32)], True, 1, shift=8)
        mask = line > 0
    return mask


def _inside(shape: tuple[int, int], polygon: np.ndarray) -> np.ndarray:
    """Pixels (H, W) with an odd number of edges to their left. Neighbours that share an edge share no pixel."""
    mask = np.zeros(shape, bool)
    low, high = (np.clip(np.ceil(end(0) - 0.5), 0, shape[::-1]).astype(int) for end in (polygon.min, polygon.max))
    part = mask[low[1]:high[1], low[0]:high[0]]
    crossed = np.zeros((part.shape[0], part.shape[1] + 1), bool)
    for a, b in zip(polygon, np.roll(polygon, -1, 0)):
        (x0, y0), (x1, y1) = (a, b) if (a[1], a[0]) < (b[1], b[0]) else (b, a)
        first, end = np.clip(np.ceil(np.array([y0, y1]) - 0.5), low[1], high[1]).astype(int)
        if first < end:
            rows = np.arange(first, end)
            x = x0 + (rows + 0.5 - y0) * ((x1 - x0) / (y1 - y0))
            crossed[rows - low[1], np.clip(np.ceil(x - 0.5) - low[0], 0, part.shape[1]).astype(int)] ^= True
    part[:] = np.logical_xor.accumulate(crossed, axis=1)[:, :-1]
    return mask


def cut(mask: np.ndarray) -> tuple[np.ndarray, tuple[slice, slice]]:
    """The part of a mask (H, W) that holds all its pixels, and its rows and columns."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    at = np.s_[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1] if rows.size else np.s_[0:0, 0:0]
    return mask[at].copy(), at


def painted(labels: np.ndarray, colour: int, apart: bool) -> list[tuple[np.ndarray, tuple[slice, slice]]]:
    """Where `labels` (H, W) is `colour`, as `cut` gives it, biggest first; `apart`: one a connected patch."""
    mask = labels == colour
    if not apart:
        return [cut(mask)] if mask.any() else []
    _, patches, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    order = 1 + np.argsort(-facts[1:, cv2.CC_STAT_AREA], kind="stable")
    found = []
    for k in order[facts[order, cv2.CC_STAT_AREA] >= FEWEST_PIXELS]:
        x, y, width, height = facts[k, :4]
        at = np.s_[y:y + height, x:x + width]
        found.append((patches[at] == k, at))
    return found


def torn(depth: np.ndarray, axis: int) -> np.ndarray:
    """Whether neighbours along an axis of a depth map belong to different things, one less than (H, W).

    Along a plane the inverse of depth is (for planar depth, and nearly so for radial) linear: a step that neither
    the one before nor the one after resembles is a tear. NaN is no neighbour.
    """
    inverse = np.moveaxis(1 / depth, axis, 0)
    step = np.diff(inverse, axis=0)
    beside = np.zeros((len(step) + 2, *step.shape[1:]))
    beside[1:-1] = step
    with np.errstate(invalid="ignore"):
        alike = np.fmax(beside[:-2] * np.sign(step), beside[2:] * np.sign(step)) >= 0.5 * np.abs(step)
        ratio = inverse[1:] / inverse[:-1]
        near = np.maximum(ratio, 1 / ratio) < DEPTH_STEP
    return np.moveaxis(~(alike | near), 0, axis)


def depth_of_regions(camera: Camera, regions: Sequence[Region], sky_depth: float,
                     known: np.ndarray | None = None) -> RegionDepth:
    """What each pixel shows, and how far it is, by regions of which later ones lie over earlier ones.

    known: (H, W) [m] radial depth from elsewhere where it is finite, for what no region covers.
    Raises InputError where nothing covers more than a few pixels, and where a region's depth cannot be told.
    """
    labels, regions = np.full((camera.height, camera.width), -1, np.int32), list(regions)
    for index, region in enumerate(regions):
        labels[region.at][region.mask] = index
    if known is not None:
        free = (labels < 0) & np.isfinite(known)
        for name, kind, part in (("map:1", "map", known < sky_depth), ("map:sky", "sky", known >= sky_depth)):
            if (part := free & part).any():
                labels[part] = len(regions)
                regions.append(Region(name, kind, *cut(part)))
    known = _closed(labels, known)
    seen = _as_seen(regions, labels)
    placing = _Placing(camera, regions, seen, labels)
    placed = placing.all()
    depth = np.empty(labels.shape)
    for region in placed:
        def found(where: tuple[np.ndarray, np.ndarray]) -> int:
            directions = camera.directions(np.stack([where[1], where[0]], -1) + 0.5)
            part = depth_along(camera, region, directions, where, sky_depth, known)
            depth[where] = np.clip(part, 1e-3, sky_depth)
            return np.count_nonzero(directions[:, 1] >= 0)

        above = sum(side_by_side(found, _blocks(region)))
        if not region.mask.any():
            placing.messages.append(f"region {region.name} is hidden by later ones, or outside the photograph")
        elif region.kind == "support" and region.near is None and above > MOST_UNCOVERED * region.mask.sum():
            share = above / region.mask.sum()
            placing.messages.append(f"region {region.name}: {share:.0%} of it lies above the horizon, as far as the"
                                    " sky; give it 'near' and 'far', or correct the horizon")
    return RegionDepth(labels, depth, placed, placing.messages)


def _as_seen(regions: Sequence[Region], labels: np.ndarray) -> list[Region]:
    """Regions with the pixels that `labels` (H, W) shows of them."""
    return [replace(region, mask=labels[box] == index, at=box) if box else
            replace(region, mask=np.zeros((0, 0), bool), at=np.s_[0:0, 0:0])
            for index, (region, box) in enumerate(zip(regions, ndimage.find_objects(labels + 1, len(regions))))]


def at_smaller_size(found: RegionDepth, camera: Camera, sky_depth: float) -> RegionDepth:
    """The same regions, where they are, as a camera of the same view sees them in fewer pixels."""
    rows, columns = (((np.arange(few) + 0.5) * many / few).astype(int) for few, many in
                     zip((camera.height, camera.width), found.labels.shape))
    labels = found.labels[np.ix_(rows, columns)]
    placed, depth = _as_seen(found.regions, labels), np.empty(labels.shape)
    for region in placed:
        for where in _blocks(region):
            directions = camera.directions(np.stack([where[1], where[0]], -1) + 0.5)
            in_full = rows[where[0]], columns[where[1]]
            depth[where] = np.clip(depth_along(camera, region, directions, in_full, sky_depth, found.depth), 1e-3, sky_depth)
    return RegionDepth(labels, depth, tuple(placed), found.messages)


def _blocks(region: Region) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The region's pixels, some at a time."""
    step = max(1, _BLOCK // max(region.mask.shape[1], 1))
    for top in range(0, len(region.mask), step):
        rows, columns = np.nonzero(region.mask[top:top + step])
        if rows.size:
            yield rows + top + region.at[0].start, columns + region.at[1].start


def _closed(labels: np.ndarray, known: np.ndarray | None) -> np.ndarray | None:
    """Fills slits between outlines in `labels` with what is nearest; `known` with its depths there."""
    uncovered = labels < 0
    share = float(uncovered.mean())
    if share > MOST_UNCOVERED:
        all_of_them = np.flatnonzero(uncovered)
        row, column = np.unravel_index(all_of_them[len(all_of_them) // 2], labels.shape)
        nothing = "no region" if known is None else "neither a region nor the depth map"
        raise InputError(f"{nothing} covers {share:.1%} of the photograph, for example pixel [{column}, {row}]",
                         remedy="draw regions over all of it" + (", or give a depth 'map'" if known is None else ""))
    if not uncovered.any():
        return known
    nearest = nearest_index(~uncovered)[uncovered]
    labels[uncovered] = labels.ravel()[nearest]
    if known is not None:
        known = known.copy()
        known[uncovered] = known.ravel()[nearest]
    return known


def nearest_index(mask: np.ndarray) -> np.ndarray:
    """Index (H, W), in the flattened image, of the nearest pixel of a mask that is not empty."""
    label = cv2.distanceTransformWithLabels((~mask).astype(np.uint8), cv2.DIST_L2, 5,
                                            labelType=cv2.DIST_LABEL_PIXEL)[1]
    table = np.zeros(label.max() + 1, int)
    table[label[mask]] = np.flatnonzero(mask)
    return table[label]


def depth_along(camera: Camera, region: Region, directions: np.ndarray, where, sky_depth: float,
                known: np.ndarray | None = None) -> np.ndarray:
    """Radial depth (n,) [m] of one region along rays (n, 3), the pixels `where` (rows, columns) of the photograph."""
    if region.kind == "sky":
        return np.full(len(directions), sky_depth)
    if region.kind == "map":
        return known[where]
    distances = [_to_plane(camera.position, directions, plane) for plane in region.planes]
    if region.kind == "support":
        return np.minimum(distances[0], sky_depth)
    # a folded front: the piece of the foot line over which the pixel stands
    found = distances[0] if len(distances) == 1 else np.choose(_piece(camera, region, directions), distances)
    # a wall seen at a grazing angle ends before its plane reaches the horizon
    return np.minimum(found, FARTHEST_BEYOND_FOOT * max(np.linalg.norm(p - camera.position) for p in ends(region)))


def ends(region: Region) -> list[np.ndarray]:
    """Points (3,) [m] of a placed upright region's foot line, or the one where it stands."""
    return [plane.point for plane in region.planes] + ([] if region.foot is None else [region.foot[-1]])


def _piece(camera: Camera, region: Region, directions: np.ndarray) -> np.ndarray:
    """Which segment (n,) of the foot line stands in each ray's vertical plane, the end ones going on."""
    feet = np.array([plane.point for plane in region.planes])[:, [0, 2]] - camera.position[[0, 2]]
    middle = np.arctan2(*(feet[1:].mean(0) * [1, -1]))

    def turned(x, z):
        return (np.arctan2(x, -z) - middle + np.pi) % (2 * np.pi) - np.pi

    first, *borders = turned(feet[:, 0], feet[:, 1])
    bearing = turned(directions[:, 0], directions[:, 2])[:, None]
    # the foot line runs from left to right, or from right to left
    return (bearing > borders if first <= borders[0] else bearing < borders).sum(1)


def _to_plane(eye: np.ndarray, directions: np.ndarray, plane: Plane) -> np.ndarray:
    """Distance along rays to a plane, inf where they run away from it."""
    approach = directions @ plane.normal
    with np.errstate(divide="ignore"):
        distance = ((plane.point - eye) @ plane.normal) / np.where(approach == 0, np.nan, approach)
    return np.where(distance > 0, distance, np.inf)


def ground_point(camera: Camera, pixel: np.ndarray) -> np.ndarray | None:
    """Where the ray through a pixel meets the ground y = 0, (3,) [m]; None at and above the horizon, and from below."""
    ray = camera.directions(np.asarray(pixel, float))
    return None if ray[1] > -1e-6 or camera.position[1] <= 0 else camera.position - ray * (camera.position[1] / ray[1])


class _Placing:
    """Finds the planes of regions, as drawn and as seen in the photograph's `labels`."""

    def __init__(self, camera: Camera, drawn: Sequence[Region], seen: list[Region], labels: np.ndarray):
        self.camera, self.drawn, self.seen, self.labels = camera, drawn, seen, labels
        self.is_support, self.is_upright = (np.array([region.kind == kind for region in seen])
                                            for kind in ("support", "vertical"))
        self.messages: list[str] = []

    def all(self) -> tuple[Region, ...]:
        # upright things stand on what supports them
        order = sorted(range(len(self.seen)), key=lambda i: self.seen[i].kind != "support")
        for i in order:
            self.seen[i] = self._placed(self.seen[i], self.drawn[i])
        self._place_floating()
        return tuple(self.seen)

    def _place_floating(self) -> None:
        """Painted patches that float above the horizon, as far as the upright thing nearest to each."""
        upright = [i for i, region in enumerate(self.seen) if region.kind == "vertical" and region.mask.any()]
        floating = [i for i in upright if not self.seen[i].planes]
        if not floating:
            return
        standing = np.isin(self.labels, [i for i in upright if self.seen[i].planes])
        nearest = nearest_index(standing) if standing.any() else None
        for i in floating:
            self.seen[i] = self._beside(self.seen[i], nearest)

    def _placed(self, region: Region, drawn: Region) -> Region:
        if region.kind == "support" and drawn.mask.any():
            if region.near is not None:
                return replace(region, planes=(self._near_to_far(drawn),))
            if self.camera.position[1] <= 0:
                raise RegionError(region.name, f"the camera lies {self.camera.position[1]:g} m above the ground",
                                  "give the camera a height above 0, or the region 'near' and 'far'")
            return replace(region, planes=(Plane.across("y", 0.0),))
        if region.kind != "vertical" or not region.mask.any():
            return region
        if region.foot is not None:
            points = [self._stands_at(pixel) for pixel in region.foot]
            for pixel, point in zip(region.foot, points):
                if point is None:
                    raise RegionError(region.name, f"its foot [{pixel[0]:g}, {pixel[1]:g}] lies above the horizon",
                                      "put it on the ground, or give the region's 'depth' [m]")
            planes = tuple(Plane(a, _upright(b - a, region.name)) for a, b in zip(points[:-1], points[1:]))
            return replace(region, planes=planes, foot=np.array(points))
        if region.depth is not None:
            return self._facing(region, self.camera.position + region.depth * self._centre(region))
        lowest = self._lowest(region, drawn)
        point = self._stands_at(lowest)
        if point is not None:
            return self._facing(region, point)
        if region.painted:
            return region
        raise RegionError(region.name, f"nowhere reaches below the horizon; its lowest pixel is"
                                       f" [{lowest[0]:g}, {lowest[1]:g}]",
                          "give its 'depth' [m], or a 'foot' on the ground")

    def _facing(self, region: Region, point: np.ndarray) -> Region:
        """Upright and across the line of sight, so that the whole region is about as far."""
        towards = self._centre(region)
        if np.linalg.norm(towards[[0, 2]]) > STEEP:
            towards = np.array([towards[0], 0.0, towards[2]])
        return replace(region, planes=(Plane(point, towards / np.linalg.norm(towards)),))

    def _centre(self, region: Region) -> np.ndarray:
        """Unit direction (3,) to the middle of a region."""
        rows, columns = region.pixels
        return self.camera.directions(np.array([columns.mean() + 0.5, rows.mean() + 0.5]))

    def _near_to_far(self, drawn: Region) -> Plane:
        """The plane that is `near` at the region's lower edge and `far` at its upper one, in its middle column."""
        rows, columns = drawn.pixels
        column = (columns.min() + columns.max() + 1) / 2
        near, far = (self.camera.position + distance * self.camera.directions(np.array([column, row])) for distance, row
                     in ((drawn.near, rows.max() + 1.0), (drawn.far, float(rows.min()))))
        normal = np.cross(self.camera.world_from_camera[:, 0], far - near)
        return Plane(near, normal / np.linalg.norm(normal))

    def _beside(self, region: Region, nearest: np.ndarray | None) -> Region:
        rows, columns = region.pixels
        if nearest is None:
            raise RegionError(region.name, f"the patch painted at [{columns[0]}, {rows[0]}] lies above the horizon",
                              "paint it in a colour of its own, and give that region's 'depth' [m]")
        beside = np.stack(np.unravel_index(nearest[rows, columns], self.labels.shape))
        row, column = beside[:, np.argmin(np.hypot(*(beside - [rows, columns])))]
        other = self.seen[self.labels[row, column]]
        ray = self.camera.directions(np.array([[column, row]]) + 0.5)
        depth = float(depth_along(self.camera, other, ray, ([row], [column]), np.inf)[0])
        self.messages.append(f"region {region.name} nowhere reaches below the horizon; it counts as far as"
                             f" {other.name} beside it, {depth:.3g} m")
        return self._facing(region, self.camera.position + depth * self._centre(region))

    def _lowest(self, region: Region, drawn: Region) -> np.ndarray:
        """Pixel (2,) where a region stands: the lowest below which support begins.

        Where that is hidden, the lowest that was drawn, as far as other upright things hide it.
        """
        rows, columns = region.pixels
        touching = self.is_support[self.labels[np.minimum(rows + 1, len(self.labels) - 1), columns]]
        if not touching.any():
            rows, columns = drawn.pixels
            touching = self.is_upright[self.labels[rows, columns]]
        rows, columns = rows[touching], columns[touching]
        lowest = rows.max()
        return np.array([np.median(columns[rows == lowest]) + 0.5, lowest + 1.0])

    def _stands_at(self, pixel: np.ndarray) -> np.ndarray | None:
        """The point (3,) [m] of the ground that a pixel shows, or would show; None above the horizon.

        Ground with near and far values is as far as they say, all other level.
        """
        row, column = (int(np.clip(pixel[i], 0, self.labels.shape[1 - i] - 1)) for i in (1, 0))
        under = [i for i in np.flatnonzero(self.is_support) if _holds(self.drawn[i], row, column)]
        if not under:  # a painted thing's lowest pixel is not the ground's
            below = self.labels[row:, column]
            under = below[self.is_support[below]][:1].tolist()
        if under and self.seen[under[-1]].near is not None:
            ray = self.camera.directions(np.asarray(pixel, float))
            depth = _to_plane(self.camera.position, ray, *self.seen[under[-1]].planes)
            return self.camera.position + depth * ray if np.isfinite(depth) else None
        return ground_point(self.camera, pixel)


def _holds(region: Region, row: int, column: int) -> bool:
    row, column = row - (region.at[0].start or 0), column - (region.at[1].start or 0)
    return 0 <= row < region.mask.shape[0] and 0 <= column < region.mask.shape[1] and bool(region.mask[row, column])


def _upright(along: np.ndarray, name: str) -> np.ndarray:
    normal = np.array([along[2], 0.0, -along[0]])
    length = np.linalg.norm(normal)
    if length < 1e-9:
        raise RegionError(name, "two points of its foot are one", "give points apart on the ground")
    return normal / length
