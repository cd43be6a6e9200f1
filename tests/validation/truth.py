"""Ground truth of the Cornell rooms by quadrature, which shares nothing with the pipeline."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tests.reference import quadrature as q

ROOM = q.cornell_room()
SCALE_HEIGHT = 0.6  # [m]


@dataclass(frozen=True)
class Fog:
    """A fog of the Cornell scenes: coefficients [1/m]; `name` is what the scene calls it."""

    absorption: float
    scattering: float
    height: bool = False

    @property
    def scene(self) -> str:
        return "cornell_height" if self.height else "cornell"

    @property
    def name(self) -> str:
        kind = "height" if self.height else "homogeneous"
        return f"{kind}_a{self.absorption:.2f}_d{self.scattering:.2f}"

    @property
    def medium(self) -> q.Medium:
        return q.Medium(self.absorption, self.scattering, scale_height=SCALE_HEIGHT if self.height else None)


ALPHAS = [Fog(a, 0.1) for a in (0.0, 0.05, 0.15, 0.4)]
DELTAS = [Fog(0.05, d) for d in (0.02, 0.1, 0.3)]
HEIGHTS = [Fog(0.05, 0.2, True), Fog(0.1, 0.4, True), Fog(0.4, 0.4, True)]


class Truth:
    """What a camera sees of the room: without fog, and with it, fog and surfaces in one integral."""

    def __init__(self, size: int):
        self.size, self.rays = size, ROOM.rays(size, size)
        self.occluders = ROOM.polygons[:ROOM.lamp_polygon]
        hit = q.cast(ROOM.camera_position, self.rays.directions, ROOM.polygons)[1]
        self.surface = self.rays.surface()
        self.brdf = ROOM.albedos[hit[self.surface]] / np.pi

    @cached_property
    def clear(self) -> np.ndarray:
        """The clear photograph R, (size, size, 3), direct light only."""
        return self._picture(None)

    def foggy(self, fog: Fog) -> np.ndarray:
        """The lamp's own light, reflected or scattered once, (size, size, 3)."""
        return self._picture(fog.medium) + self._shaped(
            q.in_scattering(self.rays, fog.medium, ROOM.lamp, self.occluders))

    def by_midpoint(self, fog: Fog) -> tuple[np.ndarray, np.ndarray]:
        """The foggy picture with T, and with V, of the lamp's midpoint instead of its area, exact otherwise."""
        midpoint = np.nan_to_num(q.transmittance(self.rays, fog.medium, [ROOM.lamp], self.occluders, "midpoint"))
        exact = self._shaped(q.in_scattering(self.rays, fog.medium, ROOM.lamp, self.occluders))
        lamp = ROOM.lamp
        power = np.asarray(lamp.radiance) * np.linalg.norm(lamp.area_vector)
        point = q.SpotLight(lamp.midpoint, power, 0.0, lamp.normal, lambda c: np.maximum(c, 0), (0.0,))
        glow = q.in_scattering(self.rays, fog.medium, point, self.occluders)
        return self.clear * self._shaped(midpoint) + exact, self._picture(fog.medium) + self._shaped(glow)

    def _picture(self, medium: q.Medium | None) -> np.ndarray:
        rays, seen = self.rays, np.zeros((len(self.rays.depth), 3))
        seen[rays.emitter] = ROOM.lamp.radiance
        seen[self.surface] = self.brdf * q.direct_irradiance(
            ROOM.lamp, rays.points(self.surface), rays.normals[self.surface], self.occluders, medium)
        if medium is not None:
            path = rays.depth * q.mean_density(rays.origin[1], rays.points()[:, 1], medium.scale_height)
            seen = seen * np.exp(-medium.extinction * path[:, None])
        return self._shaped(seen)

    def _shaped(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(self.size, self.size, 3)
