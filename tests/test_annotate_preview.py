"""What a page shows of a scene while it is annotated: lines, problems where they are, and fog at draft quality."""

from __future__ import annotations

import copy
import json
import threading
import time
from dataclasses import asdict

import cv2
import numpy as np
import pytest
from ruamel.yaml import YAML

from pipeline.annotate.preview import drafting
from pipeline.annotate.preview.preview import Preview
from pipeline.annotate.preview.scaled import scaled
from pipeline.annotate.preview.sliders import altered
from pipeline.errors import InputError
from pipeline.plugins.media.homogeneous import Homogeneous
from pipeline.scene.depth_section import DepthSection

#: Of the screen's 255 codes: between foggy pictures of the draft and of the pipeline, of a small scene with a wide room.
OFF = 3.0
#: The same between pictures led over to another fog and made for it.
LED_OVER = 2.0


@pytest.fixture
def data(tiny_scene):
    return YAML(typ="safe").load(tiny_scene.file)


@pytest.fixture
def preview(tiny_scene):
    one = Preview(tiny_scene.root / "scenes", "tiny", tiny_scene.root / "preview")
    yield one
    one.close()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A preview of the tiny scene with its estimate, for tests that only look; and the scene's data."""
    from conftest import TinyScene, write_tiny

    scene = TinyScene(tmp_path_factory.mktemp("made"))
    write_tiny(scene.folder)
    data = YAML(typ="safe").load(scene.file)
    one = Preview(scene.root / "scenes", "tiny", scene.root / "preview")
    assert one.estimate(data) == []
    until(lambda: one._made.sliders.complete)
    yield one, data, scene
    one.close()


def until(done, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end
        time.sleep(0.02)


def rms(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(((one.astype(float) - other) ** 2).mean()))


def places(problems) -> set:
    return {problem.place for problem in problems}


def test_lines_lie_where_the_camera_sees_them(preview, data):
    shown, problems = preview.geometry(data)
    assert problems == [] and shown.size == [24, 18] and shown.rooms == ["room"]
    focal = 12 / np.tan(np.radians(35))
    assert shown.focal_length == pytest.approx(focal)
    # level, looking along -z: the horizon is the middle row, and x and y meet nowhere
    assert [point[1] for point in shown.horizon] == pytest.approx([9, 9], abs=0.01)
    assert shown.vanishing_points == {"x": None, "y": None, "z": pytest.approx([12, 9], abs=0.01)}
    corner = [12 - focal * 2 / 5, 9 + focal * 1.2 / 5]  # of floor, left and back wall, 5 m away and 1.2 m below the eye
    assert np.abs(np.subtract(shown.faces["room.floor"], corner)).sum(1).min() < 0.02
    assert len(shown.lamps["lamp"][0]) == 4 and len(shown.bulbs["bulb"]) == 1
    json.dumps(asdict(shown))


def test_planes_are_named_for_what_is_put_on_them(preview, data):
    preview.geometry(data)
    assert preview.plane_at([12, 17.5]) == "room.floor" and preview.plane_at([12, 9]) == "room.back"
    assert "room.ceiling" in preview.planes()


def test_the_first_states_show_what_can_be_shown(preview):
    shown, problems = preview.geometry({"photograph": {"file": "photograph.png"}})
    assert shown.horizon is None and shown.size == [24, 18]
    assert places(problems) == {("camera",), ("lights",), ("fog",)} and {one.severity for one in problems} == {"warning"}
    assert any("draw 'lines'" in one.remedy for one in problems)

    shown, problems = preview.geometry({"photograph": {"file": "photograph.png"},
                                        "camera": {"lines": {"z": [[[2, 2], [7, 7]], [[2, 16], [8, 10]]]}}})
    assert shown.vanishing_points["z"] == pytest.approx([9, 9], abs=0.01)
    assert all(one.severity == "warning" for one in problems if one.place == ("camera",))

    # without a scale the camera is known all the same
    shown, problems = preview.geometry({"photograph": {"file": "photograph.png"}, "camera": {"horizontal_field_of_view": 70}})
    assert shown.horizon is not None and not shown.scale_known
    assert next(one for one in problems if one.place == ("camera",)).severity == "warning"


def test_nothing_is_no_scene(preview):
    for empty in ({}, {"photograph": None}, {"photograph": {"file": "../other.png"}}, {"photograph": {"file": "no.png"}, "lights": 3}):
        shown, problems = preview.geometry(empty)
        assert shown is None and problems
        preview.estimate(empty)


def test_no_picture_without_a_photograph(preview):
    with pytest.raises(InputError, match="no photograph"):
        preview.foggy()
    with pytest.raises(InputError, match="no photograph"):
        preview.photograph({})


def test_one_broken_part_hides_no_other(preview, data):
    data["shapes"]["box"] = {"type": "cuboid", "centre": [0, 0.5, -4], "size": [1, 1, 1], "colour": "red"}
    data["shapes"]["good"] = {"type": "cuboid", "centre": [1, 0.5, -4], "size": [0.5, 1, 0.5]}
    data["lights"]["lamp"]["outline"] = {"on": "box.top", "pixels": [[10, 8], [14, 8], [14, 10]]}
    data["lights"]["second"] = {"type": "point", "position": {"pixel": [12, 3], "on": "room.floor"}}
    data["fog"]["single_scattering_albedo"] = [2, 1, 1]
    shown, problems = preview.geometry(data)
    found = places(problems)
    assert {("shapes", "box", "colour"), ("lights", "lamp", "outline"), ("lights", "second", "position"),
            ("fog", "single_scattering_albedo", 0)} <= found
    waits = next(one for one in problems if one.place == ("lights", "lamp", "outline"))
    assert "waits for box" in waits.message and waits.severity == "warning"
    assert "beyond the horizon of room.floor" in next(one for one in problems if one.place[:2] == ("lights", "second")).message
    assert "good" in shown.wireframes and "bulb" in shown.bulbs


def test_a_box_that_misses_its_clicks_is_named_with_the_worst(preview, data):
    data["shapes"]["box"] = {"type": "cuboid", "stands_on": "room.floor", "corners": {
        "front_left_bottom": [8, 15], "front_right_bottom": [14, 15], "front_left_top": [8, 10],
        "front_right_top": [14, 13], "back_left_top": [9, 9.5]}}
    shown, problems = preview.geometry(data)
    worst = max(shown.corners["box"], key=lambda corner: shown.corners["box"][corner]["residual"])
    missed = next(one for one in problems if "misses the clicks" in one.message)
    assert missed.place == ("shapes", "box", "corners", worst) and missed.severity == "warning"


def test_a_patch_that_no_sun_explains_and_a_lamp_behind_the_wall(preview, data):
    window = [[-2, 1, -4], [-2, 2, -4], [-2, 2, -3], [-2, 1, -3]]
    data["lights"]["sun"] = {"type": "sun", "openings": {"window": {
        "window": {"points": window}, "patches": [{"points": [[-1, 2.5, -4], [0, 2.5, -4], [0, 2.5, -3], [-1, 2.5, -3]]}]}}}
    data["lights"]["far"] = {"type": "point", "position": {"pixel": [12, 9], "depth": 9}, "intensity": [1, 1, 1]}
    shown, problems = preview.geometry(data)
    impossible = next(one for one in problems if "no sun direction explains" in one.message)
    assert impossible.place == ("lights", "sun", "openings", "window", "patches") and impossible.severity == "error"
    behind = next(one for one in problems if one.place == ("lights", "far", "position"))
    assert "4 m behind room.back" in behind.message
    assert shown.windows["sun.window"] and shown.shafts["sun.window"] and "sun" not in shown.suns


def test_regions_have_depths_and_broken_ones_are_left_out(preview):
    data = {"photograph": {"file": "photograph.png"},
            "camera": {"horizontal_field_of_view": 70, "height": 1.6, "horizon": [[0, 9], [24, 9]]},
            "depth": {"regions": {
                "ground": {"class": "support", "pixels": [[0, 9], [24, 9], [24, 18], [0, 18]]},
                "sky": {"class": "sky", "pixels": [[0, 0], [24, 0], [24, 9], [0, 9]]},
                "house": {"class": "vertical", "depth": 12, "pixels": [[2, 3], [9, 3], [9, 11], [2, 11]]},
                "floating": {"class": "vertical", "pixels": [[12, 1], [20, 1], [20, 5], [12, 5]]}}}}
    shown, problems = preview.geometry(data)
    assert shown.regions["house"]["depth"] == pytest.approx(12, rel=0.1) and "floating" not in shown.regions
    assert any(one.place == ("depth", "regions", "floating") and "depth" in one.remedy for one in problems)


def test_the_draft_is_the_pipelines_picture(made):
    preview, data, scene = made
    assert scene.run() == 0
    theirs = cv2.imread(str(scene.build.foggy(".png")))[..., ::-1]
    assert preview.is_current(data) and preview.is_exact(data["fog"])
    assert rms(preview.foggy(), theirs) < OFF


def test_gains_are_exact(made, tmp_path):
    preview, data, scene = made
    louder = copy.deepcopy(data)
    louder["lights"]["lamp"]["gain"] = 0.25
    assert preview.is_current(louder)
    other = Preview(scene.root / "scenes", "tiny", tmp_path / "other")
    other.estimate(louder)
    assert np.abs(preview.foggy(gains={"lamp": 0.25}).astype(int) - other.foggy()).max() <= 1
    assert rms(preview.foggy(gains={"lamp": 0.25}), preview.foggy()) > 3, "it changes the picture"
    other.close()


@pytest.mark.parametrize("values", [{"visibility": 1.5}, {"visibility": 40.0}, {"g": 0.7}, {"albedo": [0.9, 0.7, 0.5]},
                                    {"height": 0.8}])
def test_sliders_lead_to_what_would_be_made(made, tmp_path, values):
    preview, data, scene = made
    other, fog = Preview(scene.root / "scenes", "tiny", tmp_path / "other"), copy.deepcopy(data)
    fog["fog"] = altered(Homogeneous.model_validate(data["fog"]), values).model_dump(mode="json")
    assert not [one for one in other.estimate(fog) if one.severity == "error"]
    assert rms(preview.foggy(values), other.foggy()) < LED_OVER
    assert not preview.is_exact(fog["fog"]) and other.is_exact(fog["fog"])
    other.close()


def test_a_fog_that_cannot_be_is_refused(made):
    with pytest.raises(InputError, match="no fog is such as"):
        made[0].foggy({"visibility": -1})
    with pytest.raises(InputError, match="has no 'colour'"):
        made[0].foggy({"colour": 1})


def test_fog_alone_redoes_no_light(made, monkeypatch):
    preview, data, _ = made
    stages = []
    monkeypatch.setattr(drafting.chain, "run", lambda build, names, done: stages.extend(names))
    denser = copy.deepcopy(data)
    denser["fog"]["visibility"] = 4
    preview.estimate(denser)
    assert stages == [] and preview.is_exact(denser["fog"])


def test_another_geometry_is_shown_at_once_in_the_light_that_was_there(preview, data):
    seen = []

    def rough():
        seen.append((preview.foggy(), preview.is_current(changed), preview.is_exact(changed["fog"])))

    changed = copy.deepcopy(data)
    preview.estimate(data, rough)
    assert not seen, "no light was there"
    before = preview.foggy()
    changed["shapes"]["room"] |= {"lower": [-1, 0.4, -4.2], "upper": [1.5, 2.5, 1]}
    preview.estimate(changed, rough)
    (shown, is_current, is_exact), = seen
    after = preview.foggy()
    assert not is_current and not is_exact and preview.is_current(changed)
    assert rms(shown, after) < 6 < rms(before, after)
    # neither other fog alone, nor a light of which nothing is known yet
    for key, value in (("fog", {**data["fog"], "visibility": 5}), ("lights", {**changed["lights"], "second": changed["lights"]["bulb"]})):
        changed = {**changed, key: value}
        assert preview.estimate(changed, rough) == [] and preview.is_current(changed) and len(seen) == 1


def test_what_is_cancelled_is_never_shown_as_new(preview, data, monkeypatch):
    preview.estimate(data)
    before, changed = preview.foggy(), copy.deepcopy(data)
    changed["lights"]["bulb"]["position"]["point"] = [0.5, 1.4, -4]
    draft = preview._drafting.of

    def slow(*given):
        result = draft(*given)
        preview.cancel()
        return result

    monkeypatch.setattr(preview._drafting, "of", slow)
    preview.estimate(changed)
    assert preview.is_current(data) and not preview.is_current(changed) and np.array_equal(preview.foggy(), before)

    # a later call ends an earlier one
    monkeypatch.setattr(preview._drafting, "of", draft)
    first = threading.Thread(target=preview.estimate, args=(data,))
    first.start()
    preview.estimate(changed)
    first.join()
    assert preview.is_current(changed)


def test_before_an_estimate_the_photograph_is_shown(preview, data, tiny_scene):
    preview.geometry(data)
    assert np.array_equal(preview.foggy(), preview.photograph(data))
    assert {path.name for path in tiny_scene.folder.iterdir()} == {"scene.yaml", "photograph.png"}, "nothing is written there"
    preview.close()
    assert not preview.folder.exists()


def test_only_what_is_annotated_in_pixels_is_scaled():
    section = DepthSection.model_validate({
        "sky_depth": 100.0, "refine": {"radius": 6}, "map": {"file": "d.exr", "focal_length": 50.0},
        "regions": {"house": {"class": "vertical", "foot": [[2.0, 8.0], [4.0, 8.0]], "pixels": [[2.0, 3.0], [9.0, 3.0], [9.0, 11.0]]}}})
    half = scaled(section, 0.5)
    assert half.regions["house"].pixels == [[1.0, 1.5], [4.5, 1.5], [4.5, 5.5]] and half.regions["house"].foot[0] == [1.0, 4.0]
    assert half.sky_depth == 100 and half.refine.radius == 3 and half.map.focal_length == 50
