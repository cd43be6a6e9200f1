"""What a label makes of a drawing, and the other way round.

KIND:NAME, or KIND:NAME:PART, with @SHAPE.FACE behind it for what lies on a plane:

    x, y, z                      line: an edge that runs left-right, vertically, front-back (camera.lines)
    horizon                      line along the horizon
    floor, ceiling               outline of four corners: the room's edges round its floor or ceiling
    room:CORNER, room:EDGE       point, line: room:back_left_floor, room:floor_back
    box:NAME                     cuboid (CVAT): a box on the room's floor; another plane: box:NAME@table.top
    box:NAME:CORNER              point: one of its corners, such as box:table:front_left_top
    light:NAME                   outline: a lamp with an area, on the room's ceiling; another plane: light:NAME@room.back
                                 point: a bulb, with its plane; line: a bulb and the spot on the ground right below it
    window:NAME@SHAPE.FACE       outline: an opening that the sun shines through
    patch:NAME                   outline: where its sunlight falls, on the room's floor; another plane: patch:NAME@room.back
    region:NAME                  outline, in the open air; its class (sky, support, vertical) by its name, or
    region:NAME:CLASS            as stated; sky and ground alone are short for region:sky and region:ground
    hole:NAME                    outline cut out of the region NAME
    foot:NAME                    line on which the region NAME stands
    shadow                       line of three points: a thing's foot, its tip, and where the tip's shadow falls
    sunlit, shadowed             outline of ground in the sun, in the shade; sunlit@NAME: of an upright region
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Callable

from pipeline.annotate.exchange.drawings import Drawn
from pipeline.errors import InputError, nearest
from pipeline.geometry.axis_box import corner_names, edge_names

LABEL = re.compile(r"(?P<kind>[A-Za-z]+)(:(?P<name>[^:@]+))?(:(?P<part>[^:@]+))?(@(?P<plane>[A-Za-z0-9_.-]+))?")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,39}")
#: Names of ground, by which a region's class is known; one called sky is sky, and every other stands upright.
GROUND = {"ground", "road", "street", "pavement", "sidewalk", "floor", "lawn", "grass", "water", "field", "path", "sand", "snow"}
CLASSES = ("sky", "support", "vertical")


@dataclass(frozen=True)
class Target:
    """What a drawing writes: `value` at `place`, or one more entry of the list there.

    needed: what must stand round it, by place; a type that is another one there stands against it. usual: likewise, where
    nothing is. against: what says the same in another way.
    """

    place: tuple
    value: Any
    more: bool = False
    needed: dict[tuple, Any] = field(default_factory=dict)
    usual: dict[tuple, Any] = field(default_factory=dict)
    against: tuple[tuple, ...] = ()


@dataclass(frozen=True)
class Label:
    kind: str
    name: str | None
    part: str | None
    plane: str | None


def parsed(text: str) -> Label:
    """Raises InputError for a label that says nothing here."""
    found = LABEL.fullmatch(text)
    kind = found["kind"] if found else text.partition(":")[0]
    if not found or kind not in KINDS:
        raise InputError(f"'{text}' does not say what it is in the scene", remedy="label it KIND:NAME, KIND being one of "
                         + ", ".join(KINDS) + nearest(kind, list(KINDS)))
    return Label(kind, found["name"], found["part"], found["plane"])


def targets(drawn: Drawn, scene: dict[str, Any], taken: set[tuple]) -> list[Target]:
    """What the drawing writes into a scene that holds `scene`; taken: things that another drawing of the file made.

    Raises InputError, of one line, for a drawing that its label does not fit.
    """
    label = parsed(drawn.label)
    if label.kind in NAMED:
        if label.name is None or not NAME.fullmatch(label.name):
            raise InputError(f"'{drawn.label}' needs a name of letters, digits, '_' and '-'", remedy=f"label it {label.kind}:NAME")
    return KINDS[label.kind](label, drawn, scene, taken)


def _form(drawn: Drawn, *forms: str) -> None:
    if drawn.form not in forms:
        words = {"outline": "an outline", "line": "a line", "point": "a point", "cuboid": "a cuboid"}
        raise InputError(f"'{drawn.label}' is drawn as {words[drawn.form]}", remedy=f"draw {' or '.join(words[f] for f in forms)}")


def _shape(scene: dict, kind: str, otherwise: str) -> str:
    """Name of the shape, or light, of that type; `otherwise` where there is none."""
    group = scene.get("lights" if kind == "sun" else "shapes")
    return next((name for name, one in (group if isinstance(group, dict) else {}).items()
                 if isinstance(one, dict) and one.get("type") == kind), otherwise)


def _unique(name: str, group: tuple, taken: set[tuple]) -> str:
    """The name, with a number if another drawing of the file has it."""
    number, one = 1, name
    while (*group, one) in taken:
        number += 1
        one = f"{name[:36]}_{number}"
    taken.add((*group, one))
    return one


def _on(label: Label, usual: str | None, place: tuple) -> tuple[dict, dict]:
    """`on` as needed or as usual, below `place`."""
    if label.plane:
        return {(*place, "on"): label.plane}, {}
    return {}, {(*place, "on"): usual} if usual else {}


def _line(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "line")
    against = (("camera", "horizon"), ("camera", "fspy"), ("camera", "position"), ("camera", "look_at"), ("camera", "pitch"),
               ("camera", "roll"), ("camera", "yaw"))
    return [Target(("camera", "lines", label.kind), [drawn.points[0], drawn.points[-1]], more=True, against=against)]


def _horizon(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "line")
    against = tuple(("camera", key) for key in ("lines", "fspy", "position", "look_at", "pitch", "roll"))
    return [Target(("camera", "horizon"), [drawn.points[0], drawn.points[-1]], against=against)]


def _level(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    """Edges of the room round its floor or ceiling, of which the back is seen between its two sides."""
    _form(drawn, "outline")
    if len(drawn.points) != 4:
        raise InputError(f"'{drawn.label}' has {len(drawn.points)} corners", remedy="draw its four corners, or its edges as"
                         " lines: room:floor_back, room:floor_left, room:floor_right")
    points = drawn.points
    # the farther of a floor's edges lies higher in the photograph, of a ceiling's lower
    sign = 1 if label.kind == "floor" else -1
    first = min(range(4), key=lambda n: sign * (points[n][1] + points[(n + 1) % 4][1]))
    back = [points[first], points[(first + 1) % 4]]
    front = [points[first - 1], points[(first + 2) % 4]]
    if back[0][0] > back[1][0]:
        back, front = back[::-1], front[::-1]
    name = _shape(scene, "room", "room")
    edges = {"back": back, "left": [back[0], front[0]], "right": [back[1], front[1]]}
    against = (("shapes", name, "lower"), ("shapes", name, "upper"))
    return [Target(("shapes", name, "edges", f"{label.kind}_{side}"), edge, needed={("shapes", name, "type"): "room"},
                   against=against) for side, edge in edges.items()]


def _room(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "point", "line")
    corner = drawn.form == "point"
    known = corner_names(room=True) if corner else edge_names(room=True)
    if label.name not in known:
        raise InputError(f"'{drawn.label}' names no {'corner' if corner else 'edge'} of a room",
                         remedy=f"use one of {', '.join(known)}" + nearest(label.name or "", known))
    name = _shape(scene, "room", "room")
    value = drawn.points[0] if corner else [drawn.points[0], drawn.points[-1]]
    return [Target(("shapes", name, "corners" if corner else "edges", label.name), value,
                   needed={("shapes", name, "type"): "room"}, against=(("shapes", name, "lower"), ("shapes", name, "upper")))]


def _box(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "cuboid", "point")
    if drawn.form == "point":
        known = corner_names()
        if label.part not in known:
            raise InputError(f"'{drawn.label}' names no corner of a box",
                             remedy=f"label it box:NAME:CORNER, with one of {', '.join(known)}")
        name, corners = label.name, {label.part: drawn.points[0]}
    else:
        name, corners = _unique(label.name, ("shapes",), taken), _seen(drawn.points)
    thing = ("shapes", name)
    needed = {(*thing, "type"): "cuboid"} | ({(*thing, "stands_on"): label.plane} if label.plane else {})
    usual = {} if label.plane else {(*thing, "stands_on"): f"{_shape(scene, 'room', 'room')}.floor"}
    against = ((*thing, "centre"), (*thing, "size"))
    return [Target((*thing, "corners", corner), point, needed=needed, usual=usual, against=against)
            for corner, point in corners.items()]


def _seen(points: list[list[float]]) -> dict[str, list[float]]:
    """Those of a cuboid's eight corners that are on a face which the camera sees; the others are the program's guesses."""
    at = dict(zip(("front_left_top", "front_left_bottom", "front_right_top", "front_right_bottom",
                   "back_left_top", "back_left_bottom", "back_right_top", "back_right_bottom"), points))
    middle = {end: (at[f"{end}_left_top"][1] + at[f"{end}_right_top"][1]) / 2 for end in ("front", "back")}
    under = {end: (at[f"{end}_left_bottom"][1] + at[f"{end}_right_bottom"][1]) / 2 for end in ("front", "back")}
    faces = {"top": middle["back"] < middle["front"], "bottom": under["back"] > under["front"],
             "left": at["back_left_top"][0] < at["front_left_top"][0],
             "right": at["back_right_top"][0] > at["front_right_top"][0], "front": True}
    return {name: point for name, point in at.items() if any(faces.get(word, False) for word in name.split("_"))}


def _light(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "outline", "point", "line")
    name = _unique(label.name, ("lights",), taken)
    thing = ("lights", name)
    if drawn.form == "outline":
        needed, usual = _on(label, f"{_shape(scene, 'room', 'room')}.ceiling", (*thing, "outline"))
        return [Target((*thing, "outline", "pixels"), drawn.points, needed={(*thing, "type"): "area"} | needed, usual=usual,
                       against=((*thing, "outline", "points"),))]
    where = (*thing, "position")
    against = ((*where, "point"), (*where, "depth"))
    if drawn.form == "line":
        return [Target((*where, "pixel"), drawn.points[0], needed={(*thing, "type"): "point"}, against=against),
                Target((*where, "above"), drawn.points[-1])]
    if not label.plane:
        raise InputError(f"'{drawn.label}' does not say how far the bulb is", remedy=f"label it light:{label.name}@SHAPE.FACE,"
                         " or draw a line from the bulb to the spot on the ground right below it")
    return [Target((*where, "pixel"), drawn.points[0], needed={(*thing, "type"): "point", (*where, "on"): label.plane},
                   against=(*against, (*where, "above")))]


def _opening(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "outline")
    sun = _shape(scene, "sun", "sun")
    group = ("lights", sun, "openings")
    needed = {("lights", sun, "type"): "sun"}
    if label.kind == "patch":
        on = label.plane or f"{_shape(scene, 'room', 'room')}.floor"
        return [Target((*group, label.name, "patches"), {"on": on, "pixels": drawn.points}, more=True, needed=needed)]
    place = (*group, _unique(label.name, group, taken), "window")
    there = _at(scene, (*place, "on"))
    if not label.plane and there is None:
        raise InputError(f"'{drawn.label}' does not say in which wall it is", remedy=f"label it window:{label.name}@room.left")
    return [Target((*place, "pixels"), drawn.points, needed=needed | {(*place, "on"): label.plane or there},
                   against=((*place, "points"),))]


def _region(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "outline")
    name = label.name or label.kind
    surface = label.part or ("sky" if name.lower() == "sky" else "support" if name.lower() in GROUND else "vertical")
    if surface not in CLASSES:
        raise InputError(f"'{drawn.label}' is of no known class", remedy=f"use one of {', '.join(CLASSES)}")
    thing = ("depth", "regions", _unique(name, ("depth", "regions"), taken))
    stated = {(*thing, "class"): surface}
    return [Target((*thing, "pixels"), drawn.points, needed=stated if label.part else {}, usual={} if label.part else stated,
                   against=((*thing, "label"),))]


def _hole(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "outline")
    return [Target(("depth", "regions", label.name, "holes"), drawn.points, more=True)]


def _foot(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "line")
    thing = ("depth", "regions", label.name)
    return [Target((*thing, "foot"), drawn.points, against=((*thing, "depth"),))]


def _cast_shadow(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "line")
    if len(drawn.points) != 3:
        raise InputError(f"'{drawn.label}' has {len(drawn.points)} points", remedy="draw three: the foot of a thing, its tip,"
                         " and where the tip's shadow falls")
    return [Target(("sun_direction", "shadows"), dict(zip(("foot", "tip", "shadow"), drawn.points)), more=True,
                   needed={("sun_direction", "type"): "cast_shadow"})]


def _ground(label: Label, drawn: Drawn, scene: dict, taken: set) -> list[Target]:
    _form(drawn, "outline")
    value = {"pixels": drawn.points} | ({"on": label.plane} if label.plane else {})
    return [Target(("illumination", label.kind), value, more=True, needed={("illumination", "type"): "liu_xing"})]


def _at(value: Any, place: tuple) -> Any:
    for key in place:
        value = value.get(key) if isinstance(value, dict) else None
    return value


KINDS: dict[str, Callable[[Label, Drawn, dict, set], list[Target]]] = {
    "x": _line, "y": _line, "z": _line, "horizon": _horizon, "floor": _level, "ceiling": _level, "room": _room, "box": _box,
    "light": _light, "window": _opening, "patch": _opening, "region": _region, "sky": _region, "ground": _region,
    "hole": _hole, "foot": _foot, "shadow": _cast_shadow, "sunlit": _ground, "shadowed": _ground}
NAMED = {"box", "light", "window", "patch", "region", "hole", "foot"}
