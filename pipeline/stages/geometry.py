"""Annotated shapes, lights and depth -> geometry.json (world metres), depth.exr, surfaces.exr, edges.exr.

surfaces.exr: R the index of the visible face, G of the light whose emitter is visible, B of the region; -1 for none.
Outdoors, where the photograph's depth comes from regions or a map, the shapes stand in for it: solid things of
about that depth, for shadows and for light that bounces.
Of a photograph larger than its working size all three are written at both sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.enlarged_view import EnlargedView
from pipeline.geometry.planes import Plane
from pipeline.geometry.visibility import visible
from pipeline.imaging.glare import glare
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.plugins.base import World
from pipeline.scene.artefacts import (
    SURFACES, image_camera, image_size, plugin_from_json, read_camera, read_json, scene_place, write_edges, write_json)
from pipeline.scene.full_size import write_full_size
from pipeline.scene.placed import placed
from pipeline.scene.outdoors import Outdoors, outdoors


def run(build: Build) -> None:
    with ThreadPoolExecutor(1) as beside:
        # a large photograph takes a while to be read
        large = build.reduced and read_json(build.input("depth")) is not None
        reading = beside.submit(read_map, build.full.photograph, image_size(build.full)[::-1]) if large else None
        _run(build, reading.result if reading else None)


def _run(build: Build, read: Callable[[], np.ndarray] | None) -> None:
    camera = read_camera(build)
    view = image_camera(build)
    world = World(camera)
    described = read_json(build.input("depth"))
    open_air: Outdoors | None = None
    if described is not None:
        world.planes["ground"] = Plane.across("y", 0.0)
        try:
            open_air = outdoors(build, camera, described, view)
        except InputError as error:
            raise error.at(scene_place(build, "depth")) from None
        world.planes |= open_air.planes
        world.messages += open_air.messages
    shapes = _placed(build, "shapes", world)
    lights = _placed(build, "lights", world)
    facts = {"outdoors": open_air is not None}
    depth, face, emitter = visible(view, shapes, lights)
    enlarged = EnlargedView(camera, view, depth, face, emitter, shapes, lights) if build.reduced else None
    missed = ~np.isfinite(depth)
    for one in (build, build.full):
        one.edges.unlink(missing_ok=True)
    region = np.full_like(face, -1)
    if open_air is not None:
        region = np.where(depth < open_air.found.depth, -1, open_air.found.labels)
        try:
            standing_in, depth, face, emitter = open_air.joined(shapes, depth, face, emitter)
        except InputError as error:
            raise error.at(scene_place(build, "shapes")) from None
        lamps = glare(view, lights, depth, open_air.photograph)
        emitter = np.where(lamps.light >= 0, lamps.light, emitter)
        edges = open_air.edges_beside(depth).with_glare(lamps, open_air.photograph)
        shapes = {**shapes, **standing_in}
        write_edges(build, edges)
        facts |= {"ground_faces": open_air.ground_faces, "sky_depth_m": open_air.sky_depth,
                  "regions": open_air.facts, "region_normals": open_air.normals()}
    elif missed.all():
        raise InputError("no ray of the camera meets any shape", place=str(build.scene_file),
                         remedy="check the camera's position and the room's corners")
    elif missed.any():
        world.messages.append(f"{missed.mean():.1%} of the pixels look past all shapes; fog ends there at the"
                              " farthest depth")
        depth = np.where(missed, depth[~missed].max(), depth)
    if enlarged is not None:
        write_full_size(build.full, enlarged, open_air, float(depth.max()), read)
    write_map(build.depth, depth.astype(np.float32), {"fog:content": "radial depth", "fog:unit": "m"},
              is_depth=True)
    write_map(build.surfaces, np.stack([face, emitter, region], -1).astype(np.float32), SURFACES)
    write_json(build.geometry, {
        **facts, "shapes": shapes, "lights": lights,
        "faces": [f"{n}.{f}" for n, s in shapes.items() for f in s.faces()],
        "residuals_pixel": world.residuals, "messages": world.messages})


def _placed(build: Build, part: str, world: World) -> dict:
    """The shapes or lights of the scene in world metres, in the file's order."""
    result = {}
    for name, data in read_json(build.input(part)).items():
        try:
            result[name] = placed(name, plugin_from_json(part, data), world)
        except InputError as error:
            raise error.at(scene_place(build, part, name)) from None
    return result
