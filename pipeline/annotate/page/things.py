"""What a scene's data holds that is drawn in the photograph: one `Thing` a line, outline or set of named corners.

Pure: plain data in, things out. Whatever does not look as it should is left out here and said by the preview's problems.
All pixels are the full-size photograph's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

Place = tuple  # keys and indices from the top of the scene file, such as ("lights", "lamp", "outline", "pixels")
Form = Literal["line", "outline", "path", "point", "corners", "nothing"]
#: Points without which a form means nothing.
LEAST = {"line": 2, "outline": 3, "path": 2, "point": 1, "corners": 1, "nothing": 0}

BOTTOM_AND_TOP = [f"{depth}_{side}_{level}" for level in ("bottom", "top") for depth, side in
                  (("front", "left"), ("front", "right"), ("back", "left"), ("back", "right"))]
#: In the order in which a person is asked for them: what most photographs show comes first.
ROOM_CORNERS = [f"{depth}_{side}_{level}" for depth, side in
                (("back", "left"), ("back", "right"), ("front", "left"), ("front", "right")) for level in ("floor", "ceiling")]
ROOM_EDGES = [*(f"{level}_{wall}" for level in ("floor", "ceiling") for wall in ("left", "right", "back", "front")),
              "back_left", "back_right", "front_left", "front_right"]
BOX_CORNERS = [BOTTOM_AND_TOP[i] for i in (0, 1, 4, 5, 6, 7, 2, 3)]
POST = ["foot", "tip", "shadow"]
AXES = {"x": "left-right", "y": "upright", "z": "front-back"}


@dataclass(frozen=True)
class Thing:
    """Something drawn. `place` holds its points: a list of pixels, a single pixel, or a group of named ones.

    owner: what it is part of, whose fields are shown and which goes with it: ("lights", "lamp"). names: of its points, where they
    have names; wanted: all names that they may have.
    """

    place: Place
    owner: Place
    label: str
    group: str
    form: Form
    colour: str
    points: tuple[tuple[float, float], ...] = ()
    names: tuple[str, ...] = ()
    wanted: tuple[str, ...] = field(default=(), repr=False)

    @property
    def closed(self) -> bool:
        return self.form == "outline"

    @property
    def least(self) -> int:
        return LEAST[self.form]

    def value(self, points, names=None) -> Any:
        """What stands at `place` for these points."""
        rounded = [[round(float(u), 1) + 0.0, round(float(v), 1) + 0.0] for u, v in points]  # + 0.0: no -0.0
        if self.form == "corners":
            return dict(zip(self.names if names is None else names, rounded))
        return rounded[0] if self.form == "point" else rounded


COLOURS = {"x": "#e5604d", "y": "#5fb760", "z": "#5b8fe0", "camera": "#d9d9d9", "shapes": "#e2b04a", "lamp": "#ffe27a",
           "window": "#7fd1e8", "sun": "#ffa94d", "known": "#d58ad6", "support": "#7fbf7b", "vertical": "#d9795d", "sky": "#79a9dd",
           "foot": "#f1e3c6", "hole": "#a8a8a8"}


def things(data: dict[str, Any]) -> list[Thing]:
    """All that is drawn, in the order of the page's list."""
    found: list[Thing] = []
    for part in (_camera, _shapes, _lights, _known, _regions, _posts):
        found += part(data)
    return found


def at(data: Any, place: Place, default: Any = None) -> Any:
    """The value at `place`, or `default` where nothing is."""
    for key in place:
        if isinstance(data, dict) and key in data or isinstance(data, list) and isinstance(key, int) and -1 < key < len(data):
            data = data[key]
        else:
            return default
    return data


def group(data: Any, *place) -> dict[str, Any]:
    found = at(data, place)
    return found if isinstance(found, dict) else {}


def listed(data: Any, *place) -> list[Any]:
    found = at(data, place)
    return found if isinstance(found, list) else []


def pixel(value: Any) -> tuple[float, float] | None:
    if isinstance(value, list) and len(value) == 2 and all(isinstance(x, (int, float)) and abs(x) < 1e7 for x in value):
        return float(value[0]), float(value[1])
    return None


def pixels(value: Any) -> tuple[tuple[float, float], ...] | None:
    """The points of a list of pixels; None where one is no pixel."""
    found = [pixel(one) for one in value] if isinstance(value, list) else [None]
    return None if None in found else tuple(found)


def _list_thing(data, place, owner, label, section, form, colour) -> Iterator[Thing]:
    points = pixels(at(data, place))
    if points:
        yield Thing(place, owner, label, section, form, colour, points)


def _named_thing(data, place, owner, label, section, colour, wanted) -> Thing:
    stated = {name: pixel(value) for name, value in group(data, *place).items()}
    kept = {name: point for name, point in stated.items() if point}
    return Thing(place, owner, label, section, "corners", colour, tuple(kept.values()), tuple(kept), tuple(wanted))


def _camera(data) -> Iterator[Thing]:
    for axis, what in AXES.items():
        for i, _ in enumerate(listed(data, "camera", "lines", axis)):
            place = ("camera", "lines", axis, i)
            yield from _list_thing(data, place, place, f"{what} {i + 1}", "Camera", "line", COLOURS[axis])
    yield from _list_thing(data, ("camera", "horizon"), ("camera", "horizon"), "horizon", "Camera", "line", COLOURS["camera"])
    yield from _list_thing(data, ("camera", "known_length", "pixels"), ("camera", "known_length"), "known length", "Camera", "line",
                           COLOURS["camera"])


def _shapes(data) -> Iterator[Thing]:
    for name, shape in group(data, "shapes").items():
        owner, kind = ("shapes", name), at(shape, ("type",))
        if kind == "room" and at(shape, ("lower",)) is None:
            yield _named_thing(data, (*owner, "corners"), owner, name, "Room and boxes", COLOURS["shapes"], ROOM_CORNERS)
            for edge in group(shape, "edges"):
                place = (*owner, "edges", edge)
                yield from _list_thing(data, place, place, f"{name} {edge}", "Room and boxes", "line", COLOURS["shapes"])
        elif kind == "cuboid" and at(shape, ("centre",)) is None:
            yield _named_thing(data, (*owner, "corners"), owner, name, "Room and boxes", COLOURS["shapes"], BOX_CORNERS)
        elif kind == "polygon":
            yield from _list_thing(data, (*owner, "outline", "pixels"), owner, name, "Room and boxes", "outline", COLOURS["shapes"])


def _lights(data) -> Iterator[Thing]:
    for name, light in group(data, "lights").items():
        owner, kind = ("lights", name), at(light, ("type",))
        if kind == "area":
            yield from _list_thing(data, (*owner, "outline", "pixels"), owner, name, "Lights", "outline", COLOURS["lamp"])
        elif kind in ("point", "spot"):
            yield from _point(data, (*owner, "position", "pixel"), owner, name, "Lights", COLOURS["lamp"])
        elif kind == "lamps":
            for i, _ in enumerate(listed(light, "positions")):
                place = (*owner, "positions", i)
                yield from _point(data, (*place, "pixel"), place, f"{name} {i + 1}", "Lights", COLOURS["lamp"])
        elif kind == "sun":
            yield Thing(owner, owner, name, "Lights", "nothing", COLOURS["sun"])
            for key in group(light, "openings"):
                opening = (*owner, "openings", key)
                yield from _list_thing(data, (*opening, "window", "pixels"), opening, f"{name}: {key}", "Lights", "outline",
                                       COLOURS["window"])
                for i, _ in enumerate(listed(light, "openings", key, "patches")):
                    place = (*opening, "patches", i)
                    yield from _list_thing(data, (*place, "pixels"), place, f"{key} patch {i + 1}", "Lights", "outline",
                                           COLOURS["sun"])
        elif kind:
            yield Thing(owner, owner, name, "Lights", "nothing", COLOURS["camera"])


def _point(data, place, owner, label, section, colour) -> Iterator[Thing]:
    point = pixel(at(data, place))
    if point:
        yield Thing(place, owner, label, section, "point", colour, (point,))


def _known(data) -> Iterator[Thing]:
    for key, what, colour in (("albedos", "known colour", "known"), ("shadowed", "in the shade", "sky"),
                              ("sunlit", "in the sun", "sun")):
        for i, _ in enumerate(listed(data, "illumination", key)):
            owner = ("illumination", key, i)
            label = f"{what} {i + 1}"
            yield from _list_thing(data, (*owner, "pixels"), owner, label, "Known colours and patches", "outline", COLOURS[colour])
            yield from _point(data, (*owner, "pixel"), owner, label, "Known colours and patches", COLOURS[colour])


def _regions(data) -> Iterator[Thing]:
    for name, region in group(data, "depth", "regions").items():
        owner, surface = ("depth", "regions", name), at(region, ("class",))
        colour = COLOURS.get(surface, COLOURS["hole"])
        if at(region, ("pixels",)) is None:  # painted in the label image
            yield Thing(owner, owner, name, "Regions", "nothing", colour)
        yield from _list_thing(data, (*owner, "pixels"), owner, name, "Regions", "outline", colour)
        yield from _list_thing(data, (*owner, "foot"), (*owner, "foot"), f"{name}: foot", "Regions", "path", COLOURS["foot"])
        for i, _ in enumerate(listed(region, "holes")):
            place = (*owner, "holes", i)
            yield from _list_thing(data, place, place, f"{name}: hole {i + 1}", "Regions", "outline", COLOURS["hole"])


def _posts(data) -> Iterator[Thing]:
    for i, _ in enumerate(listed(data, "sun_direction", "shadows")):
        place = ("sun_direction", "shadows", i)
        yield _named_thing(data, place, place, f"post and shadow {i + 1}", "Sun's direction", COLOURS["sun"], POST)
