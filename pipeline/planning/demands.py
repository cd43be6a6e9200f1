"""What of a scene and its fog decides how long its maps take and how far off they are."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.plugins.base import Medium
from pipeline.plugins.lights.sun import Sun, shafts
from pipeline.rendering.fineness import AREA, INTEGRATED, MIDPOINT, Fineness
from pipeline.rendering.runs import FEWEST_BLURRED, in_scattering_about, surface_grid, transmittance_is_rendered
from pipeline.scene.placed import PlacedScene

#: Kinds of work that a light's V may take: an integral, with a render of what shadows take from it; a render of all of it;
#: the render of a shaft; a render of what shadows take from single lamps; nothing that knobs change.
GLOW, RENDERED, SHAFT, SINGLE, EXACT = "glow", "rendered", "shaft", "single", "exact"
FINE = Fineness(transmittance=AREA)
#: Points along a ray at which it is asked whether the sun shines there.
STEPS = 32


@dataclass(frozen=True)
class LightDemand:
    """One light: `share` of the foggy picture that its V is (root mean square), and what making it takes.

    sub_lights: small lights that it is stated as; side: of their grid. shadows: whether renders tell what they take from
    V; blurred: whether the edges of one small light's shadow are blurred by others'. half_shadow: what T may be off by for each
    way of making it, as a share of the picture; surface_lights: small lights by which a render of T is lit, 0 where none is
    made. surrounded: whether what stands round the fog changes its V.
    """

    name: str
    work: str
    share: float
    sub_lights: int
    side: int
    shadows: bool
    blurred: bool
    half_shadow: dict[str, float]
    surface_lights: int
    surrounded: bool = False

    @property
    def sampled(self) -> bool:
        """Whether anything of its V is a sum of samples."""
        return self.shadows or self.work in (RENDERED, SHAFT)


@dataclass(frozen=True)
class Demands:
    """width, height [pixel]; faces: of all shapes; steps: samples a ray that uneven fog needs, 1 where it is even.

    depth: optical depth of the longest ray; surfaces: share of the foggy picture that comes from surfaces through it.
    full_size [megapixel]: of the photograph, where maps are enlarged to that, else 0. reflecting: share of the foggy picture
    that light of all orders makes up, between a room's surfaces and its fog; 0 where it is not worked out.
    """

    width: int
    height: int
    faces: int
    steps: int
    depth: float
    surfaces: float
    lights: list[LightDemand]
    full_size: float = 0.0
    reflecting: float = 0.0

    @property
    def megapixels(self) -> float:
        return self.width * self.height / 1e6

    def share(self, *works: str, blurred: bool | None = None) -> float:
        """Of the foggy picture, what the V of lights of these works is, or of all; of those whose shadows are blurred or not
        alone, where that is asked."""
        chosen = [one.share for one in self.lights if (not works or one.work in works) and (
            blurred is None or (one.sampled and one.blurred == blurred))]
        return float(np.sqrt(sum(one**2 for one in chosen)))

    def surrounded(self) -> float:
        """Of the foggy picture, what the V of lights is that what stands round the fog changes."""
        return float(np.linalg.norm([one.share for one in self.lights if one.surrounded]))

    def half_shadow(self, way: str) -> float:
        """By how much the ways from the lamps' parts differ, as a share of the picture, where T is made in this way."""
        return float(np.sqrt(sum(one.half_shadow[way] ** 2 for one in self.lights)))


def demands(scene: PlacedScene, medium: Medium, photograph: np.ndarray, strengths: dict[str, np.ndarray],
            lights: list[str], shaded: Container[str], by_template: Container[str], steps: int, full_size: float = 0.0,
            surrounded: Container[str] = (), reflecting: bool = False) -> Demands:
    """photograph (H, W, 3), linear; strengths (3,) of each light, lights: those that are made; surrounded: those whose V what
    stands round the fog changes; reflecting: whether light of all orders is worked out in a room."""
    points, directions = surface_grid(scene)
    eye = np.exp(-medium.optical_depth(scene.camera.position, points))
    glows = {name: _glow(scene, medium, name, directions, points)[..., None] * strengths[name] for name in lights}
    dimmed = cv2.resize(np.maximum(photograph, 0), points.shape[1::-1], interpolation=cv2.INTER_AREA) * eye
    foggy = dimmed + sum(glows.values(), np.zeros(dimmed.shape))
    level = np.maximum(foggy, 0.05 * max(float(foggy.mean()), 1e-300))
    found = []
    for name in lights:
        one = scene.lights[name]
        shadows = medium.coefficients()[1].max() > 0 and (
            name in shaded or (scene.rendered(name) and scene.dimmed(name)))
        found.append(LightDemand(
            name, _work(scene, medium, name, shaded, by_template), _rms(glows[name] / level), one.sub_light_count(),
            getattr(one, "sub_lights", 1), shadows, one.sub_light_count() >= FEWEST_BLURRED,
            _half_shadow(scene, medium, name, points, dimmed / level),
            _surface_lights(scene, medium, name), name in surrounded))
    depth = float(np.add(*medium.coefficients()).max()) * 2 * scene.extent()
    surfaces = _rms(dimmed / level)
    from_all_sides = [one.share for one in found if scene.lights[one.name].comes_from == "all"]
    return Demands(scene.camera.width, scene.camera.height, len(scene.faces()), steps, depth, surfaces, found, full_size,
                   float(np.linalg.norm([surfaces, *from_all_sides])) if reflecting else 0.0)


def _work(scene: PlacedScene, medium: Medium, name: str, shaded: Container[str], by_template: Container[str]) -> str:
    one = scene.lights[name]
    if not medium.coefficients()[1].max() > 0:
        return EXACT
    if not scene.rendered(name):
        return SINGLE if name in shaded else EXACT
    if name in by_template or not scene.completes(name, medium):
        return RENDERED if one.smooth else SHAFT
    if not one.smooth:
        return EXACT
    return SINGLE if one.sub_light_count() < FEWEST_BLURRED else GLOW


def _glow(scene: PlacedScene, medium: Medium, name: str, directions: np.ndarray, points: np.ndarray) -> np.ndarray:
    if not scene.rendered(name) and not scene.lights[name].bulbs()[0].size:
        # daylight in closed form
        grid = scene.camera.resized(*points.shape[1::-1])
        depth = np.linalg.norm(points - grid.position, axis=-1)
        return scene.lights[name].in_scattering(medium, grid.position, directions, depth).mean(-1)
    glow = in_scattering_about(scene, medium, name, directions, points)
    if isinstance(scene.lights[name], Sun):
        glow = glow * _share_in_shafts(scene, scene.lights[name], points)
    return glow


def _share_in_shafts(scene: PlacedScene, sun: Sun, points: np.ndarray) -> np.ndarray:
    """Share (...) of the way from the eye to each point that lies in the sun's shafts."""
    steps = (np.arange(STEPS) + 0.5) / STEPS
    places = scene.camera.position + (points - scene.camera.position)[..., None, :] * steps[:, None]
    inside = np.zeros(places.shape[:-1], bool)
    for shaft in shafts(sun):
        for hull in map(np.asarray, shaft["hulls"]):
            inside |= (places @ hull[:, :3].T <= hull[:, 3]).all(-1)
    return inside.mean(-1)


def _surface_lights(scene: PlacedScene, medium: Medium, name: str) -> int:
    one = scene.lights[name]
    if not scene.rendered(name) or not transmittance_is_rendered(scene, medium, name, FINE):
        return 0
    return one.finer(FINE.transmittance_step, float(np.add(*medium.coefficients()).max())).sub_light_count()


def _half_shadow(scene: PlacedScene, medium: Medium, name: str, points: np.ndarray, share: np.ndarray) -> dict[str, float]:
    """By each way of making T: how much the ways from a lamp's parts differ, times the surfaces' share of the picture."""
    if not scene.rendered(name):
        return dict.fromkeys((AREA, INTEGRATED, MIDPOINT), 0.0)
    parts = scene.lights[name].parts(3)
    if parts is None:
        return dict.fromkeys((AREA, INTEGRATED, MIDPOINT), 0.0)
    depths = np.stack([medium.optical_depth(centre, points) for centre in parts[0]])
    spread = depths.std(0)
    middle = medium.optical_depth(scene.lights[name].midpoint(), points)
    bend = np.abs(np.exp(np.minimum(middle - depths, 30.0)).mean(0) - 1)
    return {AREA: 0.0, INTEGRATED: _rms(spread * share), MIDPOINT: _rms((spread + bend) * share)}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
