"""What the picture that is shown shows, pixel by pixel: from the draft's geometry, at the picture's own size."""

from __future__ import annotations

import json

import numpy as np

from pipeline.annotate.preview.display import Layers, Scenery
from pipeline.annotate.preview.picture import Picture
from pipeline.annotate.preview.placing import Placing
from pipeline.annotate.preview.problems import Parts
from pipeline.annotate.preview.scaled import scaled
from pipeline.geometry.camera import Camera
from pipeline.geometry.enlarged_view import EnlargedView
from pipeline.geometry.regions import RegionDepth, depth_of_regions
from pipeline.geometry.visibility import COINCIDENT, visible
from pipeline.imaging.depth_file import read_depth
from pipeline.imaging.enlarged_edges import EnlargedEdges
from pipeline.imaging.glare import glare
from pipeline.imaging.maps import read_map
from pipeline.paths import Build, inside
from pipeline.scene.artefacts import Edges, read_edges, read_json, read_placed
from pipeline.scene.depth_section import DepthSection
from pipeline.scene.placed import PlacedScene

#: Keys of regions by class, beside those of faces, which count from 0.
KINDS = {"support": -2, "vertical": -3, "sky": -4, "map": -5}


def sceneries(build: Build, parts: Parts, picture: Picture, placing: Placing, camera: Camera
              ) -> tuple[Scenery, Scenery, Layers | None]:
    """Of the maps, of the picture, and those of its pixels that show two things.

    build: of the draft, whose geometry was made. camera: the photograph's.
    """
    scene, geometry = read_placed(build), read_json(build.geometry)
    surfaces, depth, edges = read_map(build.surfaces), read_map(build.depth).astype(float), read_edges(build)
    face, emitter, region = (surfaces[..., k].astype(np.int32) for k in range(3))
    kinds = [KINDS[one["class"]] for one in geometry.get("regions", {}).values()]
    key = np.where(region >= 0, np.array([*kinds, 0], np.int32)[region], face)
    front = depth if edges is None else edges.front_depth
    small = Scenery(front.astype(np.float32), key, (emitter >= 0) | (face < 0), emitter)
    view = camera.resized(*picture.size)
    own = {name: shape for name, shape in scene.shapes.items() if not name.startswith("region_") or not scene.outdoors}
    if not scene.outdoors:
        return small, _indoors(scene, view, (depth, face, emitter)), None
    found = _regions(parts.depth, build, camera, view, placing)
    large = _outdoors(scene, own, found, view, picture)
    layers = None
    if edges is not None and edges.mixed.any() and (view.width, view.height) != (depth.shape[1], depth.shape[0]):
        layers = _layers(edges, read_map(build.photograph), picture, large, parts.depth.sky_depth)
    return small, large, layers


def _indoors(scene: PlacedScene, view: Camera, known: tuple[np.ndarray, np.ndarray, np.ndarray]) -> Scenery:
    depth, face, emitter = _seen(scene, scene.shapes, view, known)
    missed = ~np.isfinite(depth)
    if missed.any():
        depth = np.where(missed, depth[~missed].max(initial=1.0), depth)
    return Scenery(depth.astype(np.float32), face, (emitter >= 0) | (face < 0), emitter)


def _seen(scene: PlacedScene, shapes: dict, view: Camera, known: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
          ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, face and light that are seen, at the view's size. known: at the draft's."""
    small = scene.camera
    depth, face, emitter = known or visible(small, shapes, scene.lights)
    if (view.width, view.height) == (small.width, small.height):
        return depth, face, emitter
    return EnlargedView(view, small, depth, face, emitter, shapes, scene.lights).rows(0, view.height)


def _outdoors(scene: PlacedScene, own: dict, found: RegionDepth, view: Camera, picture: Picture) -> Scenery:
    depth = found.depth
    key = np.array([KINDS[region.kind] for region in found.regions], np.int32)[found.labels]
    bare, emitter = key == KINDS["sky"], np.full(key.shape, -1, np.int32)
    if own or any(light.emitting_polygon() is not None for light in scene.lights.values()):
        distance, face, shown = _seen(scene, own, view)
        nearer = distance < depth * np.where(shown >= 0, 1 + COINCIDENT, 1.0)
        depth, key = np.where(nearer, distance, depth), np.where(nearer, face, key)
        emitter = np.where(nearer, shown, -1)
        bare = np.where(nearer, emitter >= 0, bare)
    if any(len(light.bulbs()[0]) for light in scene.lights.values()):
        lamps = glare(view, scene.lights, depth, picture.radiance)
        emitter = np.where(lamps.light >= 0, lamps.light, emitter)
        bare = bare | (lamps.light >= 0)
        depth = np.where(lamps.light >= 0, lamps.distance, depth)
    return Scenery(depth.astype(np.float32), key.astype(np.int32), bare, emitter)


def _regions(depth: DepthSection, build: Build, camera: Camera, view: Camera, placing: Placing) -> RegionDepth:
    """The regions that the draft has, at the picture's size."""
    kept = json.loads(build.input("depth").read_text(encoding="utf-8"))["regions"]
    section: DepthSection = scaled(depth, view.width / camera.width)
    section = section.model_copy(update={"regions": {name: one for name, one in section.regions.items() if name in kept}})
    known = None
    if section.map is not None:
        settings = section.map.model_dump()
        known = read_depth(inside(build, settings.pop("file")), view, **settings)
    return depth_of_regions(view, placing.described(section, view), section.sky_depth, known)


def _layers(edges: Edges, photograph: np.ndarray, picture: Picture, large: Scenery, sky_depth: float) -> Layers | None:
    """Borders that were refined at the draft's size, sharpened by the picture."""
    found = EnlargedEdges(edges, photograph, large.depth.shape).rows(0, large.depth.shape[0], picture.radiance)
    rows, columns = np.nonzero((found.alpha < 1) & (found.front_depth != found.behind_depth) & (large.emitter < 0))
    if not len(rows):
        return None
    at = rows, columns
    return Layers(rows, columns, *(values[at].astype(np.float32) for values in (
        found.alpha, found.front_depth, found.behind_depth, found.front, found.behind)),
        found.behind_depth[at] >= 0.999 * sky_depth)
