"""What lights a patch of ground besides sun and open sky: the houses and trees round it, as the photograph shows them.

The paper's ground sees all of the sky and nothing else. In a street a third of it may be walls, which hide the sky and
throw light back: skylight taken from such ground comes out too dark, and tinted as the walls are.
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
#: Rays start so high above the patch, as a share of its distance: stand-ins are right to a hundredth of it.
LIFT = 0.01


@dataclass(frozen=True)
class Surroundings:
    """sky: share of the irradiance pi * L that a uniform sky of radiance L leaves; reflected (3,): radiance of all else,
    weighted by its share; unseen: share of the irradiance that comes from what the photograph does not show."""

    sky: float
    reflected: np.ndarray
    unseen: float


def surroundings(camera: Camera, points: np.ndarray, normal: np.ndarray,
                 cast: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], photograph: np.ndarray,
                 depth: np.ndarray, face: np.ndarray) -> Surroundings:
    """Of a patch with points (n, 3) [m] and unit `normal` (3,), among solids.

    cast(origin (3,), directions (k, 3)): distance [m], inf for none, and index of the face that rays meet. photograph
    (H, W, 3) linear, depth (H, W) [m] and face (H, W) say what it shows. Whatever rises to nothing meets the sky, so
    that what stands beside and behind the camera counts as sky. What is met but not seen counts as the mean of what is
    seen of the same face, else of all faces.
    """
    directions = _hemisphere(np.asarray(normal, float))
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), POINTS)).astype(int)]
    shown = face >= 0
    overall = photograph[shown].mean(0) if shown.any() else np.zeros(3)
    means: dict[int, np.ndarray] = {}
    sky, unseen, reflected = 0, 0, np.zeros(3)
    for point in chosen:
        point = point + LIFT * np.linalg.norm(point - camera.position) * normal
        distance, met = cast(point, directions)
        open_sky = ~np.isfinite(distance) & (directions[:, 1] > 0)
        sky += int(open_sky.sum())
        at = point + np.where(np.isfinite(distance), distance, 1e6)[:, None] * directions
        pixels, _ = camera.project(at)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 0).all(-1) & (pixels < [camera.width, camera.height]).all(-1)
        column, row = np.where(inside[:, None], pixels, 0).astype(int).T
        off = np.linalg.norm(at - camera.position, axis=-1)
        seen = inside & ~open_sky & (np.abs(depth[row, column] - off) < SAME_DEPTH * off) & shown[row, column]
        reflected += photograph[row[seen], column[seen]].sum(0)
        hidden = ~open_sky & ~seen
        unseen += int(hidden.sum())
        for index, count in zip(*np.unique(met[hidden], return_counts=True)):
            if index not in means:
                own = face == index
                means[index] = photograph[own].mean(0) if index >= 0 and own.any() else overall
            reflected += count * means[index]
    total = len(chosen) * len(directions)
    return Surroundings(sky / total, reflected / total, unseen / total)


def _hemisphere(normal: np.ndarray) -> np.ndarray:
    """Unit directions (RAYS, 3) about a normal (3,), as dense as the cosine: each brings the same irradiance."""
    index = np.arange(RAYS) + 0.5
    radius, angle = np.sqrt(index / RAYS), index * np.pi * (3 - np.sqrt(5))  # a sunflower's seeds
    helper = np.array([1.0, 0, 0]) if abs(normal[0]) < 0.9 else np.array([0, 1.0, 0])
    u = np.cross(normal, helper)
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    return (np.outer(radius * np.cos(angle), u) + np.outer(radius * np.sin(angle), v)
            + np.outer(np.sqrt(1 - radius**2), normal))
