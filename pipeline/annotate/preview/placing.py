"""A scene's parts in world metres, each for itself: what is broken is said, and left out.

What was worked out for the last state is kept for the next, as long as what it depends on is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.annotate.preview.picture import stamp
from pipeline.annotate.preview.problems import Parts, Place, Problem
from pipeline.annotate.preview.scaled import scaled
from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.planes import Plane
from pipeline.geometry.regions import Region, RegionDepth, RegionError, depth_of_regions
from pipeline.geometry.visibility import COINCIDENT, seen_along, visible
from pipeline.imaging.depth_file import read_depth, read_labels
from pipeline.paths import Build, inside
from pipeline.plugins.annotations import Outline, Position
from pipeline.plugins.base import Light, Model, Shape, World
from pipeline.scene.depth_section import DepthSection
from pipeline.scene.described_camera import describe
from pipeline.scene.described_sun import QUICK, described_sun, is_sun, stated_at
from pipeline.scene.outdoors import described_regions
from pipeline.scene.placed import placed

#: Longer side [pixel] at which is worked out what hides what, and how far regions are.
VIEW = 256
#: By so much more of its objective the sun's direction is looked for anew, and not only near the last one.
WORSE = 0.15
#: Minimisations of a sun's direction: while somebody draws, few must do.
STARTS = 2
#: So many broken regions are told at once.
MOST_BROKEN = 20
#: A lamp may lie so far [share of its distance] behind what is seen there and count as seen.
ON_THE_WALL = 2e-2


@dataclass
class Placed:
    """What a scene says, in world metres; None or missing where it says nothing yet, or is broken.

    camera: of the photograph's own size; facts: as camera.json has them. view: the same camera in few pixels. suns: as
    sun_direction.json has them, of lights whose direction is known. region_depth: of the view, of an open-air scene.
    depth (h, w) [m], face (h, w): of what the view shows, inf and -1 for nothing.
    """

    camera: Camera | None = None
    facts: dict[str, Any] = field(default_factory=dict)
    view: Camera | None = None
    shapes: dict[str, Shape] = field(default_factory=dict)
    lights: dict[str, Light] = field(default_factory=dict)
    residuals: dict[str, dict[str, float]] = field(default_factory=dict)
    suns: dict[str, dict[str, Any]] = field(default_factory=dict)
    planes: dict[str, Plane] = field(default_factory=dict)
    regions: RegionDepth | None = None
    depth: np.ndarray | None = None
    face: np.ndarray | None = None
    #: what of the scene is left out, by its keys
    left_out: set[Place] = field(default_factory=set)


class Placing:
    """Places states of one scene, one after the other."""

    def __init__(self, build: Build):
        self.build = build
        self._known: dict[Any, tuple[Any, Any]] = {}
        self._labels: dict[tuple, np.ndarray] = {}
        self._suns: dict[str, dict[str, Any]] = {}

    def of(self, parts: Parts, size: tuple[int, int], exif_35mm: float | None) -> tuple[Placed, list[Problem]]:
        """size: the photograph's width and height [pixel]."""
        result, problems = Placed(left_out=set(parts.broken)), []
        if parts.camera is None:
            return result, problems
        try:
            result.camera, result.facts = self._once("camera", (parts.camera.model_dump_json(), size, exif_35mm),
                                                     lambda: describe(parts.camera, *size, exif_35mm, self.build))
        except InputError as error:
            problems.append(Problem.of(error, ("camera",), "warning" if _unfinished(parts.camera) else "error"))
            return result, problems
        problems += [Problem(("camera",), message, "check the lines", "warning")
                     for message in result.facts["messages"]]
        camera = result.camera
        scale = min(1.0, VIEW / max(size))
        result.view = camera.resized(*(max(1, round(side * scale)) for side in size))
        world, key = World(camera), (_key(camera),)
        if parts.depth is not None:
            world.planes["ground"] = Plane.across("y", 0.0)
            key = (*key, parts.depth.model_dump_json(), self._stamps(parts.depth))
            result.regions, found, left_out = self._once("regions", key, lambda: self._regions(parts.depth, camera, result.view))
            problems += found
            result.left_out |= left_out
            if result.regions is not None:
                for region in result.regions.regions:
                    for k, plane in enumerate(region.planes):
                        world.planes[f"{region.name}.{k}" if len(region.planes) > 1 else region.name] = plane
        for name, shape in parts.shapes.items():
            key = self._shape(name, shape, parts, world, key, result, problems)
        result.planes, result.residuals = world.planes, world.residuals
        key_of_shapes = key
        self._see(result, (key_of_shapes,))
        for name, light in parts.lights.items():
            self._light(name, light, parts, world, (key_of_shapes, light.model_dump_json()), result, problems)
        return result, problems

    def _once(self, what: Any, key: Any, make: Callable[[], Any]) -> Any:
        """`make()`, or what it gave last time if the key was the same; an error is raised again."""
        if what in self._known and self._known[what][0] == key:
            found = self._known[what][1]
        else:
            try:
                found = make()
            except InputError as error:
                found = error
            self._known[what] = key, found
        if isinstance(found, InputError):
            raise found
        return found

    def _shape(self, name: str, shape: Shape, parts: Parts, world: World, key: tuple, result: Placed,
               problems: list[Problem]) -> tuple:
        """Places one shape; the key of all that the next ones may stand on."""
        key = (*key, name, shape.model_dump_json())

        def place():
            own = World(world.camera, dict(world.planes))
            one = placed(name, shape, own)
            return one, own

        try:
            one, own = self._once(("shape", name), key, place)
        except InputError as error:
            problems.append(self._refused(error, ("shapes", name), shape, world, result))
            result.left_out.add(("shapes", name))
            return key
        world.planes |= own.planes
        world.residuals |= own.residuals
        result.shapes[name] = one
        for message in own.messages:
            problems.append(Problem(_worst(name, message, own.residuals.get(name, {}), shape), message,
                                    "check its corners, and the camera", "warning"))
        return key

    def _refused(self, error: InputError, place: Place, one: Model, world: World, result: Placed) -> Problem:
        """What is said of something that cannot be placed; if that is only for what it lies on, that comes first."""
        lies_on = {value.on for _, value in annotations(one)} | {getattr(one, "stands_on", None)}
        waits = sorted({on.split(".")[0] for on in lies_on if on}
                       & {key[1] for key in result.left_out if key[0] == "shapes"})
        if waits:
            return Problem(place, f"{place[-1]} waits for {waits[0]}, which it lies on", f"mend {waits[0]} first", "warning")
        return Problem.of(error, place)

    def _light(self, name: str, light: Light, parts: Parts, world: World, key: tuple, result: Placed,
               problems: list[Problem]) -> None:
        place: Place = ("lights", name)
        broken = []
        for keys, annotation in annotations(light):
            try:
                annotation.placed(".".join(map(str, (name, *keys))), world)
            except InputError as error:
                broken.append(self._refused(error, (*place, *keys), annotation, world, result))
        if broken:
            problems += broken
            result.left_out.add(place)
            return
        try:
            one = self._once(("light", name), key, lambda: placed(name, light, world))
        except InputError as error:
            problems.append(Problem.of(error, place))
            result.left_out.add(place)
            return
        problems += _hidden(place, light, one, result)
        if is_sun(one):
            settings = parts.sun_direction
            if hasattr(settings, "starts"):
                settings = settings.model_copy(update={"starts": min(settings.starts, STARTS)})
            try:
                found = self._once(("sun", name), (_key(world.camera), one.model_dump_json(), settings and settings.model_dump_json()),
                                   lambda: self._sun(name, one, world.camera, settings))
            except InputError as error:
                problems.append(Problem.of(error, _sun_place(error, stated_at(name, light, settings), light)))
                result.left_out.add(place)
                result.lights[name] = one
                return
            result.suns[name] = found
            one = one.model_copy(update={"direction": [float(x) for x in found["sun_direction"]]})
            at = stated_at(name, light, settings)
            problems += [Problem(at, f"{name}: {message}", "check the window and its patches, or the shadows", "warning")
                         for message in found["messages"]]
        result.lights[name] = one

    def _sun(self, name: str, light: Light, camera: Camera, settings) -> dict[str, Any]:
        """As `described_sun`, quickly: near the last direction, as long as what is there explains the patches as well."""
        last = self._suns.get(name)
        if last is not None and "objective" in last:
            try:
                found = described_sun(name, light, camera, settings, QUICK, np.asarray(last["sun_direction"]))
                if found.get("objective", np.inf) < last["objective"] + WORSE:
                    self._suns[name] = {**found, "objective": min(found["objective"], last["objective"] + WORSE / 4)}
                    return found
            except InputError:
                pass
        found = described_sun(name, light, camera, settings, QUICK)
        self._suns[name] = found
        return found

    def _see(self, result: Placed, key: tuple) -> None:
        """What the view shows."""
        if result.regions is None and not result.shapes:
            return
        result.depth, result.face, _ = self._once("seen", key, lambda: visible(result.view, result.shapes, {}))
        if result.regions is not None:
            nearer = result.depth < result.regions.depth
            result.face = np.where(nearer, result.face, -1)
            result.depth = np.where(nearer, result.depth, result.regions.depth)

    def _stamps(self, depth: DepthSection) -> list:
        return [stamp(self.build.source / name) for name in depth.files()]

    def _regions(self, depth: DepthSection, camera: Camera, view: Camera
                 ) -> tuple[RegionDepth | None, list[Problem], set[Place]]:
        """Regions as the view sees them, without those that are broken, and which these are."""
        problems: list[Problem] = []
        left_out: set[Place] = set()
        section: DepthSection = scaled(depth, view.width / camera.width)
        at: Place = ("depth",)
        try:
            known = None
            if section.map is not None:
                at = "depth", "map"
                settings = section.map.model_dump()
                known = read_depth(inside(self.build, settings.pop("file")), view, **settings)
            at = ("depth", "labels") if section.labels else ("depth",)
            messages: list[str] = []
            regions = self.described(section, view, messages)
        except InputError as error:
            return None, [Problem.of(error, at)], left_out
        problems += [Problem(("depth",), message, "check the painted picture", "warning") for message in messages]
        for _ in range(MOST_BROKEN):
            try:
                found = depth_of_regions(view, regions, section.sky_depth, known)
            except RegionError as error:
                name = error.region.split(":")[0]
                problems.append(Problem.of(error, ("depth", "regions", name) if name in depth.regions else ("depth", "labels")))
                regions = [one for one in regions if one.name != error.region]
                left_out.add(("depth", "regions", name))
            except InputError as error:
                # what is not covered because a region is broken is no mistake of its own
                problems += [Problem.of(error, ("depth", "regions"), "warning")] if not problems else []
                return None, problems, left_out
            else:
                problems += [Problem(_region_place(message, depth), message, "check it", "warning")
                             for message in found.messages]
                return found, problems, left_out
        return None, problems, left_out

    def described(self, section: DepthSection, view: Camera, messages: list[str] | None = None) -> list[Region]:
        """What is drawn and painted, in the view's pixels, in which the section is; notes are added to `messages`."""
        return described_regions(self.build, view, section, [] if messages is None else messages, self.labels)

    def labels(self, path: Path, width: int, height: int, colours: list[str]) -> np.ndarray:
        """`read_labels`, once as long as the file is the same."""
        key = str(path), stamp(path), width, height, tuple(colours)
        if key not in self._labels:
            if len(self._labels) > 8:
                self._labels.clear()
            self._labels[key] = read_labels(path, width, height, colours)
        return self._labels[key]


def annotations(one: Any, keys: Place = ()) -> Iterator[tuple[Place, Outline | Position]]:
    """All outlines and positions in a plugin's parameters, with their keys."""
    if isinstance(one, (Outline, Position)):
        yield keys, one
    elif isinstance(one, Model):
        for name in type(one).model_fields:
            yield from annotations(getattr(one, name), (*keys, name))
    elif isinstance(one, (list, dict)):
        for key, value in enumerate(one) if isinstance(one, list) else one.items():
            yield from annotations(value, (*keys, key))


def _key(camera: Camera) -> bytes:
    return np.concatenate([[camera.width, camera.height, camera.focal_length], *map(np.ravel, (
        camera.principal_point, camera.world_from_camera, camera.position))]).tobytes()


def _unfinished(camera: Model) -> bool:
    """Whether lines along two axes are still to be drawn, and nothing else tells the angles."""
    lines = camera.lines or {}
    return not camera.fspy and sum(len(segments) >= 2 for segments in lines.values()) < 2


def _worst(name: str, message: str, residuals: dict[str, float], shape: Shape) -> Place:
    """Keys of the corner or edge that a message about a fit names, or of the shape."""
    named = [key for key in residuals if f"'{key}'" in message]
    for part in ("corners", "edges"):
        if named and named[0] in getattr(shape, part, {}):
            return "shapes", name, part, named[0]
    return "shapes", name


def _region_place(message: str, depth: DepthSection) -> Place:
    named = [name for name in depth.regions if message.startswith((f"region {name} ", f"region {name}:"))]
    return ("depth", "regions", named[0]) if named else ("depth",)


def _sun_place(error: InputError, stated: Place, light: Light) -> Place:
    """Keys of the window that an error names, or of all."""
    openings = list(getattr(light, "openings", {}))
    named = [key for key in openings if f"'{key}'" in error.problem]
    if len(openings) == 1 or len(named) == 1:
        return (*stated, "openings", (named or openings)[0], "patches")
    return stated


def _hidden(place: Place, light: Light, one: Light, result: Placed) -> list[Problem]:
    """Lamps that what is drawn hides from the camera, although a person saw them there."""
    if result.depth is None:
        return []
    eye, found = result.camera.position, []
    for (keys, drawn), (_, value) in zip(annotations(light), annotations(one)):
        if is_sun(one) or isinstance(drawn, Outline) and drawn.pixels is None or isinstance(drawn, Position) and drawn.pixel is None:
            continue
        point = value.polygon.mean(0) if isinstance(value, Outline) else value.vector
        distance = float(np.linalg.norm(point - eye))
        ray = (point - eye) / max(distance, 1e-12)
        depth, face, _ = (float(x[0, 0]) for x in seen_along(eye, ray[None, None], result.shapes, {}))
        if distance > depth * (1 + max(ON_THE_WALL, COINCIDENT)):
            names = [f"{n}.{f}" for n, shape in result.shapes.items() for f in shape.faces()]
            found.append(Problem((*place, *keys), f"{place[1]} lies {distance - depth:.2g} m behind {names[int(face)]}, which hides it",
                                 "put it on that face, or give a smaller depth", "warning"))
    return found
