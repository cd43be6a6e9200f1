"""The scene once its annotations are resolved: what everything after the geometry stage sees."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydantic import ValidationError

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.meshes import nearest_triangles
from pipeline.geometry.planes import fan, is_convex
from pipeline.plugins.base import FARTHEST, Exporter, Light, Medium, Shape, World


def placed(name: str, one: Shape | Light, world: World) -> Shape | Light:
    """A shape or light of the scene file in world metres; a shape's planes and residuals are added to `world`.

    Raises InputError, without a place, for annotations that say nothing, or contradict one another.
    """
    try:
        return one.placed(name, world)
    except ValidationError:  # what is placed is bounded as what is stated
        raise InputError(f"{name} comes out farther away or larger than {FARTHEST:g} m",
                         remedy="move its pixels away from the horizon of its plane, or check the camera") from None


@dataclass(frozen=True)
class PlacedScene:
    """A scene in world metres: what exporters see.

    outdoors: the photograph's depth comes from regions or a map, and the shapes stand in for it.
    """

    camera: Camera
    shapes: dict[str, Shape]
    lights: dict[str, Light]
    exporter: Exporter
    outdoors: bool = False
    #: Distance [m] of the open sky, which is all there is where nothing stands in for the depth.
    sky_depth: float = 1.0

    def rendered(self, light: str) -> bool:
        """Whether POV-Ray renders the light's T and V, rather than closed forms."""
        where = self.lights[light].rendered
        return where == "always" or (where == "indoors" and not self.outdoors)

    def shaded(self, light: str) -> bool:
        """Whether a light that is not rendered needs renders of what shadows take from its V."""
        return not self.rendered(light) and self.lights[light].shaded() and self.casts_shadows()

    def casts_shadows(self) -> bool:
        return any(shape.casts_shadow for shape in self.shapes.values())

    def completes(self, light: str, medium: Medium) -> bool:
        """Whether V without shadows is known of a light that is rendered."""
        return self.lights[light].completes(medium, self.casting_faces())

    def dimmed(self, light: str) -> bool:
        """Whether anything may keep the light from the fog."""
        return self.lights[light].dimmed_by(self.casting_faces())

    def casting_faces(self) -> list[np.ndarray]:
        """Corners (n, 3) [m] of the faces that cast shadows."""
        return [corners for shape in self.shapes.values() if shape.casts_shadow for corners in shape.faces().values()]

    def faces(self) -> list[tuple[str, np.ndarray]]:
        """(SHAPE.FACE, (n, 3) [m]) in the order of their indices."""
        return [(f"{name}.{face}", corners) for name, shape in self.shapes.items()
                for face, corners in shape.faces().items()]

    def first_hit(self, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] to the first thing that rays (k, 3) from `origin` (3,) meet, inf for none, and the index of its face
        among `faces()`, -1 for none."""
        vertices, triangles, owner, others = self._solids
        distance, which = nearest_triangles(origin, directions, vertices, triangles)
        face = owner[which]
        for first, shape in others:
            found, index = (one[0] for one in shape.intersect(origin, directions[None]))
            closer = found < distance
            distance, face = np.where(closer, found, distance), np.where(closer, index + first, face)
        return distance, face

    def triangle_count(self) -> int:
        """How many `first_hit` tries each ray on."""
        return len(self._solids[1])

    @cached_property
    def _solids(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[int, Shape]]]:
        """Meshes and convex faces as one mesh, the face that each triangle is of, -1 after the last; and other shapes with
        their first face."""
        vertices, triangles, owner, others, first, count = [], [], [], [], 0, 0
        for shape in self.shapes.values():
            faces = list(shape.faces().values())
            if shape.type == "mesh":
                parts = [(np.asarray(shape.vertices, float), np.asarray(shape.triangles))]
            elif type(shape).intersect is Shape.intersect and all(map(is_convex, faces)):
                parts = [(corners, fan(len(corners))) for corners in faces]
            else:
                parts = []
                others.append((first, shape))
            for index, (corners, of_corners) in enumerate(parts):
                vertices.append(corners)
                triangles.append(of_corners + count)
                owner += len(of_corners) * [first + index]
                count += len(corners)
            first += len(faces)
        return (np.concatenate([np.zeros((0, 3)), *vertices]), np.concatenate([np.zeros((0, 3), int), *triangles]),
                np.array([*owner, -1]), others)

    def extent(self) -> float:
        """Radius [m] round the camera that holds everything."""
        if not self.shapes:
            return self.sky_depth
        points = np.concatenate([corners for _, corners in self.faces()])
        return float(np.linalg.norm(points - self.camera.position, axis=1).max())
