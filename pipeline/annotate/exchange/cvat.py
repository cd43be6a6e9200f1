"""CVAT's XML "for images", version 1.1: polygons, boxes, polylines, points and cuboids."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

from pipeline.annotate.exchange.drawings import Drawings, size_of
from pipeline.annotate.exchange.pictures import chosen
from pipeline.errors import InputError

MAX_ELEMENTS = 500_000
MAX_DEPTH = 20
#: A cuboid's corners in `Drawn`'s order, except which side of the back is left: CVAT's names go round the box.
CORNERS = ("tl1", "bl1", "tr1", "br1", "tl2", "bl2", "tr2", "br2")
_AGAIN = "export the task again as 'CVAT for images 1.1', and give its annotations.xml"


@dataclass
class _Reader:
    """Takes the pictures and what is drawn on them while the file is read."""

    pictures: list[dict[str, str]] = field(default_factory=list)
    drawn: list[list[tuple[str, dict[str, str]]]] = field(default_factory=list)
    depth: int = 0
    elements: int = 0
    root: str = ""
    video: bool = False

    def begins(self, name: str, attributes: dict[str, str]) -> None:
        self.elements, self.depth = self.elements + 1, self.depth + 1
        if self.elements > MAX_ELEMENTS or self.depth > MAX_DEPTH:
            raise InputError(f"more than {MAX_ELEMENTS} elements, or nested more than {MAX_DEPTH} deep", remedy=_AGAIN)
        if self.depth == 1:
            self.root = name
        elif self.depth == 2 and name == "image":
            self.pictures.append(attributes)
            self.drawn.append([])
        elif self.depth == 2 and name == "track":
            self.video = True
        elif self.depth == 3 and self.pictures and "label" in attributes:
            self.drawn[-1].append((name, attributes))

    def ends(self, name: str) -> None:
        self.depth -= 1

    def refuses(self, *_) -> None:
        raise InputError("declares a document type or entities, which CVAT never does", remedy=_AGAIN)


def read(content: bytes, wanted: list[str]) -> Drawings:
    """The annotations of one picture, which is called as one of `wanted` where there are several.

    Raises InputError for what is no such file; document types and entities are refused before they are expanded.
    """
    reader, parser = _Reader(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = reader.begins, reader.ends
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = parser.ExternalEntityRefHandler = reader.refuses
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"is no XML ({error})", remedy=_AGAIN) from None
    if reader.root != "annotations" or not reader.pictures:
        what = "a video's tracks" if reader.video else "no picture's annotations"
        raise InputError(f"holds {what}", remedy=_AGAIN)
    number = chosen({n: one.get("name", "") for n, one in enumerate(reader.pictures)}, wanted)
    picture = reader.pictures[number]
    drawings = Drawings("CVAT", size_of(_number(picture.get("width")), _number(picture.get("height"))))
    for kind, attributes in reader.drawn[number]:
        _add(drawings, kind, attributes)
    return drawings


def _add(drawings: Drawings, kind: str, attributes: dict[str, str]) -> None:
    label = attributes["label"]
    if kind in ("polygon", "polyline", "points"):
        points = [[_number(x) for x in pair.split(",")] for pair in attributes.get("points", "").split(";")]
        for part in ([[point] for point in points] if kind == "points" else [points]):
            drawings.add(label, {"polygon": "outline", "polyline": "line", "points": "point"}[kind], part, kind)
    elif kind == "box":
        if _number(attributes.get("rotation", "0")):
            drawings.leave_out(f"box '{label}' is turned; draw a polygon instead")
            return
        left, top, right, bottom = (_number(attributes.get(key)) for key in ("xtl", "ytl", "xbr", "ybr"))
        drawings.add(label, "outline", [[left, top], [right, top], [right, bottom], [left, bottom]], kind)
    elif kind == "cuboid":
        corners = [[_number(attributes.get("x" + key)), _number(attributes.get("y" + key))] for key in CORNERS]
        if None not in sum(corners, []) and (corners[4][0] - corners[6][0]) * (corners[0][0] - corners[2][0]) < 0:
            # a box's back is not mirrored in the photograph, whatever its corners are called
            corners = corners[:4] + corners[6:] + corners[4:6]
        drawings.add(label, "cuboid", corners, kind)
    else:
        drawings.leave_out(f"{kind} '{label}': only polygon, box, polyline, points and cuboid are read")


def _number(text: str | None) -> float | None:
    try:
        return float(text)
    except (TypeError, ValueError):
        return None
