"""The scene as other programs' languages state it: plain numbers, made once for all exporters.

World metres, right-handed, y up; colours linear Rec.709; radiance, intensity [m^2] and irradiance [sr] in photo units.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.plugins.base import Light, Medium


@dataclass(frozen=True)
class Face:
    """A planar polygon, or vertices and triangles (m, 3); corners (n, 3) [m], diffuse albedo (3,). room: seen from inside."""

    name: str
    corners: np.ndarray
    albedo: np.ndarray
    room: bool = False
    triangles: np.ndarray | None = None


@dataclass(frozen=True)
class Description:
    """One render: what = foggy | in_scattering | transmittance | clear.

    in_scattering: black surfaces, light scattered once. transmittance: white surfaces, fog that only absorbs and
    lies on the light's way alone; clear: the same without fog. The eye's way is exp(-optical depth), which
    sampling would only make noisy. lights: plugin and strength (3,) by name. bounds: corners (2, 3) [m] of the fog.
    shafts: closed convex hulls, vertices (n, 3) and outward triangles (m, 3), outside which nothing scatters.
    """

    what: str
    camera: Camera
    faces: list[Face]
    lights: dict[str, tuple[Light, np.ndarray]]
    medium: Medium
    bounds: np.ndarray
    shafts: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
