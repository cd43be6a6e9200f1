"""A scene drawn anew in the page, by mouse and keys, as its hand-written file has it: from the photograph alone to a saved file."""

from __future__ import annotations

from typing import Any

from tests.annotate_person import Person

#: What a new scene begins with, and need not be typed.
USUAL = {"height": 1.6}


def draw_room(person: Person, hand: dict[str, Any]) -> None:
    """A scene indoors. Points a little outside the frame are within the view when it is zoomed out."""
    person.keys("-")
    camera, room = hand["camera"], hand["shapes"]["room"]
    for axis, lines in camera["lines"].items():
        person.add(f"line_{axis}", by=axis)
        for line in lines:
            person.click(*line)
        person.keys("Escape")
    person.saved(lambda data: all(len(data["camera"]["lines"][axis]) == len(lines) for axis, lines in camera["lines"].items()))
    values(person, "Camera", {"horizontal field of view": camera.get("horizontal_field_of_view"), "height": camera.get("height")})
    _corners(person, "room", "r", room["corners"])
    for name, line in room.get("edges", {}).items():
        person.add("room_edge", by="e")
        person.option("edge", name)
        person.click(*line)
        person.keys("Escape")
    person.choose("room")
    for name, value in room.get("known", {}).items():
        person.field(f"known {name}", str(value))
    if "behind" in room:
        person.field("behind", str(room["behind"]))
    for name, shape in hand["shapes"].items():
        if shape["type"] == "cuboid":
            _corners(person, "box", "b", shape["corners"])
            _call(person, name, ("shapes", name))
            if shape["stands_on"] != "room.floor":
                person.field("stands on", shape["stands_on"])
    for name, light in hand["lights"].items():
        if light["type"] == "area":
            outline = light["outline"]
            person.outline("window", outline["pixels"], outline["on"], by="w")
            _call(person, name, ("lights", name))
            person.field("sub lights", str(light.get("sub_lights", "")))
            person.field("offset", str(outline.get("offset", "")))
        elif light["type"] == "sun":
            for opening in light["openings"].values():
                person.outline("sun_window", opening["window"]["pixels"], opening["window"]["on"], by="s")
                for patch in opening["patches"]:
                    person.outline("sun_patch", patch["pixels"], patch["on"], by="p")
    _patches(person, hand)
    _fog(person, hand)


def draw_open_air(person: Person, hand: dict[str, Any]) -> None:
    """A scene in the open air: horizon, regions with their feet and depths, patches."""
    person.page.click('[data-do="setting"][data-value="open"]')
    person.saved(lambda data: "sky" in data["lights"])
    camera, depth = hand["camera"], hand["depth"]
    person.add("horizon", by="h")
    person.click(*camera["horizon"])
    values(person, "Camera", {"horizontal field of view": camera["horizontal_field_of_view"], "height": camera["height"]})
    keys = {"sky": "w", "support": "g", "vertical": "b"}
    kinds = {"sky": "sky_region", "support": "ground", "vertical": "upright"}
    for name, region in depth["regions"].items():
        person.outline(kinds[region["class"]], region["pixels"], by=keys[region["class"]])
        _call(person, name, ("depth", "regions", name))
        for key in ("depth", "near", "far"):
            if key in region:
                person.field(key, str(region[key]))
        if "foot" in region:
            person.outline("foot", region["foot"], by="f")
    if "sky_depth" in depth:
        values(person, "Regions", {"sky depth": depth["sky_depth"]})
    for name, light in hand["lights"].items():
        if light["type"] == "sunlight":
            person.page.click('[data-do="add"][data-kind="sunlight"]')
            person.saved(lambda data: any(one["type"] == "sunlight" for one in data["lights"].values()))
    _patches(person, hand)
    _fog(person, hand)


def values(person: Person, heading: str, wanted: dict[str, Any]) -> None:
    """Values of a whole section, by the heading of its list."""
    person.choose(heading)
    for label, value in wanted.items():
        if value is not None:
            person.field(label, str(value))


def _call(person: Person, name: str, place: tuple) -> None:
    """Gives what was just drawn its name."""
    person.page.wait_for_selector("#rename")
    person.page.fill("#rename", name)
    person.page.press("#rename", "Enter")

    def there(data) -> bool:
        for key in place:
            data = data[key]
        return True
    person.saved(there)


def _corners(person: Person, kind: str, key: str, corners: dict[str, Any]) -> None:
    person.add(kind, by=key)
    for count, (name, point) in enumerate(corners.items()):
        if count or kind == "room":
            person.until(f"() => !!document.querySelector('.corners [data-value=\"{name}\"]') || {'true' if not count else 'false'}")
            button = person.page.query_selector(f'.corners [data-value="{name}"]')
            if button is not None and "on" not in (button.get_attribute("class") or ""):
                button.click()
                person.until(f"() => document.querySelector('.corners [data-value=\"{name}\"]').classList.contains('on')")
        person.click(point)
        person.until(f"() => document.querySelector('.corners [data-value=\"{name}\"]')?.classList.contains('set')")
    person.keys("Escape")


def _patches(person: Person, hand: dict[str, Any]) -> None:
    illumination = hand.get("illumination", {})
    for key, kind in (("albedos", "known_colour"), ("shadowed", "shadowed_outline"), ("sunlit", "sunlit_outline")):
        for patch in illumination.get(key, []):
            person.outline(kind, patch["pixels"])
            for label, stated in (("albedo", patch.get("albedo")), ("sky visibility", patch.get("sky_visibility"))):
                if stated is not None:
                    person.field(label, ", ".join(map(str, stated)) if isinstance(stated, list) else str(stated))
    typed = {key: illumination[key] for key in ("default_albedo", "bounces", "albedo") if key in illumination}
    values(person, "Known colours and patches", {key.replace("_", " "): value for key, value in typed.items()})


def _fog(person: Person, hand: dict[str, Any]) -> None:
    person.page.click("#fog .heading")
    person.field("visibility", str(hand["fog"]["visibility"]))
    asymmetry = hand["fog"].get("phase_function", {}).get("asymmetry")
    if asymmetry is not None:
        person.field("asymmetry", str(asymmetry))
    person.saved(lambda data: data["fog"]["visibility"] == hand["fog"]["visibility"])
