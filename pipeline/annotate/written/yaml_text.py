"""Values as a person would write them into a scene file: points in a row, named things below one another."""

from __future__ import annotations

import io
import math
import re
from functools import lru_cache
from typing import Any, Callable

from ruamel.yaml import YAML

from pipeline.errors import InputError
from pipeline.scene.load import FIXED, MAX_DEPTH

#: Columns of a line, as in the scenes that come along.
WIDTH = 120
#: Digits behind the point of a pixel's coordinate: nobody clicks more exactly.
PIXEL_DIGITS = 2
#: Significant digits of every other number.
DIGITS = 6
PLAIN_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_/-]*(\.[A-Za-z0-9_/-]+)*")


def plain(value: Any, depth: int = 0) -> Any:
    """The value as dict, list, number, text, True, False or None, also from tuples and numpy's own types.

    Raises InputError for what no scene file can hold. depth: of groups and lists round it.
    """
    if depth >= MAX_DEPTH:
        raise InputError(f"values are nested more than {MAX_DEPTH} groups or lists deep", remedy=f"write them less deeply; {FIXED}")
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise InputError(f"{key!r} as a name", remedy="name values by words")
        return {str(key): plain(one, depth + 1) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one, depth + 1) for one in value]
    if hasattr(value, "tolist"):  # numpy's
        return plain(value.tolist(), depth)
    if value is None or isinstance(value, (bool, int)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f"{value} is no finite number", remedy="give a number, or leave it out")
        return value
    if isinstance(value, str):
        return str(value)
    raise InputError(f"a value of type {type(value).__name__}", remedy="give numbers, words, lists and groups")


def readable(value: Any, where: tuple, unit_of: Callable[[tuple], str], kept: set[float]) -> Any:
    """The value with as many digits as are worth reading: 0.01 of a pixel, six digits of everything else.

    kept: numbers that stay as they are, for a person wrote them.
    """
    if isinstance(value, dict):
        return {key: readable(one, (*where, key), unit_of, kept) for key, one in value.items()}
    if isinstance(value, list):
        if not any(isinstance(one, (dict, list)) or isinstance(one, float) and one not in kept for one in value):
            return value
        return [readable(one, (*where, index), unit_of, kept) for index, one in enumerate(value)]
    if not isinstance(value, float) or value in kept:
        return value
    unit = unit_of(where)
    short = round(value, PIXEL_DIGITS) if unit == "pixel" else float(f"{value:.{DIGITS}g}")
    return int(short) if short.is_integer() and abs(short) < 1e15 else short


def count(value: Any) -> int:
    """How many values it holds, names among them, as a file's reader counts them."""
    if isinstance(value, dict):
        return 1 + sum(1 + count(one) for one in value.values())
    return 1 + (sum(map(count, value)) if isinstance(value, list) else 0)


def numbers(value: Any) -> set[float]:
    """All numbers in it."""
    if isinstance(value, (dict, list)):
        return set().union(*map(numbers, value.values() if isinstance(value, dict) else value))
    return {value} if isinstance(value, (int, float)) and not isinstance(value, bool) else set()


def flow(value: Any, column: int, width: int = WIDTH) -> str:
    """The value in braces and brackets, from `column` on; what would pass `width` goes on below its own beginning."""
    if isinstance(value, (dict, list)):
        opening, closing = "{}" if isinstance(value, dict) else "[]"
        text, at = opening, column + 1
        for index, item in enumerate(value.items() if isinstance(value, dict) else value):
            key = f"{word(item[0])}: " if isinstance(value, dict) else ""
            one = item[1] if isinstance(value, dict) else item
            short = key + flow(one, 0, 10**9)
            if index:
                fits = at + 2 + len(short) + 2 <= width
                text += ", " if fits else ",\n" + " " * (column + 1)
                at = at + 2 if fits else column + 1
            written = short if at + len(short) + 2 <= width else key + flow(one, at + len(key), width)
            text += written
            at = at + len(written) if "\n" not in written else len(written) - written.rfind("\n") - 1
        return text + closing
    return scalar(value)


def scalar(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    return word(value) if isinstance(value, str) else repr(value)


@lru_cache(maxsize=10_000)
def word(text: str) -> str:
    """Text in the quotes that it needs anywhere in a scene file."""
    if PLAIN_WORD.fullmatch(text) and text.lower() not in ("null", "true", "false"):
        return text
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style, yaml.width, yaml.allow_unicode = True, 10**9, True
    written = io.StringIO()
    yaml.dump([text], written)
    return written.getvalue().strip()[1:-1]


def wants_lines(value: Any) -> bool:
    """Whether the value is written on lines of its own: a group, a list of groups, a list of lists of points."""
    if isinstance(value, dict):
        return bool(value)
    return isinstance(value, list) and (_depth(value) > 2 or any(isinstance(one, dict) for one in value))


def entry(key: str, value: Any, indent: int, in_braces: bool = False) -> str:
    """`key: value` on lines of its own, each with its end, indented by `indent`; a group in braces if it fits so."""
    head = " " * indent + word(key) + ":"
    if in_braces and isinstance(value, dict):
        short = f"{head} {flow(value, 0, 10**9)}"
        if len(short) <= WIDTH:
            return short + "\n"
    if wants_lines(value):
        return f"{head}\n{block(value, indent + 2)}"
    return f"{head} {flow(value, len(head) + 1)}\n"


def block(value: dict | list, indent: int) -> str:
    """A group's or a list's lines."""
    if isinstance(value, dict):
        return "".join(entry(key, one, indent) for key, one in value.items())
    return "".join(item(one, indent) for one in value)


def item(value: Any, indent: int) -> str:
    """`- value`, on lines of its own."""
    head = " " * indent + "- "
    short = head + flow(value, 0, 10**9)
    if len(short) <= WIDTH or not isinstance(value, dict) or not value:
        return head + flow(value, len(head)) + "\n"
    return head + block(value, indent + 2).lstrip(" ")


def _depth(value: Any) -> int:
    return 1 + max(map(_depth, value), default=0) if isinstance(value, list) else 0
