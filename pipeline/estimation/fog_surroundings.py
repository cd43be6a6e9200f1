"""What the fog before a photograph sees round it: at points along eye rays, which of sky and ground is hidden, and by what.

Sky and ground light fog from all sides (Zhao et al. 2013, eq. 6, takes the sky's half of the sphere as free). Between
houses fog sees half of the sky, and for the rest the houses; in a room it sees walls alone.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import Camera
from pipeline.side_by_side import side_by_side

#: Rays along the photograph's longer side, points along each of them at most, and directions from each point.
LONGER, ALONG, DIRECTIONS = 10, 8, 200
#: How much denser directions are ahead: the asymmetry of the function that they follow.
CONCENTRATION = 0.5
#: The nearest point [m], as a share of the farthest; in a room points lie at powers of even shares.
NEAREST, INDOORS = 0.02, 1.5
#: A direction averages squares of this share of the photograph's longer side.
AVERAGED = 24
#: Pairs of direction and triangle that may be tried: some seconds. Where triangles are many, points are fewer, and what they
#: say of a street is coarser: a ninth fewer a side change its V of the sky by 3 %.
MOST_PAIRS = 200_000_000
#: Share of a ray's depth behind which its points lie in what it ends at.
BEFORE = 0.98
#: Share of what is shown beyond which nothing counts as standing round the fog.
FARTHEST_SHARE = 0.995
SKY, GROUND, THING = 0, 1, 2


@dataclass(frozen=True)
class FogSurroundings:
    """distances (k,) [m] of points along a grid of (h, w) rays; directions (d, 3) and the solid angles (d,) [sr] that they
    stand for.

    kind (h, w, k, d): SKY, GROUND or THING, whichever a point sees in a direction; radiance (h, w, k, d, 3): of ground and
    things, 0 of the sky; both of a point within something are those of the point before it on its ray. reach (h, w, k, d) [m]:
    how far what it sees is, inf for nothing, -1 of points within something; face (h, w, k, d): its index, -1 for nothing.
    seen (h, w, k, d): whether the radiance is what the photograph shows there.
    """

    distances: np.ndarray
    kind: np.ndarray
    radiance: np.ndarray
    reach: np.ndarray
    face: np.ndarray
    directions: np.ndarray
    solid_angles: np.ndarray
    seen: np.ndarray | None = None

    @property
    def known(self) -> np.ndarray:
        """Which points (h, w, k) lie in the open."""
        return self.reach[..., 0] >= 0

    def fewer(self, count: int) -> "FogSurroundings":
        """About so many of the directions at most, each standing for as much more of the sphere."""
        one = every(len(self.directions), count)
        solid_angles = self.solid_angles[one]
        return replace(self, kind=self.kind[..., one], radiance=self.radiance[..., one, :], reach=self.reach[..., one],
                       face=self.face[..., one], directions=self.directions[one],
                       solid_angles=solid_angles * (self.solid_angles.sum() / solid_angles.sum()),
                       seen=None if self.seen is None else self.seen[..., one])

    def points(self, camera: Camera) -> np.ndarray:
        """(h, w, k, 3) [m], before the camera that they were found for."""
        small = camera.resized(*self.kind.shape[1::-1])
        return camera.position + self.distances[:, None] * small.directions(small.pixel_centres())[:, :, None]

    def sky_seen(self) -> float:
        """Share of the sky that the points see on average."""
        above = self.directions[:, 1] > 0
        return float(((self.kind[..., above] == SKY) @ self.solid_angles[above]).mean() / self.solid_angles[above].sum())


def every(stored: int, wanted: int) -> slice:
    """About `wanted` of `stored` directions that turn by the golden angle from one to the next: evenly among them."""
    step = max(1, round(stored / wanted))
    return slice(step // 2, None, step)


def about(axis: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (count, 3) all over the sphere, denser about `axis` (3,), and their solid angles (count,) [sr].

    Fog scatters forward: what stands behind it, as the eye sees it, counts most. Their density is that of Henyey and
    Greenstein's phase function.
    """
    g, index = CONCENTRATION, np.arange(count) + 0.5
    cosine = (1 + g * g - ((1 - g * g) / (1 + g - 2 * g * index / count)) ** 2) / (2 * g)
    density = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    turn, across = index * np.pi * (3 - np.sqrt(5)), np.sqrt(1 - cosine**2)
    u = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    return (np.outer(across * np.cos(turn), u) + np.outer(across * np.sin(turn), v) + np.outer(cosine, axis),
            1 / (count * density))


def axis_of(camera: Camera) -> np.ndarray:
    """Unit direction (3,) to the middle of the picture."""
    return camera.directions(np.array([camera.width / 2, camera.height / 2]))


def fog_surroundings(camera: Camera, around: Surroundings, ground: list[int], triangles: int, share: float = 1.0,
                     count: int = DIRECTIONS, in_a_room: bool = False) -> FogSurroundings | None:
    """Of the fog before a photograph; None where nothing stands round it.

    ground: indices of faces that the fog's light from below comes from. triangles: of all that rays are tried on.
    share: of the rays and points along each of them that are taken at most; count: directions from each point. in_a_room: lamps
    are near, wherever a ray goes, so that points lie closer together far from the eye.
    """
    depth, face = around.depth, around.face
    standing = depth[(face >= 0) & ~np.isin(face, ground) & np.isfinite(depth)]
    if not standing.size:
        return None
    farthest = float(np.quantile(standing, FARTHEST_SHARE))
    # fewer rays and points alike, where each costs more
    share = min(share, (MOST_PAIRS / (count * max(triangles, 1)) / (LONGER * LONGER * ALONG)) ** (1 / 3))
    side, along = max(3, round(share * LONGER)), max(3, round(share * ALONG))
    longer = max(camera.width, camera.height)
    width, height = (max(2, round(side * n / longer)) for n in (camera.width, camera.height))
    small = camera.resized(width, height)
    rays = small.directions(small.pixel_centres())
    ends = (_middle_of_cells if in_a_room else _farthest_of_cells)(depth, height, width)
    distances = farthest * (((np.arange(along) + 0.5) / along) ** INDOORS if in_a_room else np.geomspace(NEAREST, 1, along))
    directions, solid_angles = about(axis_of(camera), count)
    rising = directions[:, 1] > 0
    open_plain = np.where(rising, SKY, GROUND)
    level = around.mean_of(ground)
    kind = np.broadcast_to(open_plain, (height, width, along, count)).copy()
    radiance = np.where(kind[..., None] == GROUND, level, 0)
    reach, face_met = np.full(kind.shape, -1.0), np.full(kind.shape, -1)
    seen, known = np.zeros(kind.shape, bool), distances < BEFORE * ends[..., None]

    def seen_from(at: tuple[int, int, int]) -> None:
        look = around.look(camera.position + distances[at[2]] * rays[at[:2]], directions, longer / AVERAGED)
        met, level_met = look.face >= 0, np.isin(look.face, ground)
        if (look.face[0] >= 0 and (look.face == look.face[0]).all()) or level_met[rising].mean() > 0.5:
            known[at] = False  # within something solid, or below the ground
            return
        # ground that rises before a point hides the sky
        kind[at] = np.where(met, np.where(level_met & ~rising, GROUND, THING), open_plain)
        radiance[at] = np.where(met[:, None], look.radiance, radiance[at])
        reach[at], face_met[at], seen[at] = look.distance, look.face, look.seen

    deque(side_by_side(seen_from, zip(*np.nonzero(known))), maxlen=0)
    # behind what a ray meets lies no fog that it sees: what its neighbours see there goes on from the last point before it
    for k in range(1, along):
        gone = ~known[..., k]
        kind[gone, k], radiance[gone, k] = kind[gone, k - 1], radiance[gone, k - 1]
    return FogSurroundings(distances, kind, radiance, reach, face_met, directions, solid_angles, seen)


def _middle_of_cells(depth: np.ndarray, height: int, width: int) -> np.ndarray:
    """(height, width) [m]: what the ray through the middle of each cell of a grid ends at."""
    rows, columns = (((np.arange(m) + 0.5) * n / m).astype(int) for n, m in zip(depth.shape, (height, width)))
    return depth[rows[:, None], columns]


def _farthest_of_cells(depth: np.ndarray, height: int, width: int) -> np.ndarray:
    """(height, width) [m]: the farthest that each cell of a grid shows."""
    rows, columns = (np.linspace(0, n, m + 1).astype(int)[:-1] for n, m in zip(depth.shape, (height, width)))
    return np.maximum.reduceat(np.maximum.reduceat(depth, rows, 0), columns, 1)
