"""A scene's annotations as a file for another program."""

from __future__ import annotations

from typing import Any, Iterator

from pipeline.annotate.exchange.drawings import Drawings, Drawn, pairs


def drawings_of(scene: dict[str, Any], size: tuple[int, int] | None) -> Drawings:
    """What a scene marks in the photograph's pixels, labelled so that an import gives the same again.

    scene: the file's values, which need not be a whole scene. What is stated in metres is left out, a line each.
    """
    found = Drawings("scene", size)
    for form, label, points in _all(scene):
        if points is None:
            found.leave_out(f"{label.removesuffix('@')} is no outline, line or point in the photograph")
            continue
        if label.startswith(("patch:", "light:", "window:")) and label.endswith("@"):
            found.leave_out(f"{label[:-1]} does not say on which plane it lies")
            continue
        as_pairs = pairs(points)
        if as_pairs is None:
            found.leave_out(f"{label}: its points are no pairs of numbers")
        else:
            found.drawn.append(Drawn(label, form, as_pairs))
    return found


def _all(scene: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """(form, label, points) of everything."""
    camera = _group(scene, "camera")
    for axis, lines in _group(camera, "lines").items():
        for line in lines if isinstance(lines, list) else []:
            yield "line", axis, line
    if camera.get("horizon") is not None:
        yield "line", "horizon", camera["horizon"]
    for name, shape in _groups(scene, "shapes"):
        if shape.get("type") == "room":
            yield from (("point", f"room:{corner}", [at]) for corner, at in _group(shape, "corners").items())
            yield from (("line", f"room:{edge}", line) for edge, line in _group(shape, "edges").items())
        elif shape.get("type") == "cuboid" and shape.get("corners"):
            plane = _plane(shape.get("stands_on"))
            yield from (("point", f"box:{name}:{corner}{plane}", [at]) for corner, at in _group(shape, "corners").items())
        else:
            yield "outline", f"shapes.{name}", None
    for name, light in _groups(scene, "lights"):
        yield from _light(name, light)
    for name, region in _groups(_group(scene, "depth"), "regions"):
        yield "outline", f"region:{name}:{region.get('class', 'vertical')}", region.get("pixels")
        yield from (("outline", f"hole:{name}", hole) for hole in _list(region.get("holes")))
        if region.get("foot") is not None:
            yield "line", f"foot:{name}", region["foot"]
    for shadow in _list(_group(scene, "sun_direction").get("shadows")):
        if isinstance(shadow, dict):
            yield "line", "shadow", [shadow.get(key) for key in ("foot", "tip", "shadow")]
    for kind in ("sunlit", "shadowed"):
        for patch in _list(_group(scene, "illumination").get(kind)):
            if isinstance(patch, dict):
                yield "outline", kind + _plane(patch.get("on"), ""), patch.get("pixels")


def _light(name: str, light: dict) -> Iterator[tuple[str, str, Any]]:
    if "outline" in light:
        outline = _group(light, "outline")
        yield "outline", f"light:{name}{_plane(outline.get('on'))}", outline.get("pixels")
    for opening, parts in _groups(light, "openings"):
        window = _group(parts, "window")
        yield "outline", f"window:{opening}{_plane(window.get('on'))}", window.get("pixels")
        for patch in _list(parts.get("patches")):
            if isinstance(patch, dict):
                yield "outline", f"patch:{opening}{_plane(patch.get('on'))}", patch.get("pixels")
    position = _group(light, "position")
    if light.get("type") == "point" and "above" in position and "on" not in position:
        yield "line", f"light:{name}", [position.get("pixel"), position["above"]]
    elif light.get("type") == "point" and "on" in position:
        yield "point", f"light:{name}{_plane(position['on'])}", [position.get("pixel")]
    elif "position" in light or "positions" in light:
        yield "point", f"lights.{name}", None


def _plane(on: Any, missing: str = "@") -> str:
    return f"@{on}" if isinstance(on, str) else missing


def _group(value: Any, key: str) -> dict:
    found = value.get(key) if isinstance(value, dict) else None
    return found if isinstance(found, dict) else {}


def _groups(value: Any, key: str) -> list[tuple[str, dict]]:
    return [(name, one) for name, one in _group(value, key).items() if isinstance(one, dict)]


def _list(value: Any) -> list:
    return value if isinstance(value, list) else []
