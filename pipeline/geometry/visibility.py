"""What each pixel of a placed scene shows."""

from __future__ import annotations

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import polygon_normal
from pipeline.geometry.raycast import first_hits

#: A lamp drawn on a wall and the wall coincide; so near [share of the depth] the lamp is what is seen.
COINCIDENT = 2e-3


def visible(camera: Camera, shapes: dict, lights: dict
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radial depth (H, W) [m], inf past everything; visible face's index; visible light's index, -1 for none.

    shapes, lights: placed plugins by name; a shape's `intersect` and a light's `emitting_polygon` are asked.
    """
    size = (camera.height, camera.width)
    depth, face, emitter = np.empty(size), np.empty(size, int), np.empty(size, int)
    rows = max(1, int(2e6) // camera.width)
    for top in range(0, camera.height, rows):
        part = np.s_[top : top + rows]
        u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(*part.indices(camera.height)) + 0.5)
        depth[part], face[part], emitter[part] = seen_along(
            camera.position, camera.directions(np.stack([u, v], -1)), shapes, lights)
    return depth, face, emitter


def seen_along(eye: np.ndarray, directions: np.ndarray, shapes: dict, lights: dict
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of any rays (H, W, 3) from the eye."""
    size = directions.shape[:2]
    depth, face, emitter = np.full(size, np.inf), np.full(size, -1), np.full(size, -1)
    first = 0
    for shape in shapes.values():
        distance, index = shape.intersect(eye, directions)
        nearer = distance < depth
        depth, face = np.where(nearer, distance, depth), np.where(nearer, index + first, face)
        first += len(shape.faces())
    for index, light in enumerate(lights.values()):
        polygon = light.emitting_polygon()
        if polygon is None or polygon_normal(polygon) @ (eye - polygon.mean(0)) <= 0:
            continue  # a one-sided lamp is dark from behind
        distance, hit = first_hits(eye, directions, [polygon])
        seen = (hit == 0) & (distance <= depth * (1 + COINCIDENT))
        depth, emitter = np.where(seen, np.minimum(depth, distance), depth), np.where(seen, index, emitter)
    return depth, face, emitter
