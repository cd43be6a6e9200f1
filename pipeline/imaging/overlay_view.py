"""Lines of the world as a photograph shows them, clipped in 3D and told apart by what stands before them.

Everything is clipped against the view's frustum before it is projected, so that what runs past the camera's side or
behind it ends at the picture's border.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter

from pipeline.geometry.camera import Camera

#: An edge may lie so far [share of its depth] behind a surface and count as seen: boxes are fitted one by
#: one, and one that stands at a wall ends a centimetre before or behind it.
COINCIDENT = 2e-2
#: Points along an edge that are looked up.
STEPS = 97


def clip_segment(a: np.ndarray, b: np.ndarray, planes: np.ndarray) -> np.ndarray | None:
    """Part (2, 3) of a segment where n . x + c >= 0 for all `planes` (m, 4); None where there is none."""
    at_a, at_b = planes[:, :3] @ a + planes[:, 3], planes[:, :3] @ b + planes[:, 3]
    if np.any((at_a < 0) & (at_b < 0)):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = at_a / (at_a - at_b)
    start = max([0.0, *crossing[at_a < 0]])
    end = min([1.0, *crossing[at_b < 0]])
    return np.stack([a + start * (b - a), a + end * (b - a)]) if start < end else None


def clip_polygon(points: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Part (k, 3) of a polygon (n, 3) where n . x + c >= 0 for all `planes` (m, 4); k may be 0.

    Sutherland and Hodgman 1974. Concave polygons may get edges along the planes, which a fill hides.
    """
    for plane in planes:
        kept = []
        height = points @ plane[:3] + plane[3]
        for i, (p, h) in enumerate(zip(points, height)):
            before, before_height = points[i - 1], height[i - 1]
            if (h >= 0) != (before_height >= 0):
                kept.append(before + (p - before) * (before_height / (before_height - h)))
            if h >= 0:
                kept.append(p)
        points = np.reshape(kept, (-1, 3))
        if not len(points):
            break
    return points


class ViewLines:
    """How world points come into a picture of the camera's size.

    margin [pixel]: so far beyond the picture's border lines are followed. farthest [m]: of what is seen.
    """

    def __init__(self, camera: Camera, margin: float, farthest: float):
        self.camera, self.farthest = camera, farthest
        f, (cx, cy) = camera.focal_length, camera.principal_point
        near = 1e-6 * max(farthest, 1e-12)  # any positive share: the sides bound the pixels
        #: (5, 4) half-spaces of the camera frame: before the near plane, inside the picture and the margin
        self.planes = np.array([[0, 0, 1, -near], [f, 0, cx + margin, 0], [-f, 0, camera.width + margin - cx, 0],
                                [0, f, cy + margin, 0], [0, -f, camera.height + margin - cy, 0]], float)

    def in_camera(self, points: np.ndarray) -> np.ndarray:
        return (np.asarray(points, float) - self.camera.position) @ self.camera.world_from_camera

    def sees(self, points: np.ndarray) -> bool:
        """Whether all world points (n, 3) lie in the picture or its margin."""
        return bool((self.in_camera(points) @ self.planes[:, :3].T + self.planes[:, 3]).min() >= 0)

    def pixels(self, in_camera: np.ndarray) -> np.ndarray:
        camera = self.camera
        return camera.focal_length * in_camera[..., :2] / in_camera[..., 2:] + camera.principal_point

    def clipped(self, a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
        """Ends (2, 3), in the camera frame, of the part of a world segment that is in the picture."""
        return clip_segment(self.in_camera(a), self.in_camera(b), self.planes)

    def segment(self, a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
        """Pixels (2, 2) of the ends of what is in the picture of a world segment, or None."""
        part = self.clipped(a, b)
        return None if part is None else self.pixels(part)

    def polygon(self, points: np.ndarray) -> np.ndarray:
        """Pixels (k, 2) of what is in the picture of a world polygon (n, 3); k may be 0."""
        inside = clip_polygon(self.in_camera(points), self.planes)
        return self.pixels(inside) if len(inside) >= 3 else np.zeros((0, 2))

    def edge(self, a: np.ndarray, b: np.ndarray, depth: np.ndarray) -> list[tuple[bool, np.ndarray]]:
        """Pieces of a solid thing's edge: whether it is seen, and its pixels (n, 2).

        depth (h, w) [m]: of what is seen, of any size, the farthest of a pixel and those round it.
        """
        part = self.clipped(a, b)
        if part is None:
            return []
        # evenly spaced in the picture, not in space, or one that ends near the eye gets coarse
        pixels = np.linspace(*self.pixels(part), STEPS)
        share = np.linspace(0, 1, STEPS)
        inverse = (1 - share) / part[0, 2] + share / part[1, 2]
        middle = (inverse[1:] + inverse[:-1]) / 2
        rays = (pixels[1:] + pixels[:-1]) / 2
        beside = np.linalg.norm(rays - self.camera.principal_point, axis=1) / self.camera.focal_length
        distance = np.hypot(beside, 1) / middle
        seen = distance <= self._looked_up(depth, rays) * (1 + COINCIDENT)
        seen = median_filter(seen, 9, mode="nearest")  # where two surfaces coincide it flickers
        pieces, first = [], 0
        for i in range(1, STEPS):
            if i == STEPS - 1 or seen[i] != seen[first]:
                pieces.append((bool(seen[first]), pixels[first : i + 1]))
                first = i
        return pieces

    def _looked_up(self, values: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        height, width = values.shape
        u = np.clip(pixels[:, 0] * width / self.camera.width, 0, width - 1).astype(int)
        v = np.clip(pixels[:, 1] * height / self.camera.height, 0, height - 1).astype(int)
        return values[v, u]

    def horizon(self) -> np.ndarray | None:
        """Pixels (2, 2) at which the line ends where level rays meet infinity; None where the picture shows none of it."""
        ahead = self.camera.world_from_camera[:, 2] * [1, 0, 1]
        if np.linalg.norm(ahead) < 1e-6:
            return None  # the camera looks straight up or down
        beside = np.cross(ahead, [0, 1, 0])
        middle = self.camera.position + self.farthest * ahead
        reach = 1e3 * self.farthest * beside
        return self.segment(middle - reach, middle + reach)

    def axis_length(self, origin: np.ndarray, wanted: float) -> float:
        """A round length [m], `wanted` at most, at which the ends of the axes at `origin` (3,) [m] are all seen."""
        decade = 10.0 ** np.floor(np.log10(wanted))
        lengths = decade * np.array([5, 3, 2, 1, 0.5, 0.3, 0.2, 0.1])
        lengths = lengths[lengths <= wanted * (1 + 1e-9)]
        return float(next((x for x in lengths if self.sees(origin + x * np.eye(3))), lengths[-1]))
