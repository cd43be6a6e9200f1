"""What lights the fog in a room: what points all over it and the patches of its surfaces see round them.

The photograph shows part of that. A surface that it does not show is as dark, against what lights it, as the photograph shows
of the same face, else of all: what lights it are the lamps, whose strengths are known by then, and all the other surfaces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from pipeline.estimation.fog_surroundings import AVERAGED, MOST_PAIRS, FogSurroundings
from pipeline.estimation.surroundings import Surroundings, hemisphere
from pipeline.geometry.camera import Camera
from pipeline.geometry.lattice import Lattice, lattice
from pipeline.geometry.patches import Patches, areas_and_normals, patches
from pipeline.geometry.planes import polygon_normal
from pipeline.geometry.visibility import COINCIDENT
from pipeline.physics.fog_transport import MOST_REFLECTED, Lamp, Sight
from pipeline.side_by_side import side_by_side

#: Points in the room, patches of its surfaces, and directions from each; directions from points before the photograph.
POINTS, PATCHES, DIRECTIONS, VIEW_DIRECTIONS = 300, 300, 128, 96
FEWEST_DIRECTIONS = 64
#: Share of what is met beyond which nothing counts as the room's.
OUTLIERS = 1e-3
#: Places along each ray that show where the room is open.
ALONG = 6
#: Rays start so far above a patch, as a share of its side.
LIFT = 1e-3
#: A way to a lamp that is free so far meets the lamp itself.
NEAR_END = 0.07
#: Rounds in which light is reflected among what is not shown, and rays that must have seen a face to know its colour.
ROUNDS, FEWEST = 6, 20


@dataclass(frozen=True)
class RoomLight:
    """within: what the points of `lattice` see; beside: what `patches` see before them; unhidden: by lamp, which patches (q,)
    it reaches; faces (n + q, d): index of what both see, -1 for nothing. Radiance is that of clear air."""

    lattice: Lattice
    within: Sight
    patches: Patches
    beside: Sight
    unhidden: dict[str, np.ndarray]
    faces: np.ndarray

    def lit_by(self, lights: dict[str, Any], strengths: dict[str, np.ndarray]) -> list[Lamp]:
        """Its lamps, of lights and strengths (3,) by name."""
        return [Lamp(lights[name].reaching, np.asarray(strengths[name], float), free) for name, free in self.unhidden.items()]


def sphere(count: int) -> np.ndarray:
    """Unit directions (count, 3), evenly all over the sphere: each stands for as much of it."""
    index = np.arange(count) + 0.5
    y, turn = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - y * y)
    return np.stack([across * np.cos(turn), y, across * np.sin(turn)], 1)


def meets(points: np.ndarray, directions: np.ndarray, reach: np.ndarray, lamps: list[np.ndarray]) -> np.ndarray:
    """Which rays (n, d) from points (n, 3) along directions (n, d, 3) end at the lit side of a lamp (k, 3): black, for what it
    throws back is nothing beside what it sends, and that is counted with the lamp."""
    found = np.zeros(reach.shape, bool)
    for polygon in lamps:
        normal, across = polygon_normal(polygon), polygon[1] - polygon[0]
        axes = np.stack([across, np.cross(normal, across)]) / np.linalg.norm(across)
        height = (points - polygon[0]) @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = height[:, None] / -(directions @ normal)
            meeting = (height[:, None] > 0) & (distance > 0) & (distance <= reach * (1 + COINCIDENT))
        flat = (points[np.nonzero(meeting)[0]] + distance[meeting][:, None] * directions[meeting] - polygon[0]) @ axes.T
        found[meeting] |= shapely.contains_xy(shapely.Polygon((polygon - polygon[0]) @ axes.T), flat)
    return found


def before(cut: Patches, count: int) -> np.ndarray:
    """Directions (q, count, 3) that bring patches the same irradiance each."""
    return np.stack([hemisphere(normal, count) for normal in cut.normals])


def sight(points: np.ndarray, directions: np.ndarray, weights: np.ndarray, reach: np.ndarray, radiance: np.ndarray,
          face: np.ndarray, normals: np.ndarray, among: Patches) -> Sight:
    """Of faces (n, d) with normals (f, 3): which patches those are, and which way they look."""
    solid = face >= 0
    towards = normals[np.maximum(face, 0)]
    towards = towards * -np.sign((towards * directions).sum(-1, keepdims=True))
    patch = np.full(face.shape, -1)
    met = points[:, None] + np.where(solid, reach, 0)[..., None] * directions
    patch[solid] = among.nearest(met[solid], towards[solid])
    return Sight(points, directions, weights, reach, radiance, patch, towards)


def of_view(camera: Camera, found: FogSurroundings, normals: np.ndarray, among: Patches) -> Sight:
    """Of the points before the photograph that lie in the open."""
    known = found.known
    return sight(found.points(camera)[known], np.broadcast_to(found.directions, (int(known.sum()), *found.directions.shape)),
                 np.broadcast_to(found.solid_angles / found.solid_angles.sum(), found.reach[known].shape),
                 found.reach[known], found.radiance[known], found.face[known], normals, among)


def room_light(camera: Camera, around: Surroundings, found: FogSurroundings, faces: list[np.ndarray], lamps: dict[str, Any],
               strengths: dict[str, np.ndarray], triangles: int, share: float = 1.0
               ) -> tuple[FogSurroundings, RoomLight | None]:
    """`found`, with what the photograph does not show lit as lamps do; and the room, None where its fog sees nothing.

    faces: corners (n, 3) [m] by index; lamps: lights that reach fog and surfaces from a place of their own; strengths: (3,)
    of each. triangles, share: as `fog_surroundings`.
    """
    known = found.known
    own, reach, normals = found.points(camera)[known], found.reach[known], areas_and_normals(faces)[1]
    shining = [polygon for polygon in (light.emitting_polygon() for light in lamps.values()) if polygon is not None]
    at_lamps = np.zeros(found.face.shape, bool)
    at_lamps[known] = meets(own, np.broadcast_to(found.directions, (len(own), *found.directions.shape)), reach, shining)
    found = replace(found, face=np.where(at_lamps, -1, found.face), radiance=np.where(at_lamps[..., None], 0, found.radiance))
    # as many fewer along each way
    share = min(share, (MOST_PAIRS / (DIRECTIONS * max(triangles, 1)) / (POINTS + PATCHES)) ** (1 / 4))
    count = max(FEWEST_DIRECTIONS, round(share * DIRECTIONS))
    cut = patches(faces, max(24, round(share**2 * PATCHES)))
    cut = _sides(camera, found, normals, cut)
    view = of_view(camera, found, normals, cut)
    met = (own[:, None] + reach[..., None] * found.directions)[np.isfinite(reach)]
    if not len(met):
        return found, None
    low, high = np.quantile(met, [OUTLIERS, 1 - OUTLIERS], axis=0)
    # of a floor without walls the fog is what lies before the eye
    low, high = np.minimum(low, own.min(0)), np.maximum(high, own.max(0))
    farthest = float(np.linalg.norm(high - low))
    steps = np.minimum(reach, farthest)[..., None] * ((np.arange(ALONG) + 0.5) / ALONG)
    open_places = (own[:, None, None] + steps[..., None] * found.directions[:, None]).reshape(-1, 3)
    within = lattice(open_places, low, high, max(24, round(share**3 * POINTS)))
    wide = max(camera.width, camera.height) / AVERAGED

    def seen_from(place: tuple[np.ndarray, np.ndarray]):
        return around.look(*place, wide)

    evenly = np.broadcast_to(sphere(count), (len(within.points), count, 3))
    looks = list(side_by_side(seen_from, [*zip(within.points, evenly), *zip(_above(cut), before(cut, count))]))
    sights, shown = [view], [(found.face[known], found.seen[known])]
    for places, directions, some in ((within.points, evenly, looks[:len(evenly)]), (cut.points, before(cut, count), looks[len(evenly):])):
        distance, face, radiance = (np.stack([getattr(look, part) for look in some]) for part in ("distance", "face", "radiance"))
        at_lamps = meets(places, directions, distance, shining)
        face[at_lamps], radiance[at_lamps] = -1, 0
        shown.append((face, np.stack([look.seen for look in some])))
        sights.append(sight(places, directions, np.full(face.shape, 1 / count), distance, radiance, face, normals, cut))
    unhidden = _unhidden(lamps, cut, around.cast)
    room = RoomLight(within, sights[1], cut, sights[2], unhidden, np.concatenate([shown[1][0], shown[2][0]]))
    _light_unseen(sights, shown, room.lit_by(lamps, strengths))
    radiance = found.radiance.copy()
    radiance[known] = sights[0].radiance
    for k in range(1, radiance.shape[2]):
        gone = ~known[..., k]
        radiance[gone, k] = radiance[gone, k - 1]
    return replace(found, radiance=radiance), room


def _sides(camera: Camera, found: FogSurroundings, normals: np.ndarray, cut: Patches) -> Patches:
    """The sides of patches that are seen; both, where neither is."""
    both = replace(cut, points=np.concatenate([cut.points, cut.points]), normals=np.concatenate([cut.normals, -cut.normals]))
    view = of_view(camera, found, normals, both)
    seen = np.bincount(view.patch[view.patch >= 0], minlength=len(both.points)).reshape(2, -1)
    kept = np.where(seen.any(0), seen >= seen.max(0), True).ravel()
    return replace(both, points=both.points[kept], normals=both.normals[kept])


def _above(cut: Patches) -> np.ndarray:
    return cut.points + LIFT * cut.spacing * cut.normals


def _unhidden(lamps: dict[str, Any], cut: Patches, cast: Callable) -> dict[str, np.ndarray]:
    """By lamp 1 for patches (q,) that nothing stands before on its way, else 0."""
    found, start = [light.reaching(cut.points) for light in lamps.values()], _above(cut)
    travels, path = np.stack([one.travels for one in found], 1), np.stack([one.path for one in found], 1)
    free = np.stack([cast(place, -rays)[0] for place, rays in zip(start, travels)]) > (1 - NEAR_END) * path
    return dict(zip(lamps, free.T.astype(float)))


def _light_unseen(sights: Sequence[Sight], shown: Sequence[tuple[np.ndarray, np.ndarray]], lamps: list[Lamp]) -> None:
    """Puts radiance in place of the unknown: of each face as much of its light as the photograph shows of it.

    sights: the view, which knows the colours, others, and last what patches see; shown: face (n, d) and seen (n, d) of each.
    """
    direct = [one.lit(lamps)[0] for one in sights]
    count = max(int(face.max(initial=-1)) for face, _ in shown) + 1
    face, seen = shown[0]
    known = seen & (face >= 0)
    rays = np.bincount(face[known], minlength=count)
    sent = _by_face(sights[0].radiance[known], face[known], count)
    for _ in range(ROUNDS):
        reflected = sights[-1].mean(sights[-1].radiance)
        light = [lit + reflected[np.maximum(one.patch, 0)] for one, lit in zip(sights, direct)]
        got = _by_face(light[0][known], face[known], count)
        overall = sent.sum(0) / np.maximum(got.sum(0), 1e-12)
        back = np.where(rays[:, None] >= FEWEST, sent / np.maximum(got, 1e-12), overall)
        for one, lit, (which, visible) in zip(sights, light, shown):
            dark = (which >= 0) & ~visible
            one.radiance[dark] = np.clip(back, 0, MOST_REFLECTED)[which[dark]] * lit[dark]


def _by_face(values: np.ndarray, face: np.ndarray, count: int) -> np.ndarray:
    """Sums (count, 3) of values (n, 3) by face (n,)."""
    return np.stack([np.bincount(face, values[:, c], count) for c in range(3)], 1)
