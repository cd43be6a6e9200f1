"""What the runs of a fog say: V of each light, and T of any lights together."""

from __future__ import annotations

import numpy as np

from pipeline.geometry.visibility import visible
from pipeline.imaging.maps import read_map
from pipeline.paths import Build
from pipeline.physics.composition import combined_transmittance
from pipeline.physics.upsampling import upsample
from pipeline.rendering.runs import from_json
from pipeline.scene.artefacts import read_fog, read_json, read_placed, read_strengths

#: Below this a half float of POV-Ray has lost digits; the closed form stands in.
FEWEST_DIGITS = 6e-4


class Scattered:
    """The rendered runs of one fog, read as they are asked for."""

    def __init__(self, build: Build):
        self.build, self.scene, self.medium = build, read_placed(build), read_fog(build)
        self.strengths = read_strengths(build)
        self.runs = {data["id"]: from_json(data) for data in read_json(build.plan)["runs"]}
        self.depth = read_map(build.depth).astype(float)
        camera = self.scene.camera
        self.points = camera.position + self.depth[..., None] * camera.directions(camera.pixel_centres())
        self.optical_depth = self.medium.optical_depth(camera.position, self.points)
        self.extinction = np.add(*self.medium.coefficients())

    def by(self, light: str) -> np.ndarray:
        """In-scattering V of one light at its strength, (H, W, 3)."""
        one, camera = self.scene.lights[light], self.scene.camera
        if not one.rendered:
            scattering = self.medium.coefficients()[1]
            return self.strengths[light] * one.in_scattering(scattering, self.extinction, self.optical_depth)
        if f"in_scattering_{light}" not in self.runs:
            return np.zeros((*self.depth.shape, 3))
        rendered = self._image(f"in_scattering_{light}")
        if rendered.shape[:2] != self.depth.shape:
            coarse = camera.resized(rendered.shape[1], rendered.shape[0])
            coarse_depth = visible(coarse, self.scene.shapes, self.scene.lights)[0]
            rendered = upsample(rendered, coarse_depth, self.depth)
        return self.strengths[light] * rendered / self.runs[f"in_scattering_{light}"].exposure

    def transmittance(self, lights: list[str]) -> np.ndarray:
        """T of the light that these lights together reflect from each surface, (H, W, 3)."""
        eye = np.exp(-self.optical_depth)
        clear, reduced, indirect, indirect_reduced = [], [], [], []
        for light in lights:
            irradiance, path = self.scene.lights[light].incident(self.points)
            on_the_way = np.exp(-self.extinction * path[..., None])
            d, f = self._direct(light, eye, on_the_way, irradiance)
            clear.append(d)
            reduced.append(f)
            indirect.append(irradiance[..., None] / np.pi)
            indirect_reduced.append(indirect[-1] * eye * on_the_way)
        together = combined_transmittance(eye, clear, reduced, indirect, indirect_reduced,
                                          [self.strengths[light] for light in lights])
        shows_emitter = read_map(self.build.surfaces)[..., 1] >= 0
        return np.where(shows_emitter[..., None], eye, together)

    def _direct(self, light, eye, on_the_way, irradiance) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance/pi (H, W, 3) of one light at unit strength, without fog and with it on both ways."""
        one = self.scene.lights[light]
        if not one.rendered:
            clear = np.broadcast_to(irradiance[..., None] / np.pi, eye.shape)
            return clear, clear * eye * on_the_way
        basis = read_map(self.build.basis / f"irradiance_{light}.exr").astype(float)
        clear = basis / read_json(self.build.basis / "runs.json")[f"irradiance_{light}"]["exposure"]
        fogged = self._image(f"transmittance_{light}")
        entry = np.exp(-self.extinction * one.entry_path(self.points)[..., None])
        reduced = np.minimum(fogged / self.runs[f"transmittance_{light}"].exposure, clear) * entry
        digits = (fogged > FEWEST_DIGITS) & (basis > FEWEST_DIGITS)
        return clear, np.where(digits, reduced, clear * eye * on_the_way)

    def _image(self, run: str) -> np.ndarray:
        return read_map(self.build.runs / f"{run}.exr").astype(float)
