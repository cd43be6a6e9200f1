"""T and V at the size of a photograph that is larger than its working size, from the maps of that size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from pipeline.imaging.map_strips import MapReader, fits_half, strips, writing
from pipeline.imaging.maps import Metadata, read_map, write_map
from pipeline.side_by_side import side_by_side
from pipeline.paths import Build
from pipeline.physics.enlarging import UNKNOWN, Enlarging, Pixels, Small, layer_values
from pipeline.physics.layers import mixed_transmittance
from pipeline.rendering.scattered import Scattered
from pipeline.scene.artefacts import image_size, read_edges, read_fog, read_json, read_placed

#: Lights that are enlarged together; the maps of more would take much memory.
MOST_LIGHTS = 8
#: A shape of more faces counts as one thing, whose parts only depth tells apart.
MOST_FACES = 64
#: By so much an enlarged map may be brighter than the one that it comes from.
BRIGHTER = 2.0


def write_layers(build: Build, scattered: Scattered, lights: list[str], transmittance: np.ndarray) -> None:
    """Writes what `enlarged` needs besides T and V of the working size: mean density, and all of it behind what is in
    front, where a pixel shows two things."""
    density = scattered.mean_density(scattered.front)
    write_map(build.mean_density, density, {"fog:content": "mean density of the fog along each ray, share of what is stated"})
    for old in build.fog_images.glob("behind_*.exr"):
        old.unlink()
    if scattered.behind is None:
        return
    layers = {build.mean_density: (density, scattered.mean_density(scattered.behind)),
              build.transmittance: (transmittance, scattered.behind_transmittance(lights))}
    for path, (front, behind) in layers.items():
        _write_behind(build, path, np.array(front), scattered, behind)
    for light in lights:
        _write_behind(build, build.in_scattering(light), read_map(build.in_scattering(light)), scattered,
                      scattered.behind_by(light))


def _write_behind(build: Build, path, values: np.ndarray, scattered: Scattered, behind: np.ndarray) -> None:
    values[scattered.behind.where] = behind
    write_map(build.behind(path), values, {"fog:content": "as the map without behind_, of what is behind"})


def enlarged(build: Build, lights: list[str], metadata: Metadata) -> Iterator[tuple]:
    """Writes T, V and V of each light at the photograph's size, and yields its strips as they are ready: first row, row
    after the last, T (n, W, 3), V (n, W, 3), index of the light that is seen (n, W)."""
    width, height = image_size(build)
    working = replace(build, reduced=True)
    source = _Working(working)
    groups = [lights[k:k + MOST_LIGHTS] for k in range(0, len(lights), MOST_LIGHTS)] or [[]]
    total = np.zeros((height, width, 3), np.float32) if len(groups) > 1 else None

    def writer(stack: ExitStack, path, content: str, greatest: float):
        return stack.enter_context(writing(path, width, height, 3, {**metadata, "fog:content": content},
                                           half=fits_half(greatest)))

    for old in build.out.glob("in_scattering_*.exr"):
        if old not in map(build.in_scattering, lights):
            old.unlink()
    for group in groups:
        small, brightest = source.small(group)
        enlarging, rows = Enlarging(small, (height, width), source.extinction), _Rows(build, source)
        last = group is groups[-1]

        def worked_out(strip: tuple[int, int]):
            pixels, emitter, edges = rows.read(*strip)
            values = enlarging.rows(*strip, pixels)
            if edges is not None:
                _mix(values, enlarging, strip, pixels, *edges)
            return strip, values, emitter

        with ExitStack() as stack:
            writers = [writer(stack, build.in_scattering(light), f"in-scattering V of {light}", BRIGHTER * most)
                       for light, most in zip(group, brightest)]
            if last:
                greatest = BRIGHTER * float(read_map(working.in_scattering()).max())
                whole = writer(stack, build.in_scattering(), "in-scattering map V", greatest)
                through = writer(stack, build.transmittance, "transmittance map T", 1.0)
            for (top, bottom), values, emitter in side_by_side(worked_out, strips(width, height)):
                scattered = np.zeros((bottom - top, width, 3), np.float32) if total is None else total[top:bottom]
                for one, light in zip(writers, values[1:]):
                    one.add(light)
                    scattered += light
                if last:
                    through.add(values[0])
                    whole.add(scattered)
                    yield top, bottom, values[0], scattered, emitter


def _mix(values: list[np.ndarray], enlarging: Enlarging, rows: tuple[int, int], pixels: Pixels, alpha, behind_depth, front, behind
         ) -> None:
    """Adds what is behind to T and V of each light (n, W, 3), where a share alpha (n, W) of a pixel is in front."""
    where = np.nonzero((alpha < 1) & (behind_depth != pixels.depth))
    if not len(where[0]):
        return
    farther = enlarging.behind(*rows, where, behind_depth[where], pixels.bare[where])
    share, (through, *lights), (through_farther, *lights_farther) = alpha[where], values, farther
    through[where] = mixed_transmittance(share, front[where], behind[where], through[where], through_farther)
    for light, beyond in zip(lights, lights_farther):
        light[where] = share[:, None] * light[where] + (1 - share[:, None]) * beyond


class _Working:
    """Maps of the working size, and keys by which pixels of one surface are told."""

    def __init__(self, build: Build):
        self.build, scene = build, read_placed(build)
        self.extinction = np.add(*read_fog(build).coefficients())
        known = [np.arange(len(faces)) + 1 if len(faces := shape.faces()) <= MOST_FACES else
                 np.full(len(faces), UNKNOWN) for shape in scene.shapes.values()]
        starts = np.cumsum([0, *(len(faces) for faces in known)])
        self.of_face = np.concatenate([[0], *(np.where(faces == UNKNOWN, UNKNOWN, faces + first)
                                              for faces, first in zip(known, starts))]).astype(np.int32)
        regions = read_json(build.geometry).get("regions", {}).values()
        self.of_region = np.array([UNKNOWN if facts["class"] == "map" else starts[-1] + 1 + k
                                   for k, facts in enumerate(regions)] or [UNKNOWN], np.int32)
        self.lights = len(scene.lights)

    def keys(self, surfaces: np.ndarray) -> np.ndarray:
        """Key (n, W) of pixels of surfaces.exr (n, W, 3): face or region, and light that is seen."""
        face, emitter, region = (surfaces[..., k].astype(np.int32) for k in range(3))
        surface = np.where(region >= 0, self.of_region[region], self.of_face[face + 1])
        return np.where(surface == UNKNOWN, UNKNOWN, surface * (self.lights + 1) + emitter + 1)

    def small(self, lights: list[str]) -> tuple[Small, list[float]]:
        """What is known at the working size, and the greatest value of each light's V."""
        build = self.build
        size = image_size(build)[::-1]
        key, edges = self.keys(read_map(build.surfaces, size)), read_edges(build)
        depth = read_map(build.depth, size)
        front_depth = depth if edges is None else edges.front_depth.astype(np.float32)
        paths = [build.mean_density, build.transmittance, *map(build.in_scattering, lights)]
        density, transmittance, *each = (read_map(path, size) for path in paths)
        values = layer_values(self.extinction, front_depth, density, transmittance, each)
        brightest = [float(one.max()) for one in each]
        if edges is None or not build.behind(build.mean_density).exists():
            return Small(front_depth, key, values), brightest
        mixed, behind_depth = edges.mixed, edges.behind_depth.astype(np.float32)
        density, transmittance, *each = (read_map(build.behind(path), size) for path in paths)
        behind = layer_values(self.extinction, behind_depth, density, transmittance, each)
        key = np.where(mixed | (front_depth != depth), UNKNOWN, key).astype(np.int32)
        return Small(front_depth, key, values, mixed, behind_depth, behind), brightest


class _Rows:
    """What rows of the photograph show, at its own size."""

    def __init__(self, build: Build, working: _Working):
        size = image_size(build)[::-1]
        self.working = working
        self.depth, self.surfaces = MapReader(build.depth, size), MapReader(build.surfaces, size)
        paths = (build.edges, build.edge_colours("front"), build.edge_colours("behind"))
        self.edges = [MapReader(path, size) for path in paths] if build.edges.exists() else None

    def read(self, top: int, bottom: int) -> tuple[Pixels, np.ndarray, tuple | None]:
        """Pixels as what is in front, the light that is seen (n, W), and alpha, depth and colours of the layers."""
        depth, surfaces = self.depth.rows(top, bottom), self.surfaces.rows(top, bottom)
        key, emitter = self.working.keys(surfaces), surfaces[..., 1].astype(np.int16)
        bare = (emitter >= 0) | (surfaces[..., 0] < 0)
        if self.edges is None:
            return Pixels(depth, key, bare), emitter, None
        alpha, front_depth, behind_depth = np.moveaxis(self.edges[0].rows(top, bottom), -1, 0)
        # 0 far from borders
        near = front_depth > 0
        pixels = Pixels(np.where(near, front_depth, depth), np.where(near & (front_depth != depth), UNKNOWN, key), bare)
        if not (alpha < 1).any():
            return pixels, emitter, None
        front, behind = (reader.rows(top, bottom) for reader in self.edges[1:])
        return pixels, emitter, (alpha, behind_depth, front, behind)
