"""Direction of the sunlight from windows and the sun patches they throw (Zhao et al. 2013, section 5.1).

`sun_direction` is a unit vector that points FROM the sun INTO the scene: the way sunlight travels.

The paper's objective, minimised over d_sun, sums over the windows i

    sum_j arccos(d_sun . d_j)  -  area(S_i and A_i) / area(S_i or A_i)

with d_j from vertex j of the window to the corresponding vertex of its patch, S_i the window cast
along d_sun onto the patch's planes and A_i the annotated patch, both as seen in the photograph. The
sum of radians and a ratio is kept as published. Where we had to decide:

- Correspondence: people start anywhere and go either way round. With as many corners in the patch as
  in the window, the start and the sense in which the directions agree best are taken. Else, or when
  they agree poorly (furniture hides a corner, the patch climbs a wall), only corners that agree on a
  direction are matched; each of the others counts as a constant, `UNMATCHED`, so that alternatives
  with different numbers of matches can be compared. Corners cast from (nearly) where they land, as at
  a door's threshold, show no direction and are left unmatched too. With no match at all the two
  centroids stand in for one pair of corners.
- Frame: the photograph's frame clips neither S nor A, unless the patch has a vertex on the frame.
  There the photograph ended, not the sunlight: both are clipped, and vertices on the frame match no
  corner of the window. What lies behind the camera is always clipped.
- Folds: where a patch continues on another face, the cast onto one face ends at the other.
- Directions along which the cast never meets the patch's plane overlap by 0. That is also the limit as
  the cast recedes to infinity, so the objective stays continuous, and the angles keep it sloping.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import nlopt
import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane, polygon_area, polygon_centroid
from pipeline.geometry.shaft import bounds_other_faces, planar_polygon

# Pairs of corners count as matched within this angle of a common direction: at 3 m, 0.3 m of furniture
# or careless clicking. 2 pixels of annotation noise stay well inside.
MATCH_ANGLE = np.radians(6.0)
# Cost of a window corner without a match, as if it were off by twice the angle at which matching ends.
UNMATCHED = 2 * MATCH_ANGLE
# A ray shorter than this share of the window's extent turns by more than MATCH_ANGLE under the few
# centimetres of a 2-pixel error.
SHORTEST_RAY = 0.15
# Vertices this close to the frame [pixel] were clicked where the photograph ends.
FRAME_MARGIN = 2.0
# Another direction explains the annotation as well if its objective is this close (a tenth of an
# overlap, or 1.4 degrees on each of four corners) and it lies further away than AMBIGUOUS_ANGLE.
NEARLY_EQUAL = 0.1
AMBIGUOUS_ANGLE = np.radians(4.0)
# Beyond these the annotation contradicts itself, and no arrow drawn from it means anything.
LARGEST_RMS = 15.0  # degree
LEAST_OVERLAP = 0.1
# Light nearer than this to the window's plane passes less than 2 % of the window's area.
GRAZING = np.radians(1.0)

Status = Literal["determined", "ambiguous", "impossible"]


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


@dataclass(frozen=True)
class SunEstimate:
    """The way sunlight travels, (3,), and how far to trust it.

    objective: value of the paper's objective (unmatched corners included). confidence: half-angle
    [degree] of the cone that holds 95 % of the directions re-estimated under annotation noise.
    alternatives: directions (3,) that explain the annotation nearly as well, best first. messages: why the
    status is what it is, one line each; notes: what was decided about the annotation on the way.
    """

    sun_direction: np.ndarray
    objective: float
    status: Status
    confidence: float
    openings: tuple[OpeningFit, ...]
    alternatives: tuple[np.ndarray, ...] = ()
    messages: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def estimate_sun_direction(camera: Camera, openings: Sequence[Opening], *, starts: int = 6, seed: int = 0,
                           noise: float = 2.0, resamples: int = 40) -> SunEstimate:
    """The sun direction that best explains the annotated patches (Zhao et al. 2013, section 5.1).

    starts: local minimisations, begun at the best of many candidate directions. The confidence comes
    from re-estimating under `noise` [pixel] of Gaussian error on every vertex, `resamples` times, with
    random numbers from `seed`: at its optimum the objective has a kink wherever d_sun equals some
    d_j, so that a Jacobian there says nothing. 0 resamples skip it, and the confidence is NaN.
    Raises InputError for degenerate polygons, openings without a patch or without a name of their
    own, and patches wholly behind the camera. A well-formed annotation that contradicts itself is
    no error but has status 'impossible'.
    """
    if not openings:
        raise InputError("no window with a sun patch is annotated",
                         remedy="annotate a window and its patch, or set the sun direction by hand")
    names = [o.name for o in openings]
    if repeated := {n for n in names if names.count(n) > 1}:
        raise InputError(f"openings share the name {sorted(repeated)[0]!r}", remedy="give each its own name")
    views = [_View(camera, opening) for opening in openings]
    rng = np.random.default_rng(seed)

    optima: list[_Optimum] = []
    for matching in _matchings(views):
        objective = _Objective(views, matching)
        for start in _start_directions(objective, starts, rng):
            direction, value = _minimise(objective, start)
            optima.append((value, direction, objective))
    value, direction, objective = best = min(optima, key=lambda optimum: optimum[0])

    fits = tuple(view.fit(direction, pairs) for view, pairs in zip(views, objective.matching))
    alternatives = _alternatives(optima, best)
    messages = [m for view, fit in zip(views, fits) for m in _contradictions(view, fit, direction)]
    if direction[1] >= 0:
        below = np.degrees(np.arcsin(min(direction[1], 1.0)))
        messages.insert(0, f"the sun would shine from {below:.1f} degrees below the horizon; "
                           "check which patch belongs to which window")
    status: Status = "impossible" if messages else "ambiguous" if alternatives else "determined"
    if status == "ambiguous":
        away = np.degrees(_angles(direction, alternatives[0]))
        messages.append(f"a direction {away:.1f} degrees away explains {_named(names)} nearly as well; "
                        "annotate a further window, or all corners of the patch")
    confidence = _confidence(objective, direction, noise, resamples, rng)
    notes = tuple(note for view, pairs in zip(views, objective.matching) for note in view.notes(pairs))
    return SunEstimate(direction, value, status, confidence, fits, alternatives, tuple(messages), notes)


_Pairs = tuple[tuple[int, int], ...]  # (window vertex, patch vertex); no window vertex twice


class _View:
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

    def directions(self, pairs: _Pairs) -> np.ndarray:
        """Unit d_j, (j, 3), of the matched vertices; centroid to centroid when there are none."""
        if not pairs:
            patch = np.average([polygon_centroid(p) for p in self.patches], axis=0,
                               weights=[polygon_area(p) for p in self.patches])
            return _unit(patch - polygon_centroid(self.window))[None]
        window, patch = np.array(pairs).T
        return _unit(self.vertices[patch] - self.window[window])

    def matchings(self) -> list[_Pairs]:
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
            spreads = [_spread(self.directions(turn)) for turn in turns]
            if spreads and min(spreads) < MATCH_ANGLE / 2:
                return [turns[int(np.argmin(spreads))]]
        found: set[_Pairs] = set()
        rays = _unit(np.where(usable[..., None], steps, [0, 0, 1.0]))
        for hypothesis in rays[usable]:
            angles = np.where(usable, _angles(rays, hypothesis), np.pi)
            window, patch = linear_sum_assignment(np.minimum(angles, MATCH_ANGLE))
            close = angles[window, patch] < MATCH_ANGLE
            found.add(tuple((int(j), int(k)) for j, k in zip(window[close], patch[close])))
        most = max(map(len, found), default=0)
        # A single pair agrees with itself under any hypothesis: that is no evidence.
        if most < 2:
            return [()]
        distinct: list[_Pairs] = []
        for pairs in sorted((p for p in found if len(p) == most), key=lambda p: _spread(self.directions(p))):
            mean = _mean(self.directions(pairs))
            if all(_angles(mean, _mean(self.directions(d))) > MATCH_ANGLE / 2 for d in distinct):
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

    def fit(self, direction: np.ndarray, pairs: _Pairs) -> OpeningFit:
        residuals = np.degrees(_angles(self.directions(pairs), direction))
        return OpeningFit(self.name, float(self.overlap(direction)), residuals, pairs)

    def notes(self, pairs: _Pairs) -> Iterator[str]:
        if self.on_frame.any():
            yield (f"the patch of window {self.name!r} reaches the photograph's frame and is compared "
                   "inside it")
        if not pairs:
            yield (f"no corners of the patch match window {self.name!r}: its centre and its overlap "
                   "alone speak for the direction")
        elif len(pairs) < len(self.window):
            yield (f"{len(pairs)} of {len(self.window)} corners of window {self.name!r} are matched; "
                   "the others count through the overlap alone")


class _Objective:
    """The paper's objective over unit vectors for one correspondence of vertices."""

    def __init__(self, views: Sequence[_View], matching: Sequence[_Pairs]):
        self.views, self.matching = views, matching
        self.rays = np.concatenate([v.directions(m) for v, m in zip(views, matching)])
        self.unmatched = sum(UNMATCHED * (len(v.window) - len(m)) for v, m in zip(views, matching))

    def __call__(self, direction: np.ndarray) -> float:
        return self.mismatch(direction) - sum(view.overlap(direction) for view in self.views)

    def mismatch(self, direction: np.ndarray) -> float:
        """The angle term [radian], unmatched corners included."""
        return float(_angles(self.rays, direction).sum() + self.unmatched)

    def if_partly_hidden(self, direction: np.ndarray) -> float:
        """The objective of patches of which furniture may hide any part: they need only be covered."""
        return self.mismatch(direction) - sum(view.contained(direction) for view in self.views)


_Optimum = tuple[float, np.ndarray, _Objective]  # value, direction, and under which correspondence


def _matchings(views: Sequence[_View]) -> list[list[_Pairs]]:
    """Joint correspondences: for each candidate of one opening, what agrees best in all the others."""
    candidates = [view.matchings() for view in views]
    means = [[_mean(view.directions(m)) for m in options] for view, options in zip(views, candidates)]
    joint = {tuple(int(np.argmin(_angles(np.array(options), mean))) for options in means)
             for candidate in means for mean in candidate}
    return [[options[i] for options, i in zip(candidates, chosen)] for chosen in sorted(joint)]


def _start_directions(objective: _Objective, starts: int, rng: np.random.Generator) -> list[np.ndarray]:
    """The best `starts` of: the observed directions, their mean, nlopt's global search, random ones."""
    mean = _mean(objective.rays)
    coarse, _ = _minimise(objective, mean, nlopt.GN_DIRECT_L, reach=np.pi / 3, evaluations=150)
    scattered = [_Chart(mean).direction(x) for x in rng.normal(scale=0.3, size=(16, 2))]
    chosen: list[np.ndarray] = []
    for direction in sorted([mean, coarse, *objective.rays[:32], *scattered], key=objective):
        if len(chosen) < max(starts, 1) and all(_angles(direction, c) > np.radians(1) for c in chosen):
            chosen.append(direction)
    return chosen


def _minimise(objective: _Objective, start: np.ndarray, algorithm: int = nlopt.LN_SBPLX, *,
              reach: float = np.pi / 2, step: float = 0.05, tolerance: float = 1e-6,
              evaluations: int = 400) -> tuple[np.ndarray, float]:
    """Minimum within `reach` of `start`, and its value; reach, first step and tolerance in radians.

    Without derivatives, because the angles have kinks, most often just where the minimum is.
    """
    chart, best = _Chart(start), (objective(start), start)

    def evaluate(x, gradient):
        nonlocal best
        direction = chart.direction(x)
        value = objective(direction)
        if value < best[0]:
            best = value, direction
        return value

    search = nlopt.opt(algorithm, 2)
    search.set_lower_bounds([-reach] * 2)
    search.set_upper_bounds([reach] * 2)
    search.set_initial_step(step)
    search.set_xtol_abs(tolerance)
    search.set_maxeval(evaluations)
    search.set_min_objective(evaluate)
    try:
        search.optimize([0.0, 0.0])
    except nlopt.RoundoffLimited:
        pass  # No further progress in float64: the best point so far is the answer.
    return best[1], best[0]


class _Chart:
    """The sphere around a centre in two coordinates [radian]: azimuthal equidistant, singular only behind."""

    def __init__(self, centre: np.ndarray):
        across = np.eye(3)[np.argmin(np.abs(centre))]
        u = _unit(np.cross(centre, across))
        self.centre, self.tangents = centre, np.array([u, np.cross(centre, u)])

    def direction(self, x: np.ndarray) -> np.ndarray:
        angle = np.hypot(*x)
        return _unit(np.cos(angle) * self.centre + np.sinc(angle / np.pi) * (x @ self.tangents))


def _alternatives(optima: Sequence[_Optimum], best: _Optimum) -> tuple[np.ndarray, ...]:
    """Distinct directions that explain the annotation nearly as well and are possible in themselves.

    Besides other local optima these are points of a flat valley around the best one, as a patch much
    smaller than the cast window leaves: it fits anywhere inside. Where corners are unmatched, the missing
    part of the patch may be hidden, and a small overlap is no evidence against another correspondence.
    """
    value, direction, objective = best
    chart = _Chart(direction)
    turns = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    valley = [chart.direction(1.01 * AMBIGUOUS_ANGLE * np.array([np.cos(t), np.sin(t)])) for t in turns]
    excess = [(objective(d) - value, d) for d in valley]
    hidden = objective.if_partly_hidden(direction)
    for other_value, other, other_objective in optima:
        further = other_value - value
        if objective.unmatched and other_objective.unmatched:
            further = min(further, other_objective.if_partly_hidden(other) - hidden)
        excess.append((further, other))
    chosen: list[np.ndarray] = []
    for further, other in sorted(excess, key=lambda pair: pair[0]):
        if (further < NEARLY_EQUAL and other[1] < 0
                and all(_entering(view, other) > GRAZING and view.overlap(other) > LEAST_OVERLAP
                        for view in objective.views)
                and all(_angles(other, d) > AMBIGUOUS_ANGLE for d in [direction, *chosen])):
            chosen.append(other)
    return tuple(chosen[:3])


def _entering(view: _View, direction: np.ndarray) -> float:
    """Angle [radian] at which light enters the room through the window's plane; negative when it leaves."""
    inward = view.window_plane[:3] * _room_side(view)
    return float(np.arctan2(inward @ direction, np.linalg.norm(np.cross(inward, direction))))


def _room_side(view: _View) -> float:
    """Which side (+1 or -1) of the window's plane is the room: the one from which it was photographed."""
    return float(np.sign(view.camera.position @ view.window_plane[:3] - view.window_plane[3]) or 1.0)


def _contradictions(view: _View, fit: OpeningFit, direction: np.ndarray) -> Iterator[str]:
    heights = (view.vertices @ view.window_plane[:3] - view.window_plane[3]) * _room_side(view)
    entering = _entering(view, direction)
    if heights.mean() <= 0:
        yield (f"the patch of window {view.name!r} lies on the far side of the window, seen from the camera; "
               "check the window's plane and which patch belongs to it")
    elif entering < -GRAZING:
        yield f"sunlight would leave the room through window {view.name!r}; check its plane and its patch"
    elif entering <= GRAZING:
        yield f"sunlight would run parallel to window {view.name!r}, and none would enter; check its plane"
    if fit.rms > LARGEST_RMS:
        yield (f"corners of window {view.name!r} disagree with the direction by {fit.rms:.1f} degrees RMS "
               f"(at most {LARGEST_RMS:g}); check which patch belongs to it")
    if fit.overlap < LEAST_OVERLAP:
        yield (f"window {view.name!r}, cast along the direction, overlaps its patch by "
               f"{100 * fit.overlap:.0f} % of their union (at least {100 * LEAST_OVERLAP:.0f} % needed); "
               "check the patch's outline and plane")


def _confidence(objective: _Objective, direction: np.ndarray, noise: float, resamples: int,
                rng: np.random.Generator) -> float:
    """95 % half-angle [degree] of directions re-estimated from vertices moved by `noise` [pixel]."""
    angles = []
    for _ in range(resamples):
        redrawn = [_View(view.camera, perturbed(view.camera, view.opening, noise, rng), view.on_frame)
                   for view in objective.views]
        moved, _ = _minimise(_Objective(redrawn, objective.matching), direction, tolerance=2e-3, step=0.02)
        angles.append(np.degrees(_angles(moved, direction)))
    return float(np.percentile(angles, 95)) if angles else float("nan")


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


def _spread(rays: np.ndarray) -> float:
    """Mean angle [radian] of unit vectors, (n, 3), from their mean direction."""
    return float(_angles(rays, _mean(rays)).mean())


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles [radian] between vectors, (..., 3); exact near 0 and pi, where arccos loses half its digits."""
    a, b = np.broadcast_arrays(a, b)
    crossed = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return np.arctan2(np.sqrt((crossed**2).sum(-1)), (a * b).sum(-1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _mean(rays: np.ndarray) -> np.ndarray:
    """Mean direction of unit vectors, (n, 3); the first of them where they cancel."""
    total = rays.sum(0)
    return _unit(total if np.linalg.norm(total) > 1e-6 else rays[0])


def _four_numbers(plane: Plane, polygon: np.ndarray, name: str) -> np.ndarray:
    """The plane as (nx, ny, nz, offset). Raises InputError unless it holds the polygon."""
    off = np.abs(plane.distance(polygon)).max()
    if off > 0.01 * np.ptp(polygon, axis=0).max():
        raise InputError(f"{name} stands {off:.3g} m off its plane",
                         remedy="annotate it on the face that it falls on")
    return np.append(plane.normal, plane.normal @ plane.point)


def _named(names: Sequence[str]) -> str:
    return ("window " if len(names) == 1 else "windows ") + ", ".join(repr(n) for n in names)
