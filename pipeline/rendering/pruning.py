"""Leaves out of a `.pov` text the macros that nothing in it calls: it holds what its scene needs, and no more."""

from __future__ import annotations

import re

_TOKEN = re.compile(r"#\s*(macro|ifdef|ifndef|if|for|while|switch|end)\b")
_MACRO = re.compile(r"^#\s*macro\s+([A-Za-z_]\w*)")
_NAME = re.compile(r"[A-Za-z_]\w*")


def without_unused_macros(text: str) -> str:
    """The text with empty lines for macros, and the comments right above them, that are called by nothing that stays.

    Lines keep their numbers, by which an error of POV-Ray is traced to its template. Only macros whose `#macro` and
    `#end` begin a line are looked at, which the project's includes and templates keep to.
    """
    lines = text.split("\n")
    code = [line.split("//")[0] for line in lines]
    macros = _macros(code)
    inside = {number for first, last in macros.values() for number in range(first, last + 1)}
    called = _names(code[number] for number in range(len(code)) if number not in inside)
    kept: set[str] = set()
    while more := [name for name in macros if name in called and name not in kept]:
        for name in more:
            kept.add(name)
            first, last = macros[name]
            called |= _names(code[first + 1:last + 1])
    for name, (first, last) in macros.items():
        if name not in kept:
            while first and lines[first - 1].startswith("//") and not lines[first - 1].startswith("// ----"):
                first -= 1
            lines[first:last + 1] = [""] * (last + 1 - first)
    return "\n".join(lines)


def _macros(code: list[str]) -> dict[str, tuple[int, int]]:
    """First and last line of each macro; one that is defined twice, or never ends, is left alone."""
    found: dict[str, tuple[int, int]] = {}
    twice, number = set(), 0
    while number < len(code):
        match = _MACRO.match(code[number])
        if match:
            depth, last = 0, number
            while last < len(code):
                for token in _TOKEN.findall(code[last]):
                    depth += -1 if token == "end" else 1
                if depth == 0:
                    break
                last += 1
            else:
                break
            if match.group(1) in found:
                twice.add(match.group(1))
            found[match.group(1)] = number, last
            number = last
        number += 1
    return {name: place for name, place in found.items() if name not in twice}


def _names(code) -> set[str]:
    return {name for line in code for name in _NAME.findall(line)}
