"""labelme's JSON: polygons, rectangles, lines and points, one file a picture."""

from __future__ import annotations

from typing import Any

from pipeline.annotate.exchange.drawings import Drawings, size_of
from pipeline.errors import InputError

FORMS = {"polygon": "outline", "rectangle": "outline", "line": "line", "linestrip": "line", "point": "point"}
#: labelme reads files of its own major version; what is written here has been in it since 4.
VERSION = "5.5.0"


def is_labelme(found: dict) -> bool:
    return isinstance(found.get("shapes"), list) and "imagePath" in found


def read(found: dict) -> Drawings:
    drawings = Drawings("labelme", size_of(found.get("imageWidth"), found.get("imageHeight")))
    for number, shape in enumerate(found["shapes"]):
        if not isinstance(shape, dict):
            drawings.leave_out(f"shape {number} is no shape")
            continue
        kind, label, points = shape.get("shape_type", "polygon"), shape.get("label"), shape.get("points")
        form = FORMS.get(kind) if isinstance(kind, str) else None
        if form is None:
            drawings.leave_out(f"{str(kind)[:40]} '{str(label)[:60]}': only {', '.join(FORMS)} are read")
            continue
        if kind == "rectangle" and isinstance(points, list) and len(points) == 2 and all(
                isinstance(p, list) and len(p) == 2 for p in points):
            (left, top), (right, bottom) = points
            points = [[left, top], [right, top], [right, bottom], [left, bottom]]
        drawings.add(label, form, points, kind)
    return drawings


def written(drawings: Drawings, image: str) -> dict[str, Any]:
    """A labelme file of the drawings; image: the picture's path from where the file will lie."""
    if drawings.size is None:
        raise InputError("the photograph's size is not known", remedy="put the photograph into the scene's folder")
    kinds = {"outline": "polygon", "point": "point"}
    return {
        "version": VERSION, "flags": {},
        "shapes": [{"label": one.label, "points": one.points, "group_id": None, "description": "",
                    "shape_type": kinds.get(one.form) or ("line" if len(one.points) == 2 else "linestrip"),
                    "flags": {}, "mask": None} for one in drawings.drawn],
        "imagePath": image, "imageData": None, "imageHeight": drawings.size[1], "imageWidth": drawings.size[0],
    }
