"""The depth section of a scene, with its files and the photograph, as depth, edges and solid stand-ins."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane
from pipeline.geometry.regions import Region, RegionDepth, depth_of_regions, painted, polygon_mask
from pipeline.geometry.stand_in import regions_of, stand_in
from pipeline.imaging.depth_file import read_depth, read_labels
from pipeline.imaging.edges import refined
from pipeline.imaging.maps import read_map
from pipeline.paths import Build, inside
from pipeline.plugins.base import Shape, registry
from pipeline.scene.artefacts import Edges
from pipeline.scene.depth_section import DepthSection, RegionDescription

#: Colours of a painted label image, as in the paper's Fig. 7.
PALETTE = {"#ff0000": "vertical", "#00ff00": "support", "#0000ff": "sky"}


@dataclass
class Outdoors:
    """What the geometry stage needs of an open-air scene; see `outdoors`."""

    section: DepthSection
    camera: Camera
    photograph: np.ndarray
    found: RegionDepth
    solids: dict[str, Any]
    planes: dict[str, Plane] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)
    ground_faces: list[int] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    @property
    def sky_depth(self) -> float:
        return self.section.sky_depth

    def joined(self, shapes: dict[str, Shape], depth: np.ndarray, face: np.ndarray, emitter: np.ndarray
               ) -> tuple[dict[str, Shape], np.ndarray, np.ndarray]:
        """Stand-ins as placed shapes; depth and face maps of the regions and, nearer, the scene's own shapes."""
        standing_in = {f"region_{name}": registry("shapes")["mesh"](
            type="mesh", vertices=solid.vertices.tolist(), triangles=solid.triangles.tolist())
            for name, solid in self.solids.items()}
        first = sum(len(shape.faces()) for shape in shapes.values())
        index = {name: first + k for k, name in enumerate(self.solids)}
        of_region = [index.get(name, -1) for name in self._solid_names()]
        regions_face = np.array([*of_region, -1], np.int32)[self.found.labels]
        nearer = depth < self.found.depth
        self.ground_faces = sorted({index[n] for n, r in zip(self._solid_names(), self.found.regions)
                                    if r.kind == "support" and n in index})
        return (standing_in, np.where(nearer, depth, self.found.depth),
                np.where(nearer, face, regions_face).astype(np.int32))

    def _solid_names(self) -> list[str | None]:
        names = regions_of(self.solids, self.found.regions)
        return [names.get(region.name) for region in self.found.regions]

    def edges_beside(self, depth: np.ndarray) -> Edges:
        """Refined borders of the regions; the scene's own shapes before them are as sharp as they are."""
        porous = np.array([bool(d.porous) for d in self._descriptions()] + [False])[self.found.labels]
        layers = refined(self.photograph, self.found.labels, self.found.depth, porous, self.section.refine.radius)
        own = depth < self.found.depth
        alpha = np.where(own, 1.0, layers.alpha)
        front, behind = (np.where(own, depth, d) for d in (layers.front_depth, layers.behind_depth))
        return Edges(alpha, front, behind, layers.front, layers.behind)

    def normals(self) -> dict[str, list[float]]:
        """Unit normals towards the camera of regions that lie on one plane, by name."""
        found = {}
        for region in self.found.regions:
            if len(region.planes) == 1:
                plane = region.planes[0]
                side = 1.0 if (self.camera.position - plane.point) @ plane.normal >= 0 else -1.0
                found[region.name] = (side * plane.normal).tolist()
        return found

    def _descriptions(self) -> list[RegionDescription]:
        plain = RegionDescription.model_validate({"class": "sky", "label": "#0000ff"})
        return [self.section.regions.get(region.name.split(":")[0], plain) for region in self.found.regions]


def outdoors(build: Build, camera: Camera, described: dict[str, Any]) -> Outdoors:
    """Reads what the section names, and works out depth and stand-ins. Raises InputError with a place."""
    section = DepthSection.model_validate({k: v for k, v in described.items() if k != "sha256"})
    known = None
    if section.map is not None:
        settings = section.map.model_dump()
        known = read_depth(inside(build, settings.pop("file")), camera, **settings)
    regions = _regions(build, camera, section)
    found = depth_of_regions(camera, regions, section.sky_depth, known)
    solids = stand_in(camera, found, section.sky_depth)
    planes = {f"{region.name}.{k}" if len(region.planes) > 1 else region.name: plane
              for region in found.regions for k, plane in enumerate(region.planes)}
    counts = np.bincount(found.labels.ravel(), minlength=len(found.regions)) / found.labels.size
    facts = {region.name: {
        "class": region.kind, "share": float(counts[i]),
        "depth_median_m": float(np.median(found.depth[region.mask])) if region.mask.any() else None,
        "triangles": len(solids[region.name].triangles) if region.name in solids else 0}
        for i, region in enumerate(found.regions)}
    return Outdoors(section, camera, read_map(build.photograph), found, solids, planes, list(found.messages),
                    facts=facts)


def _regions(build: Build, camera: Camera, section: DepthSection) -> list[Region]:
    """Regions from the label image first, then those that are outlined, which lie over them."""
    shape = (camera.height, camera.width)
    colours = {**PALETTE, **{r.label.lower(): None for r in section.regions.values() if r.label}}
    regions = []
    if section.labels is not None:
        picture = read_labels(inside(build, section.labels), camera.width, camera.height, list(colours))
        by_colour = {r.label.lower(): (name, r) for name, r in section.regions.items() if r.label}
        for colour, kind in colours.items():
            rgb = np.array([int(colour[i:i + 2], 16) for i in (1, 3, 5)], np.uint8)
            name, own = by_colour.get(colour, (kind, None))
            # each patch of the palette's red stands by itself
            apart = (own.surface if own else kind) == "vertical"
            masks = painted(picture, rgb, apart)
            for number, mask in enumerate(masks, 1):
                label = name if len(masks) == 1 else f"{name}:{number}"
                regions.append(_region(label, own, mask) if own else Region(label, kind, mask))
    for name, described in section.regions.items():
        if described.pixels is not None:
            mask = polygon_mask(shape, np.asarray(described.pixels, float),
                                [np.asarray(hole, float) for hole in described.holes])
            regions.append(_region(name, described, mask))
    return regions


def _region(name: str, described: RegionDescription, mask: np.ndarray) -> Region:
    foot = None if described.foot is None else np.asarray(described.foot, float)
    return Region(name, described.surface, mask, foot, described.depth, described.near, described.far,
                  described.thickness)
