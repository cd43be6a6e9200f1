"""The scene as other programs' languages state it: plain numbers, made once for all exporters.

World metres, right-handed, y up; colours linear Rec.709; radiance, intensity [m^2] and irradiance [sr] in photo units.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.plugins.lights.area import Area
from pipeline.plugins.base import Light, Medium


#: A lamp that lies in the ceiling is put so far [m] in front of it, or rounding would decide which is seen.
LIFT = 1e-3


@dataclass(frozen=True)
class Face:
    """A surface: vertices (n, 3) [m], triangles (m, 3) of their indices, diffuse albedo (3,)."""

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    albedo: np.ndarray


@dataclass(frozen=True)
class Description:
    """One render: what = foggy | in_scattering | transmittance | clear.

    in_scattering: black surfaces, light scattered once. transmittance: white surfaces, fog that only absorbs,
    where the language allows on the light's way alone, for the eye's is exp(-optical depth), which sampling would only
    make noisy; clear: the same without fog. lights: plugin and strength (3,) by name. bounds: corners (2, 3) [m] of the fog.
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

    def reflectance(self, face: Face) -> np.ndarray:
        """Albedo (3,) that the face has in this render."""
        return {"in_scattering": np.zeros(3), "foggy": face.albedo}.get(self.what, np.ones(3))

    def border(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (8, 3) [m] and outward triangles (12, 3) of the box that the fog fills."""
        corners = np.array([[self.bounds[i & 1, 0], self.bounds[i >> 1 & 1, 1], self.bounds[i >> 2, 2]] for i in range(8)])
        quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
        return corners, np.array([(q[0], q[i], q[i + 1]) for q in quads for i in (1, 2)])

    def eye_in_shaft(self) -> bool:
        eye = self.camera.position
        for vertices, triangles in self.shafts:
            a, b, c = (np.asarray(vertices)[np.asarray(triangles)[:, k]] for k in range(3))
            if (np.einsum("ij,ij->i", np.cross(b - a, c - a), eye - a) < 0).all():
                return True
        return False

    def density(self, cells: int) -> np.ndarray:
        """Relative density (z, y, x) at the centres of so many cells along each axis of `bounds`."""
        low, high = self.bounds
        x, y, z = (low[k] + (np.arange(cells) + 0.5) / cells * (high[k] - low[k]) for k in range(3))
        z, y, x = np.meshgrid(z, y, x, indexing="ij")
        return self.medium.density(np.stack([x, y, z], -1))


def fan(count: int) -> np.ndarray:
    """Triangles (count - 2, 3) of a convex polygon."""
    return np.array([(0, i, i + 1) for i in range(1, count - 1)])


def emitter(light: Area) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) [m] and triangles of an area light, counter-clockwise seen from its lit side."""
    return light.outline.polygon + LIFT * light.normal, fan(len(light.outline.polygon))
