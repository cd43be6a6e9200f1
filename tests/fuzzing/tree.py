"""Mutations of a scene's values, which still are YAML: wrong numbers, types, places, and pieces of other scenes."""

from __future__ import annotations

import copy
from random import Random
from typing import Any

from tests.fuzzing.bases import bases

Place = tuple[Any, Any]  # a group or list, and the key in it

NUMBERS = [0, -0.0, -1, 1, 2, 0.5, 1e-320, 1e-12, 1e-3, 1e3, 1e6, 1e7, -1e7, 1e12, 1e20, -1e20, 1e39, 1e155, 1e308, -1e308,
           float("nan"), float("inf"), -float("inf"), 2**31, 2**63, 2**200, 89.9, 90, 180, 360, 63.5, 64, 0.999]
STRANGE = [None, True, "", "x", "x" * 5000, [], {}, [[]], [None], {"type": "point"}, {"type": None}, {"type": []}, {"x": 1},
           "../outside/secret.png", "link.png", "/etc/passwd", "pipe", "folder", "scene.yaml", "depth.png", "density.npy",
           "<< cells >>", "\x1b[31m", "room.floor", "ground", "room.nothing", "sky"]
#: Sections that the shipped scenes do not use.
SECTIONS = {
    "photograph": [{"file": "photograph.png", "max_megapixels": 1e-4}, {"file": "photograph.png", "colour_space": "adobe_rgb"}],
    "depth": [{"map": {"file": "depth.png"}}, {"map": {"file": "depth.png", "kind": "disparity", "baseline": 1e-3}},
              {"map": {"file": "photograph.png", "metres_per_unit": 1e6}}, {"labels": "photograph.png"},
              {"map": {"file": "depth.png", "kind": "radial", "focal_length": 1e7, "principal_point": [1e6, -1e6]}}],
    "camera": [{"horizontal_field_of_view": 178.9, "height": 1e6}, {"horizontal_field_of_view": 0.11, "height": 1e-300},
               {"focal_length_35mm": 24, "pitch": -90, "height": 1}, {"focal_length_35mm": 24, "pitch": 1e300, "height": 1},
               {"horizontal_field_of_view": 60, "position": [1e7, 1e7, 1e7], "look_at": [-1e7, 0, 0]},
               {"horizontal_field_of_view": 60, "position": [0, 1, 0], "look_at": [0, 5, 0]},
               {"horizontal_field_of_view": 60, "horizon": [[0, 20], [0, 40]], "height": 1},
               {"horizontal_field_of_view": 60, "known_length": {"pixels": [[1, 40], [1, 40]], "length": 1}},
               {"fspy": "scene.yaml", "height": 1}, {"fspy": "photograph.png", "height": 1}],
    "shapes": [{}, {"room": {"type": "room", "lower": [-1e7, 0, -1e7], "upper": [1e7, 1e7, 1e7]}},
               {"m": {"type": "mesh", "vertices": [[0, 0, -5], [0, 0, -5], [0, 0, -5]], "triangles": [[0, 1, 2]]}},
               {"m": {"type": "mesh", "vertices": [[0, 0, -5], [1, 3, -5], [2, 0, -5]], "triangles": [[0, 1, 2]] * 40}},
               {"p": {"type": "polygon", "outline": {"points": [[0, 0, 0], [1, 1, 1], [2, 2, 2]]}}},
               {"c": {"type": "cuboid", "centre": [0, 0, 0], "size": [1e-7, 1e7, 1], "yaw": 1e300}}],
    "render": [{"samples": 10000, "in_scattering_size": 20000}, {"threads": 512, "timeout": 1e-9}, {"samples": 1}],
    "illumination": [{"type": "manual"}, {"type": "karsch"}, {"type": "solar_position"},
                     {"type": "liu_xing", "shadowed": [{"pixel": [32, 40]}], "albedo": 0.2}],
    "sun_direction": [{"type": "solar_position", "time": "2024-02-30T12:00", "time_zone": "Europe/Berlin", "latitude": 90,
                       "longitude": 0, "heading": 0},
                      {"type": "solar_position", "time": "0001-01-01T00:00", "time_zone": "../../etc/passwd", "latitude": 0,
                       "longitude": 180, "heading": 1e300},
                      {"type": "solar_position", "time": "2024-06-21T12:00", "time_zone": "Europe/Berlin", "latitude": 52,
                       "longitude": 13, "heading": 20}],
    "fog": [{"type": "homogeneous", "visibility": 1e-3}, {"type": "homogeneous", "visibility": float("inf")},
            {"type": "noise", "visibility": 5, "scale": 1e-3, "detail": 1, "top_height": 1e300},
            {"type": "noise", "visibility": 5, "scale_height": 1e-320, "detail": 1},
            {"type": "noise", "visibility": 5, "detail": 1, "offset": [1e7, 0, 1e7], "wind": [1e7, 0, 0], "time": 1e300},
            {"type": "layers", "visibility": 1, "layers": [{"lower": -1e308, "upper": 1e308, "density": 1e6}]},
            {"type": "height", "visibility": 1e-3, "base": 1e308, "scale_height": 1e-3},
            {"type": "height", "visibility": 10, "base": -1e308, "scale_height": 1e7, "top_height": 1e308},
            {"type": "homogeneous", "absorption_coefficient": [0, 1e12, 0], "scattering_coefficient": [1e12, 0, 1e-300]}],
}


def places(node: Any) -> list[Place]:
    """All values below `node`."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [place for key, value in items for place in ((node, key), *places(value))]


def _numbers(node: Any) -> list[Place]:
    return [(group, key) for group, key in places(node)
            if isinstance(group[key], (int, float)) and not isinstance(group[key], bool)]


def number(rng: Random, values: Any) -> None:
    if found := _numbers(values):
        group, key = rng.choice(found)
        group[key] = rng.choice(NUMBERS)


def shaken(rng: Random, values: Any) -> None:
    """Coordinates a little or far off, as of a click in the wrong place."""
    found, far = _numbers(values), rng.choice([0.5, 5.0, 100.0])
    for group, key in rng.sample(found, min(len(found), rng.choice([1, 4, 20]))):
        group[key] = group[key] + rng.gauss(0, far)


def strange(rng: Random, values: Any) -> None:
    group, key = rng.choice(places(values))
    group[key] = copy.deepcopy(rng.choice(STRANGE))


def removed(rng: Random, values: Any) -> None:
    group, key = rng.choice(places(values))
    del group[key]


def repeated(rng: Random, values: Any) -> None:
    group, key = rng.choice(places(values))
    if isinstance(group, list):
        group[key:key] = [copy.deepcopy(group[key]) for _ in range(rng.choice([1, 1, 3, 300, 6000]))]
    else:
        for n in range(rng.choice([1, 3, 60, 600])):
            group[f"{key}_{n}"] = copy.deepcopy(group[key])


def reordered(rng: Random, values: Any) -> None:
    lists = [group[key] for group, key in places(values) if isinstance(group[key], list) and len(group[key]) > 1]
    if lists:
        rng.shuffle(rng.choice(lists))


def grafted(rng: Random, values: Any) -> None:
    """A piece of another scene where one of the same name was, or anywhere."""
    other = copy.deepcopy(rng.choice(bases()).values)
    taken, at = rng.choice(places(other)), places(values)
    alike = [place for place in at if place[1] == taken[1]]
    group, key = rng.choice(alike if alike and rng.random() < 0.7 else at)
    group[key] = taken[0][taken[1]]


def section(rng: Random, values: Any) -> None:
    name = rng.choice(list(SECTIONS))
    values[name] = copy.deepcopy(rng.choice(SECTIONS[name]))


def retyped(rng: Random, values: Any) -> None:
    found = [group for group, key in places(values) if key == "type"]
    if found:
        rng.choice(found)["type"] = rng.choice([g["type"] for base in bases() for g, k in places(base.values) if k == "type"])


MUTATORS = {f.__name__: f for f in (number, shaken, strange, removed, repeated, reordered, grafted, section, retyped)}
WEIGHTS = [8, 4, 3, 2, 2, 1, 4, 4, 2]
