"""The last stage: overlay, manifest and report, from artefacts written without a renderer."""

from __future__ import annotations

import hashlib
import json
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline import paths
from pipeline.errors import InputError
from pipeline.geometry.camera import from_field_of_view
from pipeline.geometry.planes import polygon_area
from pipeline.geometry.raycast import first_hits
from pipeline.imaging.display import display_exposure, displayed, tone_factor
from pipeline.imaging.maps import write_map
from pipeline.imaging.canvas import LONG_SIDE, Canvas
from pipeline.imaging.overlay import COLOURS, overlay
from pipeline.imaging.overlay_lines import cast_window
from pipeline.imaging.overlay_view import clip_polygon, clip_segment
from pipeline.paths import Build
from pipeline.plugins.lights.area import Area
from pipeline.plugins.lights.point import Point
from pipeline.plugins.lights.sun import Sun
from pipeline.plugins.shapes.room import Room
from pipeline.reporting.facts import corner_fits, notices, sun_rows
from pipeline.reporting.manifest import plain
from pipeline.reporting.page import number, numbers
from pipeline.scene.artefacts import read_json, read_placed, write_json
from pipeline.stages import camera, geometry, photograph, report, resolve, sun_direction


@pytest.fixture
def small_overlay(monkeypatch):
    """The same drawing on fewer pixels, where a test is not about them."""
    monkeypatch.setattr("pipeline.imaging.canvas.LONG_SIDE", (160, 300))


SUN = """
  sun:
    type: sun
    direction: [0.6, -0.8, 0.1]
    irradiance: [5, 4, 3]
    openings:
      window:
        window: {points: [[-2, 1, -3], [-2, 2, -3], [-2, 2, -2], [-2, 1, -2]]}
        patches: [{points: [[-1.25, 0, -2.875], [-0.5, 0, -2.75], [-0.5, 0, -1.75], [-1.25, 0, -1.875]]}]
"""
SCENE = """
photograph: {{file: photograph.png}}
camera: {{horizontal_field_of_view: 75, position: [0, 1.5, 0], look_at: [-0.4, 1.3, -3]}}
shapes:
  room: {{type: room, lower: [-2, 0, -4], upper: [2, 2.5, 0.5]}}
  tub: {{type: cuboid, centre: [1, 0.3, -2.5], size: [0.7, 0.6, 1.4]}}
lights:
  lamp:
    type: area
    radiance: [9, 8, 7]
    outline: {{points: [[-0.3, 2.5, -2.3], [0.3, 2.5, -2.3], [0.3, 2.5, -1.9], [-0.3, 2.5, -1.9]]}}{sun}
illumination: {{type: manual}}
fog: {{type: homogeneous, visibility: {visibility}}}
fogs:
  thick: {{type: homogeneous, visibility: 2}}
"""


def made(tmp_path: Path, *, size=(12, 16), sun=SUN, visibility="9", fog=None, message="") -> Build:
    """A build up to `composite`: real stages as far as they need no renderer, plain maps after them."""
    build = Build("bath", fog, tmp_path / "scenes", tmp_path / "build")
    build.source.mkdir(parents=True)
    build.scene_file.write_text(SCENE.format(sun=sun, visibility=visibility))
    grey = np.random.default_rng(1).integers(20, 200, (*size, 3), np.uint8)
    cv2.imwrite(str(build.source / "photograph.png"), grey)
    resolve.run(build, {})
    for stage in (photograph, camera, geometry, sun_direction):
        stage.run(build)
    lights = list(read_placed(build).lights)
    write_json(build.illumination, {
        "estimator": "manual", "messages": [message] if message else [], "face_albedo": {}, "lights": {
            name: {"strength": [9.0, 8.0, 7.0], "source": "given", "gain": 1.0, "quantity": "radiance",
                   "unit": "photo unit"} for name in lights}})
    write_map(build.albedo, np.full((*size, 3), 0.5))
    clear = not np.isfinite(float(visibility.replace(".inf", "inf")))
    shown = [] if clear else lights
    runs = [{"id": f"in_scattering_{name}"} for name in shown]
    write_json(build.plan, {"expected": None, "fog_is_clear": clear, "lights": shown, "runs": runs,
                            "reasons": ["dense <fog> & more"]})
    write_json(build.seconds / "plan.json", 0.25)
    build.pov.mkdir(parents=True)
    (build.pov / "in_scattering_lamp.pov").write_text(
        "// ---- templates/head.inc\nsphere { 0, 1 }\n// ---- a rule ----\n")
    build.runs.mkdir(parents=True, exist_ok=True)
    (build.runs / "in_scattering_lamp.sha256").write_text("abc 1.500\n")
    if not clear:
        write_json(build.maps, {"transmittance_median": 0.5, "in_scattering_median": 0.25, "lights": lights})
        write_map(build.transmittance, np.full((*size, 3), 0.5))
        write_map(build.in_scattering(), np.full((*size, 3), 0.25 * len(lights)))
        for name in lights:
            write_map(build.in_scattering(name), np.full((*size, 3), 0.25))
    write_map(build.foggy(".exr"), np.full((*size, 3), 0.4))
    cv2.imwrite(str(build.foggy(".png")), np.full((*size, 3), 160, np.uint8))
    return build


class Page(HTMLParser):
    """Attributes and text of a page; fails on tags that do not match."""

    VOID = {"meta", "img", "input", "br", "link"}

    def __init__(self, text: str):
        super().__init__()
        self.attributes, self.open, self.text = [], [], []
        self.feed(text)
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *pair) for pair in attrs]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def values(self, attribute: str) -> list[str]:
        return [value for _, name, value in self.attributes if name == attribute]


def strict(text: str):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")
    return json.loads(text, parse_constant=refuse)


# ---- the stage ---------------------------------------------------------------------------------

@pytest.mark.usefixtures("small_overlay")
@pytest.mark.parametrize("options", [
    {}, {"sun": ""}, {"visibility": ".inf"}, {"fog": "thick"},
    {"size": (1, 1)}, {"size": (1, 40)}, {"size": (40, 1)}],
    ids=["sun", "no sun", "clear", "named fog", "1x1", "40x1", "1x40"])
def test_page_is_self_contained_and_its_links_lead_somewhere(tmp_path, options):
    build = made(tmp_path, **options)
    report.run(build)
    text = build.report.read_text(encoding="utf-8")
    page = Page(text)
    assert "://" not in text and "@import" not in text
    assert all(source.startswith("data:image/jpeg;base64,") for source in page.values("src"))
    links = page.values("href")
    assert len(links) >= 8
    for link in links:
        assert not Path(unquote(link)).is_absolute() and (build.out / unquote(link)).is_file(), link
    assert len(text) < 6_000_000
    assert cv2.imread(str(build.overlay)).shape[:2] != (0, 0)
    assert not list(tmp_path.rglob("*.partial*"))


@pytest.mark.usefixtures("small_overlay")
def test_manifest_holds_hashes_parameters_and_seconds_and_no_folder_of_this_machine(tmp_path):
    build = made(tmp_path)
    report.run(build)
    text = build.manifest.read_text()
    manifest = strict(text)
    for folder in (str(tmp_path), str(paths.PROJECT), str(Path.home()) + "/"):
        assert folder not in text
    for name, output in manifest["outputs"].items():
        content = (build.out / name).read_bytes()
        assert (output["sha256"], output["bytes"]) == (hashlib.sha256(content).hexdigest(), len(content))
    maps = {"transmittance.exr", "in_scattering_sun.exr"}
    assert {"foggy.png", "overlay.png"} | maps <= set(manifest["outputs"])
    head = hashlib.sha256((paths.TEMPLATES / "head.inc").read_bytes()).hexdigest()
    assert manifest["sources"]["templates"] == {"templates/head.inc": head}  # and no mere comment
    scene_hash = hashlib.sha256(build.scene_file.read_bytes()).hexdigest()
    assert manifest["sources"]["scene"] == {"scene.yaml": scene_hash}
    assert manifest["seconds"] == {"stages": {"plan": 0.25}, "runs": {"in_scattering_lamp": 1.5}}
    assert manifest["parameters"]["fog"]["visibility"] == 9
    assert {"numpy", "opencv-contrib-python-headless"} <= set(manifest["versions"]["packages"])


@pytest.mark.usefixtures("small_overlay")
def test_report_is_written_last(tmp_path, monkeypatch):
    build = made(tmp_path)
    monkeypatch.setattr(report, "page", lambda *_, **__: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        report.run(build)
    assert not build.report.exists()  # so that Make runs the stage again
    assert strict(build.manifest.read_text())["scene"] == "bath"


@pytest.mark.usefixtures("small_overlay")
def test_clear_fog_says_that_the_photograph_is_unchanged_and_lists_no_maps(tmp_path):
    build = made(tmp_path, visibility=".inf")
    write_map(build.transmittance, np.ones((2, 2, 3)))  # left over from an earlier fog
    report.run(build)
    manifest = strict(build.manifest.read_text())
    assert "transmittance.exr" not in manifest["outputs"]
    assert manifest["parameters"]["fog"]["visibility"] == "infinity"
    words = " ".join(Page(build.report.read_text(encoding="utf-8")).text)
    assert "came back unchanged" in words and "What each light adds" not in words and "∞" in words


@pytest.mark.usefixtures("small_overlay")
def test_words_from_outside_cannot_become_markup(tmp_path):
    build = made(tmp_path, message="<script>alert(1)</script> & \"quoted\"")
    report.run(build)
    text = build.report.read_text(encoding="utf-8")
    assert "<script>alert" not in text and "&lt;script&gt;alert(1)" in text
    words = "".join(Page(text).text)
    assert "<script>alert(1)</script> & \"quoted\"" in words and "dense <fog> & more" in words


@pytest.mark.usefixtures("small_overlay")
def test_named_fog_links_what_it_shares_with_the_others(tmp_path):
    build = made(tmp_path, fog="thick")
    report.run(build)
    outputs = strict(build.manifest.read_text())["outputs"]
    assert {"../depth.exr", "../overlay.png", "foggy.png"} <= set(outputs)


@pytest.mark.usefixtures("small_overlay")
def test_scene_may_bring_its_own_page_and_its_mistakes_are_one_line(tmp_path):
    build = made(tmp_path)
    own = build.source / "templates" / "report.html"
    own.parent.mkdir()
    own.write_text("mine: {{ build.scene }}")
    report.run(build)
    assert build.report.read_text() == "mine: bath"
    own.write_text("first line\n{% if %}")
    with pytest.raises(InputError, match=r"report\.html:2: template does not parse"):
        report.run(build)
    own.write_text("{{ fog.temperature }}")
    with pytest.raises(InputError, match="no attribute 'temperature'"):
        report.run(build)
    assert build.report.read_text() == "mine: bath"


def test_notices_gather_every_stage_and_ambiguity():
    found = notices({
        "camera": {"messages": ["a"]}, "geometry": {"messages": ["b"]}, "facts": {"clipped_share": 0.5},
        "suns": {"sun": {"status": "ambiguous", "messages": ["c"]}},
        "illumination": {"messages": ["'p' and 'q' cannot be told apart"],
                         "inseparable": [["p", "q"], ["q", "r"]]}})
    assert [n["text"] for n in found] == [
        "a", "b", "sun: the direction is ambiguous", "sun: c", "'p' and 'q' cannot be told apart",
        "q and r cannot be told apart in this photograph",
        "50% of its pixels are clipped: brighter than the file can say, they darken too much in fog"]


def test_sun_comes_from_the_left_and_above_when_it_travels_right_and_down():
    row, = sun_rows({"sun": {"sun_direction": [0.5, -np.sqrt(0.5), 0.5]}})
    assert row["elevation"] == pytest.approx(45) and row["azimuth"] == pytest.approx(-45)


@pytest.mark.parametrize("value, text", [
    (None, "–"), (0, "0"), (1552.3, "1550"), (0.04786, "0.0479"), (-0.5, "−0.5"), (9.0, "9"), (np.inf, "∞"),
    (np.nan, "–"), (1.234e-7, "1.23e-07"), (2.5e9, "2.50e+09")])
def test_numbers_as_a_person_writes_them(value, text):
    assert number(value) == text


def test_numbers_of_equal_channels_are_one():
    assert numbers([0.333, 0.333, 0.333]) == "0.333"
    assert numbers([0.1, 0.2, 0.3]) == "0.1, 0.2, 0.3"


def test_plain_leaves_only_json():
    value = {"a": np.float32(np.inf), "b": [np.nan, -np.inf, 1], "c": (np.array([0.5]),), 3: None, "d": True}
    assert strict(json.dumps(plain(value))) == {
        "a": "infinity", "b": ["nan", "-infinity", 1], "c": [[0.5]], "3": None, "d": True}


def test_display_of_values_that_are_no_numbers():
    shown = displayed(np.array([[[np.nan, np.inf, -1.0]]], np.float32))
    assert shown.tolist() == [[[0, 255, 0]]]


@pytest.mark.parametrize("level, factor", [(0.0, 1.0), (0.01, 100.0), (4.0, 0.25), (0.0301, 33.0)])
def test_tone_factor_has_two_digits(level, factor):
    assert tone_factor(np.full((4, 4, 3), level)) == factor


def test_exposure_only_of_float_photographs_far_from_white():
    assert display_exposure(np.full((8, 8, 3), 0.8)) == 1
    assert display_exposure(np.full((8, 8, 3), 50.0)) == pytest.approx(0.02)
    assert display_exposure(np.zeros((8, 8, 3))) == 1


# ---- clipping and drawing ----------------------------------------------------------------------

coordinate = st.floats(-5, 5, allow_nan=False)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)


@settings(max_examples=60, deadline=None)
@given(point, point)
def test_clipped_segment_is_the_part_inside(a, b):
    planes = np.array([[0, 0, 1, -0.5], [1, 0, 0, 1], [-1, 0, 1, 0.0]])
    share = np.linspace(0, 1, 201)[:, None]
    inside = ((a + share * (b - a)) @ planes[:, :3].T + planes[:, 3] >= 0).all(1)
    part = clip_segment(a, b, planes)
    if part is None:
        assert inside.sum() <= 1  # touching a plane in one point is no segment
    else:
        # ends are crossings of planes, computed from coordinates of order 5: 1e-9 is far above their rounding
        assert (part @ planes[:, :3].T + planes[:, 3]).min() > -1e-9
        # sampled in 201 points, the inside's length is known to two steps
        assert np.linalg.norm(part[1] - part[0]) == pytest.approx(
            inside.mean() * np.linalg.norm(b - a), abs=2.1 / 200 * np.linalg.norm(b - a) + 1e-9)


def test_clipped_polygon_loses_what_is_behind():
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1.0]])
    assert polygon_area(clip_polygon(square, np.array([[0, 0, 1, 0.0]]))) == pytest.approx(2)
    diagonal = np.array([[1, 0, 1, 0.0]])
    assert polygon_area(clip_polygon(square, diagonal)) == pytest.approx(2)
    assert len(clip_polygon(square, np.array([[0, 0, 1, -3.0]]))) == 0


def test_window_cast_on_floor_and_wall_ends_at_their_fold():
    window = np.array([[-2, 1, -3], [-2, 2, -3], [-2, 2, -2], [-2, 1, -2.0]])
    direction = np.array([1, -1, 0.0]) / np.sqrt(2)
    floor = np.array([[-1, 0, -3], [-0.5, 0, -3], [-0.5, 0, -2], [-1, 0, -2.0]])
    wall = np.array([[-0.5, 0, -3], [-0.5, 0, -2], [-0.5, 0.5, -2], [-0.5, 0.5, -3.0]])
    on_floor, on_wall = cast_window(window, direction, [floor, wall])
    assert np.ptp(on_floor, axis=0) == pytest.approx([0.5, 0, 1])
    assert on_floor[:, 0].max() == pytest.approx(-0.5)
    assert np.ptp(on_wall, axis=0) == pytest.approx([0, 0.5, 1]) and on_wall[:, 1].min() == pytest.approx(0)
    away, = cast_window(window, -direction, [floor])
    assert len(away) == 0
    beside, = cast_window(window, np.array([1.0, 0, 0]), [floor])
    assert len(beside) == 0


def view(width=300, height=200):
    camera = from_field_of_view(width, height, 70, camera_height=1.5, pitch=-10)
    room = Room(lower=[-2, 0, -4], upper=[2, 2.5, 0.5])
    depth, _ = room.intersect(camera.position, camera.directions(camera.pixel_centres()))
    return camera, room, depth


def test_polygon_from_before_to_behind_the_camera_covers_what_its_rays_meet():
    camera, _, depth = view()
    carpet = np.array([[-1.5, 0, -3], [1, 0, -3], [1.4, 0, 3], [-1.9, 0, 3.0]])
    canvas = Canvas(np.full((200, 300, 3), 100, np.uint8), camera, depth)
    canvas.polygon(carpet, (255, 0, 0), fill=1.0, width=0)
    drawn = (canvas.image[..., 0] > 200) & (canvas.image[..., 1] < 50)
    drawn = cv2.resize(drawn.astype(np.uint8), (300, 200), interpolation=cv2.INTER_AREA).astype(bool)
    _, hit = first_hits(camera.position, camera.directions(camera.pixel_centres()), [carpet])
    assert 0.1 < (hit == 0).mean() < 0.6
    # along 500 pixels of outline, of 60000, either side may win
    assert (drawn != (hit == 0)).mean() < 0.01


@pytest.mark.parametrize("height, width", [(1, 1), (1, 90), (90, 1), (2400, 1600)])
def test_overlay_fits_a_screen_and_keeps_the_shape(height, width):
    camera, room, depth = view(width, height)
    picture = overlay(np.full((height, width, 3), 90, np.uint8), camera, {"room": room}, {}, depth)
    assert picture.dtype == np.uint8 and LONG_SIDE[0] <= max(picture.shape) <= LONG_SIDE[1]
    assert picture.shape[0] == max(1, round(height * max(picture.shape[:2]) / max(height, width)))


def test_things_behind_the_camera_leave_no_trace_and_things_before_it_do():
    camera, room, depth = view()
    clear = np.full((200, 300, 3), 90, np.uint8)
    empty = overlay(clear, camera, {"room": room}, {}, depth)
    behind = {"bulb": Point(position={"point": [0.3, 1.0, 3.0]}, intensity=[1, 1, 1]),
              "panel": Area(outline={"points": [[-1, 2, 2], [1, 2, 2], [1, 2, 3], [-1, 2, 3]]})}
    assert np.array_equal(overlay(clear, camera, {"room": room}, behind, depth), empty)
    bulb = np.array([0.3, 1.0, -3.0])
    seen = overlay(clear, camera, {"room": room}, {"bulb": Point(position={"point": bulb.tolist()})}, depth)
    u, v = np.round(camera.project(bulb)[0] * seen.shape[1] / 300).astype(int)
    near = seen[v - 3 : v + 3, u - 3 : u + 3].astype(int)
    # 30 of 255: the strokes are a few pixels wide, and their sides are mixed with the dark line round them
    assert np.abs(near - COLOURS["lamp"]).max(-1).min() <= 30


def test_window_and_arrow_appear_for_a_sun_whose_direction_is_not_known_yet():
    camera, room, depth = view()
    openings = {"w": {"window": {"points": [[-2, 1, -3], [-2, 2, -3], [-2, 2, -2.2], [-2, 1, -2.2]]},
                      "patches": [{"points": [[-1, 0, -3], [-0.5, 0, -3], [-0.5, 0, -2.2]]}]}}
    clear = np.full((200, 300, 3), 90, np.uint8)
    unknown = overlay(clear, camera, {"room": room}, {"sun": Sun(openings=openings)}, depth)
    sun = Sun(openings=openings, direction=[1, -1, 0])
    known = overlay(clear, camera, {"room": room}, {"sun": sun}, depth)

    def count(picture, name):
        return (np.abs(picture.astype(int) - COLOURS[name]).max(-1) < 30).sum()

    assert count(unknown, "window") > 50 and count(unknown, "sun") == 0 and count(unknown, "cast") == 0
    assert count(known, "sun") > 50 and count(known, "cast") > 50


@pytest.mark.usefixtures("small_overlay")
def test_scale_of_the_world_changes_nothing_drawn_but_the_axes_name():
    """Room and camera a thousand times as large: the same pixels, but for the length beside the axes."""
    pictures = []
    for scale in (1.0, 1000.0):
        camera = from_field_of_view(300, 200, 70, camera_height=1.5 * scale, pitch=-10)
        room = Room(lower=[-2 * scale, 0, -4 * scale], upper=[2 * scale, 2.5 * scale, 0.5 * scale])
        depth, _ = room.intersect(camera.position, camera.directions(camera.pixel_centres()))
        pictures.append(overlay(np.full((200, 300, 3), 90, np.uint8), camera, {"room": room}, {}, depth))
    different = (pictures[0].astype(int) != pictures[1]).any(-1)
    assert 0 < different.mean() < 0.01  # the plate with "m" takes 0.5 % of the picture


def test_corner_fits_pair_clicks_with_the_same_corner(tmp_path):
    build = made(tmp_path)
    scene = read_placed(build)
    (clicked, fitted), = corner_fits({"tub": {"corners": {"front_left_top": [1, 2]}}}, scene)
    assert clicked.tolist() == [1, 2]
    assert fitted == pytest.approx(scene.camera.project(np.array([0.65, 0.6, -1.8]))[0])
    assert read_json(build.geometry)["shapes"].keys() == scene.shapes.keys()
