"""A file of annotations into a scene document, as one step that can be undone."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import shapely

from pipeline.annotate.written.document import SceneDocument
from pipeline.annotate.exchange import coco, cvat, fspy_files, labelme
from pipeline.annotate.exchange.drawings import Drawings, content_of, json_of
from pipeline.annotate.exchange.labels import Target, targets
from pipeline.annotate.written.yaml_text import PIXEL_DIGITS
from pipeline.errors import InputError

ACCEPTED = "an fSpy project (.fspy) or its exported JSON, labelme's or COCO's JSON, or CVAT's XML for images 1.1"
#: What tells how a camera is turned; a field of view and a height are what a new scene begins with.
DRAWN = ("lines", "fspy", "horizon", "position", "look_at", "yaw", "pitch", "roll", "principal_point", "known_length")
#: Corners that an outline of the scene file may have, of a region and of everything else.
MOST_CORNERS = {"regions": 2000, "": 200}


def import_file(document: SceneDocument, path: Path, size: tuple[int, int] | None, *, replace: bool = False,
                image: str = "") -> list[str]:
    """Writes what a file of annotations holds into the document, as one step, and returns what is to be said, a line each.

    size: of the photograph, upright [pixel]; None where it is not there to be looked at, and sizes go unchecked.
    replace: whether things that are there may be replaced; otherwise nothing is changed where one is. image: name of the
    picture in a file of several. Raises InputError for what is no such file, for one of another picture, and where nothing
    of it can be used; the document stays as it was.
    """
    try:
        found = read_file(content_of(path), _names(document, image))
        if isinstance(found, fspy_files.Matched):
            return _camera(document, found, size, replace)
        said = [f"left out: {line}" for line in found.left_out]
        if size is not None:
            found, told = found.scaled_to(*size)
            said += [f"note: {told}"] if told else []
        return [*_drawings(document, found, replace), *said]
    except InputError as error:
        raise error.at(str(path)) from None


def read_file(content: bytes, wanted: list[str]) -> Drawings | fspy_files.Matched:
    """What the file holds, by what it looks like; wanted: names of the photograph. Raises InputError for anything else."""
    if fspy_files.is_project(content):
        return fspy_files.read_project(content)
    start = content[:1000].lstrip(b"\xef\xbb\xbf \t\r\n")
    if start.startswith((b"<", b"\xff\xfe<", b"\xfe\xff\0<")):
        return cvat.read(content, wanted)
    if not start.startswith(b"{"):
        what = "a zip archive: unpack it and give the file of annotations in it" if start.startswith(b"PK\3\4") else ACCEPTED
        raise InputError("is no file of annotations that is known here", remedy=f"give {ACCEPTED}" if what is ACCEPTED else what)
    found = json_of(content)
    if labelme.is_labelme(found):
        return labelme.read(found)
    if coco.is_coco(found):
        return coco.read(found, wanted)
    if fspy_files.is_export(found):
        return fspy_files.read_export(found)
    raise InputError("is no file of annotations that is known here", remedy=f"give {ACCEPTED}")


def _names(document: SceneDocument, image: str) -> list[str]:
    file = document.get(("photograph", "file"))
    return [image] if image else [Path(file).name if isinstance(file, str) else "", document.path.parent.name]


# ---- drawings
def _drawings(document: SceneDocument, drawings: Drawings, replace: bool) -> list[str]:
    scene = document.data
    wanted = copy.deepcopy(scene)
    taken: set[tuple] = set()
    written: set[tuple] = set()
    places: set[tuple] = set()
    told, left_out, there = [], [], []
    for drawn in drawings.drawn:
        try:
            found = targets(drawn, scene, taken)
            twice = next((t.place for t in found if not t.more and t.place in written), None)
            if twice:
                raise InputError(f"'{drawn.label}' is drawn twice", remedy="keep one of them")
        except InputError as error:
            left_out.append(f"left out: {error}")
            continue
        for target in found:
            there += _written(wanted, scene, target, written, told)
            places.add(target.place)
        told.append(f"imported: {_dotted(found[0].place[:_thing(found[0].place)])} from {drawn.form} '{drawn.label}'")
    if not written:
        first = f" ({left_out[0].removeprefix('left out: ')})" if left_out else ""
        raise InputError(f"nothing in it can be used{first}", remedy="label drawings by what they are in the scene, such as"
                         " light:lamp, region:trees, box:table; see the README")
    there += [place for place in sorted(places) if _at(scene, place) not in (None, _at(wanted, place))]
    there = list(dict.fromkeys(there))
    if there and not replace:
        raise InputError(f"{', '.join(map(_dotted, there[:5]))}{', ...' if len(there) > 5 else ''}:"
                         f" {'is' if len(there) == 1 else 'are'} in the scene already",
                         remedy="allow it to be replaced (replace=yes), or label the drawing with another name")
    document.set((), wanted)
    return [*told, *(f"replaced: {_dotted(place)}" for place in there), *left_out]


def _thing(place: tuple) -> int:
    """How many keys name the thing that a place is in."""
    return {"depth": 3, "camera": 3, "illumination": 2, "sun_direction": 2}.get(place[0], 4 if "openings" in place else 2)


def _written(wanted: dict, scene: dict, target: Target, written: set[tuple], told: list[str]) -> list[tuple]:
    """Writes a target into `wanted`; what had to go or was another there, by place."""
    there = []
    for place, value in target.needed.items():
        stands = _at(wanted, place)
        if stands is not None and stands != value:
            kind = place[-1] == "type"
            if place not in written:
                there.append(place[:-1] if kind else place)
            if kind:  # of another kind, nothing else of it fits
                _put(wanted, place[:-1], {})
        _put(wanted, place, value)
        written.add(place)
    for place in target.against:
        if _at(wanted, place) is not None:
            there.append(place)
            _drop(wanted, place)
    for place, value in target.usual.items():
        if _at(wanted, place) is None:
            _put(wanted, place, value)
    value, old = _rounded(_fewer(target.place, target.value, told)), _at(scene, target.place)
    if target.more:
        before = _at(wanted, target.place) if target.place in written else []
        value = [*before, _with_rest(value, old)]
    elif _rounded(old) == value:
        value = old
    _put(wanted, target.place, value)
    written.add(target.place)
    return there


def _with_rest(value: Any, old: Any) -> Any:
    """An entry of a list with all else that stands at the one there which is drawn alike, such as its albedo."""
    for one in old if isinstance(old, list) else []:
        if _rounded(one) == value:
            return one
        if isinstance(one, dict) and isinstance(value, dict) and "pixels" in value and _rounded(one.get("pixels")) == value["pixels"]:
            return {**one, **value}
    return value


def _rounded(value: Any) -> Any:
    """Coordinates as the scene file has them."""
    if isinstance(value, dict):
        return {key: _rounded(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return round(value, PIXEL_DIGITS) if isinstance(value, float) else value


def _fewer(place: tuple, value: Any, told: list[str]) -> Any:
    """An outline with no more corners than the scene file may hold."""
    if isinstance(value, dict) and "pixels" in value:
        return {**value, "pixels": _fewer((*place, "pixels"), value["pixels"], told)}
    most = MOST_CORNERS["regions" if "regions" in place else ""]
    if not isinstance(value, list) or len(value) <= most or not isinstance(value[0], list):
        return value
    polygon, within, points = shapely.LinearRing(value), 0.25, value
    while len(points) > most:
        within *= 2
        points = [list(p) for p in polygon.simplify(within).coords[:-1]]
    told.append(f"note: {_dotted(place)} has {len(points)} corners instead of {len(value)}, within {within:g} pixels")
    return points


# ---- a camera
def _camera(document: SceneDocument, found: fspy_files.Matched, size: tuple[int, int] | None, replace: bool) -> list[str]:
    picture = Drawings("fSpy", (found.camera.width, found.camera.height))
    told = picture.scaled_to(*size)[1] if size else None
    new = fspy_files.description(found, size[0] / found.camera.width if size else 1.0)
    old = document.get(("camera",), {})
    old = old if isinstance(old, dict) else {}
    drawn = [key for key in DRAWN if old.get(key) is not None]
    if drawn and not replace:
        raise InputError(f"camera.{', camera.'.join(drawn)}: the scene has a camera already",
                         remedy="allow it to be replaced (replace=yes)")
    gone = [key for key, value in old.items() if value is not None and new.get(key) != value]
    document.set(("camera",), new)
    way = "by its lines along " + ", ".join(new["lines"]) if "lines" in new else "by its angles"
    return [f"imported: camera {way}", *(f"replaced: camera.{key}" for key in gone),
            *([] if found.metres else [f"note: camera.height = {document.get(('camera', 'height')):g} is in fSpy's own unit:"
                                       " check that it is in metres"]),
            *([f"note: {told}"] if told else [])]


# ---- places
def _at(value: Any, place: tuple) -> Any:
    for key in place:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _put(values: dict, place: tuple, value: Any) -> None:
    for key in place[:-1]:
        if not isinstance(values.get(key), dict):
            values[key] = {}
        values = values[key]
    values[place[-1]] = value


def _drop(values: dict, place: tuple) -> None:
    for key in place[:-1]:
        values = values[key]
    del values[place[-1]]


def _dotted(place: tuple) -> str:
    return ".".join(map(str, place))
