"""Point light: a small bulb that shines evenly in all directions."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from pipeline.physics import bulbs
from pipeline.plugins.annotations import Position
from pipeline.plugins.base import Colour, Light, parameter


class Point(Light):
    """A bulb: irradiance intensity / (d^2 + radius^2) at distance d."""

    type: Literal["point"] = "point"
    strength_name = "intensity"
    on_few_rays = True
    rendered = "indoors"
    position: Position = parameter(description="where the bulb is")
    intensity: Colour | None = parameter(None, "photo unit * m^2",
                                         description="known intensity; estimated when left out")
    radius: float = parameter(0.02, "m", ge=1e-6, le=1e5,
                              description="of the bulb; bounds the light close to it")
    shadows: bool = parameter(True, description="outdoors: whether things throw shadows into its glow")

    def placed(self, name, world):
        return self.model_copy(update={"position": self.position.placed(f"{name}.position", world)})

    def bulbs(self):
        return self.position.vector[None], self.radius

    def midpoint(self):
        return self.position.vector

    def incident(self, points):
        distance = np.linalg.norm(np.asarray(points, float) - self.position.vector, axis=-1)
        return 1 / (distance**2 + self.radius**2), distance

    def in_scattering(self, medium, eye, directions, depth):
        return bulbs.bulbs(medium, eye, directions, depth, self.position.vector[None], self.radius, [1.0])

    def completes(self, medium, faces):
        # elsewhere the way from the bulb to each point of a ray is an integral of its own
        return medium.layered

    def arrival(self, medium, points, normals):
        return bulbs.arrival(medium, points, normals, self.position.vector[None], self.radius, [1.0])

    def shaded(self):
        return self.shadows

    def hidden_count(self, medium, eye):
        return int(not bulbs.visible(medium, eye, self.position.vector).all())

    def shadow_worth(self, eye):
        return float(1 / (((self.position.vector - eye) ** 2).sum() + self.radius**2))

    def statement(self) -> dict[str, Any]:
        return {"location": self.position.point}
