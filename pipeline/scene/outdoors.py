"""The depth section of a scene, with its files and the photograph, as depth, edges and solid stand-ins."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane
from pipeline.geometry.regions import (
    Region, RegionDepth, RegionError, at_smaller_size, cut, depth_of_regions, painted, polygon_mask)
from pipeline.geometry.stand_in import Solid, regions_of, stand_in
from pipeline.geometry.visibility import COINCIDENT
from pipeline.imaging.depth_file import read_depth, read_labels
from pipeline.imaging.edges import EdgeLayers, refined
from pipeline.imaging.maps import read_map
from pipeline.paths import Build, inside
from pipeline.plugins.base import FARTHEST, Shape
from pipeline.plugins.registry import registry
from pipeline.scene.artefacts import Edges, scene_place
from pipeline.scene.depth_section import DepthSection, RegionDescription

#: Colours of a painted label image, as in the paper's Fig. 7.
PALETTE = {"#ff0000": "vertical", "#00ff00": "support", "#0000ff": "sky"}


@dataclass
class Outdoors:
    """What the geometry stage needs of an open-air scene; see `outdoors`.

    camera, photograph, found, radius [pixel] of refinement: at the size of the build's images. full: regions and depth at
    the photograph's size, where that is another; layers: refined borders, kept for that.
    """

    section: DepthSection
    camera: Camera
    photograph: np.ndarray
    found: RegionDepth
    solids: dict[str, Any]
    radius: int
    full: RegionDepth | None = None
    planes: dict[str, Plane] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    ground_faces: list[int] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    face_of: np.ndarray | None = None
    layers: EdgeLayers | None = None

    @property
    def sky_depth(self) -> float:
        return self.section.sky_depth

    def joined(self, shapes: dict[str, Shape], depth: np.ndarray, face: np.ndarray, emitter: np.ndarray
               ) -> tuple[dict[str, Shape], np.ndarray, np.ndarray, np.ndarray]:
        """Stand-ins as placed shapes; depth, face and emitter maps of the regions and, nearer, of the scene's own."""
        standing_in = self.standing_in(shapes)
        return standing_in, *self.seen(self.found, depth, face, emitter)

    def standing_in(self, shapes: dict[str, Shape]) -> dict[str, Shape]:
        """Stand-ins as placed shapes, which come after the scene's own."""
        for name, solid in self.solids.items():
            if not np.abs(solid.vertices).max() <= FARTHEST:
                raise InputError(f"what stands in for region {name} reaches beyond {FARTHEST:g} m",
                                 remedy="give nearer depths, or a camera nearer to the origin")
        standing_in = {f"region_{name}": registry("shapes")["mesh"](
            type="mesh", vertices=solid.vertices.tolist(), triangles=solid.triangles.tolist())
            for name, solid in self.solids.items()}
        if taken := sorted(set(standing_in) & set(shapes)):
            raise InputError(f"a shape is called '{taken[0]}', which stands in for a region", remedy="rename the shape")
        first = sum(len(shape.faces()) for shape in shapes.values())
        index = {name: first + k for k, name in enumerate(self.solids)}
        self.face_of = np.array([*(index.get(name, -1) for name in self._solid_names()), -1], np.int32)
        self.ground_faces = sorted({index[n] for n, r in zip(self._solid_names(), self.found.regions)
                                    if r.kind == "support" and n in index})
        return standing_in

    def seen(self, found: RegionDepth, depth: np.ndarray, face: np.ndarray, emitter: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth, face and emitter of regions and, nearer, of the scene's own shapes, all of one size."""
        # a lamp drawn on a wall and the wall coincide
        nearer = depth < found.depth * np.where(emitter >= 0, 1 + COINCIDENT, 1.0)
        return (np.where(nearer, depth, found.depth), np.where(nearer, face, self.face_of[found.labels]).astype(np.int32),
                np.where(nearer, emitter, -1))

    def _solid_names(self) -> list[str | None]:
        names = regions_of(self.solids, self.found.regions)
        return [names.get(region.name) for region in self.found.regions]

    def edges_beside(self, depth: np.ndarray) -> Edges:
        """Refined borders of the regions; the scene's own shapes before them are as sharp as they are."""
        layers = refined(self.photograph, self.found.labels, self.found.depth, self.porous(self.found), self.radius)
        self.layers = layers if self.full is not None else None
        own = depth < self.found.depth
        alpha = np.where(own, 1.0, layers.alpha)
        front, behind = (np.where(own, depth, d) for d in (layers.front_depth, layers.behind_depth))
        colour = np.where(own[..., None], np.maximum(self.photograph, 0), layers.front)
        return Edges(alpha, front, behind, colour, layers.behind)

    def porous(self, found: RegionDepth) -> np.ndarray:
        """Where (H, W) something farther may be seen through what was drawn."""
        return np.array([region.porous for region in found.regions])[found.labels]

    def normals(self) -> dict[str, list[float]]:
        """Unit normals towards the camera of the regions' planes, by the planes' names."""
        sides = {name: 1.0 if plane.distance(self.camera.position) >= 0 else -1.0 for name, plane in self.planes.items()}
        return {name: (sides[name] * plane.normal).tolist() for name, plane in self.planes.items()}


def outdoors(build: Build, camera: Camera, described: dict[str, Any], view: Camera | None = None) -> Outdoors:
    """Reads what the section names, and works out depth and stand-ins. Raises InputError with a place.

    camera: the photograph's, in whose pixels regions are drawn. view: that of the build's images, if it is another.
    """
    section = DepthSection.model_validate({k: v for k, v in described.items() if k != "sha256"})
    known = None
    if section.map is not None:
        settings = section.map.model_dump()
        known = read_depth(inside(build, settings.pop("file")), camera, **settings)
    messages: list[str] = []
    try:
        found = depth_of_regions(camera, described_regions(build, camera, section, messages), section.sky_depth, known)
    except RegionError as error:
        name = error.region.split(":")[0]
        raise error.at(scene_place(build, "depth", *(("regions", name) if name in section.regions else ("labels",)))
                       ) from None
    radius, full = section.refine.radius, None
    if view is not None and (view.width, view.height) != (camera.width, camera.height):
        radius = max(1, round(radius * view.width / camera.width)) if radius else 0
        full, found, camera = found, at_smaller_size(found, view, section.sky_depth), view
    solids = stand_in(camera, found, section.sky_depth)
    planes = {f"{region.name}.{k}" if len(region.planes) > 1 else region.name: plane
              for region in found.regions for k, plane in enumerate(region.planes)}
    facts = {region.name: _facts(region, found, solids.get(region.name)) for region in found.regions}
    return Outdoors(section, camera, read_map(build.photograph), found, solids, radius, full, planes,
                    messages + found.messages, facts=facts)


def _facts(region: Region, found: RegionDepth, solid: Solid | None) -> dict[str, Any]:
    """What is worth reporting of a region."""
    return {"class": region.kind, "share": float(region.mask.sum() / found.labels.size),
            "depth_median_m": float(np.median(found.depth[region.at][region.mask])) if region.mask.any() else None,
            "triangles": len(solid.triangles) if solid else 0, "mesh_error": solid.error if solid else None}


def described_regions(build: Build, camera: Camera, section: DepthSection, messages: list[str], labels=read_labels
                      ) -> list[Region]:
    """Regions from the label image first, then those that are outlined, which lie over them.

    labels: reads the label image, as `read_labels`. Raises InputError for one that cannot be read.
    """
    regions = []
    if section.labels is not None:
        by_colour = {r.label.lower(): (name, r) for name, r in section.regions.items() if r.label}
        colours = [*PALETTE, *(colour for colour in by_colour if colour not in PALETTE)]
        picture = labels(inside(build, section.labels), camera.width, camera.height, colours)
        numbers: Counter[str] = Counter()
        for index, colour in enumerate(colours):
            name, own = by_colour.get(colour, (PALETTE.get(colour), None))
            kind = own.surface if own else PALETTE[colour]
            # each patch of what stands upright stands by itself, unless it is said where all of it stands
            placed = own is not None and (own.foot is not None or own.depth is not None)
            patches = painted(picture, index, kind == "vertical" and not placed)
            alone = len(patches) == 1 and (own is not None or name not in section.regions)
            for mask, at in patches:
                numbers[name] += 1
                # a name with a number is none of the scene file's
                label = name if alone else f"{name}:{numbers[name]}"
                region = _region(label, own, mask, at) if own else Region(label, kind, mask, at)
                regions.append(replace(region, painted=own is None or not alone))
            if own and not patches:
                messages.append(f"region {name}: its colour {colour} is nowhere in {section.labels}")
    for name, described in section.regions.items():
        if described.pixels is not None:
            mask = polygon_mask((camera.height, camera.width), np.asarray(described.pixels, float),
                                [np.asarray(hole, float) for hole in described.holes])
            regions.append(_region(name, described, *cut(mask)))
    return regions


def _region(name: str, described: RegionDescription, mask: np.ndarray, at: tuple[slice, slice]) -> Region:
    foot = None if described.foot is None else np.asarray(described.foot, float)
    return Region(name, described.surface, mask, at, foot, described.depth, described.near, described.far,
                  described.thickness, described.porous)
