"""The values of a thing that are typed and not drawn, as the scene file's own schema has them: name, unit, bounds, default."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from pipeline.annotate.page.things import Place, at
from pipeline.errors import InputError
from pipeline.scene.model import json_schema

#: Characters of a text, and of a list of numbers as it is typed.
LONGEST = 400
#: Fogs that the page offers, each with what it cannot do without; all others are written by hand.
FOGS = {"homogeneous": {}, "height": {"scale_height": 5.0}}
#: What these have in common.
COMMON = ("visibility", "contrast", "single_scattering_albedo", "absorption_coefficient", "scattering_coefficient", "phase_function")


@dataclass(frozen=True)
class Field:
    """One value. form: number, whole, switch, choice, text or numbers (a list of `count`, None for any)."""

    place: Place
    label: str
    form: str
    value: Any
    default: Any
    unit: str = ""
    hint: str = ""
    choices: tuple[str, ...] = ()
    least: float | None = None
    most: float | None = None
    count: int | None = None

    @property
    def text(self) -> str:
        """The value as a person types it; nothing for one that is left out."""
        if self.value is None:
            return ""
        if isinstance(self.value, list):
            return ", ".join(f"{x:g}" if isinstance(x, (int, float)) else str(x) for x in self.value)
        return f"{self.value:.6g}" if isinstance(self.value, float) else str(self.value)

    @property
    def placeholder(self) -> str:
        if isinstance(self.default, list):
            return ", ".join(f"{x:g}" for x in self.default if isinstance(x, (int, float)))
        return "" if self.default is None else f"{self.default}"


@cache
def schema() -> dict[str, Any]:
    return json_schema()


def schema_at(data: Any, place: Place) -> dict[str, Any] | None:
    """What the scene file's schema says of `place`, the type of a plugin read from the data; None where nothing may stand."""
    found, value = schema(), data
    for key in place:
        found = _resolved(found, value)
        if found is None:
            return None
        if isinstance(key, int):
            found, value = found.get("items"), at(value, (key,))
        else:
            named = next(iter(found.get("patternProperties", {}).values()), found.get("additionalProperties") or None)
            found, value = found.get("properties", {}).get(key, named), at(value, (key,))
        if not isinstance(found, dict):
            return None
    return _resolved(found, value)


def _resolved(found: dict[str, Any], value: Any) -> dict[str, Any] | None:
    """Without references and without what a value of another type would be."""
    for _ in range(20):
        more = {key: found[key] for key in ("description", "default", "unit") if key in found}
        if "$ref" in found:
            found = {**schema()["$defs"][found["$ref"].rpartition("/")[2]], **more}
        elif "discriminator" in found:
            chosen = at(value, (found["discriminator"]["propertyName"],))
            reference = found["discriminator"]["mapping"].get(chosen) if isinstance(chosen, str) else None
            if reference is None:
                return {**found, "properties": {}}
            found = {"$ref": reference, **more}
        elif "anyOf" in found:
            parts = [one for one in found["anyOf"] if one.get("type") != "null"]
            kinds = {dict: "object", list: "array", str: "string"}.get(type(value))
            fitting = [one for one in parts if one.get("type") == kinds or "$ref" in one and kinds == "object"] if kinds else []
            found = {**(fitting or parts)[0], **more}
        else:
            return found
    return found


def fields(data: dict, owner: Place, planes: list[str]) -> list[Field]:
    """The values of what stands at `owner`, and of its outline or position; planes: what `on` and `stands_on` may hold."""
    found: list[Field] = []
    described = schema_at(data, owner)
    if described is None or described.get("type") != "object":
        return found
    if owner == ("fog",):
        found.append(Field((*owner, "type"), "kind", "choice", at(data, (*owner, "type")), None, choices=tuple(FOGS)))
    for key, one in described.get("properties", {}).items():
        if key == "type":
            continue
        place = (*owner, key)
        if key == "known":
            found += _known(data, place, one)
            continue
        made = _field(data, place, one, planes)
        if made is not None:
            found.append(made)
        elif key in ("outline", "position", "window") and isinstance(at(data, place), dict):
            found += [one for one in fields(data, place, planes) if one.place[-1] in ("on", "offset", "depth")]
        elif key == "phase_function" and isinstance(at(data, place), dict):
            found += fields(data, place, planes)
        elif key == "phase_function":
            found.append(Field((*place, "asymmetry"), "asymmetry", "number", None, 0.6, hint="mean cosine g; > 0 scatters forward",
                               least=-0.999, most=0.999))
        elif key == "known_length" and isinstance(at(data, place), dict):
            found += [one for one in fields(data, place, planes) if one.place[-1] == "length"]
    return found


def _known(data: dict, place: Place, described: dict) -> list[Field]:
    """Lengths or coordinates that nothing in the photograph shows, by name."""
    one = _resolved(described, None) or {}
    names = _resolved(one.get("propertyNames", {}), None) or {}
    value = _resolved(one.get("additionalProperties") or {}, 0.0) or {}
    return [Field((*place, name), f"known {name}", "number", at(data, (*place, name)), None, one.get("unit", "m"),
                  one.get("description", ""), least=value.get("minimum"), most=value.get("maximum")) for name in names.get("enum", ())]


def fog_of_kind(fog: dict, kind: str) -> dict[str, Any]:
    """The same fog as another medium: what both have in common stays."""
    more = FOGS[kind]
    kept = {key: value for key, value in fog.items() if key in COMMON or key in more}
    return {**kept, "type": kind, **{key: value for key, value in more.items() if key not in kept}}


def _field(data: dict, place: Place, described: dict, planes: list[str]) -> Field | None:
    value = at(data, place)
    one = _resolved(described, value) or {}
    unit, kind = one.get("unit", ""), one.get("type")
    common = {"place": place, "label": str(place[-1]).replace("_", " "), "value": value, "default": one.get("default"),
              "unit": "" if unit == "1" else unit, "hint": one.get("description", ""), "least": one.get("minimum"),
              "most": one.get("maximum")}
    if place[-1] in ("on", "stands_on"):
        known = [*planes, *([value] if isinstance(value, str) and value not in planes else [])]
        return Field(form="choice", **{**common, "choices": tuple(known)})
    if "enum" in one:
        return Field(form="choice", **{**common, "choices": tuple(str(x) for x in one["enum"])})
    if kind in ("number", "integer"):
        return Field(form="whole" if kind == "integer" else "number", **common)
    if kind == "boolean":
        return Field(form="switch", **common)
    if kind == "string" and "const" not in one:
        return Field(form="text", **common)
    items = one.get("items")
    if kind == "array" and unit != "pixel" and isinstance(items, dict) and items.get("type") == "number":
        counts = one.get("minItems"), one.get("maxItems")
        return Field(form="numbers", **{**common, "least": items.get("minimum"), "most": items.get("maximum"),
                                        "count": counts[0] if counts[0] == counts[1] else None})
    return None


def typed(field: Field, text: Any) -> Any:
    """What a person typed as the field's value; None for nothing, which leaves it out. InputError where it is no such value."""
    if field.form == "switch":
        return bool(text)
    stated = str(text).strip()
    if len(stated) > LONGEST:
        raise InputError(f"{field.label}: {len(stated)} characters", remedy=f"keep it below {LONGEST}")
    if not stated:
        return None
    if field.form == "choice":
        if stated not in field.choices:
            raise InputError(f"{field.label} = '{stated}'", remedy="use one of " + ", ".join(field.choices))
        return stated
    if field.form == "text":
        return stated
    parts = [part for part in stated.strip("[]").replace(";", ",").split(",") if part.strip()] if field.form == "numbers" else [stated]
    numbers = [_number(field, part.strip()) for part in parts]
    if field.form == "numbers":
        if field.count is not None and len(numbers) == 1:
            numbers *= field.count
        if field.count is not None and len(numbers) != field.count:
            raise InputError(f"{field.label}: {len(numbers)} numbers", remedy=f"give {field.count}, with commas between, or one for all")
        return numbers
    return numbers[0]


def _number(field: Field, text: str) -> float | int:
    try:
        value = int(text) if field.form == "whole" else float(text)
    except ValueError:
        raise InputError(f"{field.label} = '{text}'", remedy="give a whole number" if field.form == "whole" else "give a number") from None
    if not math.isfinite(value) and field.place[-1] != "visibility":
        raise InputError(f"{field.label} = {text}", remedy="give a number")
    if field.least is not None and value < field.least:
        raise InputError(f"{field.label} = {text}", remedy=f"give a number of {field.least:g} or more")
    if field.most is not None and value > field.most:
        raise InputError(f"{field.label} = {text}", remedy=f"give a number of {field.most:g} or less")
    return value
