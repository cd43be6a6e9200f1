"""Light that the ground throws back: the lower half of the sphere."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.physics import airlight
from pipeline.plugins.base import Colour, Light, parameter


class Ground(Light):
    """Uniform radiance from below the horizon: what ground, water and snow reflect into the fog.

    The paper leaves it out; with it fog under a sky as bright as the ground looks like both (the airlight of
    a uniformly lit place is its own radiance). Its way counts as clear; it costs no render.
    """

    type: Literal["ground"] = "ground"
    strength_name = "radiance"
    rendered = "never"
    light_source = False
    comes_from = "below"
    radiance: Colour | None = parameter(
        None, "photo unit", description="the mean of the photograph's ground when left out")
    unobstructed: bool = parameter(False, description="true: upright things hide nothing of it from the fog")

    def placed(self, name, world):
        return self

    def incident(self, points):
        shape = np.shape(points)[:-1]
        return np.full(shape, np.pi), np.zeros(shape)

    def in_scattering(self, medium, eye, directions, depth):
        return airlight.dome(medium, eye, directions, depth, upper=False)

    def arrival(self, medium, points, normals):
        """A level ground sees nothing of itself, an upright wall half of it."""
        return np.pi * (1 - normals[..., 1]) / 2, np.ones((*np.shape(points)[:-1], 3))
