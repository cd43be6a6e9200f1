"""What stands round a place in the open air and what it throws back, as the photograph shows it.

The paper's ground, and its fog, see all of the sky and nothing else. In a street a third of it may be walls, which hide the
sky and throw light back: skylight taken from such ground comes out too dark and tinted as the walls are, and fog that is
lit as if nothing stood there comes out too bright and too blue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.geometry.camera import Camera

#: Rays from each point, and points of a patch that rays are cast from.
RAYS, POINTS = 192, 24
#: A point is what the photograph shows at its pixel if its distance is within this share of the depth there.
SAME_DEPTH = 0.08
#: Pixels along the side of a square that a wide ray averages.
SIDE = 5
#: Rays start so high above the patch, as a share of its distance: stand-ins are right to a hundredth of it.
LIFT = 0.01


@dataclass(frozen=True)
class Look:
    """What rays (k,) from a point meet: distance [m], inf for nothing; face, its index, -1 for nothing; radiance (k, 3) of
    things; seen: whether that is what the photograph shows there, else the mean of what it shows of the same face."""

    distance: np.ndarray
    face: np.ndarray
    radiance: np.ndarray
    seen: np.ndarray


class Surroundings:
    """Solids with their colours in a photograph.

    cast(origin (3,), directions (k, 3)): distance [m], inf for none, and index of the face that rays meet. photograph
    (H, W, 3) linear, depth (H, W) [m] and face (H, W) say what it shows; lamps (H, W): pixels that show lamps, which throw
    nothing back.
    """

    def __init__(self, camera: Camera, cast: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
                 photograph: np.ndarray, depth: np.ndarray, face: np.ndarray, lamps: np.ndarray | None = None):
        self.camera, self.cast, self.depth, self.face = camera, cast, depth, face
        self.shown = face >= 0 if lamps is None else (face >= 0) & ~lamps
        self.photograph = photograph
        own, faces = photograph[self.shown].astype(float), face[self.shown].astype(int)
        overall = own.mean(0) if len(own) else np.zeros(3)
        count = np.bincount(faces)
        sums = np.stack([np.bincount(faces, own[:, k]) for k in range(3)], -1) if len(own) else np.zeros((0, 3))
        # a face that the photograph does not show counts as the mean of all that it shows
        self.means = np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], overall)
        self.overall = overall

    def mean_of(self, faces: list[int]) -> np.ndarray:
        """Mean radiance (3,) of what the photograph shows of these faces, else of all."""
        pixels = self.shown & np.isin(self.face, faces)
        return self.photograph[pixels].mean(0) if pixels.any() else self.overall

    def look(self, point: np.ndarray, directions: np.ndarray, width: float = 0.0) -> Look:
        """From a point (3,) [m] along unit directions (k, 3), each of which averages a square of the photograph `width`
        [pixel] wide as far as it shows the same face."""
        distance, met = self.cast(point, directions)
        solid = np.isfinite(distance)
        radiance = np.zeros((len(directions), 3))
        radiance[solid] = np.concatenate([self.means, [self.overall]])[np.minimum(met[solid], len(self.means))]
        at = point + distance[solid, None] * directions[solid]
        pixels, _ = self.camera.project(at)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 0).all(-1) & (pixels < [self.camera.width, self.camera.height]).all(-1)
        column, row = np.where(inside[:, None], pixels, 0).astype(int).T
        off = np.linalg.norm(at - self.camera.position, axis=-1)
        known = inside & (np.abs(self.depth[row, column] - off) < SAME_DEPTH * off) & self.shown[row, column]
        seen = np.zeros(len(directions), bool)
        seen[solid] = known
        radiance[seen] = self._averaged(row[known], column[known], met[seen], width)
        return Look(distance, met, radiance, seen)

    def _averaged(self, row: np.ndarray, column: np.ndarray, face: np.ndarray, width: float) -> np.ndarray:
        """Radiance (n, 3) round pixels (n,) of these faces (n,)."""
        if not width or not len(row):
            return self.photograph[row, column]
        aside = np.round(np.linspace(-width / 2, width / 2, SIDE)).astype(int)
        rows = np.clip(row[:, None, None] + aside[:, None], 0, self.camera.height - 1)
        columns = np.clip(column[:, None, None] + aside, 0, self.camera.width - 1)
        rows, columns = (n.reshape(len(row), -1) for n in np.broadcast_arrays(rows, columns))
        same = self.shown[rows, columns] & (self.face[rows, columns] == face[:, None])
        # its own pixel is one of them, and shown, but may be of a face nearby where two meet
        total, count = np.einsum("nk,nkc->nc", same.astype(float), self.photograph[rows, columns]), same.sum(1)
        return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], self.photograph[row, column])

    def of_patch(self, points: np.ndarray, normal: np.ndarray) -> "PatchLight":
        """What lights a patch with points (n, 3) [m] and unit `normal` (3,).

        Whatever rises to nothing meets the sky, so that what stands beside and behind the camera counts as sky.
        """
        directions = hemisphere(np.asarray(normal, float), RAYS)
        chosen = points[np.linspace(0, len(points) - 1, min(len(points), POINTS)).astype(int)]
        sky, unseen, reflected = 0, 0, np.zeros(3)
        for point in chosen:
            found = self.look(point + LIFT * np.linalg.norm(point - self.camera.position) * normal, directions)
            nothing = found.face < 0
            open_sky = nothing & (directions[:, 1] > 0)
            sky += int(open_sky.sum())
            unseen += int((~open_sky & ~found.seen).sum())
            # beyond the edge of the ground there is more of what the photograph shows
            reflected += found.radiance.sum(0) + (nothing & ~open_sky).sum() * self.overall
        total = len(chosen) * len(directions)
        return PatchLight(sky / total, reflected / total, unseen / total)


@dataclass(frozen=True)
class PatchLight:
    """sky: share of the irradiance pi * L that a uniform sky of radiance L leaves; reflected (3,): radiance of all else,
    weighted by its share; unseen: share of the irradiance that comes from what the photograph does not show."""

    sky: float
    reflected: np.ndarray
    unseen: float


def hemisphere(normal: np.ndarray, count: int) -> np.ndarray:
    """Unit directions (count, 3) about a normal (3,), as dense as the cosine: each brings the same irradiance."""
    index = np.arange(count) + 0.5
    radius, angle = np.sqrt(index / count), index * np.pi * (3 - np.sqrt(5))  # a sunflower's seeds
    helper = np.array([1.0, 0, 0]) if abs(normal[0]) < 0.9 else np.array([0, 1.0, 0])
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    return (np.outer(radius * np.cos(angle), u) + np.outer(radius * np.sin(angle), v)
            + np.outer(np.sqrt(1 - radius**2), normal))
