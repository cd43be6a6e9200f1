"""COCO's JSON of instances: polygons, and masks that are not compressed, their categories being the labels."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.annotate.exchange.drawings import MAX_DRAWN, Drawings, size_of
from pipeline.annotate.exchange.labels import KINDS
from pipeline.annotate.exchange.pictures import chosen
from pipeline.errors import InputError

#: Masks with more pixels are left out.
MAX_MASK = 50_000_000


def is_coco(found: dict) -> bool:
    return all(isinstance(found.get(key), list) for key in ("images", "annotations", "categories"))


def read(found: dict, wanted: list[str]) -> Drawings:
    """The annotations of one picture, which is called as one of `wanted` where there are several.

    A category's supercategory is the label's kind where it is one: category tree of supercategory region is region:tree.
    """
    images = {one["id"]: one for one in found["images"] if isinstance(one, dict) and isinstance(one.get("id"), (int, str))}
    if not images:
        raise InputError("holds no picture", remedy="export it again with its pictures' list")
    key = chosen({key: str(one.get("file_name", "")) for key, one in images.items()}, wanted)
    drawings = Drawings("COCO", size_of(images[key].get("width"), images[key].get("height")))
    labels = {one["id"]: _label(one) for one in found["categories"]
              if isinstance(one, dict) and isinstance(one.get("id"), (int, str))}
    for number, one in enumerate(found["annotations"]):
        if not isinstance(one, dict) or one.get("image_id") != key:
            continue
        category = one.get("category_id")
        label = labels.get(category) if isinstance(category, (int, str)) else None
        said, shape = f"annotation {number}", one.get("segmentation")
        if isinstance(shape, dict):
            shape = _outlines(shape, drawings, f"{said} '{label}'")
        elif not shape:
            drawings.leave_out(f"{said} '{label}' has a frame only, and no outline")
            continue
        for part in shape if isinstance(shape, list) else [None]:
            flat = part if isinstance(part, list) and len(part) % 2 == 0 else None
            drawings.add(label, "outline", None if flat is None else [flat[n:n + 2] for n in range(0, len(flat), 2)], said)
        if len(drawings.left_out) >= MAX_DRAWN:
            break
    return drawings


def _label(category: dict) -> str | None:
    name, above = category.get("name"), category.get("supercategory")
    if isinstance(name, str) and isinstance(above, str) and above in KINDS and ":" not in name and name not in KINDS:
        return f"{above}:{name}"
    return name if isinstance(name, str) else None


def _outlines(mask: dict[str, Any], drawings: Drawings, said: str) -> list[list[float]]:
    """Outlines of a mask of run lengths, down the columns, beginning outside."""
    counts, size = mask.get("counts"), mask.get("size")
    if isinstance(counts, str):
        drawings.leave_out(f"{said}: a compressed mask (RLE); export it as a polygon")
        return []
    height, width = (size if isinstance(size, list) and len(size) == 2 else (0, 0))
    whole = all(isinstance(n, int) and not isinstance(n, bool) and 0 <= n <= MAX_MASK for n in
                [height, width, *(counts if isinstance(counts, list) else [-1])])
    if not whole or not 0 < height * width <= MAX_MASK or sum(counts) != height * width:
        drawings.leave_out(f"{said}: its run lengths do not fill a mask of that size, or it has more than {MAX_MASK} pixels")
        return []
    inside = np.repeat(np.arange(len(counts)) % 2, counts).reshape(width, height).T.astype(np.uint8)
    # pixels' centres lie half a pixel from the corner that coordinates start at; twice the size, so that edges are edges
    found, _ = cv2.findContours(np.pad(np.repeat(np.repeat(inside, 2, 0), 2, 1), 1), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [((one.reshape(-1, 2) - 0.5) / 2).ravel().tolist() for one in found if len(one) >= 3]
