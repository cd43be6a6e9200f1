"""Depth, surfaces and edges at the size of a photograph that is larger than its working size.

Indoors all is written as it is worked out, some rows at a time; in the open air the photograph is held in memory, as
float32, for its borders are refined against it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pipeline.geometry.enlarged_view import EnlargedView
from pipeline.geometry.regions import RegionDepth
from pipeline.imaging.edges import EdgeLayers, refined
from pipeline.imaging.enlarged_edges import EnlargedEdges
from pipeline.imaging.glare import Glare, glare
from pipeline.imaging.map_strips import fits_half, strips, writing
from pipeline.side_by_side import side_by_side
from pipeline.paths import Build
from pipeline.scene.artefacts import EDGE_COLOURS, EDGES, SURFACES, THIN
from pipeline.scene.outdoors import Outdoors

#: Whole numbers up to this are exact as half floats.
MOST_IN_HALF = 2048
#: Borders that are refined by more than FEWEST pixels are refined at the working size, and enlarged.
FEWEST = 18


def write_full_size(build: Build, view: EnlargedView, open_air: Outdoors | None, farthest: float,
                    read: Callable[[], np.ndarray] | None = None) -> None:
    """Writes depth.exr, surfaces.exr and, in the open air, edges*.exr. farthest [m]: depth past everything; read(): the
    photograph (H, W, 3), linear, for the open air."""
    camera = view.camera
    size = camera.width, camera.height
    if open_air is None:
        def seen(rows: tuple[int, int]):
            depth, *surface = view.rows(*rows)
            return np.where(np.isfinite(depth), depth, farthest), *surface, -1

        return _write(build, size, side_by_side(seen, strips(*size)), sum(len(shape.faces()) for shape in view.shapes.values()))
    full, open_air.full = open_air.full, None
    depth, face, emitter, region = _joined(view, open_air, full)
    photograph = read()
    lamps = glare(camera, view.lights, depth, photograph)
    lit = lamps.light >= 0
    emitter[lit] = lamps.light[lit]
    faces = len(open_air.face_of) + sum(len(shape.faces()) for shape in view.shapes.values())
    with ThreadPoolExecutor(1) as beside:
        written = beside.submit(_write, build, size, (
            (depth[a:b], face[a:b], emitter[a:b], region[a:b]) for a, b in strips(*size)), faces)
        _write_edges(build, view, open_air, full, depth, photograph, lamps)
        written.result()


def _write_edges(build: Build, view: EnlargedView, open_air: Outdoors, full: RegionDepth, depth: np.ndarray,
                 photograph: np.ndarray, lamps: Glare) -> None:
    size, lit = (view.camera.width, view.camera.height), lamps.light >= 0
    own = depth < full.depth.astype(np.float32)
    radius = open_air.section.refine.radius
    if radius > FEWEST:
        found = EnlargedEdges(open_air.layers, open_air.photograph, depth.shape)
        layers = side_by_side(lambda rows: found.rows(*rows, photograph[slice(*rows)]), strips(*size))
    else:
        found = refined(photograph, full.labels, full.depth, open_air.porous(full), radius, mixed_only=True)
        layers = (EdgeLayers(*(values[a:b] for values in vars(found).values())) for a, b in strips(*size))
    # a lamp's light is of a layer that covers next to nothing, and too bright for half floats
    half = not lit.any() and fits_half(float(photograph.max()))
    with writing(build.edges, *size, 3, EDGES, patchy=True) as edges, \
            writing(build.edge_colours("front"), *size, 3, EDGE_COLOURS["front"], half=half, patchy=True) as front, \
            writing(build.edge_colours("behind"), *size, 3, EDGE_COLOURS["behind"], half=half, patchy=True) as behind:
        for (a, b), layer in zip(strips(*size), layers):
            hidden = own[a:b]
            layer.alpha[hidden], layer.front_depth[hidden], layer.behind_depth[hidden] = 1, 0, 0
            layer.front[hidden], layer.behind[hidden] = 0, 0
            if lit[a:b].any():
                _add_glare(layer, Glare(lamps.light[a:b], lamps.distance[a:b], lamps.radiance[a:b]), depth[a:b],
                           photograph[a:b])
            edges.add(np.stack([layer.alpha, layer.front_depth, layer.behind_depth], -1))
            front.add(layer.front)
            behind.add(layer.behind)


def _joined(view: EnlargedView, open_air: Outdoors, full) -> tuple[np.ndarray, ...]:
    """Depth (H, W) float32 [m], face, emitter and region (H, W) int32 of regions and the scene's own shapes."""
    shape = full.labels.shape
    depth = np.empty(shape, np.float32)
    face, emitter, region = (np.empty(shape, np.int32) for _ in range(3))
    alone = not (view.inverse > 0).any()
    for top, bottom in strips(shape[1], shape[0]):
        part = np.s_[top:bottom]
        labels, distance = full.labels[part], full.depth[part]
        if alone:
            depth[part], face[part], emitter[part], region[part] = distance, open_air.face_of[labels], -1, labels
            continue
        own, own_face, own_emitter = view.rows(top, bottom)
        strip = type(full)(labels, distance, full.regions)
        depth[part], face[part], emitter[part] = open_air.seen(strip, own, own_face, own_emitter)
        region[part] = np.where(own < distance, -1, labels)
    return depth, face, emitter, region


def _add_glare(layers: EdgeLayers, lamps: Glare, depth: np.ndarray, photograph: np.ndarray) -> None:
    """As `Edges.with_glare`, in place, where a front depth of 0 stands for the one in `depth` (H, W)."""
    on = lamps.light >= 0
    front_depth = np.where(layers.front_depth[on] > 0, layers.front_depth[on], depth[on])
    layers.behind_depth[on] = np.where(layers.alpha[on] > 0.5, front_depth, layers.behind_depth[on])
    layers.alpha[on], layers.front_depth[on] = THIN, lamps.distance[on]
    radiance = lamps.radiance[on]
    layers.front[on] = radiance / THIN
    layers.behind[on] = np.maximum(photograph[on] - radiance, 0) / (1 - THIN)


def _write(build: Build, size: tuple[int, int], found, faces: int) -> None:
    with writing(build.depth, *size, 1, {"fog:content": "radial depth", "fog:unit": "m"}, is_depth=True) as depths, \
            writing(build.surfaces, *size, 3, SURFACES, half=faces < MOST_IN_HALF, patchy=True) as surfaces:
        for depth, face, emitter, region in found:
            depths.add(depth)
            surfaces.add(np.stack(np.broadcast_arrays(face, emitter, region), -1))
