"""Light from all sides in fog that something stands round, less what that hides of it, more what it throws back."""

from __future__ import annotations

import copy
from functools import cached_property

import cv2
import numpy as np
import scipy

from pipeline.estimation.fog_surroundings import GROUND, SKY, THING
from pipeline.estimation.room_light import DIRECTIONS, VIEW_DIRECTIONS, of_view
from pipeline.geometry.camera import Camera
from pipeline.geometry.patches import areas_and_normals
from pipeline.paths import Build
from pipeline.physics import hidden_sky
from pipeline.physics.airlight import clear_skylight
from pipeline.physics.fog_transport import Transport
from pipeline.plugins.base import Medium
from pipeline.rendering.surroundings_files import asks, lamps_of, read_room, read_surroundings
from pipeline.scene.artefacts import read_json
from pipeline.scene.placed import PlacedScene

#: Longer side [pixel] at which light on one plane is found, and enlarged.
PLANE_SIZE = 64


class Enclosed:
    """Factors of the V of lights that come from all sides, by what stands round the fog.

    What hides the sky throws back its colour: in the sky's stead, unless the scene has an ambient light for all that is
    reflected, which then comes from there. Light from the ground is the ground light's, where there is one. In a room with
    lamps an ambient light is all that arrives but straight from them: fog dims what surfaces throw back, and scatters it and
    the lamps' light again.
    """

    def __init__(self, build: Build, scene: PlacedScene, medium: Medium, directions: int):
        """directions: along which points in a room see, at most."""
        self.scene, self.medium = scene, medium
        self.around, self.room = read_surroundings(build, scene.camera), read_room(build, scene, directions)
        if self.room is not None:
            self.around = self.around.fewer(round(directions * VIEW_DIRECTIONS / DIRECTIONS))
        self.lights = read_json(build.illumination)["lights"]
        self.values: dict[str, np.ndarray] = {}

    def in_fog(self, medium: Medium) -> Enclosed:
        """The same of another fog."""
        other = copy.copy(self)
        other.medium, other.values = medium, {}
        other.__dict__.pop("transport", None)
        return other

    def changes(self, light: str) -> bool:
        return self.around is not None and asks(self.scene, self.scene.lights[light], self.lights[light]["source"])

    def strength(self, light: str) -> np.ndarray:
        """(3,), as it was estimated, whatever its gain."""
        return np.asarray(self.lights[light]["strength"], float)

    def reflects(self, light: str) -> bool:
        """Whether `reflected` is this light at its estimated strength."""
        return self.room is not None and self.scene.lights[light].comes_from == "all" and self.changes(light)

    def factor(self, light: str, camera: Camera, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Of the light's V, (h, w, 3), at `pixels` (h, w, 2) of `camera` whose rays end at depth (h, w) [m]."""
        around, eye = self.around, self.scene.camera.position
        if light not in self.values:
            self.values[light] = self._values(light)
        values = self.values[light]
        places = pixels * [values.shape[1] / camera.width, values.shape[0] / camera.height] - 0.5
        return hidden_sky.along_rays(self.medium, eye, camera.directions(pixels), depth, around.distances,
                                     _between(values, places))

    def reflected(self, light: str, points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance / pi (..., 3) of points (..., 3) [m] on faces (...) by all that is reflected and scattered to them, in clear
        air and in fog, at unit strength of this light."""
        normals = self._normals[np.maximum(faces, 0)]
        normals = normals * np.sign((normals * (self.scene.camera.position - points)).sum(-1, keepdims=True))
        index, weight = self.room.patches.between(points, normals)
        own = self.strength(light)
        return tuple(np.where(own > 0, np.einsum("...k,...kc->...c", weight, one[index]) / np.where(own > 0, own, 1), 1)
                     for one in (self.transport.clear, self.transport.E))

    def reflected_in_view(self, light: str, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same (H, W, 3) of all pixels, which show these faces (H, W): on each face's plane it changes slowly, and is found at
        some of its pixels."""
        height, width = faces.shape
        camera = self.scene.camera
        small = camera.resized(*(max(2, round(PLANE_SIZE * n / max(width, height))) for n in (width, height)))
        rays, corners = small.directions(small.pixel_centres()), [one for _, one in self.scene.faces()]
        result = np.ones((2, height, width, 3), np.float32)
        for face in np.unique(faces[faces >= 0]):
            along = rays @ self._normals[face]
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = (corners[face].mean(0) - camera.position) @ self._normals[face] / along
            # beside the horizon of its plane nothing shows it
            depth = np.where(depth > 0, np.minimum(depth, self.transport.farthest), self.transport.farthest)
            found = self.reflected(light, camera.position + depth[..., None] * rays, np.full(depth.shape, face))
            shown = faces == face
            for one, values in zip(result, found):
                one[shown] = cv2.resize(values.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)[shown]
        return result[0], result[1]

    @cached_property
    def _normals(self) -> np.ndarray:
        return areas_and_normals([corners for _, corners in self.scene.faces()])[1]

    @cached_property
    def transport(self) -> Transport:
        strengths = {name: self.strength(name) for name in self.lights}
        low, high = self.room.lattice.low, self.room.lattice.high
        return Transport(self.medium, self.room.within, self.room.beside, self.room.lit_by(lamps_of(self.scene), strengths),
                         self.room.lattice.nearest(), float(np.linalg.norm(high - low)))

    def _in_the_room(self) -> np.ndarray:
        """Radiance (h, w, k, d, 3) that arrives at the points before the photograph, but what comes straight from lamps."""
        around = self.around
        found = self.transport.arriving(of_view(self.scene.camera, around, self._normals, self.room.patches))
        points = around.points(self.scene.camera)
        # a point within something is as the one before it, or as the nearest
        stands = np.zeros(around.known.shape, int)
        stands[around.known] = np.arange(len(found))
        nearest = scipy.spatial.cKDTree(points[around.known])
        for k in range(stands.shape[2]):
            gone = ~around.known[..., k]
            stands[gone, k] = stands[gone, k - 1] if k else nearest.query(points[gone, k])[1]
        return found[stands]

    def _values(self, light: str) -> np.ndarray:
        """The factor (h, w, k + 1, 3) at points along coarse rays, and behind them."""
        around = self.around
        coarse = self.scene.camera.resized(around.kind.shape[1], around.kind.shape[0])
        rays = coarse.directions(coarse.pixel_centres())
        if self.reflects(light):
            weight = hidden_sky.weights(self.medium.phase(), rays, around.directions, around.solid_angles)
            found = hidden_sky.instead(weight, self._in_the_room(), np.broadcast_to(self.strength(light), rays.shape))
            return np.concatenate([found, found[:, :, -1:]], 2)
        # behind the last point nothing stands any more
        plain = np.where(around.directions[:, 1] > 0, SKY, GROUND)
        kind = np.concatenate([around.kind, np.broadcast_to(plain, (*around.kind.shape[:2], 1, len(plain)))], 2)
        ground = around.radiance[around.kind == GROUND].mean(0) if (around.kind == GROUND).any() else np.zeros(3)
        beyond = np.where(plain[:, None] == GROUND, ground, 0)
        radiance = np.concatenate([around.radiance, np.broadcast_to(beyond, (*kind.shape[:2], 1, *beyond.shape))], 2)
        return self._seen(light, rays, kind, radiance)

    def _seen(self, light: str, rays: np.ndarray, kind: np.ndarray, radiance: np.ndarray) -> np.ndarray:
        """The factor at points (h, w, k, 3) along coarse rays (h, w, 3), which see kind (h, w, k, d) and radiance
        (h, w, k, d, 3)."""
        weight = hidden_sky.weights(self.medium.phase(), rays, self.around.directions, self.around.solid_angles)
        side, above = self.scene.lights[light].comes_from, self.around.directions[:, 1] > 0
        if side == "below":
            return np.repeat(hidden_sky.left_of(weight, ~above, kind == GROUND), 3, -1)
        strength = self.strength(light)
        types = {one.type for one in self.scene.lights.values()}
        things = np.where((kind == THING)[..., None], radiance, 0)
        if side == "above":
            left = np.repeat(hidden_sky.left_of(weight, above, kind == SKY), 3, -1)
            own = clear_skylight(self.medium.phase(), rays[..., 1])[..., None] * strength
            return left if "ambient" in types else left + hidden_sky.instead(weight, things, own)
        return hidden_sky.instead(weight, things if "ground" in types else radiance,
                                  np.broadcast_to(strength, rays.shape))


def _between(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Values (h, w, k, c) of a grid's pixels at places (H, W, 2) between their centres, (H, W, k, c)."""
    columns, rows = np.ascontiguousarray(places.transpose(2, 0, 1), np.float32)
    parts = [cv2.remap(np.ascontiguousarray(values[:, :, k], np.float32), columns, rows, cv2.INTER_LINEAR,
                       borderMode=cv2.BORDER_REPLICATE) for k in range(values.shape[2])]
    return np.stack(parts, 2).astype(float)
