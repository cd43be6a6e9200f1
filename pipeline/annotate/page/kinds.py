"""What a person can add to a scene: where it goes in the scene file, what stands there, and what is drawn for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pipeline.annotate.written.new_scene import USUAL_ANGLE
from pipeline.annotate.page.things import (
    BOX_CORNERS, LEAST, POST, ROOM_CORNERS, ROOM_EDGES, Form, Place, at, group, listed)

#: Of a clicked patch: pixels of its radius in a photograph of this width; it grows with the photograph.
RADIUS, WIDTH = 6.0, 768

#: A new scene begins with a guess, which lines along two axes take the place of.
GUESSED = ("camera", "horizontal_field_of_view")


@dataclass(frozen=True)
class Drawn:
    """What a finished drawing changes: values to set, in order, places to remove first, and the place that is then selected."""

    values: list[tuple[Place, Any]]
    selected: Place
    removed: tuple[Place, ...] = ()


@dataclass(frozen=True)
class Kind:
    """Something to add. `make(data, points, options)` says what a drawing of `points` changes.

    where: "room" or "open", or both. of: the place of what it is drawn for must begin so, such as a region for its foot.
    options: which choice is asked for besides: "plane", "edge" or nothing.
    """

    name: str
    title: str
    group: str
    form: Form
    hint: str
    make: Callable[[dict, list, dict], Drawn]
    where: tuple[str, ...] = ("room", "open")
    key: str = ""
    of: Place = ()
    option: str = ""

    @property
    def first(self) -> int:
        """So many points, and it is in the scene: the rest may follow, and lines and points are then finished."""
        return LEAST[self.form]


def is_open(data: dict) -> bool:
    """Whether the scene lies in the open air, by its `depth` section."""
    return at(data, ("depth",)) is not None


def settled(data: dict) -> bool:
    """Whether something in it tells a room from the open air."""
    return is_open(data) or bool(group(data, "shapes"))


def free_name(taken, wanted: str) -> str:
    """`wanted`, or wanted_2, wanted_3, ... where that is taken."""
    number, name = 1, wanted
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    return name


def _line(axis: str):
    def make(data, points, options):
        place = ("camera", "lines", axis)
        count = len(listed(data, *place))
        new = (*place, count)
        others = any(listed(data, *place[:2], other) for other in "xyz" if other != axis)
        guessed = others and at(data, GUESSED) == USUAL_ANGLE
        return Drawn([(new, points) if count else (place, [points])], new, (GUESSED,) if guessed else ())
    return make


def _horizon(data, points, options):
    return Drawn([(("camera", "horizon"), points)], ("camera", "horizon"))


def _known_length(data, points, options):
    place = ("camera", "known_length")
    length = at(data, (*place, "length"), 1.0)
    removed = (("camera", "height"),) if at(data, ("camera", "height")) is not None else ()
    return Drawn([(place, {"pixels": points, "length": length})], (*place, "pixels"), removed)


def first_room(data) -> str | None:
    return next((name for name, shape in group(data, "shapes").items() if at(shape, ("type",)) == "room"), None)


def _room(data, points, options):
    name = first_room(data) or "room"
    place = ("shapes", name)
    if at(data, place) is None:
        return Drawn([(place, {"type": "room", "corners": {options.get("name") or ROOM_CORNERS[0]: points[0]}})], (*place, "corners"))
    return Drawn([((*place, "corners", options.get("name") or ROOM_CORNERS[0]), points[0])], (*place, "corners"))


def _room_edge(data, points, options):
    name = first_room(data) or "room"
    place = ("shapes", name)
    edge = options.get("edge") or free_edge(data)
    if at(data, place) is None:
        return Drawn([(place, {"type": "room", "edges": {edge: points}})], (*place, "edges", edge))
    return Drawn([((*place, "edges", edge), points)], (*place, "edges", edge))


def free_edge(data) -> str:
    taken = group(data, "shapes", first_room(data) or "room", "edges")
    return next((edge for edge in ROOM_EDGES if edge not in taken), ROOM_EDGES[0])


def _box(data, points, options):
    name = free_name(group(data, "shapes"), "box")
    place = ("shapes", name)
    value = {"type": "cuboid", "stands_on": options.get("plane") or f"{first_room(data) or 'room'}.floor",
             "corners": {options.get("name") or BOX_CORNERS[0]: points[0]}}
    return Drawn([(place, value)], (*place, "corners"))


def _flat(data, points, options):
    place = ("shapes", free_name(group(data, "shapes"), "flat"))
    return Drawn([(place, {"type": "polygon", "outline": {"on": options.get("plane") or "room.back", "pixels": points}})],
                 (*place, "outline", "pixels"))


def _area(wanted: str, plane: str, **more):
    def make(data, points, options):
        place = ("lights", free_name(group(data, "lights"), wanted))
        value = {"type": "area", "outline": {"on": options.get("plane") or plane, "pixels": points}, **more}
        return Drawn([(place, value)], (*place, "outline", "pixels"))
    return make


def _bulb(data, points, options):
    place = ("lights", free_name(group(data, "lights"), "bulb"))
    where = {"pixel": points[0], "depth": 10.0} if is_open(data) else {"pixel": points[0], "on": options.get("plane") or "room.ceiling"}
    return Drawn([(place, {"type": "point", "position": where})], (*place, "position", "pixel"))


def _sun(data) -> str:
    return next((name for name, light in group(data, "lights").items() if at(light, ("type",)) == "sun"), "sun")


def _sun_window(data, points, options):
    sun = ("lights", _sun(data))
    name = free_name(group(data, *sun, "openings"), "window")
    opening, window = (*sun, "openings", name), {"on": options.get("plane") or "room.left", "pixels": points}
    if at(data, sun) is None:
        return Drawn([(sun, {"type": "sun", "openings": {name: {"window": window, "patches": []}}})], (*opening, "window", "pixels"))
    return Drawn([(opening, {"window": window, "patches": []})], (*opening, "window", "pixels"))


def _sun_patch(data, points, options):
    openings = group(data, "lights", _sun(data), "openings")
    stated = options.get("of") or ()
    name = stated[3] if len(stated) > 3 and stated[3] in openings else next(reversed(openings), None)
    patches = ("lights", _sun(data), "openings", name, "patches")
    count = len(listed(data, *patches))
    patch = {"on": options.get("plane") or "room.floor", "pixels": points}
    new = (*patches, count)
    return Drawn([(new, patch) if count else (patches, [patch])], (*new, "pixels"))


def _plain_light(type: str, wanted: str):
    def make(data, points, options):
        place = ("lights", free_name(group(data, "lights"), wanted))
        return Drawn([(place, {"type": type})], place)
    return make


def _known_colour(data, points, options):
    place, one = ("illumination", "albedos"), {"pixels": points, "albedo": [0.5, 0.5, 0.5]}
    count = len(listed(data, *place))
    if at(data, ("illumination", "type")) != "karsch":
        return Drawn([(("illumination",), {"type": "karsch", "albedos": [one]})], (*place, 0, "pixels"))
    return Drawn([((*place, count), one) if count else (place, [one])], (*place, count, "pixels"))


def _liu_xing(key: str, outline: bool):
    def make(data, points, options):
        width = options.get("width", WIDTH)
        one = {"pixels": points} if outline else {"pixel": points[0]}
        if not outline and width > WIDTH:
            one["radius"] = round(RADIUS * width / WIDTH, 1)
        place, last = ("illumination", key), "pixels" if outline else "pixel"
        if at(data, ("illumination", "type")) != "liu_xing":
            return Drawn([(("illumination",), {"type": "liu_xing", key: [one]})], (*place, 0, last))
        count = len(listed(data, *place))
        return Drawn([((*place, count), one) if count else (place, [one])], (*place, count, last))
    return make


def _region(surface: str, wanted: str):
    def make(data, points, options):
        place = ("depth", "regions", free_name(group(data, "depth", "regions"), wanted))
        return Drawn([(place, {"class": surface, "pixels": points})], (*place, "pixels"))
    return make


def _foot(data, points, options):
    place = (*options["of"][:3], "foot")
    removed = ((*options["of"][:3], "depth"),) if at(data, (*options["of"][:3], "depth")) is not None else ()
    return Drawn([(place, points)], place, removed)


def _hole(data, points, options):
    place = (*options["of"][:3], "holes")
    count = len(listed(data, *place))
    return Drawn([((*place, count), points) if count else (place, [points])], (*place, count))


def _post(data, points, options):
    place, one = ("sun_direction", "shadows"), {options.get("name") or POST[0]: points[0]}
    if at(data, ("sun_direction", "type")) != "cast_shadow":
        return Drawn([(("sun_direction",), {"type": "cast_shadow", "shadows": [one]})], (*place, 0))
    count = len(listed(data, *place))
    return Drawn([((*place, count), one) if count else (place, [one])], (*place, count))


ROOM, OPEN = ("room",), ("open",)
KINDS = {kind.name: kind for kind in (
    Kind("line_x", "Edge left-right", "Camera", "line", "Click both ends of an edge that runs left-right.", _line("x"), key="x"),
    Kind("line_y", "Edge upright", "Camera", "line", "Click both ends of an upright edge.", _line("y"), key="y"),
    Kind("line_z", "Edge front-back", "Camera", "line", "Click both ends of an edge that runs away from you.", _line("z"), key="z"),
    Kind("horizon", "Horizon", "Camera", "line", "Click two points of the horizon; instead of edges.", _horizon, key="h"),
    Kind("known_length", "Known length", "Camera", "line", "Click two points on the floor whose distance you know; instead of the"
         " camera's height.", _known_length),
    Kind("room", "Room corners", "Room and boxes", "corners", "Click the corners that you see; the name says which is next.", _room,
         ROOM, "r"),
    Kind("room_edge", "Room edge", "Room and boxes", "line", "Click two points along an edge between floor, walls and ceiling.",
         _room_edge, ROOM, "e", option="edge"),
    Kind("box", "Box", "Room and boxes", "corners", "Click the corners that you see; front is towards you.", _box, ROOM, "b",
         option="plane"),
    Kind("flat", "Flat piece", "Room and boxes", "outline", "Outline something flat, such as a door leaf.", _flat, ROOM, option="plane"),
    Kind("lamp", "Lamp", "Lights", "outline", "Outline the shining surface.", _area("lamp", "room.ceiling"), ROOM, "l",
         option="plane"),
    Kind("window", "Window", "Lights", "outline", "Outline the glass through which skylight comes.",
         _area("sky", "room.left", sub_lights=8), ROOM, "w", option="plane"),
    Kind("sun_window", "Sun's window", "Lights", "outline", "Outline what the sun shines through.", _sun_window, ROOM, "s",
         option="plane"),
    Kind("sun_patch", "Sun patch", "Lights", "outline", "Outline the sunlit patch that the window throws, one a surface.", _sun_patch,
         ROOM, "p", of=("lights", None, "openings"), option="plane"),
    Kind("bulb", "Bulb", "Lights", "point", "Click the bulb.", _bulb, key="u"),
    Kind("reflected", "Reflected light", "Lights", "nothing", "What walls and floor throw back.", _plain_light("ambient", "reflected"),
         ROOM),
    Kind("sky", "Skylight", "Lights", "nothing", "", _plain_light("sky", "sky"), OPEN),
    Kind("sunlight", "Sunlight", "Lights", "nothing", "", _plain_light("sunlight", "sun"), OPEN),
    Kind("ground_light", "Light from the ground", "Lights", "nothing", "", _plain_light("ground", "ground"), OPEN),
    Kind("known_colour", "Known colour", "Known colours and patches", "outline", "Outline a surface whose colour you know.",
         _known_colour, ROOM, "k"),
    Kind("ground", "Ground", "Regions", "outline", "Outline level ground: a road, a lawn, a lake.", _region("support", "ground"), OPEN,
         "g"),
    Kind("upright", "Upright thing", "Regions", "outline", "Outline a wall, a tree, a person. Later ones lie over earlier ones.",
         _region("vertical", "upright"), OPEN, "b"),
    Kind("sky_region", "Sky", "Regions", "outline", "Outline the open sky.", _region("sky", "sky"), OPEN, "w"),
    Kind("foot", "Foot line", "Regions", "path", "Click along the line on which the chosen region stands on the ground.", _foot, OPEN,
         "f", of=("depth", "regions")),
    Kind("hole", "Hole", "Regions", "outline", "Outline what is cut out of the chosen region.", _hole, OPEN, "o",
         of=("depth", "regions")),
    Kind("shadowed", "In the shade", "Known colours and patches", "point", "Click ground in the shade.", _liu_xing("shadowed", False),
         OPEN, "d"),
    Kind("sunlit", "In the sun", "Known colours and patches", "point", "Click ground of the same kind in the sun.",
         _liu_xing("sunlit", False), OPEN, "s"),
    Kind("shadowed_outline", "Shade, outlined", "Known colours and patches", "outline", "Outline ground in the shade.",
         _liu_xing("shadowed", True), OPEN),
    Kind("sunlit_outline", "Sun, outlined", "Known colours and patches", "outline", "Outline ground in the sun.",
         _liu_xing("sunlit", True), OPEN),
    Kind("post", "Post and shadow", "Sun's direction", "corners", "Click foot and tip of something upright, and where the tip's shadow"
         " falls.", _post, OPEN, "p"),
)}
NAMES = {"room": ROOM_CORNERS, "box": BOX_CORNERS, "post": POST}


def offered(data: dict, setting: str = "room") -> list[Kind]:
    """What can be added to this scene; setting: "room" or "open", for one that does not tell itself."""
    where = setting if not settled(data) else "open" if is_open(data) else "room"
    return [kind for kind in KINDS.values() if where in kind.where]


def fits(kind: Kind, selected: Place | None, data: dict) -> bool:
    """Whether what it is drawn for is there."""
    if kind.name == "sun_patch":
        return bool(group(data, "lights", _sun(data), "openings"))
    return not kind.of or (selected is not None and selected[:len(kind.of)] == kind.of)
