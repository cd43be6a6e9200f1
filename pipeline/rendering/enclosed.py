"""Light from all sides in fog that something stands round, less what that hides of it, more what it throws back."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.estimation.fog_surroundings import (
    GROUND, SKY, THING, FogSurroundings, about, axis_of, fog_surroundings)
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import Camera
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.physics import hidden_sky
from pipeline.physics.airlight import clear_skylight
from pipeline.plugins.base import Light, Medium
from pipeline.scene.artefacts import read_json
from pipeline.scene.placed import PlacedScene

#: Rows: points in the fog, along a grid of eye rays; columns: directions over the sphere.
CONTENT = "what points in the fog (rows) see along directions (columns): radiance of ground and things"
KINDS = "what points in the fog (rows) see along directions (columns): 0 sky, 1 ground, 2 things"


def _asks(scene: PlacedScene, light: Light, source: str) -> bool:
    """Whether things round the fog matter to a light. A sky in a room is none of the open air's; an ambient radiance that a
    person states is what they say, everywhere."""
    if light.comes_from is None or light.unobstructed:
        return False
    return source != "given" if light.comes_from == "all" else scene.outdoors


def write_surroundings(build: Build, scene: PlacedScene, lights: dict[str, dict], lamps: np.ndarray, share: float = 1.0
                       ) -> dict | None:
    """Writes what the fog of a scene sees round it where a light asks for that; what `read_surroundings` needs, else None.

    lights: what was estimated of each, and the `source` of that. lamps (H, W): pixels of the photograph that show lamps.
    share: as `fog_surroundings`.
    """
    found = None
    if any(_asks(scene, light, lights[name]["source"]) for name, light in scene.lights.items()):
        photograph = np.maximum(read_map(build.photograph).astype(float), 0)
        depth, face = read_map(build.depth).astype(float), read_map(build.surfaces)[..., 0].astype(int)
        around = Surroundings(scene.camera, scene.first_hit, photograph, depth, face, lamps)
        found = fog_surroundings(scene.camera, around, read_json(build.geometry).get("ground_faces", []),
                                 scene.triangle_count(), share)
    if found is None:
        for path in (build.surroundings, build.surrounding_kinds):
            path.unlink(missing_ok=True)
        return None
    for path, values, content in ((build.surroundings, found.radiance, CONTENT), (build.surrounding_kinds, found.kind, KINDS)):
        write_map(path, values.reshape(-1, *values.shape[3:]), {"fog:content": content})
    return {"rays": list(found.kind.shape[:2]), "distances_m": found.distances.tolist(),
            "sky_seen": found.sky_seen() if scene.outdoors else None, "mean_radiance": around.overall.tolist()}


def read_surroundings(build: Build, camera: Camera) -> FogSurroundings | None:
    facts = read_json(build.illumination).get("surroundings")
    if not facts:
        return None
    distances = np.asarray(facts["distances_m"])
    shape = (*facts["rays"], len(distances), -1)
    kind = np.round(read_map(build.surrounding_kinds)).astype(int).reshape(shape)
    radiance = read_map(build.surroundings).astype(float).reshape(*shape, 3)
    return FogSurroundings(distances, kind, radiance, *about(axis_of(camera), kind.shape[-1]))


class Enclosed:
    """Factors of the V of lights that come from all sides, by what stands round the fog.

    What hides the sky throws back its colour: in the sky's stead, unless the scene has an ambient light for all that is
    reflected, which then comes from there. Light from the ground is the ground light's, where there is one.
    """

    def __init__(self, build: Build, scene: PlacedScene, medium: Medium):
        self.scene, self.medium = scene, medium
        self.around = read_surroundings(build, scene.camera)
        illumination = read_json(build.illumination)
        self.lights = illumination["lights"]
        #: of all that the photograph shows: what an ambient light is estimated as
        self.mean = np.asarray((illumination.get("surroundings") or {}).get("mean_radiance", (1, 1, 1)), float)

    def changes(self, light: str) -> bool:
        return self.around is not None and _asks(self.scene, self.scene.lights[light], self.lights[light]["source"])

    def factor(self, light: str, camera: Camera, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Of the light's V, (h, w, 3), at `pixels` (h, w, 2) of `camera` whose rays end at depth (h, w) [m]."""
        around, eye = self.around, self.scene.camera.position
        coarse = self.scene.camera.resized(around.kind.shape[1], around.kind.shape[0])
        # behind the last point nothing stands any more
        plain = np.where(around.directions[:, 1] > 0, SKY, GROUND)
        kind = np.concatenate([around.kind, np.broadcast_to(plain, (*around.kind.shape[:2], 1, len(plain)))], 2)
        ground = around.radiance[around.kind == GROUND].mean(0) if (around.kind == GROUND).any() else np.zeros(3)
        beyond = np.where(plain[:, None] == GROUND, ground, 0)
        radiance = np.concatenate([around.radiance, np.broadcast_to(beyond, (*kind.shape[:2], 1, *beyond.shape))], 2)
        values = self._values(light, coarse.directions(coarse.pixel_centres()), kind, radiance)
        places = pixels * [coarse.width / camera.width, coarse.height / camera.height] - 0.5
        return hidden_sky.along_rays(self.medium, eye, camera.directions(pixels), depth, around.distances,
                                     _between(values, places))

    def _values(self, light: str, rays: np.ndarray, kind: np.ndarray, radiance: np.ndarray) -> np.ndarray:
        """The factor at points (h, w, k, 3) along coarse rays (h, w, 3), which see kind (h, w, k, d) and radiance
        (h, w, k, d, 3)."""
        weight = hidden_sky.weights(self.medium.phase(), rays, self.around.directions, self.around.solid_angles)
        side, above = self.scene.lights[light].comes_from, self.around.directions[:, 1] > 0
        if side == "below":
            return np.repeat(hidden_sky.left_of(weight, ~above, kind == GROUND), 3, -1)
        strength = np.asarray(self.lights[light]["strength"], float)
        types = {one.type for one in self.scene.lights.values()}
        things = np.where((kind == THING)[..., None], radiance, 0)
        if side == "above":
            left = np.repeat(hidden_sky.left_of(weight, above, kind == SKY), 3, -1)
            own = clear_skylight(self.medium.phase(), rays[..., 1])[..., None] * strength
            return left if "ambient" in types else left + hidden_sky.instead(weight, things, own)
        return hidden_sky.instead(weight, things if "ground" in types else radiance,
                                  np.broadcast_to(self.mean, (*rays.shape[:2], 3)))


def _between(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (h, w, k, c) of a grid's pixels at places (H, W, 2) between their centres, (H, W, k, c)."""
    columns, rows = np.ascontiguousarray(places.transpose(2, 0, 1), np.float32)
    parts = [cv2.remap(np.ascontiguousarray(values[:, :, k], np.float32), columns, rows, cv2.INTER_LINEAR,
                       borderMode=cv2.BORDER_REPLICATE) for k in range(values.shape[2])]
    return np.stack(parts, 2).astype(float)
