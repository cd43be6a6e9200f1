"""A few pixels of a fog made as finely as it takes, which tell how far off all the others are.

A small random set of pixels, half of them where depth jumps and maps made smaller than the photograph are at their worst.
Their V without shadows is integrated along their own rays, POV-Ray renders what shadows take from it along the same rays
with many samples and lights, and T is averaged over the lamps' areas as far as these are seen from the surface. Nothing
of it is made at another size and enlarged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.geometry.segments import blocked
from pipeline.plugins.base import Medium, Shape
from pipeline.rendering.emit import Run
from pipeline.rendering.fineness import INTEGRATED, Fineness
from pipeline.rendering.runs import fog_runs
from pipeline.rendering.scattered import Scattered
from pipeline.rendering.view import View
from pipeline.scene.placed import PlacedScene

#: How finely those pixels are made.
FINENESS = Fineness(in_scattering_size=20000, glow_tolerance=1e-3, shadow_size=20000, samples=96, shadow_lights=9,
                    shaft_samples=200, optical_step=0.1, density_steps=200, transmittance=INTEGRATED,
                    transmittance_step=0.03)
#: Side of the grid of points on a lamp that a surface is lit from.
LAMP_SIDE = 14
#: So much [share] of the way from a lamp is not asked for what stands in it: there the surface itself is met.
NEAR_END = 1e-3
#: Depths that differ by so much within what one pixel of a smaller map covers are an edge.
EDGE = 0.05
PREFIX = "check_"


@dataclass(frozen=True)
class Pixels:
    """rows, columns (n,) of single pixels; weights (n,): share of the photograph that each stands for."""

    rows: np.ndarray
    columns: np.ndarray
    weights: np.ndarray

    @property
    def where(self) -> tuple[np.ndarray, np.ndarray]:
        return self.rows, self.columns


def chosen(depth: np.ndarray, usable: np.ndarray, smaller: int, count: int) -> Pixels:
    """`count` pixels of a photograph with `depth` (H, W) [m] where `usable` (H, W); the same at every call.

    smaller: pixels a side that one of the smallest map stands for.
    """
    kernel = np.ones((2 * smaller + 1, 2 * smaller + 1), np.uint8)
    values = depth.astype(np.float32)
    edge = usable & (cv2.dilate(values, kernel) > (1 + EDGE) * cv2.erode(values, kernel))
    rest = usable & ~edge
    parts = [(mask, mask.sum() / max(usable.sum(), 1)) for mask in (edge, rest) if mask.any()]
    random = np.random.default_rng(len(values))
    rows, columns, weights = [], [], []
    for mask, share in parts:
        number = max(1, count // len(parts))
        # one of each run of pixels in the order of rows, so that they lie all over the picture
        at = np.flatnonzero(mask)
        strata = np.linspace(0, len(at), min(number, len(at)) + 1)
        picked = at[(strata[:-1] + random.random(len(strata) - 1) * np.diff(strata)).astype(int)]
        rows.append(picked // mask.shape[1])
        columns.append(picked % mask.shape[1])
        weights.append(np.full(len(picked), share / len(picked)))
    if not parts:
        return Pixels(*(np.zeros(0, int),) * 2, np.zeros(0))
    return Pixels(np.concatenate(rows), np.concatenate(columns), np.concatenate(weights))


def runs(scene: PlacedScene, medium: Medium, lights: list[str], shaded: list[str], in_one: bool, pixels: Pixels
         ) -> list[Run]:
    """Renders along the pixels' rays; of lights with edges of their own all of V, which is known without where they shine."""
    rays = scene.camera.directions(np.stack([pixels.columns + 0.5, pixels.rows + 0.5], -1))
    whole = [name for name in lights if scene.rendered(name) and not scene.lights[name].smooth]
    found = [one for one in fog_runs(scene, medium, lights, FINENESS, shaded, whole, in_one) if one.kind == "in_scattering"]
    return [replace(one, id=PREFIX + one.id, width=len(rays), height=1, options={**one.options, "along": rays.tolist()})
            for one in found]


class Converged(Scattered):
    """T and V of single pixels, by the same rules as the maps, but each for itself."""

    def __init__(self, whole: Scattered, pixels: Pixels, check_runs: list[Run]):
        self.__dict__.update(whole.__dict__)
        self.fineness, self.glows, self.ways, self.known = FINENESS, {}, {}, {}
        names = [one.id.removeprefix(PREFIX) for one in check_runs]
        self.runs = {name: replace(one, id=name) for name, one in zip(names, check_runs)}
        self.pixels, self.single = pixels, whole.single(pixels.where)

    def beforehand(self, lights: list[str]) -> "Converged":
        self.known["transmittance"] = self._transmittance(lights, self.single)
        if self.medium.coefficients()[1].max() > 0:
            for light in lights:
                if f"in_scattering_{light}" not in self.runs:
                    self.known[light, False] = self._without_shadows(light, self.single)
        return self

    def maps(self, lights: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """T and V of all lights together, (n, 3) each."""
        if not self.known:
            self.beforehand(lights)
        total = sum((self.strengths[light] * self._by(light, self.single) for light in lights),
                    np.zeros((len(self.single.depth), 3)))
        return self.known.pop("transmittance"), total

    def _image(self, run: str) -> np.ndarray:
        return super()._image(PREFIX + run)[0]

    def _resampled(self, values: np.ndarray, view: View) -> np.ndarray:
        return values

    def _surrounded(self, light: str, view: View) -> np.ndarray:
        pixels = np.stack([self.pixels.columns + 0.5, self.pixels.rows + 0.5], -1)
        return self.enclosed.factor(light, self.scene.camera, pixels[None], view.depth[None])[0]

    def _reflected(self, light: str, view: View) -> tuple[np.ndarray, np.ndarray]:
        return self.enclosed.reflected(light, view.points, self.faces[view.where])

    def _unshadowed(self, light: str, view: View) -> np.ndarray:
        eye = self.scene.camera.position
        return self.scene.lights[light].glow(self.medium, eye, view.directions, view.depth, self.fineness.glow_tolerance)

    def _way(self, light: str, view: View) -> np.ndarray:
        one = self.scene.lights[light]
        return one.way_transmittance(self.medium, view.points, view.normals, self.fineness.transmittance_step)

    def _arriving(self, light: str, eye: np.ndarray, view: View) -> tuple[np.ndarray, ...]:
        parts = self.scene.lights[light].parts(LAMP_SIDE)
        strength, clear, reduced, indirect, indirect_reduced = super()._arriving(light, eye, view)
        if not self.scene.rendered(light) or parts is None:
            return strength, clear, reduced, indirect, indirect_reduced
        clear, through = self._seen_parts(parts, view)
        return strength, clear, clear * eye * through, indirect, indirect_reduced

    def _free(self, centres: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Whether nothing stands between points (n, 3) and centres (k, 3), (n, k)."""
        free = np.ones((len(points), len(centres)), bool)
        casting = [shape for shape in self.scene.shapes.values() if shape.casts_shadow]
        faces = [face for shape in casting if type(shape).intersect is Shape.intersect for face in shape.faces().values()]
        starts, ends = (np.broadcast_to(one, (*free.shape, 3)).reshape(-1, 3) for one in (centres, points[:, None]))
        free &= ~blocked(starts, ends, faces, 1 - NEAR_END).reshape(free.shape)
        for shape in casting:
            if type(shape).intersect is not Shape.intersect:  # with curved parts
                for k, centre in enumerate(centres):
                    length = np.linalg.norm(points - centre, axis=-1)
                    nearest = shape.intersect(centre, ((points - centre) / length[:, None])[None])[0][0]
                    free[:, k] &= nearest > (1 - NEAR_END) * length
        return free

    def _seen_parts(self, parts, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance/pi (n, 1) of the parts that the surfaces see, and the mean transmittance (n, 3) of their ways."""
        centres, areas, normal = parts
        way = view.points[:, None] - centres
        length = np.linalg.norm(way, axis=-1)
        leaving = way @ normal / length
        arriving = -np.einsum("nki,ni->nk", way, view.normals) / length
        share = np.maximum(leaving, 0) * np.maximum(arriving, 0) * areas / length**2
        share *= self._free(centres, view.points)
        depths = self.medium.optical_depth(centres, np.broadcast_to(view.points[:, None], way.shape))
        irradiance = share.sum(1)
        mean = np.einsum("nk,nkc->nc", share, np.exp(-depths)) / np.maximum(irradiance, 1e-300)[:, None]
        return irradiance[:, None] / np.pi * np.ones(3), np.where(irradiance[:, None] > 0, mean, 1.0)
