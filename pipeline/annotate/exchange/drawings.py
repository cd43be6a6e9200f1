"""What all annotation programs draw: labelled outlines, lines, points and boxes in a photograph's pixels.

Coordinates are those of this project: u right, v down, from the photograph's top-left corner.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.errors import InputError

#: Annotations may bring the picture along, in base64.
MAX_BYTES = 200_000_000
#: Of what is read of it.
MAX_DRAWN = 5_000
MAX_POINTS = 200_000
FARTHEST = 1e6
FORMS = {"outline": 3, "line": 2, "point": 1, "cuboid": 8}


@dataclass(frozen=True)
class Drawn:
    """One drawing. form: outline (n, 2), line (n, 2), point (1, 2), or cuboid: eight corners [pixel].

    A cuboid's corners are front left top, left bottom, right top, right bottom, then the same of its back.
    """

    label: str
    form: str
    points: list[list[float]]


@dataclass
class Drawings:
    """All drawings of one picture. size: its width and height [pixel], where the file says it.

    left_out: what was not read, one line each.
    """

    source: str
    size: tuple[int, int] | None
    drawn: list[Drawn] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    points: int = 0

    def add(self, label: Any, form: str, points: Any, what: str) -> None:
        """Takes a drawing; what cannot be one is left out, `what` saying which it was."""
        said = f"{what} '{label}'" if isinstance(label, str) and label.strip() else what
        if not isinstance(label, str) or not label.strip():
            return self.leave_out(f"{said} has no label")
        if len(label) > 200 or not label.isprintable():
            return self.leave_out(f"{what} '{label[:40]}': its label is longer than 200 characters, or more than one line")
        if len(self.drawn) >= MAX_DRAWN:
            raise InputError(f"more than {MAX_DRAWN} drawings", remedy="leave out those of other pictures")
        found = pairs(points)
        if found is None:
            return self.leave_out(f"{said}: its points are no pairs of numbers within {FARTHEST:g} pixels")
        if form == "outline":
            found = [p for n, p in enumerate(found) if p != found[n - 1]] or found  # some repeat the first point
        self.points += len(found)
        if self.points > MAX_POINTS:
            raise InputError(f"more than {MAX_POINTS} points", remedy="leave out those of other pictures")
        if len(found) < FORMS[form]:
            return self.leave_out(f"{said}: {len(found)} points, fewer than the {FORMS[form]} of "
                                  + {"outline": "an outline", "line": "a line", "point": "a point", "cuboid": "a box"}[form])
        self.drawn.append(Drawn(label.strip(), form, found))

    def leave_out(self, why: str) -> None:
        if len(self.left_out) < MAX_DRAWN:  # what a stranger's file says goes to a terminal
            self.left_out.append("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in why[:300]))

    def scaled_to(self, width: int, height: int) -> tuple[Drawings, str | None]:
        """The drawings in a photograph of that size, and what is to be said about it.

        Raises InputError where the picture that was drawn on is of another shape.
        """
        if self.size is None:
            return self, "its file does not say how large the picture is: taken to be as large as the photograph"
        if self.size == (width, height):
            return self, None
        across, down = width / self.size[0], height / self.size[1]
        told = f"drawn on {self.size[0]} x {self.size[1]} pixels, the photograph has {width} x {height}"
        # a smaller copy's sides are rounded to whole pixels
        if abs(across / down - 1) > 1.01 / min(*self.size, width, height):
            raise InputError(told + ": another shape", remedy="draw on the photograph itself, upright and uncropped")
        drawn = [replace(one, points=[[u * across, v * down] for u, v in one.points]) for one in self.drawn]
        return replace(self, drawn=drawn, size=(width, height)), f"{told}: scaled by {across:.4g}"


def pairs(points: Any) -> list[list[float]] | None:
    """Points as [[u, v], ...], or None for anything else."""
    if not isinstance(points, list):
        return None
    found = []
    for point in points:
        if not isinstance(point, (list, tuple)) or len(point) != 2:
            return None
        if any(isinstance(x, bool) or not isinstance(x, (int, float)) for x in point):
            return None
        if not all(math.isfinite(x) and abs(x) <= FARTHEST for x in map(_number, point)):
            return None
        found.append([float(x) for x in point])
    return found


def _number(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def size_of(width: Any, height: Any) -> tuple[int, int] | None:
    """A picture's size by what a file says, or None."""
    whole = [int(x) if isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(_number(x)) and x == int(x)
             else 0 for x in (width, height)]
    return (whole[0], whole[1]) if min(whole) >= 1 and max(whole) <= FARTHEST else None


def content_of(path: Path) -> bytes:
    """The file's bytes. Raises InputError for what is not there, no plain file or too large."""
    try:
        if not path.is_file():
            problem = "is no plain file" if path.exists() else "no such file"
            raise InputError(problem, place=str(path), remedy="give a file of annotations")
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read ({getattr(error, 'strerror', None) or error})", place=str(path),
                         remedy="give a readable file") from None
    if len(content) > MAX_BYTES:
        raise InputError(f"more than {MAX_BYTES} bytes", place=str(path), remedy="save it without the picture in it")
    return content


def json_of(content: bytes) -> dict[str, Any]:
    """What a JSON file says. Raises InputError for anything but an object."""
    try:
        found = json.loads(content.decode("utf-8-sig"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise InputError(f"is no JSON ({' '.join(str(error).split())[:100]})", remedy="save it again") from None
    if not isinstance(found, dict):
        raise InputError("is no JSON object", remedy="save it again")
    return found
