"""Spot light: a bulb behind a cone."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from pipeline.errors import InputError
from pipeline.physics import bulbs
from pipeline.plugins.annotations import Position
from pipeline.plugins.base import Colour, Light, mistake, parameter


class Spot(Light):
    """A bulb with a cone: full inside `inner_angle`, nothing outside `outer_angle`, smooth between.

    Irradiance is intensity * s / (d^2 + radius^2), with s the smoothstep of the cosine of the angle off
    axis between the two cone angles.
    """

    type: Literal["spot"] = "spot"
    strength_name = "intensity"
    rendered = "indoors"
    position: Position = parameter(description="where the bulb is")
    target: Position = parameter(description="a point on its axis")
    inner_angle: float = parameter(20.0, "degree", ge=0, le=89, description="half angle of the full cone")
    outer_angle: float = parameter(30.0, "degree", gt=0, le=89.5, description="half angle where it ends")
    intensity: Colour | None = parameter(None, "photo unit * m^2",
                                         description="on the axis; estimated when left out")
    radius: float = parameter(0.02, "m", ge=1e-6, le=1e5,
                              description="of the bulb; bounds the light close to it")
    shadows: bool = parameter(True, description="outdoors: whether things throw shadows into its glow")

    @model_validator(mode="after")
    def _cone(self):
        if not self.inner_angle < self.outer_angle:
            raise mistake(f"inner_angle {self.inner_angle} is not below outer_angle {self.outer_angle}",
                          "give an inner_angle below the outer_angle [degree]")
        return self

    def placed(self, name, world):
        position = self.position.placed(f"{name}.position", world)
        target = self.target.placed(f"{name}.target", world)
        if np.linalg.norm(target.vector - position.vector) < 1e-9:
            raise InputError(f"{name}: target and position are the same point {position.point}",
                             remedy="move the target to where the light points")
        return self.model_copy(update={"position": position, "target": target})

    def cone(self, cosine: np.ndarray) -> np.ndarray:
        """Share of the axial intensity, by the cosine of the angle off axis."""
        inner, outer = np.cos(np.radians([self.inner_angle, self.outer_angle]))
        x = np.clip((np.asarray(cosine, float) - outer) / (inner - outer), 0, 1)
        return x * x * (3 - 2 * x)

    def bulbs(self):
        return self.position.vector[None], self.radius

    def midpoint(self):
        return self.position.vector

    def incident(self, points):
        offset = np.asarray(points, float) - self.position.vector
        distance = np.linalg.norm(offset, axis=-1)
        axis = self.target.vector - self.position.vector
        cosine = (offset @ axis) / np.maximum(distance * np.linalg.norm(axis), 1e-12)
        return self.cone(cosine) / (distance**2 + self.radius**2), distance

    @property
    def lit_cone(self) -> bulbs.Cone:
        axis = self.target.vector - self.position.vector
        inner, outer = np.cos(np.radians([self.inner_angle, self.outer_angle]))
        return bulbs.Cone(axis / np.linalg.norm(axis), float(inner), float(outer))

    def in_scattering(self, medium, eye, directions, depth):
        return bulbs.bulb(medium, eye, directions, depth, self.position.vector, self.radius, self.lit_cone)

    def completes(self, medium, faces):
        # elsewhere the way from the bulb to each point of a ray is an integral of its own
        return medium.layered

    def arrival(self, medium, points, normals):
        return bulbs.arrival(medium, points, normals, self.position.vector[None], self.radius, [1.0],
                             self.lit_cone)

    def shaded(self):
        return self.shadows

    def hidden_count(self, medium, eye):
        return int(not bulbs.visible(medium, eye, self.position.vector).all())

    def shadow_worth(self, eye):
        return float(1 / (((self.position.vector - eye) ** 2).sum() + self.radius**2))

    def statement(self) -> dict[str, Any]:
        return {"location": self.position.point, "point_at": self.target.point}
