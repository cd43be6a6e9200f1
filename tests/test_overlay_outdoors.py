"""What the overlay and the report show of the open air."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.geometry.camera import from_field_of_view
from pipeline.imaging.canvas import LONG_SIDE, Canvas
from pipeline.imaging.display import depth_picture
from pipeline.imaging.maps import write_map
from pipeline.imaging.overlay import COLOURS, overlay
from pipeline.imaging.overlay_outdoors import OpenAir, draw_open_air, draw_sunlight
from pipeline.paths import Build
from pipeline.plugins.lights.lamps import Lamps
from pipeline.plugins.lights.sunlight import Sunlight
from pipeline.reporting.facts import light_rows
from pipeline.reporting.page import number
from pipeline.scene.artefacts import read_json
from tests.conftest import CHAIN
from tests.test_daylight import OPEN_AIR, picture
from tests.test_report import Page

GREY = 110


def street(width=300, height=200):
    """A camera over ground with a house to the right: depth, and labels sky 0, ground 1, house 2."""
    camera = from_field_of_view(width, height, 60, camera_height=1.6, pitch=-5)
    rays = camera.directions(camera.pixel_centres())
    ground = np.where(rays[..., 1] < -1e-3, -1.6 / np.minimum(rays[..., 1], -1e-3), 500.0)
    labels = np.where(ground < 400, 1, 0)
    depth = np.minimum(ground, 500.0)
    house = np.s_[height // 5 : height // 2, 2 * width // 3 :]
    labels[house], depth[house] = 2, 20.0
    return camera, depth, labels


REGIONS = [("sky", "sky", 500.0), ("street", "support", 6.2), ("house", "vertical", 20.4)]


def drawn(air, lights=None, width=300, height=200):
    camera, depth, labels = street(width, height)
    photograph = np.full((height, width, 3), GREY, np.uint8)
    return overlay(photograph, camera, {}, lights or {}, depth, air=air if air is not None else OpenAir(labels, REGIONS))


def near(image, colour, tolerance=40):
    """Pixels of a colour, but for what antialiasing and the dark line round strokes mix into it."""
    return np.abs(image.astype(int) - COLOURS[colour]).max(-1) < tolerance


def test_regions_have_the_papers_colours():
    image = drawn(None).astype(float)
    height, width = image.shape[:2]
    for name, channel, (u, v) in (("house", 0, (0.9, 0.25)), ("street", 1, (0.9, 0.8)), ("sky", 2, (0.3, 0.1))):
        part = image[int(v * height) - 4 : int(v * height) + 4, int(u * width) - 4 : int(u * width) + 4].mean((0, 1))
        assert part.argmax() == channel and part.max() - part.min() > 20, (name, part)


def test_outlines_lie_on_the_borders():
    image = drawn(None)
    found = near(image, "vertical")
    scale = image.shape[1] / 300
    left = np.flatnonzero(found[int(60 * scale)])
    # the house's left border is column 200; strokes and supersampling smear it by two pixels of the photograph
    assert left.size and abs(left.min() / scale - 200) < 2


def test_names_and_depths_are_written_once_a_region(monkeypatch):
    written = []
    monkeypatch.setattr(Canvas, "_write", lambda self, anchor, extent, text, colour, taken: written.append(text))
    drawn(None)
    assert {"sky", "street 6.2 m", "house 20 m", "horizon"} <= set(written)
    assert any(text.startswith("ground, ") for text in written), "axes stand on the ground, not on a floor"


def test_many_regions_are_outlined_and_only_the_largest_named(monkeypatch):
    written = []
    monkeypatch.setattr(Canvas, "_write", lambda self, anchor, extent, text, colour, taken: written.append(text))
    _, _, labels = street()
    labels = np.where(labels == 1, 1 + (np.arange(200)[:, None] // 4 % 10) * 10 + np.arange(300) // 30, labels)
    regions = [("sky", "sky", 500.0), *((f"r{i}", "vertical", 9.0) for i in range(1, 120))]
    drawn(OpenAir(labels, regions))
    assert 20 <= sum(text.startswith("r") for text in written) <= 30


def test_marks_are_where_they_were_clicked():
    _, _, labels = street()
    patch = np.array([[40, 150], [80, 150], [80, 180], [40, 180.0]])
    post = tuple(np.array(p, float) for p in ([150, 170], [150, 120], [190, 175]))
    image = drawn(OpenAir(labels, REGIONS, [np.array([[20, 140], [120, 140.0]])], [("sunlit[0]", "sunlit", patch)], [post]))
    scale = image.shape[1] / 300

    def at(u, v, colour):
        row, column = int(v * scale), int(u * scale)
        return near(image[row - 3 : row + 4, column - 3 : column + 4], colour).any()

    assert at(30, 140, "foot") and at(110, 140, "foot")
    assert at(40, 165, "sunlit") and at(80, 165, "sunlit")
    assert at(150, 145, "foot") and at(170, 172.5, "shadowed") and at(170, 147.5, "sunlit")


def test_every_lamp_of_a_row_is_marked():
    camera, _, _ = street()
    points = np.array([[x, 3.0, z] for z in (-9, -14, -22) for x in (-3, 3)])
    row = Lamps(positions=[{"point": p.tolist()} for p in points], intensity=[1, 1, 1])
    image = drawn(None, {"row": row})
    marked = near(image, "lamp", 60)
    for u, v in camera.project(points)[0] * image.shape[1] / 300:
        assert marked[int(v) - 6 : int(v) + 7, int(u) - 6 : int(u) + 7].any(), (u, v)


class Recorder(Canvas):
    """Notes down the segments of the world that are drawn."""

    def line(self, a, b, colour, width=1.6, cased=True):
        self.drawn = [*getattr(self, "drawn", []), (np.asarray(a), np.asarray(b))]
        return super().line(a, b, colour, width, cased)


@pytest.mark.parametrize("elevation", [1, 30, 89])
@pytest.mark.parametrize("azimuth", [0, 100, 200, 300])
def test_post_throws_its_shadow_as_the_sun_does(elevation, azimuth):
    e, a = np.radians([elevation, azimuth])
    direction = np.array([np.cos(e) * np.sin(a), -np.sin(e), -np.cos(e) * np.cos(a)])
    camera, depth, labels = street()
    canvas = Recorder(np.full((200, 300, 3), GREY, np.uint8), camera, depth)
    draw_open_air(canvas, OpenAir(labels, REGIONS))
    draw_sunlight(canvas, "sun", direction)
    (foot, end), (base, tip), (start, hit) = canvas.drawn
    assert foot == pytest.approx(base) and end == pytest.approx(hit)
    # the canvas looks for room on a grid of depths in float32, and calls floor what is within 2 % of it
    assert foot[1] == pytest.approx(0, abs=0.02 * 6)
    assert tip[1] > foot[1] and (tip - foot)[[0, 2]] == pytest.approx([0, 0])
    ray = (hit - start) / np.linalg.norm(hit - start)
    assert ray == pytest.approx(direction, abs=1e-9)
    assert end[1] == pytest.approx(foot[1], abs=1e-9)
    assert np.linalg.norm(end - foot) < 0.2 * 1000 * canvas.unit * 20 / camera.focal_length, "it stays in the picture"


def test_sun_without_ground_or_direction_is_left_out():
    camera, depth, labels = street()
    sky = OpenAir(np.zeros_like(labels), REGIONS[:1])
    photograph = np.full((200, 300, 3), GREY, np.uint8)
    up = from_field_of_view(300, 200, 60, camera_height=1.6, pitch=60)
    args = photograph, up, {}
    nothing = overlay(*args, {}, np.full((200, 300), 500.0), air=sky)
    for sun in (Sunlight(direction=[0.1, -1, 0]), Sunlight()):
        assert np.array_equal(overlay(*args, {"sun": sun}, np.full((200, 300), 500.0), air=sky), nothing)


@pytest.mark.parametrize("height, width", [(1, 1), (1, 90), (90, 1), (2400, 1600)])
def test_overlay_of_any_size(height, width):
    camera, depth, labels = street(width, height)
    air = OpenAir(labels, REGIONS, [np.array([[-1e6, 5], [1e6, 5.0]])], [("a", "shadowed", np.array([[0, 0], [9, 0], [9, 9.0]]))])
    image = overlay(np.full((height, width, 3), GREY, np.uint8), camera, {}, {"sun": Sunlight(direction=[0.2, -0.5, 0.1])},
                    depth, air=air)
    assert image.dtype == np.uint8 and LONG_SIDE[0] <= max(image.shape) <= LONG_SIDE[1]


def test_pixels_before_all_regions_keep_their_colour():
    _, _, labels = street()
    labels[150:, :100] = -1  # a shape of the scene's own stands there
    image = drawn(OpenAir(labels, REGIONS))
    scale = image.shape[1] / 300
    own = image[int(165 * scale) : int(170 * scale), int(5 * scale) : int(10 * scale)]
    assert np.ptp(own.astype(int), axis=-1).max() <= 2


# ---- depth as a picture ------------------------------------------------------------------------

def test_depth_picture_leaves_the_sky_out_of_its_scale():
    depth = np.full((50, 50), 10.0)
    depth[:, 25:] = 20.0
    depth[:10] = 9000.0
    colours, near_end, far_end, ratios = depth_picture(depth, 9000.0)
    assert (near_end, far_end, ratios) == (10, 20, False)
    assert np.array_equal(colours[0, 0], colours[20, 30]), "the sky is as bright as the far end"
    assert depth_picture(depth)[2] == 9000


def test_depth_picture_of_a_wide_range_goes_by_ratios():
    depth = np.geomspace(1, 1000, 200)[None] * np.ones((9, 1))
    colours, near_end, far_end, ratios = depth_picture(depth, 5000.0)
    assert ratios and near_end < 2 and far_end > 500
    grey = cv2.cvtColor(np.ascontiguousarray(colours), cv2.COLOR_RGB2GRAY)[0].astype(int)
    steps = np.diff(grey[[20, 60, 100, 140, 180]])
    assert steps.min() > 15, "each factor takes its share of the scale"
    assert depth_picture(np.full((4, 4), 7.0), 7.0)[1:3] == (7, 7)


# ---- the page ----------------------------------------------------------------------------------

@pytest.fixture
def open_air(tiny_scene, monkeypatch):
    """The painted scene whose lights all are known in closed form, so that nothing is rendered."""
    monkeypatch.setattr("pipeline.imaging.canvas.LONG_SIDE", (200, 300))
    tiny_scene.file.write_text(OPEN_AIR.replace("{type: sunlight, ", "{type: sunlight, shadows: false, ") +
                               "fogs:\n  thick: {type: homogeneous, visibility: 90}\n"
                               "  low: {type: height, visibility: 40, scale_height: 2}\n"
                               "  light: {type: homogeneous, visibility: 700}\n")
    write_map(tiny_scene.folder / "photograph.exr", picture())
    return tiny_scene


def words(build: Build) -> str:
    return " ".join(" ".join(Page(build.report.read_text(encoding="utf-8")).text).split())


def test_page_says_what_was_understood_of_the_open_air(open_air):
    assert open_air.run(*CHAIN, "report") == 0
    said = words(open_air.build)
    assert "visibility 100 m, thick fog" in said
    found = read_json(open_air.build.geometry)["regions"]
    # outlines of 96 x 33, 96 x 31 and 36 x 34 of 96 x 64 pixels, the house over the two others
    assert [round(found[name]["share"], 1) for name in ("sky", "ground", "house")] == [0.4, 0.4, 0.2]
    for name, facts in found.items():
        row = f"{name} {facts['class']} {number(100 * facts['share'], 2)} % {number(facts['depth_median_m'])} m"
        assert row in said, row
    assert "Strengths come from 2 patches of the photograph by their stated albedo." in said
    assert "the sun is 0.93 times as strong as the open sky" in said
    assert "shadowed[0]" in said and "pixels that count" in said
    # elevation asin(0.7 / |d|), and from the left and behind: the light goes to the right and away
    assert "54.5° 143° to the left of −z" in said and "patches overlap" not in said
    assert "Named fogs" in said and "light homogeneous 700 m light fog thick homogeneous 90 m thick fog low height 40 m" in said
    assert "windows cast" not in said and "upright regions" in said and "clicked corner" not in said
    assert read_json(open_air.build.manifest)["parameters"]["depth"]["sky_depth"] == 500


def test_pages_of_named_fogs_link_each_other(open_air):
    assert open_air.run(*CHAIN, "report") == 0
    assert open_air.run(*CHAIN, "report", fog="thick") == 0
    assert open_air.run("report") == 0
    page = Page(open_air.build.report.read_text(encoding="utf-8"))
    assert "thick/report.html" in page.values("href") and "low/report.html" not in page.values("href")


def test_page_of_an_overcast_street(open_air):
    open_air.replace("  sun: {type: sunlight, shadows: false, direction: [0.3, -0.7, -0.4]}\n", "")
    open_air.replace("  sunlit:\n    - {sky_visibility: 1, pixel: [70, 54], radius: 7}\n", "")
    assert open_air.run(*CHAIN, "report") == 0
    said = words(open_air.build)
    assert "Strengths come from 1 patch of the photograph by its stated albedo." in said and "There is no sun." in said and "to the left of −z" not in said


def test_strengths_by_means_are_not_called_given(open_air):
    open_air.replace("{type: sky}", "{type: sky, radiance: [1, 1, 1]}")
    open_air.replace("shadows: false, ", "shadows: false, irradiance: [1, 1, 1], ")
    assert open_air.run(*CHAIN, "report") == 0
    assert "Every strength is given by hand" not in words(open_air.build)


def test_doubt_about_the_sun_stands_first(open_air):
    open_air.replace(", direction: [0.3, -0.7, -0.4]", "")
    open_air.file.write_text(open_air.file.read_text() + "sun_direction:\n  type: cast_shadow\n  shadows:\n"
                             "    - {foot: [20, 50], tip: [20, 30], shadow: [40, 55]}\n")
    assert open_air.run(*CHAIN, "report") == 0
    said = words(open_air.build)
    assert "sun: the direction is ambiguous (sun direction)" in said and "degrees of doubt" in said
    suns = read_json(open_air.build.sun_direction)["suns"]
    assert f"± {suns['sun']['confidence_degree']:.0f}" in said


def test_standard_errors_of_a_channel_each():
    rows = light_rows({"lights": {"sky": {"strength": [1, 2, 3], "standard_error": [0.1, 0.2, 0.3], "source": "liu_xing"}}},
                      {"sky": 1.0})
    assert rows[0]["standard_error"] == [0.1, 0.2, 0.3]


def test_region_that_later_ones_hide_is_said_to_be_hidden(open_air):
    open_air.replace("    house:", "    hidden: {class: vertical, depth: 9, pixels: [[70, 20], [80, 20], [80, 30]]}\n    house:")
    assert open_air.run(*CHAIN, "report") == 0
    assert "hidden vertical 0 % hidden" in words(open_air.build)
