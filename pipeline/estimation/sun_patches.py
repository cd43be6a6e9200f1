"""Windows and their annotated sun patches: corners that correspond, and the overlap in the photograph."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from pipeline.errors import InputError
from pipeline.estimation.spherical import angles_between, mean_direction, spread, unit
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane, polygon_area, polygon_centroid
from pipeline.geometry.shaft import bounds_other_faces, planar_polygon

# Pairs of corners count as matched within this angle of a common direction: at 3 m, 0.3 m of furniture
# or careless clicking. 2 pixels of annotation noise stay well inside.
MATCH_ANGLE = np.radians(6.0)
# A ray shorter than this share of the window's extent turns by more than MATCH_ANGLE under the few
# centimetres of a 2-pixel error.
SHORTEST_RAY = 0.15
# Vertices this close to the frame [pixel] were clicked where the photograph ends.
FRAME_MARGIN = 2.0
Pairs = tuple[tuple[int, int], ...]  # (window vertex, patch vertex); no window vertex twice


@dataclass(frozen=True)
class Opening:
    """A window, or open door, and the sun patch it throws.

    window: (m, 3) world [m], in order around its outline. patches: one (polygon (k, 3) [m], plane) per
    face that the patch falls on; plane None stands for the polygon's own. The annotation in pixels is
    the projection of these polygons; there is no second copy of it that could disagree.
    """

    name: str
    window: np.ndarray
    patches: Sequence[tuple[np.ndarray, Plane | None]]


@dataclass(frozen=True)
class OpeningFit:
    """How well one opening agrees with the estimated direction.

    overlap: intersection over union of the cast window and the patch in the photograph.
    angle_residuals: [degree], one per matched pair of corners, between the pair's and the estimated
    direction; of the centroids when no corner matches. matched: (window vertex, patch vertex) indices,
    patch vertices counted through all its parts.
    """

    name: str
    overlap: float
    angle_residuals: np.ndarray
    matched: tuple[tuple[int, int], ...]

    @property
    def rms(self) -> float:
        """Root mean square of the angle residuals [degree]."""
        return float(np.sqrt(np.mean(self.angle_residuals**2)))

    @property
    def largest(self) -> float:
        """Largest angle residual [degree]."""
        return float(self.angle_residuals.max())


class View:
    """One opening with all that does not depend on the sun direction."""

    def __init__(self, camera: Camera, opening: Opening, on_frame: np.ndarray | None = None):
        self.camera, self.opening, self.name = camera, opening, opening.name
        self.window, self.window_plane = planar_polygon(opening.window, f"window {opening.name!r}")
        if not len(opening.patches):
            raise InputError(f"window {self.name!r} has no sun patch",
                             remedy="annotate the patch that its sunlight throws, or leave the window out")
        self.patches, self.planes = [], []
        for i, (polygon, plane) in enumerate(opening.patches):
            patch_name = f"sun patch {i + 1} of window {self.name!r}"
            polygon, own = planar_polygon(polygon, patch_name)
            self.patches.append(polygon)
            self.planes.append(own if plane is None else _four_numbers(plane, polygon, patch_name))
        self.extent = np.ptp(self.window, axis=0).max()
        if abs(camera.position @ self.window_plane[:3] - self.window_plane[3]) < 1e-6 * self.extent:
            raise InputError(f"the camera stands in the plane of window {self.name!r}",
                             remedy="check the wall that the window was put on")
        self.folds = [[other for j, other in enumerate(self.planes) if j != i
                       and bounds_other_faces(other, self.window, self.patches[i])
                       and np.linalg.norm(np.cross(other[:3], self.planes[i][:3])) > 1e-3]
                      for i in range(len(self.patches))]
        self.vertices = np.concatenate(self.patches)
        self.near = 1e-4 * np.linalg.norm(self.window.mean(0) - camera.position)
        self.frame = shapely.box(0, 0, camera.width, camera.height)
        self.on_frame = _on_frame(camera, self.vertices) if on_frame is None else on_frame
        self.area = self._region(self.patches)
        if not self.area.area > 0:
            raise InputError(f"the sun patch of window {self.name!r} has no area in the photograph",
                             remedy="annotate a patch that the camera sees")

    def _image(self, polygon: np.ndarray) -> shapely.Geometry | None:
        in_camera = (polygon - self.camera.position) @ self.camera.world_from_camera
        in_camera = _clip(in_camera, np.array([0.0, 0.0, 1.0]), self.near)
        if len(in_camera) < 3:
            return None
        pixels = self.camera.focal_length * in_camera[:, :2] / in_camera[:, 2:] + self.camera.principal_point
        outline = shapely.Polygon(pixels)
        return outline if outline.is_valid else outline.buffer(0)

    def _region(self, polygons: Sequence[np.ndarray]) -> shapely.Geometry:
        images = [image for p in polygons if len(p) >= 3 and (image := self._image(p)) is not None]
        region = images[0] if len(images) == 1 else shapely.union_all(images)
        return region.intersection(self.frame) if self.on_frame.any() else region

    def cast(self, direction: np.ndarray) -> shapely.Geometry:
        """S_i: the window cast along `direction` on the patch's planes, in the photograph [pixel]."""
        polygons = []
        for plane, folds in zip(self.planes, self.folds):
            rate = plane[:3] @ direction
            ahead = plane[3] - self.window @ plane[:3]
            if abs(rate) < 1e-9:
                continue
            window = self.window
            if (ahead * np.sign(rate)).min() < 0:
                window = _clip(window, -np.sign(rate) * plane[:3], -np.sign(rate) * plane[3])
                ahead = plane[3] - window @ plane[:3]
            polygon = window + (ahead / rate)[:, None] * direction
            for fold in folds:
                side = np.sign((self.window @ fold[:3] - fold[3]).mean())
                polygon = _clip(polygon, side * fold[:3], side * fold[3])
            polygons.append(polygon)
        return self._region(polygons)

    def overlap(self, direction: np.ndarray) -> float:
        """Intersection over union of the cast window and the patch in the photograph."""
        cast = self.cast(direction)
        both = cast.intersection(self.area).area
        return both / (cast.area + self.area.area - both)

    def contained(self, direction: np.ndarray) -> float:
        """Share of the patch that the cast window covers in the photograph."""
        return self.cast(direction).intersection(self.area).area / self.area.area

    def directions(self, pairs: Pairs) -> np.ndarray:
        """Unit d_j, (j, 3), of the matched vertices; centroid to centroid when there are none."""
        if not pairs:
            patch = np.average([polygon_centroid(p) for p in self.patches], axis=0,
                               weights=[polygon_area(p) for p in self.patches])
            return unit(patch - polygon_centroid(self.window))[None]
        window, patch = np.array(pairs).T
        return unit(self.vertices[patch] - self.window[window])

    def matchings(self) -> list[Pairs]:
        """Plausible correspondences between window and patch vertices, those with most matches only."""
        m = len(self.window)
        steps = self.vertices - self.window[:, None]
        lengths = np.linalg.norm(steps, axis=-1)
        usable = (lengths > SHORTEST_RAY * self.extent) & ~self.on_frame & ~self._on_fold()
        if len(self.patches) == 1 and len(self.vertices) == m and not self.on_frame.any():
            turns = [tuple((j, (start + sense * j) % m) for j in range(m))
                     for start in range(m) for sense in (1, -1)]
            turns = [tuple(pair for pair in turn if usable[pair]) for turn in turns]
            turns = [turn for turn in turns if len(turn) >= 2]
            spreads = [spread(self.directions(turn)) for turn in turns]
            if spreads and min(spreads) < MATCH_ANGLE / 2:
                return [turns[int(np.argmin(spreads))]]
        found: set[Pairs] = set()
        rays = unit(np.where(usable[..., None], steps, [0, 0, 1.0]))
        for hypothesis in rays[usable]:
            angles = np.where(usable, angles_between(rays, hypothesis), np.pi)
            window, patch = linear_sum_assignment(np.minimum(angles, MATCH_ANGLE))
            close = angles[window, patch] < MATCH_ANGLE
            found.add(tuple((int(j), int(k)) for j, k in zip(window[close], patch[close])))
        most = max(map(len, found), default=0)
        # A single pair agrees with itself under any hypothesis: that is no evidence.
        if most < 2:
            return [()]
        distinct: list[Pairs] = []
        for pairs in sorted((p for p in found if len(p) == most), key=lambda p: spread(self.directions(p))):
            mean = mean_direction(self.directions(pairs))
            if all(angles_between(mean, mean_direction(self.directions(d))) > MATCH_ANGLE / 2
                   for d in distinct):
                distinct.append(pairs)
        return distinct[:4]

    def _on_fold(self) -> np.ndarray:
        """Which patch vertices lie where one face of the patch meets another: no corner was cast there."""
        flags = []
        gap = 0.05 * self.extent
        for polygon, folds in zip(self.patches, self.folds):
            near = [np.abs(polygon @ fold[:3] - fold[3]) < gap for fold in folds]
            flags.append(np.any(near, axis=0) if near else np.zeros(len(polygon), bool))
        return np.concatenate(flags)

    def fit(self, direction: np.ndarray, pairs: Pairs) -> OpeningFit:
        residuals = np.degrees(angles_between(self.directions(pairs), direction))
        return OpeningFit(self.name, float(self.overlap(direction)), residuals, pairs)

    def notes(self, pairs: Pairs) -> Iterator[str]:
        if self.on_frame.any():
            yield (f"the patch of window {self.name!r} reaches the photograph's frame and is compared "
                   "inside it")
        if not pairs:
            yield (f"no corners of the patch match window {self.name!r}: its centre and its overlap "
                   "alone speak for the direction")
        elif len(pairs) < len(self.window):
            yield (f"{len(pairs)} of {len(self.window)} corners of window {self.name!r} are matched; "
                   "the others count through the overlap alone")


def joint_matchings(views: Sequence[View]) -> list[list[Pairs]]:
    """Joint correspondences: for each candidate of one opening, what agrees best in all the others."""
    candidates = [view.matchings() for view in views]
    means = [[mean_direction(view.directions(m)) for m in options]
             for view, options in zip(views, candidates)]
    joint = {tuple(int(np.argmin(angles_between(np.array(options), mean))) for options in means)
             for candidate in means for mean in candidate}
    return [[options[i] for options, i in zip(candidates, chosen)] for chosen in sorted(joint)]


def perturbed(camera: Camera, opening: Opening, noise: float, rng: np.random.Generator) -> Opening:
    """The opening annotated again with Gaussian error of `noise` [pixel] on each vertex.

    Vertices move within their planes. One stays where it is if the camera does not see it, or if its
    moved ray misses the plane. A draw that leaves a polygon degenerate is drawn again, and after ten
    such draws the polygon is returned as it was.
    """
    def again(polygon, plane):
        pixels, _ = camera.project(polygon)
        for _ in range(10):
            rays = camera.directions(pixels + rng.normal(scale=noise, size=pixels.shape))
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (plane[3] - camera.position @ plane[:3]) / (rays @ plane[:3])
            seen = np.isfinite(depth) & (depth > 0)
            hits = camera.position + np.where(seen, depth, 0)[:, None] * rays
            moved = np.where(seen[:, None], hits, polygon)
            try:
                checked, _ = planar_polygon(moved, "redrawn")
            except InputError:
                continue
            if len(checked) == len(polygon):
                return checked
        return polygon

    window, plane = planar_polygon(opening.window, f"window {opening.name!r}")
    patches = []
    for i, (polygon, given) in enumerate(opening.patches):
        polygon, own = planar_polygon(polygon, f"sun patch {i + 1} of window {opening.name!r}")
        plane4 = own if given is None else np.append(given.normal, given.normal @ given.point)
        patches.append((again(polygon, plane4), given))
    return Opening(opening.name, again(window, plane), patches)


def _clip(polygon: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    """The part of a polygon, (n, 3), with normal . x >= offset (Sutherland & Hodgman 1974); may be empty."""
    heights = polygon @ normal - offset
    if (heights >= 0).all():
        return polygon
    kept = []
    for i, height in enumerate(heights):
        following = (i + 1) % len(heights)
        if height >= 0:
            kept.append(polygon[i])
        if height * heights[following] < 0:
            share = height / (height - heights[following])
            kept.append(polygon[i] + share * (polygon[following] - polygon[i]))
    return np.array(kept).reshape(-1, 3)


def _on_frame(camera: Camera, vertices: np.ndarray) -> np.ndarray:
    """Which vertices, (n, 3), lie on the edge of the photograph; (n,) bool."""
    pixels, _ = camera.project(vertices)
    size = np.array([camera.width, camera.height])
    near = (np.abs(pixels) <= FRAME_MARGIN) | (np.abs(pixels - size) <= FRAME_MARGIN)
    within = (pixels >= -FRAME_MARGIN).all(-1) & (pixels <= size + FRAME_MARGIN).all(-1)
    return near.any(-1) & within


def _four_numbers(plane: Plane, polygon: np.ndarray, name: str) -> np.ndarray:
    """The plane as (nx, ny, nz, offset). Raises InputError unless it holds the polygon."""
    off = np.abs(plane.distance(polygon)).max()
    if off > 0.01 * np.ptp(polygon, axis=0).max():
        raise InputError(f"{name} stands {off:.3g} m off its plane",
                         remedy="annotate it on the face that it falls on")
    return np.append(plane.normal, plane.normal @ plane.point)
