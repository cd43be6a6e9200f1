"""Reads pbrt-v4 scene files as strictly as their format page states it, to tell whether one is sound and complete.

Directives, their order and nesting, typed parameters with their counts, finite numbers, and names that must exist.
"""

from __future__ import annotations

import math
import re

TOKEN = re.compile(r'#[^\n]*|"([^"\n]*)"|(\[)|(\])|([^\s\[\]"#]+)|(.)', re.S)
#: Numbers that each value of a type has.
TYPES = {"integer": 1, "float": 1, "point3": 3, "vector3": 3, "rgb": 3, "bool": 1, "string": 1}
#: What must be said of each thing, by directive and type name.
NEEDED = {("Film", "rgb"): {"integer xresolution", "integer yresolution", "string filename"},
          ("Camera", "perspective"): {"float fov"}, ("Integrator", "volpath"): {"integer maxdepth"},
          ("Shape", "trianglemesh"): {"integer indices", "point3 P"},
          ("LightSource", "point"): {"rgb I", "point3 from"},
          ("LightSource", "spot"): {"rgb I", "point3 from", "point3 to", "float coneangle", "float conedeltaangle"},
          ("LightSource", "distant"): {"rgb L", "point3 from", "point3 to"}, ("Material", "interface"): set(),
          ("AreaLightSource", "diffuse"): {"rgb L"}, ("Material", "diffuse"): {"rgb reflectance"},
          ("PixelFilter", "box"): set(), ("Sampler", "independent"): {"integer pixelsamples"}}
BEFORE_WORLD = {"Film", "Camera", "Integrator", "PixelFilter", "Sampler"}
ONLY_IN_WORLD = {"Shape", "LightSource", "AreaLightSource", "Material"}


class Unsound(ValueError):
    pass


def read(text: str) -> list[tuple[str, list[str], dict[str, list]]]:
    """Directives with their names and parameters; raises Unsound with what is wrong."""
    tokens = [m for m in TOKEN.finditer(text) if not m.group().startswith("#") and m.group().strip()]
    found, media, depth, world, at = [], set(), 0, False, 0

    def fail(why: str):
        line = text.count("\n", 0, tokens[min(at, len(tokens) - 1)].start()) + 1 if tokens else 1
        raise Unsound(f"line {line}: {why}")

    def values() -> list:
        nonlocal at
        if at >= len(tokens) or not tokens[at].group(2):
            fail("'[' expected")
        at, result = at + 1, []
        while at < len(tokens) and not tokens[at].group(3):
            token = tokens[at]
            if token.group(1) is not None:
                result.append(token.group(1))
            elif token.group(4) in ("true", "false"):
                result.append(token.group(4) == "true")
            else:
                try:
                    result.append(float(token.group(4)))
                except (TypeError, ValueError):
                    fail(f"'{token.group()}' is no value")
                if not math.isfinite(result[-1]):
                    fail(f"{token.group()} is not finite")
            at += 1
        if at >= len(tokens):
            fail("a list without ']'")
        at += 1
        return result

    while at < len(tokens):
        directive = tokens[at].group(4)
        if directive is None:
            fail(f"a directive expected, not '{tokens[at].group()}'")
        at += 1
        names, parameters = [], {}
        if directive == "Transform":
            parameters["matrix"] = values()
            if len(parameters["matrix"]) != 16:
                fail("a matrix of 16 numbers expected")
        elif directive in ("AttributeBegin", "AttributeEnd", "WorldBegin"):
            depth += {"AttributeBegin": 1, "AttributeEnd": -1}.get(directive, 0)
            if depth < 0:
                fail("AttributeEnd without AttributeBegin")
            world = world or directive == "WorldBegin"
        elif directive in {"MakeNamedMedium", "MediumInterface", "ColorSpace"} | {key for key, _ in NEEDED}:
            if directive in BEFORE_WORLD and world or directive in ONLY_IN_WORLD and not world:
                fail(f"{directive} on the wrong side of WorldBegin")
            for _ in range(2 if directive == "MediumInterface" else 1):
                if at >= len(tokens) or tokens[at].group(1) is None:
                    fail(f"{directive} without a name")
                names.append(tokens[at].group(1))
                at += 1
            while at < len(tokens) and tokens[at].group(1) is not None:
                declared = tokens[at].group(1)
                kind = declared.split(" ")[0]
                if not re.fullmatch(r"\w+ \w+", declared) or kind not in TYPES:
                    fail(f"'{declared}' declares no parameter")
                at += 1
                parameters[declared] = values()
                if not parameters[declared] or len(parameters[declared]) % TYPES[kind]:
                    fail(f"'{declared}' has {len(parameters[declared])} values")
                wanted = {"string": str, "bool": bool}.get(kind, float)
                if not all(type(v) is wanted for v in parameters[declared]):
                    fail(f"'{declared}' has values of another kind")
        else:
            fail(f"no directive is called {directive}")
        if directive == "MakeNamedMedium":
            media.add(names[0])
            needed = {"string type", "rgb sigma_a", "rgb sigma_s"}
            if parameters.get("string type") == ["uniformgrid"]:
                needed |= {"integer nx", "integer ny", "integer nz", "float density", "point3 p0", "point3 p1"}
            cells = [parameters.get(f"integer n{k}", [1])[0] for k in "xyz"]
            if needed <= set(parameters) and len(parameters.get("float density", [0])) != math.prod(cells):
                fail("a grid of another size than it says")
        elif directive == "MediumInterface":
            needed = set()
            for name in names:
                if name and name not in media:
                    fail(f"no medium is called '{name}'")
        elif directive in {key for key, _ in NEEDED}:
            if (directive, names[0]) not in NEEDED:
                fail(f"{directive} knows no '{names[0]}'")
            needed = NEEDED[directive, names[0]]
        else:
            needed = set()
        if needed - set(parameters):
            fail(f"{directive} lacks {', '.join(sorted(needed - set(parameters)))}")
        if names and names[0] == "trianglemesh":
            points = len(parameters["point3 P"]) / 3
            if len(parameters["integer indices"]) % 3 or not all(
                    0 <= i < points and i == int(i) for i in parameters["integer indices"]):
                fail("indices of no triangles")
        found.append((directive, names, parameters))
    stated = [directive for directive, _, _ in found]
    missing = [d for d in ("Film", "Camera", "Integrator", "WorldBegin", "Shape") if d not in stated]
    if depth or missing or not {"LightSource", "AreaLightSource"} & set(stated):
        raise Unsound(f"incomplete: {'AttributeEnd' if depth else ', '.join(missing) or 'a light'} is missing")
    return found
