"""Single scattering in homogeneous fog by numerical quadrature: the known answer for the renders.

Computes the in-scattering V, the transmittance T and the direct irradiance E (Zhao et al. 2013,
section 4) of point, spot, rectangle and window-sun lights among opaque convex polygons, without
POV-Ray and without any module of the pipeline.

Method. The shadow that one convex polygon throws from one light point is a convex volume, so a
straight line crosses it in a single interval: shadows are exact and there is nothing to sample.
What a light point sees of a line is integrated in the equi-angular variable, in which 1/d^2 is
constant, with Gauss-Kronrod (7, 15) rules halved until their two orders agree. A lamp's area is a
quadtree of Gauss patches, refined for each ray until a patch agrees with its four children, which
follows penumbrae and rays that pass close to the lamp.

Conventions: metres, world axes as in `pipeline.geometry.camera`; phase functions take the cosine of
the angle between *propagation* directions (1 = straight on) and return 1/sr; radiance in photo
units, irradiance in photo unit * sr; depth is radial. Colours are linear.

Accuracy: `tolerance` is relative, to each ray's own sum; it is the parameter to refine. In
`cornell_room` (16 polygons, lamp of 0.5 x 0.4 m, 32 x 32 rays, kappa 0.1/m, g 0.6), against a run at
1e-6, the default tolerances are wrong in V by 1e-7 (median), 2e-5 (95 %), 1e-4 (99 %), 1e-3 (worst; rays
that end on the lamp), and in T by 2e-5 (worst). Cost on one core, 64 x 64 rays: V 3 s, T 1 s, a point
light 0.02 s; 16 times the rays, 16 times the time. Memory stays below 100 MB: shadows are found for
`_CHUNK` pairs of ray and light point at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Sequence

import numpy as np

PhaseFunction = Callable[[np.ndarray], np.ndarray]

_CHUNK = 8192  # light-point/ray pairs at once: some tens of megabytes with 60 polygon edges
_ON_PLANE = 1e-7  # [m] a point this close to a polygon's plane lies on it and is not shadowed by it
_NO_SIZE = 1e-100  # [m] stands for a distance of zero from a point light: huge instead of 0/0
_NEGLIGIBLE_DEPTH = 80.0  # exp(-80) = 2e-35: optical depth behind which a lit interval is cut

# Gauss-Kronrod (7, 15) on [-1, 1], positive half; the Gauss nodes are every second one
# (Piessens et al. 1983, QUADPACK, qk15).
_K_NODES = np.array([0.991455371120812639206854697526329, 0.949107912342758524526189684047851,
                     0.864864423359769072789712788640926, 0.741531185599394439863864773280788,
                     0.586087235467691130294144691258970, 0.405845151377397166906606412076961,
                     0.207784955007898467600689403773245, 0.0])
_K_WEIGHTS = np.array([0.022935322010529224963732008058970, 0.063092092629978553290700663189204,
                       0.104790010322250183839876322541518, 0.140653259715525918745189590510238,
                       0.169004726639267902826583426598550, 0.190350578064785409913256402421014,
                       0.204432940075298892414161999234649, 0.209482141084727828012999174891714])
_NODES = 0.5 + 0.5 * np.concatenate([-_K_NODES, _K_NODES[-2::-1]])
_WEIGHTS = 0.5 * np.concatenate([_K_WEIGHTS, _K_WEIGHTS[-2::-1]])
_COARSE_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(7)[1]


# --- the scene ---------------------------------------------------------------------------------


def henyey_greenstein(asymmetry: float) -> PhaseFunction:
    """Henyey-Greenstein phase function [1/sr]; the form 1+g^2-2g cos cancels at |g| -> 1, this does not."""
    g = abs(asymmetry)
    side = 1.0 if asymmetry >= 0 else -1.0

    def phase(cosine: np.ndarray) -> np.ndarray:
        squared = (1 - g) ** 2 + 2 * g * (1 - side * cosine)
        return (1 - g * g) / (4 * np.pi * squared * np.sqrt(squared))

    return phase


def rayleigh(cosine: np.ndarray) -> np.ndarray:
    """Rayleigh phase function [1/sr]."""
    return 3 / (16 * np.pi) * (1 + cosine**2)


@dataclass(frozen=True)
class Medium:
    """Homogeneous fog: coefficients [1/m], grey (a number) or RGB (3,), and the phase function.

    scale_height [m]: coefficients are times exp(-y / scale_height), not clamped below; not for the sun.
    """

    absorption_coefficient: np.ndarray | float
    scattering_coefficient: np.ndarray | float
    phase_function: PhaseFunction = henyey_greenstein(0.0)
    scale_height: float | None = None

    @property
    def scattering(self) -> np.ndarray:
        return _rgb(self.scattering_coefficient)

    @property
    def extinction(self) -> np.ndarray:
        return _rgb(self.absorption_coefficient) + self.scattering


@dataclass(frozen=True)
class Rays:
    """Camera rays up to what they hit.

    origin (3,), directions (N, 3) unit, depth (N,) [m] (inf where nothing is hit), normals (N, 3)
    unit, towards the camera (zero where nothing is hit), emitter (N,) true where a lamp is seen.
    """

    origin: np.ndarray
    directions: np.ndarray
    depth: np.ndarray
    normals: np.ndarray
    emitter: np.ndarray

    def surface(self) -> np.ndarray:
        """True (N,) where the ray ends on a surface that reflects light."""
        return np.isfinite(self.depth) & ~self.emitter

    def points(self, which=slice(None)) -> np.ndarray:
        """End points (N, 3) [m], or those of `which` rays."""
        return self.origin + self.depth[which, None] * self.directions[which]


@dataclass(frozen=True)
class PointLight:
    """A bulb of `radius` [m]: E = intensity / (d^2 + radius^2), in fog times exp(-kappa d)."""

    position: np.ndarray
    intensity: np.ndarray | float
    radius: float = 0.0

    @property
    def midpoint(self) -> np.ndarray:
        return np.asarray(self.position, float)


@dataclass(frozen=True)
class SpotLight(PointLight):
    """A bulb times `cone`(cosine of the angle off `axis`).

    `cone_breaks` are the cosines at which `cone` is not smooth (its inner and outer edge): lines are
    split there. Without them a cone narrower than the node spacing can be missed.
    """

    axis: np.ndarray = (0.0, -1.0, 0.0)
    cone: Callable[[np.ndarray], np.ndarray] = np.ones_like
    cone_breaks: tuple[float, ...] = ()


@dataclass(frozen=True)
class RectangleLight:
    """Lambertian parallelogram of `radiance`, one-sided: shines towards edge_a x edge_b."""

    corner: np.ndarray
    edge_a: np.ndarray
    edge_b: np.ndarray
    radiance: np.ndarray | float

    @property
    def area_vector(self) -> np.ndarray:
        """Normal times area, (3,) [m^2]."""
        return np.cross(self.edge_a, self.edge_b)

    @property
    def normal(self) -> np.ndarray:
        return self.area_vector / np.linalg.norm(self.area_vector)

    @property
    def midpoint(self) -> np.ndarray:
        """Where the diagonals meet, (3,) [m]: the paper's light position in eq. 5."""
        return np.asarray(self.corner, float) + 0.5 * (np.asarray(self.edge_a) + np.asarray(self.edge_b))


@dataclass(frozen=True)
class SunWindow:
    """Sunlight through a window.

    irradiance: on a plane facing the sun [photo unit * sr]. direction (3,): unit, the way the light
    *travels*. window (n, 3): convex planar polygon [m]; the fog begins at its plane, and only what
    stands behind that plane throws shadows. The lit region is the prism behind the window, or the
    convex polyhedron `shaft`, planes (m, 4) with rows (n, c) meaning n.x <= c, if given.
    """

    irradiance: np.ndarray | float
    direction: np.ndarray
    window: np.ndarray
    shaft: np.ndarray | None = None


Light = PointLight | RectangleLight | SunWindow


# --- in-scattering -----------------------------------------------------------------------------


def in_scattering(rays: Rays, medium: Medium, light: Light, occluders: Sequence[np.ndarray] = (),
                  **refinement) -> np.ndarray:
    """In-scattered radiance V, (N, 3), of any one light; see the function of its kind."""
    kinds = {RectangleLight: rectangle_light_in_scattering, SunWindow: sun_window_in_scattering,
             SpotLight: spot_light_in_scattering, PointLight: point_light_in_scattering}
    return kinds[type(light)](rays, medium, light, occluders, **refinement)


def point_light_in_scattering(rays: Rays, medium: Medium, light: PointLight,
                              occluders: Sequence[np.ndarray] = (), tolerance: float = 1e-5) -> np.ndarray:
    """In-scattered radiance V, (N, 3), of a bulb (single scattering; Zhao et al. 2013, section 4.2).

    A ray straight through a bulb of radius 0 has no finite answer and returns a huge one (~1e100).
    """
    return _bulb_in_scattering(rays, medium, light, occluders, tolerance, np.ones_like, (0, 1, 0), ())


def spot_light_in_scattering(rays: Rays, medium: Medium, light: SpotLight,
                             occluders: Sequence[np.ndarray] = (), tolerance: float = 1e-5) -> np.ndarray:
    """In-scattered radiance V, (N, 3), of a bulb behind a cone factor."""
    return _bulb_in_scattering(rays, medium, light, occluders, tolerance, light.cone, light.axis,
                               light.cone_breaks)


def _bulb_in_scattering(rays, medium, light, occluders, tolerance, cone, axis, cone_breaks):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    count = len(rays.directions)

    def factor(item, s, distance, perpendicular):
        off_axis = ((perpendicular @ axis)[:, None] + s * (rays.directions[item] @ axis)[:, None]) / distance
        return medium.phase_function(-s / distance) * cone(np.clip(off_axis, -1, 1))

    def breaks(perpendicular, direction):
        """Where the line crosses the cone's edges; the foot, where a thick bulb's light turns round."""
        feet = [np.zeros(len(direction))] if light.radius > 0 else []
        across, along = perpendicular @ axis, direction @ axis
        squared = np.einsum("ij,ij->i", perpendicular, perpendicular)
        for cosine in cone_breaks:
            a, b = along**2 - cosine**2, across * along
            root = np.sqrt(np.maximum(b * b - a * (across**2 - cosine**2 * squared), 0))
            feet += [(-b - root) / a, (-b + root) / a]
        return feet

    position = np.broadcast_to(np.asarray(light.position, float), (count, 3))
    lines = _Lines(np.broadcast_to(rays.origin, (count, 3)), rays.directions, np.zeros(count), rays.depth)
    return _rgb(light.intensity) * _scattered(medium, count, lambda extinction: _seen_by_points(
        lines, position, extinction, _Polygons(occluders), factor, tolerance, light.radius, breaks, 1.0,
        medium.scale_height))


def rectangle_light_in_scattering(rays: Rays, medium: Medium, light: RectangleLight,
                                  occluders: Sequence[np.ndarray] = (), tolerance: float = 1e-4,
                                  nodes: int = 3, base: tuple[int, int] = (1, 1),
                                  max_level: int = 12) -> np.ndarray:
    """In-scattered radiance V, (N, 3), of a Lambertian parallelogram.

    The lamp starts as base[0] x base[1] patches of nodes x nodes Gauss points. For each ray a patch is
    quartered, up to `max_level` times, while it differs from the sum of its quarters by more than
    `tolerance` of the ray's V; the quarters, several times more accurate, are what is summed.
    """
    count = len(rays.directions)
    polygons, normal = _Polygons(occluders), light.normal
    corner, edge_a, edge_b = (np.asarray(v, float) for v in (light.corner, light.edge_a, light.edge_b))
    # Only the half-space in front of the lamp is lit: cut every ray at the lamp's plane.
    front = np.append(-normal, -normal @ corner)[None]
    all_lines = _Lines(np.broadcast_to(rays.origin, (count, 3)), rays.directions,
                       np.zeros(count), rays.depth).inside(front)
    gauss, weights = np.polynomial.legendre.leggauss(nodes)
    grid_u, grid_v = (g.ravel() for g in np.meshgrid(0.5 + 0.5 * gauss, 0.5 + 0.5 * gauss))
    weight = 0.25 * np.outer(weights, weights).ravel()

    def patches(extinction, ray, u, v, size):
        """Contribution (C, n) of patches with lower corner (u, v) and extent `size` (2,) in lamp units."""
        points = (corner + (u[:, None] + size[0] * grid_u)[..., None] * edge_a
                  + (v[:, None] + size[1] * grid_v)[..., None] * edge_b).reshape(-1, 3)
        lines = all_lines.take(np.repeat(ray, len(weight)))

        def factor(item, s, distance, perpendicular):
            along = (lines.direction[item] @ normal)[:, None]
            cosine = ((perpendicular @ normal)[:, None] + s * along) / distance
            return medium.phase_function(-s / distance) * np.maximum(cosine, 0)

        # A tenth: the line integral's error must not be mistaken for a difference between patches.
        line = _seen_by_points(lines, points, extinction, polygons, factor, 0.1 * tolerance, eye=1.0,
                               scale_height=medium.scale_height)
        return size.prod() * (line.reshape(len(extinction), -1, len(weight)) @ weight)

    def over_lamp(extinction):
        size = 1.0 / np.asarray(base)
        v, u = (g.ravel() * s for g, s in zip(np.mgrid[:base[1], :base[0]], size[::-1]))
        ray = np.repeat(np.arange(count), len(u))
        u, v = np.tile(u, count), np.tile(v, count)
        coarse = patches(extinction, ray, u, v, size)
        accepted = np.zeros((len(extinction), count))
        for level in range(max_level + 1):
            size = size / 2
            quarter = [np.stack([q + dq * s for dq in shift], 1).ravel()
                       for q, s, shift in ((u, size[0], (0, 1, 0, 1)), (v, size[1], (0, 0, 1, 1)))]
            fine = patches(extinction, np.repeat(ray, 4), *quarter, size).reshape(len(extinction), -1, 4)
            total = accepted + _sum_by(ray, fine.sum(-1), count)
            wrong = np.abs(fine.sum(-1) - coarse) > tolerance * np.abs(total[:, ray])
            split = wrong.any(0) if level < max_level else np.zeros(len(ray), bool)
            accepted += _sum_by(ray[~split], fine[:, ~split].sum(-1), count)
            ray, coarse = np.repeat(ray[split], 4), fine[:, split].reshape(len(extinction), -1)
            u, v = (q.reshape(-1, 4)[split].ravel() for q in quarter)
            if not len(ray):
                break
        return accepted

    return np.linalg.norm(light.area_vector) * _rgb(light.radiance) * _scattered(medium, count, over_lamp)


def sun_window_in_scattering(rays: Rays, medium: Medium, light: SunWindow,
                             occluders: Sequence[np.ndarray] = (), tolerance: float = 1e-5) -> np.ndarray:
    """In-scattered radiance V, (N, 3), of the sun's shaft behind a window (Zhao et al. 2013, section 5.1)."""
    count, direction = len(rays.directions), _unit(light.direction)
    shaft, entry = _shaft(light)
    if shaft is None:
        return np.zeros((count, 3))
    lines = _Lines(np.broadcast_to(rays.origin, (count, 3)), rays.directions, np.zeros(count), rays.depth)
    lines = lines.inside(shaft)
    behind = _Polygons(_clipped(occluders, entry))
    ray, start, end = _gaps(lines, *behind.shadows(-direction[None], np.zeros(1), lines))
    slope = 1 + (rays.directions @ entry[:3])[ray]  # growth of the path window - point - eye along the ray
    path = start * slope + rays.origin @ entry[:3] - entry[3]
    phase = medium.phase_function(rays.directions @ -direction)[ray]

    def over_rays(extinction):
        with np.errstate(divide="ignore"):
            last = start + np.where(slope > 0, _NEGLIGIBLE_DEPTH / (extinction.min() * slope), np.inf)
        length = np.minimum(end, last) - start

        def integrand(item, f):
            along = path[item, None] + slope[item, None] * length[item, None] * f
            return np.exp(-extinction[:, None, None] * along) * length[item, None]

        return _sum_by(ray, phase * _adaptive(integrand, len(ray), tolerance, len(extinction)), count)

    return _rgb(light.irradiance) * _scattered(medium, count, over_rays)


# --- direct irradiance and transmittance -------------------------------------------------------


def direct_irradiance(light: Light, points: np.ndarray, normals: np.ndarray,
                      occluders: Sequence[np.ndarray] = (), medium: Medium | None = None,
                      tolerance: float = 1e-5) -> np.ndarray:
    """Irradiance E, (N, 3) [photo unit * sr], at `points` (N, 3) [m] with unit `normals` (N, 3).

    With a `medium`, the fog between light and point weakens it; without, the air is clear. Points
    must lie on their own polygon to within `_ON_PLANE`, or it shadows them.
    """
    points, normals = np.asarray(points, float), np.asarray(normals, float)
    extinction = np.zeros(3) if medium is None else medium.extinction
    if isinstance(light, RectangleLight):
        return _rectangle_irradiance(light, points, normals, _Polygons(occluders), extinction, tolerance,
                                     medium and medium.scale_height)
    if isinstance(light, SunWindow):
        return _sun_irradiance(light, points, normals, occluders, extinction)
    offset = points - light.midpoint
    distance = np.linalg.norm(offset, axis=1)
    towards = offset / distance[:, None]
    share = np.maximum(-np.einsum("ij,ij->i", towards, normals), 0) / (distance**2 + light.radius**2)
    if isinstance(light, SpotLight):
        share = share * light.cone(np.clip(towards @ _unit(light.axis), -1, 1))
    share = share * ~_Polygons(occluders).block(light.midpoint[None], np.ones(1), points)
    path = distance * mean_density(light.midpoint[1], points[:, 1], medium and medium.scale_height)
    return _rgb(light.intensity) * share[:, None] * np.exp(-extinction * path[:, None])


def _rectangle_irradiance(light, points, normals, polygons, extinction, tolerance, scale_height=None):
    """Lines across the lamp along edge_b, each cut exactly where `points` do not see it."""
    corner, edge_a, edge_b = (np.asarray(v, float) for v in (light.corner, light.edge_a, light.edge_b))
    extinction, channel = np.unique(extinction, return_inverse=True)
    in_front = (points - corner) @ light.normal
    result = np.zeros((len(points), 3))
    seen = np.nonzero(in_front > 0)[0]
    points, normals, in_front = points[seen], normals[seen], in_front[seen]
    length = np.linalg.norm(edge_b)

    def integrand(index, f):
        point = np.repeat(index, f.shape[1])
        ones = np.ones(len(point))
        lines = _Lines(corner + f.reshape(-1, 1) * edge_a, ones[:, None] * edge_b / length, 0 * ones,
                       length * ones)
        # Only the part of the lamp above the surface's own plane lights it.
        lines = lines.above(normals[point], np.einsum("ij,ij->i", normals, points)[point])

        def factor(item, s, distance, perpendicular):
            normal = normals[point[item]]
            at_surface = (np.einsum("ij,ij->i", normal, perpendicular)[:, None]
                          + s * np.einsum("ij,ij->i", normal, lines.direction[item])[:, None])
            return np.maximum(at_surface, 0) * in_front[point[item], None] / distance**2

        return _seen_by_points(lines, points[point], extinction, polygons, factor, 0.1 * tolerance,
                               eye=0.0, scale_height=scale_height).reshape(-1, *f.shape)

    share = _adaptive(integrand, len(seen), tolerance, len(extinction))[channel].T
    result[seen] = share * np.linalg.norm(light.area_vector) / length
    return _rgb(light.radiance) * result


def _sun_irradiance(light, points, normals, occluders, extinction):
    direction = _unit(light.direction)
    shaft, entry = _shaft(light)
    if shaft is None:
        return np.zeros((len(points), 3))
    lit = (points @ shaft[:, :3].T <= shaft[:, 3] + _ON_PLANE).all(1)
    lit &= ~_Polygons(_clipped(occluders, entry)).block(-direction[None], np.zeros(1), points)
    share = np.where(lit, np.maximum(-normals @ direction, 0), 0)
    path = points @ entry[:3] - entry[3]
    return _rgb(light.irradiance) * share[:, None] * np.exp(-extinction * np.maximum(path, 0)[:, None])


def transmittance(rays: Rays, medium: Medium, lights: Sequence[Light], occluders: Sequence[np.ndarray] = (),
                  variant: str = "area", tolerance: float = 1e-5) -> np.ndarray:
    """Fraction of the surface's directly reflected radiance that reaches the camera, (N, 3).

    Eye path times the light paths' transmittance, each light weighted by its share of the direct,
    unoccluded irradiance (a Lambertian surface reflects all directions alike). variant "area" averages
    over each lamp's area, "midpoint" takes its midpoint (Zhao et al. 2013, eq. 5) under the same shares.
    Where an emitter or nothing is seen only the eye path counts (nothing: 0, or 1 without fog).
    NaN where the surface gets no direct light: T is undefined there, a renderer's fallback is its own.
    """
    if variant not in ("area", "midpoint"):
        raise ValueError(f"variant is 'area' or 'midpoint', not {variant!r}")
    extinction = medium.extinction
    with np.errstate(invalid="ignore"):
        path = rays.depth * mean_density(rays.origin[1], rays.points()[:, 1], medium.scale_height)
        eye = np.where(extinction == 0, 1.0, np.exp(-extinction * path[:, None]))
    surface = rays.surface()
    points, normals = rays.points(surface), rays.normals[surface]
    clear, foggy = np.zeros((2, len(points), 3))
    for light in lights:
        without = direct_irradiance(light, points, normals, occluders, None, tolerance)
        clear += without
        if variant == "area" or isinstance(light, SunWindow):
            foggy += direct_irradiance(light, points, normals, occluders, medium, tolerance)
        else:
            distance = np.linalg.norm(points - light.midpoint, axis=1)
            distance = distance * mean_density(light.midpoint[1], points[:, 1], medium.scale_height)
            foggy += without * np.exp(-extinction * distance[:, None])
    with np.errstate(invalid="ignore"):
        eye[surface] *= foggy / clear
    return eye


# --- lines, shadows ----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Lines:
    """Pieces of straight lines: origin (n, 3), unit direction (n, 3), start and end (n,) [m]."""

    origin: np.ndarray
    direction: np.ndarray
    start: np.ndarray
    end: np.ndarray

    def take(self, index) -> "_Lines":
        return _Lines(self.origin[index], self.direction[index], self.start[index], self.end[index])

    def inside(self, planes: np.ndarray) -> "_Lines":
        """Cut to the convex region n.x <= c of the rows (n, c) of `planes`, (m, 4)."""
        start, end = _inside(planes[:, :3] @ self.origin.T - planes[:, 3:], planes[:, :3] @ self.direction.T)
        return _Lines(self.origin, self.direction, np.maximum(self.start, start.max(0)),
                      np.minimum(self.end, end.min(0)))

    def above(self, normals: np.ndarray, levels: np.ndarray) -> "_Lines":
        """Cut each line to its own half-space normals[i].x >= levels[i]."""
        start, end = _inside(levels - np.einsum("ij,ij->i", normals, self.origin),
                             -np.einsum("ij,ij->i", normals, self.direction))
        return _Lines(self.origin, self.direction, np.maximum(self.start, start), np.minimum(self.end, end))


def _inside(level: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interval of t, elementwise, in which level + slope * t < 0; empty is (inf, -inf)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -level / slope
    never = (slope == 0) & (level >= 0)
    start = np.where(never, np.inf, np.where(slope < 0, root, -np.inf))
    end = np.where(never, -np.inf, np.where(slope > 0, root, np.inf))
    return start, end


class _Polygons:
    """Opaque planar convex polygons and their shadow volumes.

    Light points are homogeneous: (position, 1), or (-direction, 0) for parallel light. The plane through
    a light point P and an edge from v to v + e has, at x, the signed value
    (weight x - P).(v x e) - (x x P).e: linear in the line's Pluecker coordinates, hence one matrix product
    for all edges of all polygons.
    """

    def __init__(self, polygons: Sequence[np.ndarray]):
        self.polygons = [np.asarray(p, float) for p in polygons]
        normals = [_polygon_normal(p) for p in self.polygons]
        self.counts = np.array([len(p) for p in self.polygons], int)
        self.first = np.cumsum(self.counts) - self.counts
        self.normals = np.array(normals).reshape(-1, 3)
        self.levels = np.array([n @ p.mean(0) for n, p in zip(normals, self.polygons)])
        edges = [np.hstack([np.cross(p, np.roll(p, -1, 0)), p - np.roll(p, -1, 0)]) for p in self.polygons]
        self.edges = np.concatenate(edges) if edges else np.zeros((0, 6))

    def _side(self, points, weight):
        """+1 or -1, (M, n): the side of each polygon's plane on which each light point lies; 0 on it."""
        height = self.normals @ points.T - np.outer(self.levels, weight)
        return np.sign(np.where(np.abs(height) < _ON_PLANE, 0.0, height))

    def shadows(self, points, weight, lines: _Lines) -> tuple[np.ndarray, np.ndarray]:
        """Start and end, (M, n), of the shadow of each polygon on each line, seen from the line's point."""
        n, weight = len(lines.origin), weight[:, None]
        if not self.polygons or not n:
            return np.full((0, n), np.inf), np.full((0, n), -np.inf)
        side = self._side(points, weight[:, 0])
        level = self.edges @ np.hstack([weight * lines.origin - points, np.cross(lines.origin, points)]).T
        slope = self.edges @ np.hstack([weight * lines.direction, np.cross(lines.direction, points)]).T
        by_edge = np.repeat(side, self.counts, axis=0)
        start, end = _inside(by_edge * level, by_edge * slope)
        behind = _inside(side * (self.normals @ lines.origin.T - self.levels[:, None]),
                         side * (self.normals @ lines.direction.T))
        return (np.maximum(np.maximum.reduceat(start, self.first, axis=0), behind[0]),
                np.minimum(np.minimum.reduceat(end, self.first, axis=0), behind[1]))

    def block(self, points, weight, targets) -> np.ndarray:
        """True (n,) where some polygon stands between a light point and its target (n, 3)."""
        if not self.polygons or not len(targets):
            return np.zeros(len(targets), bool)
        points = np.broadcast_to(points, targets.shape)
        side = self._side(points, np.broadcast_to(weight, len(targets)))
        level = self.edges @ np.hstack([weight[:, None] * targets - points, np.cross(targets, points)]).T
        within = np.maximum.reduceat(np.repeat(side, self.counts, axis=0) * level, self.first, axis=0) < 0
        behind = side * (self.normals @ targets.T - self.levels[:, None]) < -_ON_PLANE
        return (within & behind).any(0)


def _gaps(lines: _Lines, starts: np.ndarray, ends: np.ndarray):
    """What is left of `lines` outside the intervals (M, n): line index, start, end, each (k,)."""
    empty = ~(np.maximum(starts, lines.start) < np.minimum(ends, lines.end))
    keep = ~empty.all(1)
    # A shadow off the line becomes an empty one at its end, so that no gap follows it.
    starts = np.where(empty, lines.end, starts)[keep]
    ends = np.where(empty, lines.end, ends)[keep]
    order = np.argsort(starts, axis=0)
    starts, ends = np.take_along_axis(starts, order, 0), np.take_along_axis(ends, order, 0)
    ends = np.maximum.accumulate(ends, axis=0) if len(ends) else ends
    left = np.maximum(np.concatenate([lines.start[None], ends]), lines.start)
    right = np.minimum(np.concatenate([starts, lines.end[None]]), lines.end)
    which, line = np.nonzero(right > left)
    return line, left[which, line], right[which, line]


def _shaft(light: SunWindow):
    """Planes (m, 4) of the lit region, n.x <= c, and the window's plane (n, c) scaled so that n.x - c is
    the distance behind it along the light; (None, None) where the light grazes the window's plane."""
    window, direction = np.asarray(light.window, float), _unit(light.direction)
    normal = _polygon_normal(window)
    if abs(normal @ direction) < 1e-12:
        return None, None
    normal = normal / (normal @ direction)
    entry = np.append(normal, normal @ window.mean(0))
    if light.shaft is not None:
        return np.asarray(light.shaft, float), entry
    outward = np.cross(np.roll(window, -1, 0) - window, direction)
    level = np.einsum("ij,ij->i", outward, window)
    flip = np.where(outward @ window.mean(0) > level, -1.0, 1.0)
    return np.vstack([np.column_stack([outward, level]) * flip[:, None], -entry]), entry


def _clipped(polygons, plane) -> list[np.ndarray]:
    """The parts of convex `polygons` where n.x > c for `plane` (n, c)."""
    kept = []
    for polygon in (np.asarray(p, float) for p in polygons):
        height = polygon @ plane[:3] - plane[3]
        following = np.roll(height, -1)
        if height.max() <= _ON_PLANE:
            continue
        corners = []
        for here, there, a, b in zip(polygon, np.roll(polygon, -1, 0), height, following):
            if a >= 0:
                corners.append(here)
            if a * b < 0:
                corners.append(here + (there - here) * a / (a - b))
        kept.append(np.array(corners))
    return kept


def _polygon_normal(polygon: np.ndarray) -> np.ndarray:
    """Unit normal (3,) of a planar convex polygon (n, 3); its corners run anticlockwise about it."""
    following = np.roll(polygon, -1, 0)
    vector = np.cross(polygon - polygon[0], following - polygon[0]).sum(0)
    size = np.linalg.norm(vector)
    if not size > 0:
        raise ValueError(f"polygon without area: {polygon.tolist()}")
    normal = vector / size
    extent = np.ptp(polygon, axis=0).max()
    if np.abs((polygon - polygon.mean(0)) @ normal).max() > 1e-6 * extent:
        raise ValueError(f"polygon is not planar: {polygon.tolist()}")
    turns = np.cross(following - polygon, np.roll(following, -1, 0) - following) @ normal
    if turns.min() < -1e-9 * extent**2:
        raise ValueError(f"polygon is not convex: {polygon.tolist()}")
    return normal


# --- integration -------------------------------------------------------------------------------


def _scattered(medium: Medium, count: int, integral) -> np.ndarray:
    """delta times integral(extinctions (C,)) -> (C, count), as (count, 3); equal channels count once."""
    scattering = medium.scattering
    active = scattering > 0
    result = np.zeros((count, 3))
    if active.any():
        extinction, channel = np.unique(medium.extinction[active], return_inverse=True)
        result[:, active] = scattering[active] * integral(extinction)[channel].T
    return result


def _seen_by_points(lines: _Lines, points, extinction, polygons, factor, tolerance, radius=0.0,
                    breaks=None, eye=1.0, scale_height=None) -> np.ndarray:
    """Integral (C, n) over the part of each line that its point sees, of
    exp(-kappa (eye t + d)) factor / (d^2 + radius^2) dt, with d the distance from point to line element.

    factor(item (k,), s (k, m), d (k, m), perpendicular (k, 3)) -> (k, m): the element lies at
    perpendicular + s * direction from the point. breaks(perpendicular, direction) -> list of s (n,), NaN
    for none, at which the factor is not smooth.
    """
    result = np.zeros((len(extinction), len(points)))
    for begin in range(0, len(points), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        piece, point = lines.take(part), points[part]
        foot = np.einsum("ij,ij->i", point - piece.origin, piece.direction)
        perpendicular = piece.origin + foot[:, None] * piece.direction - point
        squared = np.einsum("ij,ij->i", perpendicular, perpendicular)
        item, start, end = _gaps(piece, *polygons.shadows(point, np.ones(len(point)), piece))
        start, end = start - foot[item], end - foot[item]
        if eye and extinction.min() > 0 and scale_height is None:
            # Along the line t + d only grows: cut where it has grown by the negligible optical depth.
            reach = start + np.sqrt(start**2 + squared[item]) + _NEGLIGIBLE_DEPTH / extinction.min()
            end = np.minimum(end, (reach**2 - squared[item]) / (2 * reach))
        with np.errstate(invalid="ignore", divide="ignore"):
            split = breaks(perpendicular, piece.direction) if breaks else []
        for s in split:
            inside = (start < s[item]) & (s[item] < end)
            item, start, end = (np.concatenate([item, item[inside]]),
                                np.concatenate([start, s[item[inside]]]),
                                np.concatenate([np.where(inside, s[item], end), end[inside]]))
        # Equi-angular: s = width tan(angle). The angle is counted from the interval's start, because
        # counted from the foot a ray close to the light has all its angles near 90 degrees and no digits.
        width = np.maximum(np.sqrt(squared + radius**2), _NO_SIZE)[item]
        opening = np.arctan2(width * (end - start), width**2 + start * end)
        opening = np.where(opening < 0, opening + np.pi, opening)

        def integrand(index, f):
            angle = opening[index, None] * f
            a, w, which = start[index, None], width[index, None], item[index]
            sine, cosine = np.sin(angle), np.cos(angle)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = (a * cosine + w * sine) / (cosine - a / w * sine)
            s = np.clip(s, a, end[index, None])
            distance = np.maximum(np.sqrt(s * s + squared[which, None]), _NO_SIZE)
            value = factor(which + begin, s, distance, perpendicular[which]) * opening[index, None] / w
            path = distance + eye * (foot[which, None] + s)
            if scale_height is not None:
                base = point[which, 1][:, None]
                height = base + perpendicular[which, 1][:, None] + s * piece.direction[which, 1][:, None]
                path = distance * mean_density(base, height, scale_height)
                if eye:
                    origin = piece.origin[which, 1][:, None]
                    path = path + eye * (foot[which, None] + s) * mean_density(origin, height, scale_height)
                    value = value * np.exp(-height / scale_height)
            return np.exp(-extinction[:, None, None] * path) * value

        values = _adaptive(integrand, len(item), tolerance, len(extinction))
        result[:, part] = _sum_by(item, values, len(point))
    return result


def mean_density(low, high, scale_height):
    """Mean of exp(-y / scale_height) over heights between `low` and `high`; 1 without a scale height."""
    if scale_height is None:
        return np.ones(np.broadcast_shapes(np.shape(low), np.shape(high)))
    rise = (high - np.asarray(low)) / scale_height
    small = np.abs(rise) < 1e-6
    thinning = np.where(small, 1 - rise / 2, -np.expm1(-rise) / np.where(small, 1.0, rise))
    return np.exp(-np.asarray(low) / scale_height) * thinning


def _adaptive(integrand, count: int, tolerance: float, channels: int, max_halvings: int = 40) -> np.ndarray:
    """Integrals (channels, count) over [0, 1] of integrand(index (k,), f (k, 15)) -> (channels, k, 15).

    Gauss-Kronrod, halving the intervals on which the 7- and 15-point values differ by more than
    `tolerance` of their integral. The 15-point value is the one used, so the error is far smaller on
    smooth integrands. A jump needs about log2(1/tolerance) halvings.
    """
    result = np.zeros((channels, count))
    index, begin, width = np.arange(count), np.zeros(count), 1.0
    for halving in range(max_halvings + 1):
        if not len(index):
            break
        values = np.concatenate([integrand(index[k:k + _CHUNK], begin[k:k + _CHUNK, None] + width * _NODES)
                                 for k in range(0, len(index), _CHUNK)], 1)
        fine, coarse = width * (values @ _WEIGHTS), width * (values[..., 1::2] @ _COARSE_WEIGHTS)
        total = result + _sum_by(index, fine, count)
        split = (np.abs(fine - coarse) > tolerance * np.abs(total[:, index])).any(0)
        if halving == max_halvings:
            split[:] = False
        result += _sum_by(index[~split], fine[:, ~split], count)
        width /= 2
        index = np.repeat(index[split], 2)
        begin = np.repeat(begin[split], 2) + width * np.tile([0.0, 1.0], split.sum())
    return result


def _sum_by(index: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums (C, count) of `values` (C, k) by `index` (k,)."""
    return np.stack([np.bincount(index, row, count) for row in values])


def _rgb(value) -> np.ndarray:
    return np.broadcast_to(np.asarray(value, float), 3)


def _unit(vector) -> np.ndarray:
    return np.asarray(vector, float) / np.linalg.norm(vector)


# --- the Cornell-like room ---------------------------------------------------------------------


@dataclass(frozen=True)
class Room:
    """Opaque polygons (list of (n, 3) [m]), their albedos (M, 3), the lamp and which polygon it is."""

    polygons: list[np.ndarray]
    albedos: np.ndarray
    lamp: RectangleLight
    lamp_polygon: int
    camera_position: np.ndarray
    camera_look_at: np.ndarray
    horizontal_field_of_view: float  # [degree]

    def rays(self, width: int, height: int) -> Rays:
        """Rays through the pixel centres, row by row from the top left, cast at the room."""
        directions = camera_directions(self.camera_position, self.camera_look_at,
                                       self.horizontal_field_of_view, width, height)
        rays, hit = cast(self.camera_position, directions, self.polygons)
        return Rays(rays.origin, rays.directions, rays.depth, rays.normals, hit == self.lamp_polygon)


def cornell_room() -> Room:
    """A Cornell-like box of 2 x 2 x 2 m, open towards the viewer (+z): two blocks, a lamp at the ceiling."""
    def quad(*corners):
        return np.array(corners, float)

    shell = [quad((-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)),
             quad((-1, 2, -1), (1, 2, -1), (1, 2, 1), (-1, 2, 1)),
             quad((-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)),
             quad((-1, 0, 1), (-1, 0, -1), (-1, 2, -1), (-1, 2, 1)),
             quad((1, 0, -1), (1, 0, 1), (1, 2, 1), (1, 2, -1))]
    tall = _box((-0.33, 0.6, -0.28), (0.3, 0.6, 0.3), 18)
    short = _box((0.33, 0.3, 0.38), (0.3, 0.3, 0.3), -18)
    lamp = RectangleLight((-0.25, 1.98, -0.2), (0.5, 0, 0), (0, 0, 0.4), (17.0, 12.0, 7.0))
    corner, a, b = (np.asarray(v) for v in (lamp.corner, lamp.edge_a, lamp.edge_b))
    polygons = shell + tall + short + [np.array([corner, corner + a, corner + a + b, corner + b])]
    white, red, green, black = (0.73, 0.73, 0.73), (0.63, 0.065, 0.05), (0.14, 0.45, 0.091), (0.0, 0.0, 0.0)
    albedos = [white, white, white, red, green] + [white] * 10 + [black]
    return Room(polygons, np.array(albedos), lamp, len(polygons) - 1, np.array([0.03, 1.04, 3.9]),
                np.array([0.01, 0.97, 0.0]), 37.0)


def _box(centre, half, degrees) -> list[np.ndarray]:
    """Top and four sides of a box turned about y: x' = x cos + z sin, z' = -x sin + z cos."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def corner(x, y, z):
        x, y, z = x * half[0], y * half[1], z * half[2]
        return np.array([x * c + z * s, y, -x * s + z * c]) + centre

    outline = [(-1, 1), (1, 1), (1, -1), (-1, -1)]
    sides = [np.array([corner(x, -1, z), corner(p, -1, q), corner(p, 1, q), corner(x, 1, z)])
             for (x, z), (p, q) in zip(outline, outline[1:] + outline[:1])]
    return [np.array([corner(x, 1, z) for x, z in outline])] + sides


def camera_directions(position, look_at, horizontal_field_of_view: float, width: int,
                      height: int) -> np.ndarray:
    """Unit directions (height * width, 3) through pixel centres; y up, square pixels, angle in degrees."""
    forward = _unit(np.asarray(look_at, float) - position)
    right = _unit(np.cross(forward, (0, 1, 0)))
    up = np.cross(right, forward)
    pitch = 2 * np.tan(np.radians(horizontal_field_of_view) / 2) / width
    x = (np.arange(width) + 0.5 - width / 2) * pitch
    y = (height / 2 - 0.5 - np.arange(height)) * pitch
    directions = forward + x[None, :, None] * right + y[:, None, None] * up
    return (directions / np.linalg.norm(directions, axis=-1, keepdims=True)).reshape(-1, 3)


def cast(origin, directions, polygons: Sequence[np.ndarray]) -> tuple[Rays, np.ndarray]:
    """Rays up to the nearest polygon, and that polygon's index (N,), -1 for none.

    `emitter` of the returned rays is all false: a caller who knows which polygon shines replaces it.
    """
    origin, directions = np.asarray(origin, float), np.asarray(directions, float)
    depth, index = np.full(len(directions), np.inf), np.full(len(directions), -1)
    normals = np.zeros_like(directions)
    for k, polygon in enumerate(np.asarray(p, float) for p in polygons):
        normal = _polygon_normal(polygon)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (polygon[0] - origin) @ normal / (directions @ normal)
        t = np.where(np.isfinite(t), t, -1.0)
        inward = np.cross(normal, np.roll(polygon, -1, 0) - polygon)
        offset = (origin + t[:, None] * directions)[:, None] - polygon
        inside = (np.einsum("nej,ej->ne", offset, inward) >= 0).all(1)
        nearer = inside & (t > _ON_PLANE) & (t < depth)
        depth[nearer], index[nearer] = t[nearer], k
        normals[nearer] = -np.sign(directions[nearer] @ normal)[:, None] * normal
    return Rays(origin, directions, depth, normals, np.zeros(len(directions), bool)), index
