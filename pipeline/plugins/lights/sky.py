"""Skylight: the upper half of the sphere, evenly bright."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.physics import airlight
from pipeline.plugins.base import Colour, Light, parameter


class Sky(Light):
    """Uniform radiance from above the horizon (Liu et al. 2009), as in Zhao et al. 2013, eq. 6.

    Its way down counts as clear unless the fog has a top. It is known in closed form or by quadrature and
    costs no render.
    """

    type: Literal["sky"] = "sky"
    strength_name = "radiance"
    rendered = "never"
    light_source = False
    comes_from = "above"
    radiance: Colour | None = parameter(None, "photo unit", description="estimated when left out")
    unobstructed: bool = parameter(
        False, description="true: the fog sees all of it, as in the paper; else upright things hide it in the open air and"
                           " throw back what the photograph shows of them")

    def placed(self, name, world):
        return self

    def incident(self, points):
        shape = np.shape(points)[:-1]
        return np.full(shape, np.pi), np.zeros(shape)

    def in_scattering(self, medium, eye, directions, depth):
        return airlight.dome(medium, eye, directions, depth, upper=True)

    def arrival(self, medium, points, normals):
        """An upright wall sees half of the sky, a ceiling none."""
        return np.pi * (1 + normals[..., 1]) / 2, airlight.dome_arrival(medium, points)
