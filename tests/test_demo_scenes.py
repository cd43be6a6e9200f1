"""The scenes made from real photographs: their annotations alone, so that nothing need be fetched.

Camera, geometry and sun direction ask of the photograph only its size, which photograph.yaml states.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from pipeline.geometry.camera import yaw_pitch_roll
from pipeline.geometry.raycast import first_hits
from pipeline.paths import Build
from pipeline.scene.artefacts import read_camera, write_json
from pipeline.scene.load import load_scene
from pipeline.stages import camera as camera_stage, geometry as geometry_stage, sun_direction as sun_stage

SCENES = Path(__file__).resolve().parent.parent / "scenes"
#: What may lie outside the frame: a lamp or window that the frame cuts off, the foreground below it, and the
#: end of a long shape.
OUTSIDE = {"sunroom": {"lights.sky"}, "lobby": {"shapes.bench"}}


@pytest.fixture(scope="module", params=["sunroom", "lobby"])
def placed(request, tmp_path_factory):
    """A scene with its camera, geometry and sun direction, by the stages' own code."""
    name = request.param
    view = YAML(typ="safe").load(SCENES / name / "photograph.yaml")["view"]
    scene = load_scene(SCENES / name / "scene.yaml")
    build = Build(name, None, SCENES, tmp_path_factory.mktemp("build"))
    write_json(build.photograph_facts, {"width_pixel": view["width"], "height_pixel": view["height"],
                                        "focal_length_35mm_mm": None})
    data = scene.model_dump(mode="json")
    for part in ("camera", "depth", "shapes", "lights", "sun_direction"):
        write_json(build.input(part), data[part])
    camera_stage.run(build)
    geometry_stage.run(build)
    sun_stage.run(build)
    return name, view, data, build


def pixels_in(node, path=""):
    """(path, [u, v]) of every annotated pixel below `node`."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from pixels_in(value, f"{path}.{key}" if path else key)
    elif isinstance(node, list) and len(node) == 2 and all(isinstance(x, (int, float)) for x in node):
        yield path, node
    elif isinstance(node, list):
        for value in node:
            yield from pixels_in(value, path)


def test_annotations_lie_in_the_frame_or_are_meant_not_to(placed):
    name, view, data, _ = placed
    sections = {key: data[key] for key in ("camera", "shapes", "lights", "illumination")}
    found = list(pixels_in(sections))
    assert len(found) > 30  # the walk finds them at all
    outside = {".".join(path.split(".")[:2]) for path, (u, v) in found
               if not (0 <= u <= view["width"] and 0 <= v <= view["height"])}
    assert outside <= OUTSIDE[name]


def test_the_lines_give_the_view_that_the_photograph_was_taken_with(placed):
    name, view, _, build = placed
    camera = read_camera(build)
    _, pitch, roll = yaw_pitch_roll(camera.world_from_camera)
    assert json.loads(build.camera.read_text())["residual_rms_pixel"] < 3  # clicks are good to 2 pixels
    # A panorama need not be level: 13 lines of the lobby, with 0.8 px left over, say 11.6, not 13.
    assert abs(pitch - view["pitch_degree"]) < (0.5 if name == "sunroom" else 2)
    assert abs(roll) < 0.5
    expected = view["width"] / 2 / np.tan(np.radians(view["horizontal_field_of_view_degree"]) / 2)
    assert camera.focal_length == pytest.approx(expected)


def test_boxes_fit_their_clicks(placed):
    _, _, _, build = placed
    residuals = json.loads(build.geometry.read_text())["residuals_pixel"]
    assert residuals
    for shape, of_shape in residuals.items():
        assert of_shape["rms"] < 3, shape  # clicks are good to 2 pixels


def test_every_pixel_shows_a_shape(placed):
    _, _, _, build = placed
    assert not any("look past" in message for message in json.loads(build.geometry.read_text())["messages"])


def test_visible_lamps_can_be_seen(placed):
    _, _, data, build = placed
    camera = read_camera(build)
    lights = json.loads(build.geometry.read_text())["lights"]
    shown = [name for name, light in data["lights"].items() if light["type"] == "area" and light["visible"]]
    assert shown
    for name in shown:
        polygon = np.array(lights[name]["outline"]["points"])
        _, hit = first_hits(camera.position, camera.directions(camera.pixel_centres()), [polygon])
        assert (hit == 0).sum() > 50, name  # the smallest lamp has about 100 pixels


def test_the_sun_of_the_sunroom_is_determined(placed):
    name, _, _, build = placed
    suns = json.loads(build.sun_direction.read_text())["suns"]
    if name == "lobby":
        assert not suns
        return
    sun = suns["sun"]
    assert sun["status"] == "determined"
    assert sun["openings"]["window"]["overlap"] > 0.9  # 2 pixels round its outline are 5 %
    assert sun["confidence_degree"] < 2
    # the bars' shadows on the floor run 26 to 28 degrees from the x axis, and climb the wall at dy/dx = -0.84
    x, y, z = sun["sun_direction"]
    assert np.degrees(np.arctan2(-z, x)) == pytest.approx(27, abs=2)
    assert y / x == pytest.approx(-0.84, abs=0.03)
