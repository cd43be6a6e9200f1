"""Light of all orders in fog between surfaces that throw it back, at some hundred points.

What arrives at a point along a direction is what the surface there sends, dimmed, and what the fog before it scatters: of
lamps' own light by the phase function, and of all that arrives there after it was turned once, evenly to all sides. What a
surface sends is what the photograph shows of it, times how much more or less light reaches it through the fog. Both are
linear in the mean radiance J at each point and in the light E that each patch of the surfaces gets from there, for which
one system of equations is solved: no order of scattering or reflection is left out, whatever the density.

Surfaces and fog must throw back less than they get; a surface that the photograph shows brighter than that shines itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.side_by_side import side_by_side

#: Cells along each direction, the first ones shortest, and the optical depth at which they end.
CELLS, DEEPEST = 4, 12.0
#: Cells that one thread works on at a time.
AT_ONCE = 1 << 15
#: Share of its light that a surface throws back at most.
MOST_REFLECTED = 0.95


@dataclass(frozen=True)
class Sight:
    """What points (n, 3) [m] see along directions (n, d, 3), by weights (n, d) whose sums are 1: of a mean over the sphere, or
    of the irradiance / pi of a surface.

    reach (n, d) [m]: how far; radiance (n, d, 3) of it in clear air; patch (n, d): index of the nearest patch, -1 where there
    is no surface; normals (n, d, 3): of it, towards the point.
    """

    points: np.ndarray
    directions: np.ndarray
    weights: np.ndarray
    reach: np.ndarray
    radiance: np.ndarray
    patch: np.ndarray
    normals: np.ndarray

    def lit(self, lamps: list["Lamp"], medium: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance / pi (n, d, 3) that lamps give what is seen, in clear air and in fog; 0 where nothing is."""
        solid = self.patch >= 0
        places = self.points[np.nonzero(solid)[0]] + self.reach[solid][:, None] * self.directions[solid]
        normals, patch = self.normals[solid], self.patch[solid]
        found = np.zeros((2, *self.patch.shape, 3))
        found[:, solid] = sum((np.stack(lamp.on(places, normals, patch, medium)) for lamp in lamps), np.zeros((2, *places.shape)))
        return found[0], found[1]

    def mean(self, radiance: np.ndarray) -> np.ndarray:
        """(n, 3) of what arrives (n, d, 3)."""
        return np.einsum("nd,ndc->nc", self.weights, radiance)


@dataclass(frozen=True)
class Lamp:
    """A light that reaches fog and surfaces from a place of its own: its plugin's `reaching`, its strength (3,), and which of
    the patches (q,) nothing hides it from."""

    reaching: Callable[[np.ndarray], Any]
    strength: np.ndarray
    unhidden: np.ndarray

    def on(self, points: np.ndarray, normals: np.ndarray, patch: np.ndarray, medium: Any = None
           ) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance / pi (..., 3) of points (..., 3) on surfaces, each near a patch (...), in clear air and in fog."""
        found = self.reaching(points)
        facing = np.maximum(-np.einsum("...i,...i->...", found.travels, normals), 0)
        own = found.irradiance * facing * self.unhidden[patch] / np.pi
        clear = own[..., None] * self.strength
        if medium is None:
            return clear, clear
        return clear, clear * through(np.add(*medium.coefficients()), way_path(medium, points, found))


class Cells:
    """The fog before what points see, in cells along each direction."""

    def __init__(self, medium: Any, sight: Sight, nearest: Callable[[np.ndarray], np.ndarray], farthest: float):
        self.sight, densest = sight, float(np.add(*medium.coefficients()).max())
        ends = np.minimum(sight.reach, min(farthest, DEEPEST / densest if densest > 0 else np.inf))
        edges = ends[..., None] * (np.arange(CELLS + 1) / CELLS) ** 2
        middle = (edges[..., 1:] + edges[..., :-1]) / 2
        self.places = sight.points[:, None, None] + middle[..., None] * sight.directions[:, :, None]
        density = np.ones(middle.shape) if medium.even else medium.density(self.places)
        self.path = density * np.diff(edges, axis=-1)
        # what reaches beyond the last cell is taken to be as dense as that
        self.beyond = (sight.reach - ends) * np.maximum(density[..., -1], 1e-12)
        #: the point of the lattice that stands for each cell
        self.near = nearest(self.places)
        self.known: dict[float, tuple[np.ndarray, np.ndarray]] = {}

    def shares(self, extinction: float) -> tuple[np.ndarray, np.ndarray]:
        """(n, d, s): of what arrives at each cell, what it scatters to the point where fog does not absorb; (n, d): what is
        left of what lies behind them."""
        if extinction not in self.known:
            left = np.exp(-np.cumsum(extinction * self.path, -1))
            before = np.concatenate([np.ones_like(left[..., :1]), left[..., :-1]], -1)
            with np.errstate(invalid="ignore"):
                beyond = np.exp(-np.nan_to_num(extinction * self.beyond, nan=0.0))
            self.known[extinction] = before - left, left[..., -1] * beyond
        return self.known[extinction]


class Transport:
    """Of one fog. lattice: what points all over the fog see; beside: what patches see before them, both as far as `farthest`
    [m]; nearest(points (..., 3)): index (...) of the lattice's nearest point."""

    def __init__(self, medium: Any, lattice: Sight, beside: Sight, lamps: list[Lamp],
                 nearest: Callable[[np.ndarray], np.ndarray], farthest: float):
        self.medium, self.lamps, self.nearest, self.farthest = medium, lamps, nearest, farthest
        absorption, scattering = medium.coefficients()
        self.extinction = absorption + scattering
        self.albedo = np.divide(scattering, self.extinction, out=np.zeros(3), where=self.extinction > 0)
        #: irradiance / pi (q, 3) of patches by all that is reflected, in clear air
        self.clear = beside.mean(beside.radiance)
        seen, count = [self._seen(one) for one in (lattice, beside)], len(lattice.points)
        unknowns = count + len(beside.points)
        #: mean radiance (n, 3) at the lattice, and irradiance / pi (q, 3) of patches, but what comes straight from lamps
        self.J, self.E = np.zeros((count, 3)), np.zeros((len(beside.points), 3))
        for c in range(3):
            matrix, right, first = np.eye(unknowns), np.zeros(unknowns), 0
            for one in seen:
                share, left = one.cells.shares(float(self.extinction[c]))
                weights, size = one.sight.weights, len(one.sight.points)
                row = np.arange(size)[:, None]
                part = np.bincount((row[..., None] * unknowns + one.cells.near).ravel(),
                                   (weights[..., None] * self.albedo[c] * share).ravel(), size * unknowns)
                part += np.bincount((row * unknowns + count + one.hit).ravel(),
                                    (weights * left * one.back[..., c]).ravel(), size * unknowns)
                matrix[first:first + size] -= part.reshape(size, unknowns)
                right[first:first + size] = (weights * one.fixed[..., c]).sum(-1)
                first += size
            found = np.maximum(np.linalg.solve(matrix, right), 0)
            self.J[:, c], self.E[:, c] = found[:count], found[count:]

    def arriving(self, sight: Sight) -> np.ndarray:
        """Radiance (n, d, 3) in the fog, but what comes straight from lamps, where `sight` says what there is."""
        one = self._seen(sight)
        found = one.fixed
        for c in range(3):
            share, left = one.cells.shares(float(self.extinction[c]))
            found[..., c] += (left * one.back[..., c] * self.E[one.hit, c]
                              + self.albedo[c] * (share * self.J[one.cells.near, c]).sum(-1))
        return found

    def _seen(self, sight: Sight) -> "_Seen":
        cells = Cells(self.medium, sight, self.nearest, self.farthest)
        hit = np.maximum(sight.patch, 0)
        clear, foggy = sight.lit(self.lamps, self.medium)
        light = clear + self.clear[hit]
        back = np.where((sight.patch >= 0)[..., None], np.minimum(sight.radiance / np.maximum(light, 1e-12), MOST_REFLECTED), 0)
        fixed = self._scattered_once(cells)
        for c in range(3):
            left = cells.shares(float(self.extinction[c]))[1]
            shining = np.maximum(sight.radiance[..., c] - back[..., c] * light[..., c], 0)
            fixed[..., c] += left * (shining + back[..., c] * foggy[..., c])
        return _Seen(sight, cells, hit, back, fixed)

    def _scattered_once(self, cells: Cells) -> np.ndarray:
        """Radiance (n, d, 3) of lamps' own light that the fog turns once."""
        shares = [(value, cells.shares(value)[0], self.extinction == value) for value in np.unique(self.extinction).tolist()]
        parts = np.array_split(np.arange(len(cells.places)), max(1, cells.places[..., 0].size // AT_ONCE))

        def of(part: np.ndarray) -> np.ndarray:
            places, directions = cells.places[part], cells.sight.directions[part]
            total = np.zeros((*places.shape[:2], 3))
            for lamp in self.lamps:
                found = lamp.reaching(places)
                cosine = -np.einsum("ndsc,ndc->nds", found.travels, directions)
                own = self.medium.phase().value(np.clip(cosine, -1, 1)) * found.irradiance
                way = way_path(self.medium, places, found)
                for value, share, same in shares:
                    arriving = (share[part] * own * np.exp(-value * way)).sum(-1)
                    total[..., same] += arriving[..., None] * (lamp.strength * self.albedo)[same]
            return total

        return np.concatenate(list(side_by_side(of, parts)))


@dataclass(frozen=True)
class _Seen:
    """A sight in fog: hit (n, d), the patch of what is seen; back (n, d, 3), the share of its light that it throws back; fixed
    (n, d, 3), radiance of lamps' light turned once, by fog or surfaces, and of what shines itself."""

    sight: Sight
    cells: Cells
    hit: np.ndarray
    back: np.ndarray
    fixed: np.ndarray


def through(extinction: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Transmittance (..., 3) of so much (...) [m] of fog; each extinction (3,) [1/m] once."""
    values, channel = np.unique(extinction, return_inverse=True)
    return np.stack([np.exp(-value * path) for value in values], -1)[..., channel]


def way_path(medium: Any, points: np.ndarray, reaching: Any) -> np.ndarray:
    """Integral of the relative density (...) [m] on a lamp's way to points (..., 3)."""
    if medium.even:
        return reaching.path
    along = [medium.density(points - (t * reaching.path)[..., None] * reaching.travels) for t in (1 / 6, 1 / 2, 5 / 6)]
    return np.mean(along, axis=0) * reaching.path
