"""Reads a scene file: YAML with line numbers, overrides, and one-line complaints."""

from __future__ import annotations

import re
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode

from pipeline.errors import InputError, nearest
from pipeline.plugins.base import Model
from pipeline.scene.model import scene_model

MAX_BYTES = 2_000_000
MAX_NODES = 200_000
MAX_DEPTH = 50
COMMAND_LINE = "command line"
#: Said of limits that no value of the scene raises.
FIXED = "this limit is fixed, as scene files may come from strangers"
#: What plain values are; any other tag would ask the reader to build an object.
PLAIN_TAGS = {f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str", "timestamp",
                                                       "seq", "map")}



class _BoundedComposer(Composer):
    """Stops at too many or too deep values while the file is read: by its end it may have taken minutes."""

    warn_double_anchors = False  # what an anchor is for, an alias, is refused with its line
    count = 0

    def compose_node(self, parent, index):
        self.count += 1
        line = self.parser.peek_event().start_mark.line + 1
        if self.count > MAX_NODES:
            raise InputError(f"more than {MAX_NODES} values in line {line}", remedy=f"split the scene; {FIXED}")
        if self.depth >= MAX_DEPTH:
            raise InputError(f"values are nested too deeply in line {line}, more than {MAX_DEPTH} groups or lists",
                             remedy=f"write them less deeply; {FIXED}")
        return super().compose_node(parent, index)


#: What a scene file should hold instead, by pydantic's name of the mistake; {unit} like " [m]", or empty.
WANTED = {
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "a number{unit}"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number{unit}"),
    **dict.fromkeys(("dict_type", "model_type", "mapping_type"), "a group of 'name: value' lines"),
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list such as [1, 2, 3]",
    "greater_than": "a number above {gt}{unit}",
    "greater_than_equal": "a number of {ge} or more{unit}",
    "less_than": "a number below {lt}{unit}",
    "less_than_equal": "a number of {le} or less{unit}",
    "too_short": "at least {min_length} entries, not {actual_length}",
    "too_long": "at most {max_length} entries, not {actual_length}",
    "literal_error": "{expected}",
    "string_too_short": "at least {min_length} characters",
    "string_too_long": "at most {max_length} characters",
    "string_pattern_mismatch":
        "a name of letters, digits, '_' and '-' (a fog's may hold single dots), beginning with a letter, 40 characters"
        " at most",
}

#: Lists that may be as long as this are bounded for the work that they are; shorter ones have a form, as [x, y, z].
FEWEST_OF_A_LIMIT = 20

Keys = tuple  # names and list indices from the top of the scene file, such as ("lights", "lamp", "gain")


@dataclass
class SceneText:
    """What stands in a scene file: plain values, the line of each key, and which were overridden."""

    path: Path
    values: dict[str, Any]
    lines: dict[Keys, int]
    overridden: list[Keys] = field(default_factory=list)

    def line(self, where: Keys) -> int:
        """Line of the key at `where`, or of the nearest group round it that is in the file."""
        while where not in self.lines:
            where = where[:-1]
        return self.lines[where]

    def is_overridden(self, where: Keys) -> bool:
        return any(where[: len(o)] == o for o in self.overridden)

    def place(self, where: Keys) -> str:
        line = f"{self.path}:{self.line(where)}"
        if self.is_overridden(where):
            return COMMAND_LINE
        within = where and any(o[: len(where)] == where for o in self.overridden)
        return f"{COMMAND_LINE}, {line}" if within else line


def load_scene(path: Path, overrides: dict[str, str] | None = None, fog: str | None = None) -> Model:
    """The scene of `path`, with `overrides` ({"fog.visibility": "3"}) and the fog called `fog` picked.

    An override beginning with `fog.` means the picked fog. Raises InputError naming file, line, value
    and what is allowed.
    """
    return checked(read_scene(path), overrides or {}, fog)


def checked(text: SceneText, overrides: dict[str, str], fog: str | None) -> Model:
    """The scene of a file that was read, as `load_scene`."""
    model = scene_model()
    if fog is not None:
        fogs = text.values.get("fogs")
        known = list(fogs) if isinstance(fogs, dict) else []
        if fog not in known:
            raise InputError(f"no fog is called '{fog}'", place=text.place(("fogs",)), remedy="use one of "
                             + ", ".join(known) + nearest(fog, known) if known else "add it below 'fogs:'")
    for key, value in overrides.items():
        _override(text, model, key, value, fog)
    scene = validated(text, model)
    return scene if fog is None else scene.model_copy(update={"fog": scene.fogs[fog]})


def validated(text: SceneText, model: type[Model]) -> Model:
    """What the file describes. Raises InputError naming file, line, value and what is allowed."""
    try:
        return model.model_validate(text.values)
    except ValidationError as error:
        raise _complaint(error, text, model) from None


#: What a scene file begins with.
FIRST = "photograph, camera, shapes, lights, fog"


def read_scene(path: Path, what: str = "scene", first: str = FIRST) -> SceneText:
    """The file's values and lines; tags, aliases, repeated keys and oversized files are refused.

    what: is described, of which `first` are what to begin with.
    """
    return parsed(path, re.sub("\r\n?", "\n", content_of(path, what, first)), what, first)


def content_of(path: Path, what: str = "scene", first: str = FIRST) -> str:
    """The file's text with the line ends that it has; what is too large or no UTF-8 is refused."""
    try:
        if path.exists() and not path.is_file():
            raise InputError("is no plain file", place=str(path), remedy="give a UTF-8 text file")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{what} file of {size} bytes", place=str(path),
                             remedy=f"keep it below {MAX_BYTES} bytes, and pictures in files of their own; {FIXED}")
        return path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"no such {what} file", place=str(path), remedy=scenes_beside(path.parent) if what == "scene"
                         else f"write it, with {first}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", place=str(path),
                         remedy="give a readable UTF-8 text file") from None


def parsed(path: Path, content: str, what: str = "scene", first: str = FIRST) -> SceneText:
    """Values and lines of a file's content, as `read_scene`; `path` is for messages."""
    return composed(path, content, what, first)[1]


def composed(path: Path, content: str, what: str = "scene", first: str = FIRST) -> tuple[MappingNode, SceneText]:
    """The same, with the nodes whose marks tell where in the content each value stands."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _BoundedComposer
    try:
        root = yaml.compose(content)
        if root is None:
            raise InputError(f"the {what} file is empty", place=f"{path}:1", remedy=f"state at least {first}")
        if not isinstance(root, MappingNode):
            raise InputError(f"the {what} file is not a group of 'name: value' lines", place=f"{path}:1",
                             remedy=f"start its lines with {first.replace(',', ':,')}:")
        lines: dict[Keys, int] = {(): 1}
        return root, SceneText(path, _values(root, (), path, lines, set(), yaml.constructor), lines)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        remedy = "mend this line or the one before"
        if "\\t" in (error.problem or ""):
            remedy = "indent with spaces instead of tabs"
        raise InputError(f"not valid YAML ({error.problem or error.context})",
                         place=f"{path}:{mark.line + 1}",
                         remedy=remedy) from None
    except (YAMLError, ValueError) as error:
        raise InputError(f"not valid YAML ({str(error).splitlines()[0]})", place=str(path),
                         remedy="save it as plain text without control characters") from None
    except InputError as error:
        raise error.at(str(path)) from None


def scenes_beside(folder: Path) -> str:
    """What to do about a scene that is not there: the scenes that are, and the one most alike."""
    names = sorted(p.parent.name for p in folder.parent.glob("*/scene.yaml"))
    if not names:
        return f"write {folder / 'scene.yaml'}"
    return f"use one of {', '.join(names)}" + nearest(folder.name, names)


def _values(node: Node, where: Keys, path: Path, lines: dict[Keys, int], seen: set[int], constructor) -> Any:
    """A YAML node as dict, list, number, text, True, False or None; notes the lines of what is in it."""
    here = f"{path}:{node.start_mark.line + 1}"
    if id(node) in seen:
        raise InputError("YAML alias", place=f"{path}:{lines[where]}", remedy="write the values out")
    seen.add(id(node))
    if node.tag not in PLAIN_TAGS:
        raise InputError(f"YAML tag {node.tag.replace('tag:yaml.org,2002:', '!!')}", place=here,
                         remedy="remove it; scene files hold plain values only")
    if isinstance(node, ScalarNode):
        value = constructor.construct_object(node)
        return value if value is None or isinstance(value, (bool, int, float, str)) else node.value
    if not isinstance(node, MappingNode):
        result: list[Any] = []
        for index, item in enumerate(node.value):
            lines[(*where, index)] = item.start_mark.line + 1
            result.append(_values(item, (*where, index), path, lines, seen, constructor))
        return result
    group: dict[str, Any] = {}
    for key, item in node.value:
        line = key.start_mark.line + 1
        if not isinstance(key, ScalarNode) or key.tag not in PLAIN_TAGS:
            is_word = isinstance(key, ScalarNode)
            said = f"'{key.value}' is not a plain name" if is_word else "a group as a name"
            raise InputError(said, place=f"{path}:{line}",
                             remedy="name values by words, and write merged ones out")
        if key.value in group:
            raise InputError(f"'{key.value}' is stated twice, first in line {lines[(*where, key.value)]}",
                             place=f"{path}:{line}", remedy="keep one of the two")
        lines[(*where, key.value)] = line
        group[key.value] = _values(item, (*where, key.value), path, lines, seen, constructor)
    return group


def _override(text: SceneText, model: type[Model], key: str, value: str, fog: str | None) -> None:
    """Sets one value of the scene by its dotted path; a group that the file lacks starts from its default."""
    parts = key.split(".")
    if parts[0] == "fog" and fog is not None:
        parts = ["fogs", fog, *parts[1:]]
    try:
        new = YAML(typ="safe", pure=True).load(value)
    except (YAMLError, ValueError):
        raise InputError(f"{key}={value} is not a value", place=COMMAND_LINE,
                         remedy="give a number, a word, or a list such as [1,2,3]") from None
    node, where = text.values, ()
    for depth, part in enumerate(parts):
        group = ".".join(map(str, where)) or "the scene"
        if isinstance(node, list):
            if not part.isdecimal() or int(part) >= len(node):
                raise InputError(f"{key}: {group} has {len(node)} entries, none numbered '{part}'",
                                 place=COMMAND_LINE,
                                 remedy=f"count from 0 to {len(node) - 1}")
            part = int(part)
        elif not isinstance(node, dict):
            raise InputError(f"{key}: {group} is a value, not a group", place=COMMAND_LINE,
                             remedy=f"override {group} itself")
        where = (*where, part)
        if depth == len(parts) - 1:
            node[part] = new
        else:
            if isinstance(node, dict) and node.get(part) is None:
                known = _field(model, text.values, where)
                if known is None:
                    names = sorted({*map(str, node), *(model.model_fields if depth == 0 else ())})
                    raise InputError(f"{key}: {group} has no '{part}'", place=COMMAND_LINE,
                                     remedy=f"use one of {', '.join(names)}" + nearest(part, names))
                if not (_models(known.annotation) or _is_dict(known.annotation)):
                    inner = ".".join(map(str, where))
                    raise InputError(f"{key}: {inner} is a value, not a group", place=COMMAND_LINE,
                                     remedy=f"override {inner} itself")
                default = known.get_default(call_default_factory=True)
                if isinstance(default, BaseModel):
                    default = default.model_dump(mode="json")
                node[part] = dict(default) if isinstance(default, dict) else {}
            node = node[part]
    text.overridden.append(where)


def _complaint(error: ValidationError, text: SceneText, model: type[Model]) -> InputError:
    """The first mistake in one line, with how many more there are."""
    found = _by_place(error, text.values)
    # values of the command line first, then in the file's order, a value before the group round it
    where = min(found, key=lambda w: (not text.is_overridden(w), text.line(w), -len(w)))
    said, remedy = _said(where, found[where], text.values, model)
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return InputError(said + more, place=text.place(where), remedy=remedy)


def complaints(error: ValidationError, values: dict[str, Any], model: type[Model]) -> list[tuple[Keys, str, str, bool]]:
    """All mistakes: keys of where each stands, what is wrong, what to do, and whether it is only that something is missing,
    whose keys those would be."""
    found = []
    for where, problems in _by_place(error, values).items():
        missing = [problem for problem in problems if problem["type"] == "missing"]
        found += [((*where, one["loc"][-1]), *_said(where, [one], values, model), True) for one in missing]
        if others := [problem for problem in problems if problem["type"] != "missing"]:
            found.append((where, *_said(where, others, values, model), False))
    return found


def _by_place(error: ValidationError, values: dict[str, Any]) -> dict[Keys, list[dict]]:
    found: dict[Keys, list[dict]] = {}
    for problem in error.errors(include_url=False):
        found.setdefault(_where(problem, values), []).append(problem)
    return found


def _said(where: Keys, problems: list[dict], values: dict[str, Any], model: type[Model]) -> tuple[str, str]:
    """What is wrong at a place of the file, and what to do."""
    kind, context = problems[0]["type"], problems[0].get("ctx", {})
    dotted = ".".join(map(str, where)) or "the file"
    if kind == "mistake":
        return f"{dotted}: {context['problem']}", context["remedy"]
    if kind == "missing":
        key = problems[0]["loc"][-1]
        return f"{dotted}: '{key}' is missing", f"add '{key}:'{_unit(model, values, (*where, key))}"
    if kind == "value_error":
        problem, _, remedy = problems[0]["msg"].removeprefix("Value error, ").partition("; ")
        return f"{dotted}: {problem}", remedy or "mend this entry"
    unit = _unit(model, values, where)
    # of groups pydantic does not tell how many they are
    wanted = [WANTED.get(p["type"], "").format(**(p.get("ctx", {}) | _length(p)), unit=unit) or p["msg"]
              for p in problems]
    value = problems[0]["loc"][-2] if problems[0]["loc"][-1] == "[key]" else problems[0]["input"]
    remedy = f"give {' or '.join(dict.fromkeys(wanted))}"
    if context.get("max_length", 0) >= FEWEST_OF_A_LIMIT:
        remedy += f"; {FIXED}"
    return f"{dotted} = {_short(value)}", remedy


def _length(problem: dict) -> dict[str, int]:
    return {"actual_length": len(problem["input"])} if isinstance(problem["input"], (dict, list)) else {}


def _where(problem: dict, values: Any) -> Keys:
    """Path in the file of what pydantic complains about: its location without the names of union branches."""
    node, where, entered = values, (), True
    for part in problem["loc"]:
        if entered and isinstance(node, dict) and node.get("type") == part:
            entered = False  # the branch of a plugin, which pydantic names after entering its group
        elif _holds(node, part):
            node, where, entered = node[part], (*where, part), True
    return (*where, *problem.get("ctx", {}).get("at", ()))


def _holds(node: Any, part: str | int) -> bool:
    return isinstance(node, dict) and part in node or isinstance(node, list) and part in range(len(node))


def _field(model: type[BaseModel], values: Any, where: Keys) -> FieldInfo | None:
    """The field that a path of the file means, or None for a name that the person chose or nobody knows."""
    models, found, node, named = [model], None, values, False
    for part in where:
        if named or isinstance(part, int):
            found, named = None, False
        else:
            stated = node.get("type") if isinstance(node, dict) else None
            options = [m for m in models if getattr(m, "type_name", lambda: stated)() == stated] or models
            found = next((m.model_fields[part] for m in options if part in m.model_fields), None)
            if found is None:
                return None
            models, named = _models(found.annotation), _is_dict(found.annotation)
        node = node[part] if _holds(node, part) else None
    return found


def unit_at(model: type[BaseModel], values: Any, where: Keys) -> str:
    """Unit of the numbers at `where`, such as "pixel", or "": that of the nearest value round it which the model knows."""
    for end in range(len(where), 0, -1):
        known = None if isinstance(where[end - 1], int) else _field(model, values, where[:end])
        if known is not None:
            return (known.json_schema_extra or {}).get("unit", "")
    return ""


def _unit(model: type[BaseModel], values: Any, where: Keys) -> str:
    """Unit of the value at `where`, like " [m]", or of the list that holds it."""
    while where and not isinstance(where[-1], str):
        where = where[:-1]
    known = _field(model, values, where)
    unit = (known.json_schema_extra or {}).get("unit") if known else None
    return f" [{unit}]" if unit and unit != "1" else ""


def _models(annotation: Any) -> list[type[BaseModel]]:
    """The models that an annotation mentions, in any depth of unions, lists and dicts."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in typing.get_args(annotation) for model in _models(part)]


def _is_dict(annotation: Any) -> bool:
    return typing.get_origin(annotation) is dict or any(
        _is_dict(part) for part in typing.get_args(annotation) if typing.get_origin(annotation) is not list)


def _short(value: Any) -> str:
    text = f"'{value}'" if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
