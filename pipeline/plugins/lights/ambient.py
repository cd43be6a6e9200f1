"""Ambient light: what walls and furniture reflect, as one uniform field."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.physics import airlight
from pipeline.plugins.base import Colour, Light, parameter


class Ambient(Light):
    """Light reflected about the room or street, from wherever the photograph shows it.

    In a room with lamps it is all that arrives but straight from them: what fog lets through of what surfaces throw back, and
    what it scatters again, any number of times, of that and of the lamps' light (pipeline/physics/fog_transport.py). Elsewhere
    its way counts as clear, as the sky's does outdoors: what the fog takes from it on one way it adds from another, so that
    what is lit by it alone looks the same in fog that absorbs nothing. It costs no render. Its strength is the mean of the
    photograph without its lamps. A stated radiance is the same from all sides, everywhere.
    """

    type: Literal["ambient"] = "ambient"
    strength_name = "radiance"
    rendered = "never"
    light_source = False
    comes_from = "all"
    radiance: Colour | None = parameter(None, "photo unit", description="estimated when left out")
    unobstructed: bool = parameter(
        False, description="true: the same from all sides everywhere, as a stated radiance is; else what is estimated comes from"
                           " where the photograph shows it, through the fog")

    def placed(self, name, world):
        return self

    def incident(self, points):
        shape = np.shape(points)[:-1]
        return np.full(shape, np.pi), np.zeros(shape)

    def in_scattering(self, medium, eye, directions, depth):
        """delta/kappa (1 - exp(-tau)): the phase function integrates to 1."""
        return airlight.veil(medium, eye, directions, depth)

    def arrival(self, medium, points, normals):
        shape = np.shape(points)[:-1]
        return np.full(shape, np.pi), np.ones((*shape, 3))

