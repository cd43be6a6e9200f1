"""Annotations of other programs into a scene file and out of it, and the first file of a new scene."""

from __future__ import annotations

import json
import os
import re
import struct
from dataclasses import replace
from pathlib import Path

import imagecodecs
import numpy as np
import pytest

from pipeline.annotate.written.document import SceneDocument
from pipeline.annotate.exchange import coco, cvat, fspy_files, labelme
from pipeline.annotate.exchange.drawings import Drawings
from pipeline.annotate.exchange.exporting import drawings_of
from pipeline.annotate.exchange.importing import import_file, read_file
from pipeline.annotate.exchange.labels import KINDS
from pipeline.annotate.written.new_scene import new_scene
from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, rotation
from pipeline.geometry.fspy import camera_from_fspy
from pipeline.geometry.vanishing_points import calibrate
from pipeline.imaging.photograph_reading import read, read_size
from pipeline.scene.load import load_scene

PROJECT = Path(__file__).resolve().parent.parent
WIDTH, HEIGHT = 60, 40


CUT = imagecodecs.png_encode(np.random.default_rng(1).integers(0, 255, (40, 60, 3), np.uint8))[:3000]


def picture(path: Path, width: int = WIDTH, height: int = HEIGHT) -> Path:
    path.write_bytes(imagecodecs.png_encode(np.full((height, width, 3), 100, np.uint8)))
    return path


@pytest.fixture
def scene(tmp_path) -> SceneDocument:
    """A scene that nothing is drawn in yet."""
    return SceneDocument.open(new_scene(tmp_path / "scenes", "mine", picture(tmp_path / "IMG_1.png")))


def given(tmp_path: Path, content: str | bytes | dict, name: str = "annotations.json") -> Path:
    path = tmp_path / name
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def shape(label, kind="polygon", points=((1, 2), (9, 2), (9, 8.123456))):
    return {"label": label, "shape_type": kind, "points": [list(p) for p in points], "group_id": None, "flags": {}}


def labelled(*shapes, width=WIDTH, height=HEIGHT):
    return {"version": "5.5.0", "flags": {}, "shapes": list(shapes), "imagePath": "IMG_1.png", "imageData": None,
            "imageHeight": height, "imageWidth": width}


# ---- a new scene ----------------------------------------------------------------------------------

def test_new_scene_is_whole_and_says_what_is_still_to_be_drawn(tmp_path):
    photo = picture(tmp_path / "IMG 1.PNG")
    path = new_scene(tmp_path / "scenes", "mine", photo)
    assert path == tmp_path / "scenes/mine/scene.yaml"
    assert sorted(p.name for p in path.parent.iterdir()) == ["photograph.png", "scene.yaml"]
    assert (path.parent / "photograph.png").read_bytes() == photo.read_bytes()
    assert os.listdir(tmp_path / "scenes") == ["mine"] and "# 60 x 40 pixels" in path.read_text()
    with pytest.raises(InputError, match="neither 'shapes' nor 'depth' is there; describe a room by 'shapes', the open air by"):
        load_scene(path)
    document = SceneDocument.open(path)
    document.set(("shapes", "room", "edges", "floor_back"), [[1, 30], [50, 30]])
    document.set(("shapes", "room", "type"), "room")
    document.save()
    assert load_scene(path).camera.horizontal_field_of_view == 65
    assert "# To be drawn: for the camera" in path.read_text()


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden", "inputs", "a..b", "two words", "x" * 90])
def test_names_that_no_scene_may_have(tmp_path, name):
    with pytest.raises(InputError, match="scene name"):
        new_scene(tmp_path / "scenes", name, picture(tmp_path / "photo.png"))
    assert sorted(os.listdir(tmp_path)) == ["photo.png"]


@pytest.mark.parametrize("content, said", [
    (b"", "the file is empty"), (b"no picture at all", "not a readable image"), (None, "no such file"),
    (CUT, "truncated or damaged|not a readable image")])
def test_what_is_no_photograph_leaves_nothing(tmp_path, content, said):
    photo = tmp_path / "photo.png"
    if content is not None:
        photo.write_bytes(content)
    with pytest.raises(InputError, match=said):
        new_scene(tmp_path / "scenes", "mine", photo)
    assert not (tmp_path / "scenes").exists() or not os.listdir(tmp_path / "scenes")


def test_new_scene_never_touches_what_is_there(tmp_path):
    photo = picture(tmp_path / "photo.png")
    (tmp_path / "scenes/mine").mkdir(parents=True)
    with pytest.raises(InputError, match="'mine' is there already"):
        new_scene(tmp_path / "scenes", "mine", photo)
    assert os.listdir(tmp_path / "scenes/mine") == []
    (tmp_path / "scenes/link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="'link' is there already"):
        new_scene(tmp_path / "scenes", "link", photo)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="is no plain file"):
        new_scene(tmp_path / "scenes", "other", tmp_path / "pipe")
    assert sorted(os.listdir(tmp_path / "scenes")) == ["link", "mine"]


# ---- labels -----------------------------------------------------------------------------------------

def test_a_room_from_labelme(scene, tmp_path):
    file = given(tmp_path, labelled(
        shape("light:lamp"), shape("window:left@room.left"), shape("patch:left"), shape("patch:left@room.back"),
        shape("floor", points=[(50, 39), (10, 39), (20, 25), (40, 25)]), shape("room:back_left", "line", [(20, 25), (20, 3)]),
        shape("room:back_left_ceiling", "point", [(20, 3)]), shape("x", "line", [(20, 25), (40, 25)]),
        shape("x", "linestrip", [(20, 3), (30, 3), (40, 3)]), shape("box:table:front_left_top", "point", [(5, 6)]),
        shape("light:bulb@room.back", "point", [(5, 6)]), shape("light:lamp", "rectangle", [(1, 2), (5, 4)])))
    text = scene.text
    said = import_file(scene, file, (WIDTH, HEIGHT))
    data = scene.data
    assert data["lights"]["lamp"] == {"type": "area", "outline": {"on": "room.ceiling", "pixels": [[1, 2], [9, 2], [9, 8.12]]}}
    assert data["lights"]["lamp_2"]["outline"]["pixels"] == [[1, 2], [5, 2], [5, 4], [1, 4]]
    assert data["lights"]["bulb"] == {"type": "point", "position": {"on": "room.back", "pixel": [5, 6]}}
    assert data["lights"]["sun"]["openings"]["left"]["window"]["on"] == "room.left"
    assert [p["on"] for p in data["lights"]["sun"]["openings"]["left"]["patches"]] == ["room.floor", "room.back"]
    assert data["shapes"]["room"] == {
        "type": "room", "corners": {"back_left_ceiling": [20, 3]},
        "edges": {"floor_back": [[20, 25], [40, 25]], "floor_left": [[20, 25], [10, 39]], "floor_right": [[40, 25], [50, 39]],
                  "back_left": [[20, 25], [20, 3]]}}
    assert data["shapes"]["table"] == {"type": "cuboid", "stands_on": "room.floor", "corners": {"front_left_top": [5, 6]}}
    assert data["camera"]["lines"] == {"x": [[[20, 25], [40, 25]], [[20, 3], [40, 3]]]}
    assert "imported: lights.lamp from outline 'light:lamp'" in said and len(said) == 12
    assert all(line in scene.text for line in text.splitlines()), "what a new scene says stays"
    scene.save()
    assert load_scene(scene.path).lights["lamp"].type == "area"
    assert scene.undo() and scene.text == text and not scene.undo()


def test_the_open_air_from_labelme(scene, tmp_path):
    file = given(tmp_path, labelled(
        shape("sky"), shape("ground"), shape("region:tree"), shape("region:tree"), shape("region:bench:support"), shape("hole:tree"),
        shape("foot:tree", "line", [(1, 9), (9, 9)]), shape("horizon", "line", [(0, 20), (60, 21)]), shape("shadowed"),
        shape("sunlit@tree"), shape("shadow", "linestrip", [(1, 2), (3, 4), (5, 6)])))
    import_file(scene, file, (WIDTH, HEIGHT))
    data = scene.data
    assert {name: r["class"] for name, r in data["depth"]["regions"].items()} == {
        "sky": "sky", "ground": "support", "tree": "vertical", "tree_2": "vertical", "bench": "support"}
    assert list(data["depth"]["regions"]["tree"]) == ["class", "pixels", "holes", "foot"]
    assert data["sun_direction"] == {"type": "cast_shadow", "shadows": [{"foot": [1, 2], "tip": [3, 4], "shadow": [5, 6]}]}
    assert data["illumination"]["type"] == "liu_xing" and data["illumination"]["sunlit"][0]["on"] == "tree"
    scene.save()
    assert load_scene(scene.path).depth.regions["sky"].surface == "sky"


@pytest.mark.parametrize("one, said", [
    (shape("tree"), "'tree' does not say what it is in the scene; label it KIND:NAME"),
    (shape("lihgt:lamp"), r"did you mean 'light'\?"),
    (shape("light"), "'light' needs a name"),
    (shape("light:two words"), "needs a name of letters"),
    (shape("x"), "'x' is drawn as an outline; draw a line"),
    (shape("region:a", "line", [(1, 2), (3, 4)]), "drawn as a line; draw an outline"),
    (shape("region:a:wall"), "of no known class; use one of sky, support, vertical"),
    (shape("room:corner", "point", [(1, 2)]), "names no corner of a room"),
    (shape("window:left"), "does not say in which wall it is; label it window:left@room.left"),
    (shape("light:bulb", "point", [(1, 2)]), "does not say how far the bulb is"),
    (shape("floor"), "has 3 corners; draw its four corners"),
    (shape("shadow", "line", [(1, 2), (3, 4)]), "has 2 points; draw three"),
    (shape("region:a", "circle"), "circle 'region:a': only polygon, rectangle"),
    (shape("region:a", points=[(1, 2), (3, 4)]), "2 points, fewer than the 3"),
    (shape("region:a", points=[(1, 2), (3, float("nan")), (1, 4)]), "are no pairs of numbers"),
    (shape("region:a", points=[(1, 2), (3, 1e9), (1, 4)]), "are no pairs of numbers"),
    (shape("region:a", points=[(1, 2), (3, True), (1, 4)]), "are no pairs of numbers"),
    (shape(""), "polygon has no label"),
    (shape("x:\x1b[31m\n"), "polygon 'x:\N{REPLACEMENT CHARACTER}"),
    (shape("region:" + "a" * 300), "longer than 200 characters"),
    ("x", "shape 0 is no shape"),
])
def test_what_cannot_be_imported_is_named(scene, tmp_path, one, said):
    found = import_file(scene, given(tmp_path, labelled(one, shape("sky"))), (WIDTH, HEIGHT))
    (line,) = [line for line in found if line.startswith("left out: ")]
    assert re.search(said, line) and "\n" not in line
    assert list(scene.get(("depth", "regions"))) == ["sky"]


def test_nothing_that_can_be_used(scene, tmp_path):
    with pytest.raises(InputError, match="nothing in it can be used.*'tree' does not say what it is"):
        import_file(scene, given(tmp_path, labelled(shape("tree"))), (WIDTH, HEIGHT))
    assert not scene.changed


def test_what_is_there_is_never_replaced_unsaid(scene, tmp_path):
    import_file(scene, given(tmp_path, labelled(shape("light:lamp"), shape("patch:left"), shape("sky"))), (WIDTH, HEIGHT))
    scene.set(("lights", "lamp", "sub_lights"), 8)
    before = scene.text
    other = given(tmp_path, labelled(shape("light:lamp", points=[(0, 0), (5, 0), (5, 5)]), shape("patch:left", points=[(1, 2), (9, 2), (9, 7)]),
                                     shape("x", "line", [(1, 2), (3, 4)])))
    with pytest.raises(InputError, match="lights.lamp.outline.pixels, lights.sun.openings.left.patches: are in the scene already;"
                                         r" allow it to be replaced \(replace=yes\)"):
        import_file(scene, other, (WIDTH, HEIGHT))
    assert scene.text == before
    said = import_file(scene, other, (WIDTH, HEIGHT), replace=True)
    assert "replaced: lights.lamp.outline.pixels" in said
    assert scene.get(("lights", "lamp")) == {"type": "area", "sub_lights": 8, "outline": {
        "on": "room.ceiling", "pixels": [[0, 0], [5, 0], [5, 5]]}}
    assert len(scene.get(("lights", "sun", "openings", "left", "patches"))) == 1
    # the same again changes nothing, and needs no leave
    before = scene.text
    import_file(scene, given(tmp_path, labelled(shape("light:lamp", points=[(0, 0), (5, 0), (5, 5)]))), (WIDTH, HEIGHT))
    assert scene.text == before
    # a lamp of another kind takes nothing of the old one along
    bulb = given(tmp_path, labelled(shape("light:lamp@room.back", "point", [(1, 2)])))
    with pytest.raises(InputError, match="lights.lamp: is in the scene already"):
        import_file(scene, bulb, (WIDTH, HEIGHT))
    import_file(scene, bulb, (WIDTH, HEIGHT), replace=True)
    assert scene.get(("lights", "lamp")) == {"type": "point", "position": {"on": "room.back", "pixel": [1, 2]}}


def test_lines_do_not_stand_beside_a_horizon(scene, tmp_path):
    scene.set(("camera", "horizon"), [[0, 20], [60, 20]])
    file = given(tmp_path, labelled(shape("z", "line", [(1, 2), (3, 4)])))
    with pytest.raises(InputError, match="camera.horizon: is in the scene already"):
        import_file(scene, file, (WIDTH, HEIGHT))
    import_file(scene, file, (WIDTH, HEIGHT), replace=True)
    assert "horizon" not in scene.get(("camera",))


def test_pictures_of_other_sizes(scene, tmp_path):
    twice = given(tmp_path, labelled(shape("sky"), width=2 * WIDTH, height=2 * HEIGHT + 1))
    said = import_file(scene, twice, (WIDTH, HEIGHT))
    assert "note: drawn on 120 x 81 pixels, the photograph has 60 x 40: scaled by 0.5" in said
    assert scene.get(("depth", "regions", "sky", "pixels"))[1] == [4.5, pytest.approx(0.99)]
    with pytest.raises(InputError, match="drawn on 40 x 60 pixels, the photograph has 60 x 40: another shape; draw on"):
        import_file(scene, given(tmp_path, labelled(shape("ground"), width=HEIGHT, height=WIDTH)), (WIDTH, HEIGHT))
    unsaid = labelled(shape("ground"))
    del unsaid["imageWidth"]
    assert any("does not say how large" in line for line in import_file(scene, given(tmp_path, unsaid), (WIDTH, HEIGHT)))


def test_outlines_with_too_many_corners_are_simplified(scene, tmp_path):
    angles = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    ring = np.stack([30 + 20 * np.cos(angles), 20 + 15 * np.sin(angles)], 1)
    said = import_file(scene, given(tmp_path, labelled(shape("light:lamp", points=ring.tolist()))), (WIDTH, HEIGHT))
    assert any("corners instead of 3000, within" in line for line in said)
    found = np.array(scene.get(("lights", "lamp", "outline", "pixels")))
    assert 3 < len(found) <= 200
    assert np.abs(np.hypot((found[:, 0] - 30) / 20, (found[:, 1] - 20) / 15) - 1).max() < 1e-2


# ---- CVAT -----------------------------------------------------------------------------------------

CVAT = """<?xml version="1.0" encoding="utf-8"?>
<annotations><version>1.1</version><meta><task><name>x</name></task></meta>
<image id="0" name="other.png" width="9" height="9"><polygon label="ground" points="1,2;3,4;5,6"/></image>
<image id="1" name="some/photograph.png" width="60" height="40">
 <polygon label="light:lamp" source="manual" occluded="0" points="1.00,2.00;9.00,2.00;9.00,8.00" z_order="0"></polygon>
 <polyline label="x" points="1.5,2;9,2"/><points label="room:back_left_floor" points="4,5"/>
 <box label="region:house" xtl="1" ytl="2" xbr="5" ybr="4"/><box label="sky" xtl="1" ytl="2" xbr="5" ybr="4" rotation="20"/>
 <cuboid label="box:table" xtl1="10" ytl1="20" xbl1="10" ybl1="30" xtr1="20" ytr1="20" xbr1="20" ybr1="30"
   xtl2="24" ytl2="16" xbl2="24" ybl2="24" xtr2="15" ytr2="16" xbr2="15" ybr2="24"/>
 <mask label="sky" rle="1, 2" left="0" top="0" width="3" height="1"/>
</image></annotations>"""


def test_cvat(scene, tmp_path):
    said = import_file(scene, given(tmp_path, CVAT, "annotations.xml"), (WIDTH, HEIGHT))
    data = scene.data
    assert data["lights"]["lamp"]["outline"]["pixels"] == [[1, 2], [9, 2], [9, 8]]
    assert data["camera"]["lines"]["x"] == [[[1.5, 2], [9, 2]]]
    assert data["shapes"]["room"]["corners"] == {"back_left_floor": [4, 5]}
    assert data["depth"]["regions"] == {"house": {"class": "vertical", "pixels": [[1, 2], [5, 2], [5, 4], [1, 4]]}}
    # seen from the front, the right and above: the corner behind on the left, below, is hidden
    assert data["shapes"]["table"]["corners"] == {
        "front_left_top": [10, 20], "front_left_bottom": [10, 30], "front_right_top": [20, 20], "front_right_bottom": [20, 30],
        "back_left_top": [15, 16], "back_right_top": [24, 16], "back_right_bottom": [24, 24]}
    left_out = [line for line in said if line.startswith("left out")]
    assert left_out == ["left out: box 'sky' is turned; draw a polygon instead",
                        "left out: mask 'sky': only polygon, box, polyline, points and cuboid are read"]


def test_a_cuboid_whose_back_is_named_either_way(tmp_path):
    swapped = CVAT.replace('xtl2="24"', 'xtl2="15"').replace('xbl2="24"', 'xbl2="15"').replace(
        'xtr2="15"', 'xtr2="24"').replace('xbr2="15"', 'xbr2="24"')
    found = [next(d for d in cvat.read(text.encode(), ["photograph.png"]).drawn if d.form == "cuboid") for text in (CVAT, swapped)]
    assert found[0] == found[1]


BOMB = '<!DOCTYPE a [<!ENTITY b "bbbb">' + "".join(
    f'<!ENTITY {chr(c + 1)} "{("&" + chr(c) + ";") * 10}">' for c in range(ord("b"), ord("k"))) + "]>"


@pytest.mark.parametrize("content, said", [
    (BOMB + "<annotations>&k;</annotations>", "declares a document type or entities"),
    ('<!DOCTYPE a SYSTEM "file:///etc/passwd"><annotations/>', "declares a document type"),
    (('<?xml version="1.0" encoding="utf-16"?><!DOCTYPE a><annotations/>').encode("utf-16"), "declares a document type"),
    ("<annotations><image", "is no XML"),
    ("<annotations></annotations>", "holds no picture's annotations"),
    ("<annotations><track label='x'/></annotations>", "holds a video's tracks"),
    ("<svg/>", "holds no picture's annotations"),
    ("<a>" * 30 + "</a>" * 30, "nested more than 20 deep"),
])
def test_hostile_and_foreign_xml(scene, tmp_path, content, said):
    with pytest.raises(InputError, match=said):
        import_file(scene, given(tmp_path, content, "annotations.xml"), (WIDTH, HEIGHT))
    assert not scene.changed


def test_which_of_several_pictures(scene, tmp_path):
    file = given(tmp_path, CVAT.replace("some/photograph.png", "a.png"))
    with pytest.raises(InputError, match="2 pictures, and which is the scene's photograph is not clear.*--image NAME, one of other"):
        import_file(scene, file, (WIDTH, HEIGHT))
    import_file(scene, file, (WIDTH, HEIGHT), image="a.png")
    assert "lamp" in scene.get(("lights",))


# ---- COCO ------------------------------------------------------------------------------------------

def test_coco(scene, tmp_path):
    inside = np.zeros((HEIGHT, WIDTH), int)
    inside[10:20, 30:50] = 1
    flat = inside.T.ravel()
    edges = np.flatnonzero(np.diff(np.r_[0, flat, 0]))
    counts = np.diff(np.r_[0, edges, len(flat)]).tolist()
    file = given(tmp_path, {
        "images": [{"id": 7, "file_name": "IMG_1.png", "width": WIDTH, "height": HEIGHT}],
        "categories": [{"id": 1, "name": "tree", "supercategory": "region"}, {"id": 2, "name": "light:lamp"}, {"id": 3, "name": "car"}],
        "annotations": [
            {"id": 1, "image_id": 7, "category_id": 1, "segmentation": [[1, 2, 9, 2, 9, 8], [11, 2, 19, 2, 19, 8]], "iscrowd": 0},
            {"id": 2, "image_id": 7, "category_id": 2, "segmentation": {"counts": counts, "size": [HEIGHT, WIDTH]}, "iscrowd": 1},
            {"id": 3, "image_id": 7, "category_id": 3, "segmentation": [[1, 2, 9, 2, 9, 8]]},
            {"id": 4, "image_id": 7, "category_id": 1, "segmentation": {"counts": "abc", "size": [HEIGHT, WIDTH]}},
            {"id": 5, "image_id": 7, "category_id": 1, "segmentation": {"counts": [10**9], "size": [10**5, 10**5]}},
            {"id": 6, "image_id": 7, "category_id": 1, "segmentation": [], "bbox": [1, 2, 3, 4]},
            {"id": 7, "image_id": 7, "category_id": 1, "segmentation": [[1, 2, 3]]},
            {"id": 8, "image_id": 8, "category_id": 1, "segmentation": [[1, 2, 9, 2, 9, 8]]}]})
    said = import_file(scene, file, (WIDTH, HEIGHT))
    assert list(scene.get(("depth", "regions"))) == ["tree", "tree_2"]
    outline = np.array(scene.get(("lights", "lamp", "outline", "pixels")))
    # the outline goes through the middles of halved pixels
    assert np.abs(outline.min(0) - [30, 10]).max() <= 0.25 and np.abs(outline.max(0) - [50, 20]).max() <= 0.25
    left_out = "\n".join(line for line in said if line.startswith("left out"))
    assert left_out.count("\n") == 4
    for part in ("'car' does not say", "a compressed mask (RLE); export it as a polygon", "do not fill a mask",
                 "has a frame only", "no pairs of numbers"):
        assert part in left_out


# ---- fSpy -------------------------------------------------------------------------------------------

CAMERA = Camera(WIDTH, HEIGHT, 50.0, np.array([30.0, 20]), rotation(20, -12, 3), np.array([0.7, 1.6, -0.4]))


def project(camera: Camera = CAMERA, mode: str = "TwoVanishingPoints", unit: str = "Meters", bits: bytes = b"picture") -> bytes:
    """A project as fSpy saves it: two lines towards each of the vanishing points of x and z."""
    ends = {0: [[-2, 0, -5], [2, 0, -5], [-2, 2, -6], [2, 2, -6]], 2: [[-1, 0, -5], [-1, 0, -9], [1, 2, -5], [1, 2, -9]]}
    lines = {axis: camera.project(np.array(points, float) + [camera.position[0], 0, 0])[0].reshape(2, 2, 2) / [WIDTH, HEIGHT]
             for axis, points in ends.items()}
    held = {axis: {"lineSegments": [[{"x": u, "y": v} for u, v in line] for line in two.tolist()]} for axis, two in lines.items()}
    state = json.dumps({
        "globalSettings": {"calibrationMode": mode},
        "calibrationSettingsBase": {"referenceDistanceAxis": "zPositive", "referenceDistance": 1, "referenceDistanceUnit": unit},
        "controlPointsStateBase": {"firstVanishingPoint": held[0], "origin": {"x": 0.5, "y": 0.5}},
        "controlPointsState2VP": {"secondVanishingPoint": held[2]},
        "cameraParameters": fspy_files.exported(camera)}).encode()
    return struct.pack("<4sIII", b"fspy", 1, len(state), len(bits)) + state + bits


def test_exported_camera_comes_back():
    camera = replace(CAMERA, principal_point=np.array([28.0, 21]))
    found = camera_from_fspy(json.dumps(fspy_files.exported(camera)).encode())
    points = np.array([[0, 0, -4], [1, 2, -6], [-1, 0.5, -3.0]])
    np.testing.assert_allclose(found.project(points)[0], camera.project(points)[0], atol=1e-9)


def test_lines_of_a_project_are_drawn_in_the_scene(scene, tmp_path):
    said = import_file(scene, given(tmp_path, project(), "room.fspy"), (WIDTH, HEIGHT))
    camera = scene.get(("camera",))
    assert set(camera) == {"height", "lines"} and camera["height"] == 1.6 and set(camera["lines"]) == {"x", "z"}
    found = calibrate(width=WIDTH, height=HEIGHT, lines={a: np.array(l, float) for a, l in camera["lines"].items()}).camera
    # coordinates are rounded to 0.01 of 60 pixels
    np.testing.assert_allclose(found.focal_length, CAMERA.focal_length, rtol=0.01)
    np.testing.assert_allclose(found.world_from_camera, CAMERA.world_from_camera, atol=0.01)
    assert said[0] == "imported: camera by its lines along x, z" and not any("own unit" in line for line in said)


@pytest.mark.parametrize("content", [project(mode="OneVanishingPoint"), json.dumps(fspy_files.exported(CAMERA)).encode()],
                         ids=["project", "export"])
def test_a_camera_by_its_angles(scene, tmp_path, content):
    said = import_file(scene, given(tmp_path, content), (WIDTH * 2, HEIGHT * 2))
    camera = scene.get(("camera",))
    assert {key: camera[key] for key in ("yaw", "pitch", "roll")} == {
        key: pytest.approx(value, abs=1e-3) for key, value in {"yaw": 20, "pitch": -12, "roll": 3}.items()}
    assert camera["horizontal_field_of_view"] == pytest.approx(2 * np.degrees(np.arctan(30 / 50)), abs=1e-3)
    assert any("scaled by 2" in line for line in said)
    with pytest.raises(InputError, match="camera.yaw, camera.pitch, camera.roll: the scene has a camera already"):
        import_file(scene, given(tmp_path, content), (WIDTH, HEIGHT))
    import_file(scene, given(tmp_path, content), (WIDTH, HEIGHT), replace=True)


def test_units_of_a_project(scene, tmp_path):
    import_file(scene, given(tmp_path, project(unit="Centimeters")), (WIDTH, HEIGHT))
    assert scene.get(("camera", "height")) == pytest.approx(0.016)
    said = import_file(scene, given(tmp_path, project(unit="No unit")), (WIDTH, HEIGHT), replace=True)
    assert "note: camera.height = 1.6 is in fSpy's own unit: check that it is in metres" in said


@pytest.mark.parametrize("content, said", [
    (project()[:300], "is cut off"), (b"fspy", "is cut off"), (struct.pack("<4sIII", b"fspy", 2, 0, 0), "is of version 2"),
    (struct.pack("<4sIII", b"fspy", 1, 2, 0) + b"{}", "holds no camera"),
    (struct.pack("<4sIII", b"fspy", 1, 2**32 - 1, 2**32 - 1) + b"{}", "is cut off"),
])
def test_damaged_projects(scene, tmp_path, content, said):
    with pytest.raises(InputError, match=said):
        import_file(scene, given(tmp_path, content), (WIDTH, HEIGHT))


# ---- whatever else is given --------------------------------------------------------------------------

@pytest.mark.parametrize("content, said", [
    (b"", "known here; give an fSpy project"), (b"PK\3\4....", "unpack it and give the file of annotations in it"),
    (b"[1, 2]", "known here; give an fSpy project"), (b'{"a": 1}', "or CVAT's XML for images 1.1"),
    (b'{"a": ' + b"[" * 200_000, "is no JSON"), (b'{"a": \xff}', "is no JSON"),
    (b'{"shapes": [], "imagePath": ""}', "nothing in it can be used"),
    (b'{"images": [], "annotations": [], "categories": []}', "holds no picture"),
    (b'{"images": [{"id": [1]}], "annotations": [], "categories": []}', "holds no picture"),
])
def test_files_that_are_not_known(scene, tmp_path, content, said):
    with pytest.raises(InputError, match=said) as caught:
        import_file(scene, given(tmp_path, content), (WIDTH, HEIGHT))
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("seed", range(4))
def test_mangled_files_are_refused_or_read(seed):
    chance = np.random.default_rng(seed)
    good = [json.dumps(labelled(shape("light:lamp"), shape("x", "line", [(1, 2), (3, 4)]))).encode(), CVAT.encode(), project()]
    for content in good:
        for _ in range(40):
            mangled = bytearray(content)
            for at in chance.integers(0, len(mangled), 3):
                mangled[at] = chance.choice(list(b'{}[]",:<>0x\xff'))
            try:
                assert isinstance(read_file(bytes(mangled), ["photograph.png"]), (Drawings, fspy_files.Matched))
            except InputError as error:
                assert len(str(error)) < 1200


# ---- exports ------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name", ["bathroom", "street", "building", "sunroom"])
def test_labelme_export_imports_to_the_same_scene(name, tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_bytes((PROJECT / "scenes" / name / "scene.yaml").read_bytes())
    document = SceneDocument.open(path)
    size = (768, 768)
    content = json.loads(json.dumps(labelme.written(drawings_of(document.data, size), "photograph.jpg")))
    before = document.text
    said = import_file(document, given(tmp_path, content), size, replace=True)
    assert document.text == before and not [line for line in said if line.startswith("left out")]
    bare = {key: value for key, value in document.data.items() if key in ("photograph", "fog")}
    empty = SceneDocument(path, json.dumps(bare))
    import_file(empty, given(tmp_path, content), size)
    for section in ("camera", "shapes", "lights", "depth", "sun_direction", "illumination"):
        for place, points in _marked(document.get((section,)), (section,)):
            if "albedos" not in place:
                assert empty.get(place) == points, place


def _marked(value, where):
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _marked(one, (*where, key))
    elif isinstance(value, list) and value and isinstance(value[0], list):
        yield where, value
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for index, one in enumerate(value):
            yield from _marked(one, (*where, index))


def test_what_is_in_metres_is_not_exported():
    found = drawings_of({"shapes": {"box": {"type": "cuboid", "centre": [1, 2, 3], "size": [1, 1, 1]}}, "lights": {
        "lamp": {"type": "area", "outline": {"points": [[1, 2, 3]] * 3}}, "odd": {"type": "area", "outline": {"pixels": [[1, 2]] * 3}},
        "bulb": {"type": "point", "position": {"point": [1, 2, 3]}}, "wrong": 3}}, (9, 9))
    assert not found.drawn and found.left_out == [
        "shapes.box is no outline, line or point in the photograph", "light:lamp is no outline, line or point in the photograph",
        "light:odd does not say on which plane it lies", "lights.bulb is no outline, line or point in the photograph"]


def test_photograph_size_is_that_of_the_upright_picture(tmp_path):
    path = picture(tmp_path / "a.png", 7, 5)
    assert read_size(path) == (7, 5) == (read(path).width, read(path).height)
    bathroom = PROJECT / "scenes/bathroom/photograph.exr"
    assert read_size(bathroom) == read(bathroom).radiance.shape[1::-1]


# ---- the command ---------------------------------------------------------------------------------------

def test_command(scene, tmp_path, capsys):
    folders = ["--scene", "mine", "--scenes", str(tmp_path / "scenes"), "--build", str(tmp_path / "build")]
    file = given(tmp_path, labelled(shape("sky"), shape("tree")))
    assert main(["annotations", "--import", str(file), *folders]) == 0
    out, err = capsys.readouterr()
    assert "imported: depth.regions.sky from outline 'sky'" in out and "left out: 'tree' does not say" in out and out.endswith("scene.yaml\n")
    assert "note: " not in err and load_scene(scene.path).depth.regions
    assert main(["annotations", "--import", str(file), *folders]) == 0, "the same again is nothing new"
    changed = given(tmp_path, labelled(shape("sky", points=[(0, 0), (1, 0), (1, 1)])))
    assert main(["annotations", "--import", str(changed), *folders]) == 2
    assert "depth.regions.sky.pixels: is in the scene already" in capsys.readouterr().err
    assert main(["annotations", "--import", str(changed), "--replace", *folders]) == 0
    target = tmp_path / "out.json"
    assert main(["annotations", "--export", str(target), *folders]) == 0
    written = json.loads(target.read_text())
    assert written["imagePath"] == "scenes/mine/photograph.png" and written["shapes"][0]["points"] == [[0, 0], [1, 0], [1, 1]]
    capsys.readouterr()
    for arguments, said in [
            (["--export", str(target)], "the file exists already"), (["--export", str(tmp_path)], "is a folder"),
            (["--export", str(tmp_path / "x/y")], "its folder does not exist"), (["--import", ""], "no file of annotations is named"),
            (["--import", str(tmp_path / "none")], "no such file"), ([], "give one of --import FILE and --export FILE"),
            (["--export", str(tmp_path / "o"), "--to", "svg"], "use one of labelme, fspy"),
            (["--import", str(file), "--replace", "no"], "give replace=yes"),
            (["--export", str(tmp_path / "o"), "--to", "fspy"], "the scene's camera is not worked out yet")]:
        assert main(["annotations", *arguments, *folders]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1, error


def test_every_kind_of_label_is_in_the_readme():
    readme = (PROJECT / "README.md").read_text()
    missing = [kind for kind in KINDS if f"`{kind}" not in readme]
    assert not missing


def test_coco_needs_no_more_than_lists():
    assert not coco.is_coco({"images": {}, "annotations": [], "categories": []})
