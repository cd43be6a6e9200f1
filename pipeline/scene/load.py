"""Reads a scene file: YAML with line numbers, overrides, and one-line complaints."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq, TaggedScalar
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from pipeline.errors import InputError
from pipeline.plugins.base import KINDS, Model, registry
from pipeline.scene.model import scene_model

MAX_BYTES = 2_000_000
MAX_NODES = 200_000
COMMAND_LINE = "command line"


def load_scene(path: Path, overrides: dict[str, str] | None = None, fog: str | None = None) -> Model:
    """The scene of `path`, with `overrides` ({"fog.visibility": "3"}) and the fog called `fog` picked.

    An override beginning with `fog.` means the picked fog. Raises InputError naming file, line, value
    and what is allowed.
    """
    data = read_yaml(path)
    overridden = [_override(data, key, value, fog) for key, value in (overrides or {}).items()]
    try:
        scene = scene_model().model_validate(_plain(data))
    except ValidationError as error:
        raise _complaint(error, path, data, overridden) from None
    if fog is not None:
        if fog not in scene.fogs:
            known = ", ".join(scene.fogs) or "(none; the scene has only its default fog)"
            raise InputError(f"no fog is called '{fog}'", place=str(path),
                             remedy=f"use one of {known}" + _nearest(fog, list(scene.fogs)))
        scene = scene.model_copy(update={"fog": scene.fogs[fog]})
    return scene


def read_yaml(path: Path) -> CommentedMap:
    """The file's mapping with line numbers; tags, aliases and oversized files are refused."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"scene file of {size} bytes", place=str(path),
                             remedy=f"keep it below {MAX_BYTES} bytes; pictures belong into files of their own")
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError("no such scene file", place=str(path), remedy=_other_scenes(path)) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", place=str(path),
                         remedy="give a readable UTF-8 text file") from None
    try:
        data = YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{path}:{mark.line + 1}" if mark else str(path)
        raise InputError(f"not valid YAML ({error.problem or error.context})", place=place,
                         remedy="mend the syntax on or just before this line") from None
    except (YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"not valid YAML ({error})", place=str(path), remedy="mend the syntax") from None
    if not isinstance(data, CommentedMap):
        raise InputError("the scene file is not a mapping of names to values", place=f"{path}:1",
                         remedy="start with 'photograph:', 'camera:', 'shapes:', 'lights:', 'fog:'")
    _check_tree(data, path)
    return data


def _check_tree(data: Any, path: Path) -> None:
    seen: set[int] = set()
    stack = [(data, 1)]
    count = 0
    while stack:
        node, line = stack.pop()
        count += 1
        if count > MAX_NODES:
            raise InputError(f"more than {MAX_NODES} values", place=str(path), remedy="split the scene")
        if isinstance(node, TaggedScalar) or (
                getattr(node, "tag", None) is not None and getattr(node.tag, "value", None)
                and not str(node.tag.value).startswith("tag:yaml.org,2002:")):
            raise InputError(f"YAML tag {getattr(node.tag, 'value', node.tag)}", place=f"{path}:{line}",
                             remedy="remove it; scene files hold plain values only")
        if isinstance(node, (CommentedMap, CommentedSeq)):
            if id(node) in seen:
                raise InputError("YAML alias", place=f"{path}:{line}", remedy="write the values out")
            seen.add(id(node))
            for key in node if isinstance(node, CommentedMap) else range(len(node)):
                stack.append((node[key], _own_line(node, key) or line))


def _own_line(node: CommentedMap | CommentedSeq, key: Any) -> int | None:
    try:
        position = node.lc.key(key) if isinstance(node, CommentedMap) else node.lc.item(key)
        return position[0] + 1
    except (KeyError, TypeError, AttributeError, IndexError):
        return None


def _plain(node: Any) -> Any:
    if isinstance(node, dict):
        return {str(k) if not isinstance(k, str) else k: _plain(v) for k, v in node.items()}
    if isinstance(node, list):
        return [_plain(v) for v in node]
    if isinstance(node, bool) or node is None:
        return node
    for plain in (int, float, str):
        if isinstance(node, plain):
            return plain(node)
    return str(node)  # dates and other YAML scalars


def _override(data: CommentedMap, key: str, text: str, fog: str | None) -> tuple:
    """Sets one value by its dotted path; returns the path as a tuple."""
    parts = key.split(".")
    if parts[0] == "fog" and fog is not None:
        parts = ["fogs", fog, *parts[1:]]
    try:
        value = YAML(typ="safe", pure=True).load(text)
    except YAMLError:
        raise InputError(f"{key}={text} is not a value", place=COMMAND_LINE,
                         remedy="give a number, a word, or a list such as [1,2,3]") from None
    node: Any = data
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        where = ".".join(parts[:depth]) or "the scene"
        if isinstance(node, list):
            if not part.isdigit() or int(part) >= len(node):
                raise InputError(f"'{key}': {where} has {len(node)} entries, not '{part}'", place=COMMAND_LINE,
                                 remedy=f"use a number from 0 to {len(node) - 1}")
            part = int(part)
        elif not isinstance(node, dict):
            raise InputError(f"'{key}': {where} is a value, not a group", place=COMMAND_LINE,
                             remedy=f"override {where} itself")
        if last:
            node[part] = value
        else:
            if isinstance(node, dict) and part not in node:
                if depth == 0 and part not in scene_model().model_fields or part == "fogs":
                    raise InputError(f"'{key}': {where} has no '{part}'", place=COMMAND_LINE,
                                     remedy="use one of " + ", ".join(map(str, node))
                                            + _nearest(str(part), list(map(str, node))))
                node[part] = CommentedMap()
            node = node[part]
    return tuple(p if not p.isdigit() else int(p) for p in parts)


def _complaint(error: ValidationError, path: Path, data: CommentedMap, overridden: list[tuple]) -> InputError:
    """The first mistake in one line, with how many more there are."""
    problems = error.errors(include_url=False)
    # in a union every branch complains; the deepest complaint is about what the person meant
    first = max(problems, key=lambda p: (p["type"] != "missing", len(p["loc"]))) if len(problems) > 1 else problems[0]
    location = [part for part in first["loc"] if not _is_tag(part, first["loc"], data)]
    line, found, known = _locate(data, location)
    dotted = ".".join(str(part) for part in found) or "scene"
    place = f"{path}:{line}"
    if any(tuple(found[: len(o)]) == o or o[: len(found)] == tuple(found) for o in overridden):
        place = COMMAND_LINE
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    kind, context = first["type"], first.get("ctx", {})
    value = _short(first.get("input"))
    name = location[-1] if location else "scene"
    if kind == "extra_forbidden":
        allowed = _allowed_keys(first["loc"], data)
        return InputError(f"{dotted}: unknown key '{name}'{more}", place=place,
                          remedy=f"use one of {', '.join(allowed)}" + _nearest(str(name), allowed))
    if kind == "missing":
        return InputError(f"{dotted}: '{name}' is missing{more}", place=place, remedy=f"add '{name}:'")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        asked = context.get("tag", "(none)")
        allowed = sorted(t.strip().strip("'") for t in str(context.get("expected_tags", "")).split(",") if t.strip())
        if not allowed:
            allowed = sorted({n for k in KINDS for n in registry(k)})
        return InputError(f"{dotted}: type '{asked}' is not known{more}", place=place,
                          remedy=f"use one of {', '.join(allowed)}" + _nearest(str(asked), allowed))
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if kind == "value_error":
        problem, _, remedy = message.partition("; ")
        return InputError(f"{dotted}: {problem}{more}", place=place, remedy=remedy or "mend this entry")
    if kind == "string_pattern_mismatch":
        message = "a name of letters, digits, '_' and '-', beginning with a letter, 40 at most"
    return InputError(f"{dotted} = {value}{more}", place=place, remedy=f"give {message}")


def _is_tag(part: Any, loc: tuple, data: Any) -> bool:
    """Whether a part of pydantic's location names a union's branch rather than a key of the file."""
    if not isinstance(part, str):
        return False
    node: Any = data
    for other in loc:
        if other is part:
            break
        try:
            node = node[other]
        except (KeyError, IndexError, TypeError):
            pass
    if part == "[key]":
        return True
    present = isinstance(node, dict) and part in node
    if present:
        return False
    is_plugin = any(part in registry(kind) for kind in KINDS)
    return is_plugin or "[" in part or part in ("float", "int", "str", "constrained-str")


def _locate(data: Any, location: list) -> tuple[int, list, bool]:
    """Line of the deepest existing part of a location, and that part."""
    node, line, found = data, 1, []
    for part in location:
        try:
            child = node[part]
        except (KeyError, IndexError, TypeError):
            break
        line = _own_line(node, part) or line
        node = child
        found.append(part)
    return line, found, len(found) == len(location)


def _allowed_keys(loc: tuple, data: Any) -> list[str]:
    """Keys that the model at the parent of `loc` takes."""
    model: Any = scene_model()
    node: Any = data
    for part in loc[:-1]:
        model = _descend(model, part)
        if model is None:
            return []
    return sorted(model.model_fields) if hasattr(model, "model_fields") else []


def _descend(model: Any, part: Any) -> Any:
    import typing

    if hasattr(model, "model_fields"):
        field = model.model_fields.get(part)
        return _unwrap(field.annotation) if field else None
    candidates = model if isinstance(model, list) else [model]
    for candidate in candidates:
        if hasattr(candidate, "type_name") and candidate.type_name() == part:
            return candidate
    for candidate in candidates:
        origin = typing.get_origin(candidate)
        if origin is dict:
            return _unwrap(typing.get_args(candidate)[1])
        if origin is list:
            return _unwrap(typing.get_args(candidate)[0])
    return None


def _unwrap(annotation: Any) -> Any:
    import types
    import typing

    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _unwrap(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        options = [_unwrap(a) for a in typing.get_args(annotation) if a is not type(None)]
        return options[0] if len(options) == 1 else options
    return annotation


def _nearest(word: str, among: list[str]) -> str:
    near = difflib.get_close_matches(word, among, n=1, cutoff=0.6)
    return f" (did you mean '{near[0]}'?)" if near else ""


def _short(value: Any) -> str:
    text = repr(value) if not isinstance(value, str) else f"'{value}'"
    return text if len(text) <= 60 else text[:57] + "..."


def _other_scenes(path: Path) -> str:
    scenes = sorted(p.parent.name for p in path.parent.parent.glob("*/scene.yaml"))
    return f"use one of {', '.join(scenes)}" + _nearest(path.parent.name, scenes) if scenes else "write one"
