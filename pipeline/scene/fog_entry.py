"""A named fog written into a person's scene file, of which nothing else changes."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.paths import RESERVED
from pipeline.scene.load import SceneText, checked, parsed, read_scene

#: By this comment an entry is known as ours, which may be replaced.
OURS = "# by make match"
FOG_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*(\.[A-Za-z0-9_-]+)*")


def refuse_taken(path: Path, name: str) -> None:
    """Raises InputError where a fog of this name may not be written into the scene file."""
    if not FOG_NAME.fullmatch(name) or len(name) > 40 or name in RESERVED:
        raise InputError(f"to={name} is no fog's name", place="command line",
                         remedy="use letters, digits, '_', '-' and single dots, beginning with a letter, 40 at most, and none of "
                                + ", ".join(sorted(RESERVED)))
    text = read_scene(path)
    checked(text, {}, None)
    _with_entry(text, _raw(path), name, "{type: homogeneous, visibility: 1}", "")


def write_fog(path: Path, name: str, fog: dict[str, Any], remark: str) -> int:
    """Writes `fogs: name: fog` with a comment into the scene file, and returns its line.

    An entry of this name is replaced if it was written like that. The new file is read, and must hold what the old one did,
    before it takes the old one's place. Raises InputError, and leaves the file as it is, for whatever is in the way.
    """
    text, raw = read_scene(path), _raw(path)
    new = _with_entry(text, raw, name, _flow(fog), remark)
    wanted = {**text.values, "fogs": {**(text.values.get("fogs") or {}), name: fog}}
    try:
        read = parsed(path, new)
    except InputError:
        read = None
    if read is None or read.values != wanted:
        raise _refusal(text, name, _flow(fog))
    checked(parsed(path, new), {}, name)
    target = path.resolve()  # a link stays one
    with replacing(target) as partial:
        partial.write_bytes(new.encode("utf-8"))
        shutil.copymode(target, partial)
    return read.lines[("fogs", name)]


def _raw(path: Path) -> str:
    """With the line ends that the file has."""
    return path.read_bytes().decode("utf-8")


def _with_entry(text: SceneText, raw: str, name: str, flow: str, remark: str) -> str:
    end = "\r\n" if "\r\n" in raw else "\n"
    entry = f"{name}: {flow}"
    comment = f"   {OURS} {' '.join(''.join(c if c.isprintable() else ' ' for c in remark).split())}".rstrip()
    lines = raw.split("\n")  # one of CRLF keeps its CR
    root = YAML(typ="safe", pure=True).compose(raw.replace("\r\n", "\n"))
    node = next((value for key, value in root.value if key.value == "fogs"), None)
    if root.flow_style:
        raise _refusal(text, name, flow)
    if node is None:
        before = raw if raw.endswith("\n") else raw + end
        return f"{before}{end}fogs:{end}  {entry}{comment}{end}"
    if not isinstance(node, MappingNode):
        raise _refusal(text, name, flow)
    for key, value in node.value:
        if key.value == name:
            line = lines[key.start_mark.line]
            if node.flow_style or OURS not in line[value.end_mark.column:] or _last_line(value) != key.start_mark.line:
                raise InputError(f"a fog is called '{name}' already, and not by an earlier match",
                                 place=text.place(("fogs", name)), remedy="give another name: to=NAME")
            lines[key.start_mark.line] = line[:key.start_mark.column] + entry + comment + "\r" * line.endswith("\r")
            return "\n".join(lines)
    if not node.flow_style:
        last, indent = _last_line(node), node.value[0][0].start_mark.column
        added = " " * indent + entry + comment + end[:-1]
        if last + 1 == len(lines):
            lines[last] += end[:-1]
            return "\n".join([*lines, added, ""])
        return "\n".join([*lines[:last + 1], added, *lines[last + 1:]])
    # within braces: before the closing one
    row, column = node.end_mark.line, node.end_mark.column - 1
    line = lines[row]
    comma = "," if node.value else ""
    lines[row] = f"{line[:column].rstrip()}{comma}{end}  {entry}{comment}{end}  {line[column:]}"
    return "\n".join(lines)


def _last_line(node: Node) -> int:
    """Index of the last line with anything of the node in it; a group's own end is where the next one begins."""
    if isinstance(node, ScalarNode) or node.flow_style or not node.value:
        return node.end_mark.line - (node.end_mark.column == 0 and node.end_mark.line > node.start_mark.line)
    return max(_last_line(part) for item in node.value for part in (item if isinstance(item, tuple) else (item,)))


def _flow(value: Any) -> str:
    """On one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return repr(value) if isinstance(value, float) else str(value)


def _refusal(text: SceneText, name: str, flow: str) -> InputError:
    return InputError("no fog can be added to 'fogs' without changing what stands there", place=text.place(("fogs",)),
                      remedy=f"add it yourself: {name}: {flow}")
