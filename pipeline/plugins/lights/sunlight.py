"""Sunlight in the open air."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from pipeline.physics import airlight
from pipeline.plugins.base import Colour, Direction, Light, parameter


class Sunlight(Light):
    """The sun over open ground: parallel light, kept from the fog by what stands in the photograph.

    What the photograph shows of it has already crossed the air, so that its way down counts as clear unless
    the fog has a top. Its direction comes from a shadow, from date and place, or by hand.
    """

    type: Literal["sunlight"] = "sunlight"
    strength_name = "irradiance"
    rendered = "never"
    direction: Direction | None = parameter(
        None, "1", description="in which the light travels, from the sun; estimated when left out")
    irradiance: Colour | None = parameter(
        None, "photo unit * sr", description="on a surface facing the sun; estimated when left out")
    shadows: bool = parameter(
        True, description="whether what stands in the photograph throws shadows into the fog")

    def placed(self, name, world):
        return self

    def shaded(self):
        return self.shadows

    def incident(self, points):
        shape = np.shape(points)[:-1]
        return np.ones(shape), np.zeros(shape)

    def in_scattering(self, medium, eye, directions, depth):
        return airlight.directional(medium, eye, directions, depth, np.asarray(self.direction))

    def arrival(self, medium, points, normals):
        # a surface that the photograph shows dark has its shadow already; a share of nothing would be none
        cosine = np.maximum(-(normals @ np.asarray(self.direction)), 0.0)
        extinction = np.add(*medium.coefficients())
        path = medium.daylight_path(points, np.asarray(self.direction))
        return cosine, np.exp(-path[..., None] * extinction)

    def statement(self) -> dict[str, Any]:
        return {}
