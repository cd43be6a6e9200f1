"""All light in a fog-filled room by path tracing, split by how often fog and surfaces turned it.

Shares nothing with the pipeline and needs no other renderer: what single scattering of the lamp's own light leaves
out is measured against it. Conventions as in `tests.reference.quadrature`.

Method. Every camera ray is split: one path starts on the surface it meets, one in the fog before it, where the
distance is drawn in proportion to what the fog takes away, so that neither is left to luck. From there on distances
are drawn alike (in the closed form of the layered density too), surfaces reflect by the cosine and fog by its phase
function; at each vertex the lamp is sampled by area and by direction, joined by the balance heuristic (Veach and
Guibas 1995), and later vertices end by Russian roulette. Nothing is clamped: the result is right on average.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.reference.quadrature import Medium, RectangleLight, Room, mean_density

#: Turned by surfaces alone: once (what T is made for), more often; by fog once: straight from the lamp (what V is),
#: with surfaces before or after it; by fog more than once.
SHARES = ("direct", "reflected", "single", "single and reflected", "multiple")
_OFFSET = 1e-6  # [m] by which a path leaves its surface
_CHUNK = 1 << 16  # paths at once
_SURE = 3  # vertices before Russian roulette


@dataclass(frozen=True)
class Fog:
    """Grey fog: coefficients [1/m], asymmetry g of its Henyey-Greenstein phase function, scale height [m] or None."""

    absorption: float
    scattering: float
    asymmetry: float = 0.0
    scale_height: float | None = None

    @property
    def extinction(self) -> float:
        return self.absorption + self.scattering

    def optical_depth(self, origin, direction, length):
        """(N,) along `length` (N,) [m]; nothing of it is infinite where the length is not."""
        with np.errstate(over="ignore", invalid="ignore"):
            density = mean_density(origin[:, 1], origin[:, 1] + length * direction[:, 1], self.scale_height)
            return self.extinction * np.nan_to_num(length * density, nan=np.inf, posinf=np.inf)

    def distance(self, origin, direction, depth):
        """Length (N,) [m] after which the optical depth is `depth` (N,); inf where it never is."""
        if not self.extinction:
            return np.full(len(depth), np.inf)
        if self.scale_height is None:
            return depth / self.extinction
        slope = direction[:, 1] / self.scale_height
        density = self.extinction * np.exp(-origin[:, 1] / self.scale_height)
        share = depth / density * slope
        with np.errstate(divide="ignore", invalid="ignore"):
            length = np.where(np.abs(share) < 1e-9, depth / density, -np.log1p(-np.minimum(share, 1.0)) / slope)
        return np.where(share >= 1, np.inf, length)

    def phase(self, cosine):
        g = self.asymmetry
        return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)

    def medium(self) -> Medium:
        """The same fog for the quadrature."""
        return Medium(self.absorption, self.scattering, self.phase, self.scale_height)


def trace(room: Room, rays, fog: Fog | None, samples: int, seed: int, starts: tuple[str, ...] = ("surface", "fog")) -> np.ndarray:
    """Radiance (5, N, 3) of `SHARES` along each of the rays, the mean of so many paths a ray.

    `rays`: of `room.rays`, N of them. Without fog the last three shares are zero. starts: of which light, sent towards the eye
    by surfaces or by the fog.
    """
    fog, rng, tracer = fog or Fog(0, 0), np.random.default_rng(seed), _Tracer(room)
    result = np.zeros((len(SHARES), len(rays.directions), 3))
    seen = rays.emitter
    reach = fog.optical_depth(np.broadcast_to(rays.origin, rays.directions.shape), rays.directions, rays.depth)
    result[0, seen] = np.exp(-reach[seen, None]) * np.asarray(room.lamp.radiance)
    for pixels in np.array_split(np.arange(len(seen)), max(1, len(seen) * samples // _CHUNK)):
        pixel = np.repeat(pixels, samples)
        origin, direction = np.broadcast_to(rays.origin, (len(pixel), 3)), rays.directions[pixel]
        count = len(seen)
        surface = rays.surface()[pixel]
        on = pixel[surface]
        points = rays.points(on)
        hit = tracer.nearest(origin[surface], direction[surface])[1]
        if "surface" in starts:
            tracer.follow(result, on, points, direction[surface], rays.normals[on], room.albedos[hit],
                          np.exp(-reach[on])[:, None] * np.ones(3), np.zeros(len(on), int), fog, rng)
        if fog.scattering and "fog" in starts:
            met = -np.expm1(-reach[pixel])
            length = fog.distance(origin, direction, -np.log1p(-rng.random(len(pixel)) * met))
            tracer.follow(result, pixel, origin + length[:, None] * direction, direction, np.zeros((len(pixel), 3)),
                          np.full((len(pixel), 3), np.nan), (met * fog.scattering / fog.extinction)[:, None] * np.ones(3),
                          np.ones(len(pixel), int), fog, rng)
    result[:, ~seen] /= samples
    result[1:, seen] /= samples
    return result


class _Tracer:
    def __init__(self, room: Room):
        self.room, self.lamp = room, room.lamp
        self.corner = np.array([p[0] for p in room.polygons], float)
        a, b = (np.array([p[k] - p[0] for p in room.polygons], float) for k in (1, 3))
        if not np.allclose([p[2] - p[1] - (p[3] - p[0]) for p in room.polygons], 0):
            raise ValueError("the tracer knows parallelograms only")
        self.normal = np.cross(a, b)
        self.normal /= np.linalg.norm(self.normal, axis=1)[:, None]
        # what a point's offset from the corner is in units of the two edges
        basis = np.linalg.inv(np.stack([a, b, self.normal], 2))
        self.along = basis[:, :2]

    def nearest(self, origin, direction):
        """Depth (N,) [m] to the nearest polygon (inf: none) and its index (N,)."""
        depth, index = np.full(len(origin), np.inf), np.full(len(origin), -1)
        for k, (corner, normal, (u, v)) in enumerate(zip(self.corner, self.normal, self.along)):
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (corner @ normal - origin @ normal) / (direction @ normal)
                x = origin @ u - corner @ u + t * (direction @ u)
                y = origin @ v - corner @ v + t * (direction @ v)
                nearer = (t > _OFFSET) & (t < depth) & (x >= 0) & (x <= 1) & (y >= 0) & (y <= 1)
            depth[nearer], index[nearer] = t[nearer], k
        return depth, index

    def follow(self, result, pixel, point, incoming, normal, albedo, throughput, scatters, fog, rng):
        """Adds what paths from these vertices find; `normal` and `albedo` are zero and NaN in the fog."""
        lamp, radiance = self.lamp, np.asarray(self.lamp.radiance, float)
        area = np.linalg.norm(lamp.area_vector)
        reflections = (scatters == 0).astype(int)
        start = throughput.max(1)
        for vertex in range(1000):
            solid = np.isfinite(albedo[:, 0])
            point = point + _OFFSET * normal

            def bsdf(towards):
                """Value times cosine (N, 3), and the density [1/sr] with which directions are drawn."""
                on_surface = np.maximum(np.einsum("ij,ij->i", normal, towards), 0) / np.pi
                density = np.where(solid, on_surface, fog.phase(np.einsum("ij,ij->i", incoming, towards)))
                return np.where(solid[:, None], albedo, 1.0) * density[:, None], density

            # ---- the lamp by its area
            u, v = rng.random((2, len(point), 1))
            towards = lamp.corner + u * np.asarray(lamp.edge_a) + v * np.asarray(lamp.edge_b) - point
            distance = np.linalg.norm(towards, axis=1)
            towards /= distance[:, None]
            facing = np.maximum(-towards @ lamp.normal, 0)
            value, density = bsdf(towards)
            use = (facing > 0) & (density > 0)
            depth, index = self.nearest(point[use], towards[use])
            use[use] = (index == self.room.lamp_polygon) | (depth >= distance[use] - _OFFSET)
            by_area = distance**2 / (area * np.where(facing > 0, facing, 1))
            dimmed = np.exp(-fog.optical_depth(point, towards, distance))
            self._add(result, pixel, scatters, reflections,
                      throughput * value * (use * dimmed / (by_area + density))[:, None] * radiance)
            # ---- on, and the lamp where that direction meets it
            direction = np.where(solid[:, None], _cosine(normal, rng), _henyey_greenstein(incoming, fog.asymmetry, rng))
            value, density = bsdf(direction)
            throughput = throughput * np.where(solid[:, None], albedo, 1.0)
            depth, index = self.nearest(point, direction)
            shining = (index == self.room.lamp_polygon) & (direction @ lamp.normal < 0)
            by_area = np.where(shining, depth, 0) ** 2 / (area * np.where(shining, -direction @ lamp.normal, 1))
            reach = fog.optical_depth(point, direction, depth)
            weight = np.where(shining, np.exp(-reach) * density / np.where(shining, density + by_area, 1), 0)
            self._add(result, pixel, scatters, reflections, throughput * weight[:, None] * radiance)
            # ---- the next vertex
            length = fog.distance(point, direction, rng.exponential(size=len(point)))
            in_fog = length < depth
            keep = in_fog | (index >= 0)
            if vertex >= _SURE:
                chance = np.minimum(throughput.max(1) / start, 0.95)
                keep &= rng.random(len(point)) < chance
                throughput = throughput / np.where(chance > 0, chance, 1)[:, None]
            if not keep.any():
                return
            step, index, direction, in_fog = np.minimum(length, depth)[keep], index[keep], direction[keep], in_fog[keep]
            pixel, start = pixel[keep], start[keep]
            point = point[keep] + step[:, None] * direction
            scatters, reflections = scatters[keep] + in_fog, reflections[keep] + ~in_fog
            albedo = np.where(in_fog[:, None], np.nan, self.room.albedos[index])
            side = -np.sign(np.einsum("ij,ij->i", self.normal[index], direction))
            normal = np.where(in_fog[:, None], 0, side[:, None] * self.normal[index])
            share = fog.scattering / fog.extinction if fog.extinction else 0
            throughput = throughput[keep] * np.where(in_fog, share, 1)[:, None]
            incoming = direction

    @staticmethod
    def _add(result, pixel, scatters, reflections, value):
        share = np.where(scatters == 0, (reflections > 1).astype(int), np.where(scatters == 1, 2 + (reflections > 0), 4))
        flat = share * result.shape[1] + pixel
        for c in range(3):
            result[..., c] += np.bincount(flat, value[:, c], result[..., 0].size).reshape(result.shape[:2])


def _frame(axis):
    """Two unit vectors (N, 3) across `axis` (N, 3)."""
    helper = np.where(np.abs(axis[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(axis, first)


def _around(axis, cosine, rng):
    angle = 2 * np.pi * rng.random(len(axis))
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    first, second = _frame(axis)
    return (cosine[:, None] * axis + (sine * np.cos(angle))[:, None] * first + (sine * np.sin(angle))[:, None] * second)


def _cosine(normal, rng):
    # a vertex in the fog has no normal; any does, for what comes of it is not used
    some = np.where((normal == 0).all(1)[:, None], [[0.0, 1.0, 0.0]], normal)
    return _around(some, np.sqrt(rng.random(len(normal))), rng)


def _henyey_greenstein(incoming, g, rng):
    u = rng.random(len(incoming))
    if abs(g) < 1e-3:
        return _around(incoming, 1 - 2 * u, rng)
    return _around(incoming, (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g), rng)
