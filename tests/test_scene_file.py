"""The scene file: its JSON Schema, overrides, named fogs, and which parts a change touches."""

from __future__ import annotations

import json
import os
from pathlib import Path

import fastjsonschema
import imagecodecs
import numpy as np
import pytest
from ruamel.yaml import YAML

from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.paths import SCHEMA
from pipeline.scene.load import load_scene, read_scene

SCENES = Path(__file__).resolve().parent.parent / "scenes"
BATHROOM = SCENES / "bathroom" / "scene.yaml"
PARTS = ("photograph", "camera", "shapes", "lights", "strengths", "gains", "illumination", "sun_direction",
         "fog",
         "render")


# ---- JSON Schema ---------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def schema():
    return json.loads((SCENES / SCHEMA).read_text())


@pytest.fixture(scope="module")
def validate(schema):
    return fastjsonschema.compile(schema)


def plain(path: Path) -> dict:
    return YAML(typ="safe", pure=True).load(path.read_text())


def test_schema_is_current(tmp_path):
    assert main(["schema", "--output", str(tmp_path / SCHEMA)]) == 0
    assert (tmp_path / SCHEMA).read_text() == (SCENES / SCHEMA).read_text(), "run `make schema`"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*/scene.yaml")), ids=lambda path: path.parent.name)
def test_scenes_are_valid(path, validate):
    assert load_scene(path).lights
    validate(plain(path))
    assert path.read_text().startswith("# yaml-language-server: $schema=../scene.schema.json\n")


@pytest.mark.parametrize("keys, value", [
    (("fog", "visibilty"), 3), (("fog", "visibility"), -3), (("fog", "visibility"), "3 m"),
    (("fog", "type"), "homogenous"),
    (("fog",), {"visibility": 3}), (("lights", "sun", "type"), "son"), (("lights", "sun", "gain"), -1),
    (("lights", "my lamp"), {"type": "point", "position": {"point": [0, 0, 0]}}),
    (("shapes", "room", "corner"), {}),
    (("camera", "lines", "w"), []), (("camera", "height"), [1]), (("photograph",), {}), (("renders",), {}),
])
def test_schema_and_pipeline_refuse_the_same(keys, value, validate, tmp_path):
    scene = plain(BATHROOM)
    group = scene
    for key in keys[:-1]:
        group = group[key]
    group[keys[-1]] = value
    with pytest.raises(fastjsonschema.JsonSchemaValueException):
        validate(scene)
    (tmp_path / "scene.yaml").write_text(json.dumps(scene))
    with pytest.raises(InputError):
        load_scene(tmp_path / "scene.yaml")


def test_schema_tells_units_and_meanings(schema):
    visibility = schema["$defs"]["Homogeneous"]["properties"]["visibility"]
    assert visibility["unit"] == "m" and "contrast" in visibility["description"]
    assert schema["$defs"]["HenyeyGreenstein"]["properties"]["asymmetry"]["maximum"] == 0.999


# ---- what YAML means -----------------------------------------------------------------------------

def test_values_and_lines(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("a:\n  on: yes\n  7: [1, 2.5e-3,\n      .inf]\nb: 2020-01-31\nc: ~\nd: !!str 3\n")
    text = read_scene(path)
    # YAML 1.2: `on` and `yes` are words, as every editor's checker reads them
    assert text.values == {"a": {"on": "yes", "7": [1, 2.5e-3, float("inf")]}, "b": "2020-01-31", "c": None,
                           "d": "3"}
    assert text.line(("a", "7", 2)) == 4 and text.line(("b",)) == 5
    assert text.line(("a", "missing", "deeper")) == 1


# ---- overrides and fogs --------------------------------------------------------------------------

@pytest.mark.parametrize("key, value, read", [
    ("fog.visibility", "3", lambda s: s.fog.visibility == 3),
    ("fog.visibility", ".inf", lambda s: s.fog.is_clear()),
    ("fog.phase_function", "{type: rayleigh}", lambda s: s.fog.phase_function.type == "rayleigh"),
    ("fogs.thin.visibility", "31", lambda s: s.fogs["thin"].visibility == 31 and s.fog.visibility == 9),
    ("lights.ceiling_lamp.gain", "0.5",
     lambda s: s.lights["ceiling_lamp"].gain == 0.5 and s.lights["sun"].gain == 1),
    ("lights.sun.openings.window.patches.0.pixels.1", "[250, 351]",
     lambda s: s.lights["sun"].openings["window"].patches[0].pixels[1] == [250, 351]),
    ("lights.bulb", "{type: point, position: {point: [0, 1, 0]}}", lambda s: "bulb" in s.lights),
    ("render.samples", "48", lambda s: s.render.samples == 48),  # the file has no `render`
    ("photograph.file", "photograph.exr", lambda s: s.photograph.file == "photograph.exr"),
])
def test_override(key, value, read, tmp_path):
    path = tmp_path / "scene.yaml"
    fogs = "fog: {type: homogeneous, visibility: 9}\nfogs: {thin: {type: homogeneous, visibility: 30}}\n"
    path.write_text(BATHROOM.read_text().split("\nfog:")[0] + "\n" + fogs)
    assert not read(load_scene(path))
    assert read(load_scene(path, {key: value}))


def test_named_fog(tiny_scene):
    assert load_scene(tiny_scene.file).fog.visibility == 6
    assert load_scene(tiny_scene.file, fog="thick").fog.visibility == 2


def test_override_of_the_picked_fog(tiny_scene):
    scene = load_scene(tiny_scene.file, {"fog.phase_function.asymmetry": "0.9"}, "thick")
    # `thick` states no phase function: the override begins with its default
    assert scene.fog.phase_function.asymmetry == 0.9 and scene.fog.visibility == 2
    assert load_scene(tiny_scene.file, {"fog.visibility": "3"}, "thick").fogs["thick"].visibility == 3


def test_overrides_from_make(tiny_scene, monkeypatch):
    """Make hands them over one a line; what stands on the command line wins."""
    monkeypatch.setenv("FOG_OVERRIDES", "fog.visibility=3\n render.samples=9\n\n")
    assert tiny_scene.run("resolve", overrides=("render.samples=10",)) == 0
    assert json.loads(tiny_scene.build.input("fog").read_text())["visibility"] == 3
    assert json.loads(tiny_scene.build.input("render").read_text())["samples"] == 10


# ---- what a change touches -----------------------------------------------------------------------

def touched(scene, change, **options) -> set[str]:
    """Inputs that `change` followed by resolving writes anew."""
    assert scene.run("resolve") == 0
    inputs = {part: scene.build.input(part) for part in PARTS}
    for path in inputs.values():
        os.utime(path, ns=(0, 0))
    change()
    assert scene.run("resolve", **options) == 0
    return {part for part, path in inputs.items() if path.stat().st_mtime_ns != 0}


def test_resolving_again_touches_nothing(tiny_scene):
    assert touched(tiny_scene, lambda: None) == set()


@pytest.mark.parametrize("override, part", [
    ("fog.visibility=3", "fog"), ("lights.lamp.gain=0.5", "gains"),
    ("lights.lamp.radiance=[1,2,3]", "strengths"),
    ("lights.lamp.sub_lights=3", "lights"), ("shapes.room.upper.1=2.6", "shapes"),
    ("camera.roll=1", "camera"),
    ("render.samples=9", "render"), ("photograph.colour_space=linear", "photograph"),
    ("illumination.bounces=1", "illumination"), ("sun_direction.starts=3", "sun_direction"),
])
def test_override_touches_its_part_alone(override, part, tiny_scene):
    assert touched(tiny_scene, lambda: None, overrides=(override,)) == {part}


def test_comments_and_order_touch_nothing(tiny_scene):
    def reorder():
        text = tiny_scene.file.read_text()
        first = text.index("fog:")
        tiny_scene.file.write_text("# in the morning\n" + text[first:] + text[:first])
    assert touched(tiny_scene, reorder) == set()


def test_other_pixels_touch_the_photograph_alone(tiny_scene):
    def repaint():
        path = tiny_scene.folder / "photograph.png"
        path.write_bytes(imagecodecs.png_encode(np.zeros((18, 24, 3), np.uint8)))
    assert touched(tiny_scene, repaint) == {"photograph"}


def test_another_fog_keeps_to_its_folder(tiny_scene):
    assert touched(tiny_scene, lambda: None, fog="thick") == set()
    fog = tiny_scene.build.shared / "thick" / "inputs" / "fog.json"
    assert json.loads(fog.read_text())["visibility"] == 2
