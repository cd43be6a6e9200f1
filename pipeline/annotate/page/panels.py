"""What stands beside the picture, as HTML: all of it by templates/annotate/panels.html, with every value escaped."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import jinja2

from pipeline.annotate.page import kinds
from pipeline.annotate.page.fog_sliders import STEPS, sliders
from pipeline.annotate.page.things import Place, Thing, at, group, listed
from pipeline.paths import TEMPLATES

GROUPS = ["Camera", "Room and boxes", "Regions", "Lights", "Sun's direction", "Known colours and patches"]
#: The sections of the scene file whose values stand below a group's heading.
SETTINGS = {"Camera": ("camera",), "Regions": ("depth",), "Known colours and patches": ("illumination",),
            "Sun's direction": ("sun_direction",)}
PANELS = ("banner", "status", "add", "things", "chosen", "hint", "fog", "problems", "job")
FACES = {"room": ("floor", "ceiling", "left", "right", "back", "front"), "cuboid": ("top", "bottom", "left", "right", "back", "front"),
         "polygon": ("face",), "mesh": ("surface",)}


@cache
def _macros() -> Any:
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES / "annotate"), autoescape=True,
                                     undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["place"] = lambda place: json.dumps(list(place))
    return environment.get_template("panels.html").module


def render(page, every: list[Thing], chosen: Thing | None) -> dict[str, str]:
    """HTML of each panel, by the id of its element."""
    desk, data = page.desk, page.data
    shown = {
        "writes": page.may_write, "said": page.said, "fault": desk.fault, "conflict": desk.conflict, "desk": desk, "data": data,
        "page": page, "chosen": chosen, "owner": page.owner(), "adding": page.adding, "draft": len(page.draft), "corner": page.corner,
        "adds": [(name, [(kind, kinds.fits(kind, page.chosen, data)) for kind in kinds.offered(data, page.setting) if kind.group == name])
                 for name in GROUPS],
        "settled": kinds.settled(data), "setting": page.setting, "groups": grouped(every, data), "troubled": troubled(every, desk.problems), "problems": desk.problems,
        "fields": page.fields() if page.may_write else [], "sliders": sliders(data), "steps": STEPS, "hint": hint(page, chosen),
        "planes": planes_of(page), "edges": kinds.ROOM_EDGES, "free_edge": kinds.free_edge(data), "job": desk.render,
        "paintable": page.paintable and page.may_write, "brush": page.painting, "facts": facts(desk.shown), "scene": desk.document.path.parent.name,
    }
    return {name: str(getattr(_macros(), name)(shown)) for name in PANELS}


def grouped(every: list[Thing], data: dict) -> list[tuple[str, Place | None, list[Thing]]]:
    """Headings, the section whose values stand below each, and the things."""
    wanted = []
    for name in GROUPS:
        members = [one for one in every if one.group == name]
        settings = SETTINGS.get(name)
        if settings is not None and at(data, settings) is None:
            settings = None
        if members or settings is not None:
            wanted.append((name, settings, members))
    return wanted


def planes(data: dict) -> list[str]:
    """What an outline may lie on, by the shapes that are there."""
    found = [f"{name}.{face}" for name, shape in group(data, "shapes").items() for face in FACES.get(at(shape, ("type",)), ())]
    if kinds.is_open(data):
        found += ["ground", *(name for name, region in group(data, "depth", "regions").items() if at(region, ("class",)) == "vertical")]
    return found


def planes_of(page) -> list[str]:
    known = getattr(page.desk.preview, "planes", None)
    return (known() if known is not None else []) or planes(page.data)


def troubled(every: list[Thing], problems) -> set[Place]:
    """Places of the things that a problem is about."""
    found = set()
    for problem in problems:
        one = thing_of(problem.place, every)
        if one is not None:
            found.add(one.place)
    return found


def thing_of(place: Place, every: list[Thing]) -> Thing | None:
    """The thing that a problem's place means: the one that shares most of the way to it, at least below its section."""
    best, most = None, 1
    for one in every:
        shared = 0
        for a, b in zip(one.place, place):
            if a != b:
                break
            shared += 1
        if shared > most or shared == most and best is not None and len(one.place) < len(best.place):
            if shared >= min(len(one.owner), len(place)):
                best, most = one, shared
    return best


def facts(shown) -> list[tuple[str, str]]:
    """Horizon and focal length, as numbers."""
    if shown is None:
        return []
    found = []
    if getattr(shown, "focal_length", None):
        found.append(("focal length", f"{shown.focal_length:.0f} px"))
    if getattr(shown, "field_of_view", None):
        found.append(("field of view", f"{shown.field_of_view:.1f}°"))
    return found


def hint(page, chosen: Thing | None) -> str:
    """What a click or key does now."""
    if not page.may_write:
        return "Only looking: another tab edits this scene."
    if page.painting != "off":
        return (f"{'Erase' if page.painting == 'erase' else 'Paint'} over it with the button held; [ and ] change the brush, Q leaves"
                " it. The wheel zooms, arrow keys move the view.")
    kind = page.adding
    if kind is not None:
        ends = {"outline": " Enter, double click or the first point again ends it.", "path": " Enter or double click ends it."}
        return kind.hint + ends.get(kind.form, "")
    if page.corner is not None:
        return f"Click {page.corner.replace('_', ' ')}. Choose another corner on the right; Esc ends."
    if chosen is None:
        return "Choose something to change it, or add something. Drag moves the view, the wheel zooms."
    if chosen.form in ("outline", "path"):
        return "Drag points; double click on an edge adds one; Delete removes the chosen one."
    if chosen.form == "nothing":
        return "Its values are on the right."
    return "Drag points, or move the chosen one with the arrow keys; Delete removes."


def empty(data: dict) -> bool:
    """Whether nothing is annotated yet."""
    return not group(data, "shapes") and not listed(data, "camera", "lines", "x") and not group(data, "depth", "regions")
