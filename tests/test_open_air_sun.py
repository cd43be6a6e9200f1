"""sun_direction.json of open-air scenes through the command line: by hand, by shadows, by date and place."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geometry.camera import from_field_of_view
from pipeline.imaging.maps import write_map
from pipeline.scene.artefacts import read_json, read_placed
from tests.test_bad_input import refusal
from tests.test_daylight import BEFORE, OPEN_AIR, picture

CAMERA = from_field_of_view(96, 64, 60, camera_height=1.6)
GIVEN = "direction: [0.3, -0.7, -0.4]"
BY_DATE = ("sun_direction: {type: solar_position, time: '2024-06-21 17:30', time_zone: Europe/Berlin, latitude: 52.5,"
           " longitude: 13.4, heading: 200}\n")
TRUE = np.array([0.6, -0.5, -0.3]) / np.sqrt(0.7)


def clicks(direction=TRUE, x=-2.0, z=-9.0, height=1.5):
    """A post's foot, tip and shadow, as a scene file states them."""
    foot = np.array([x, 0, z])
    tip = foot + [0, height, 0]
    pixels, _ = CAMERA.project(np.array([foot, tip, tip - direction * height / direction[1]]))
    return "{{foot: {}, tip: {}, shadow: {}}}".format(*(p.round(6).tolist() for p in pixels))


def by_shadows(*shadows, more=""):
    lines = "".join(f"    - {shadow}\n" for shadow in shadows)
    return f"sun_direction:\n  type: cast_shadow\n{more}  shadows:\n{lines}"


@pytest.fixture
def open_air(tiny_scene):
    """The painted scene, its sun's direction to be found as a test appends."""
    tiny_scene.file.write_text(OPEN_AIR.replace(", " + GIVEN, ""))
    write_map(tiny_scene.folder / "photograph.exr", picture())
    return tiny_scene


def found(scene, text):
    scene.file.write_text(scene.file.read_text() + text)
    assert scene.run(*BEFORE) == 0
    return read_json(scene.build.sun_direction)["suns"]["sun"]


def test_direction_by_hand(open_air):
    open_air.file.write_text(OPEN_AIR)
    sun = found(open_air, "")
    assert sun["status"] == "given" and sun["messages"] == []
    assert sun["sun_direction"] == pytest.approx(np.array([0.3, -0.7, -0.4]) / np.sqrt(0.74))


def test_direction_by_shadows_reaches_the_scene(open_air):
    sun = found(open_air, by_shadows(clicks(), clicks(x=0.5, z=-7), clicks(x=1, z=-12, height=3)))
    assert sun["sun_direction"] == pytest.approx(TRUE, abs=1e-5), "pixels are written to six digits"
    assert sun["residual_rms_pixel"] < 1e-4 and len(sun["residuals_pixel"]) == 3
    assert read_placed(open_air.build).lights["sun"].direction == pytest.approx(sun["sun_direction"])


def test_a_coarse_photograph_leaves_doubt_and_says_so(open_air):
    """Two pixels of 96 are a third of the post's height."""
    sun = found(open_air, by_shadows(clicks()))
    assert sun["status"] == "ambiguous" and sun["confidence_degree"] > 10
    assert "degrees of doubt: click a longer shadow" in sun["messages"][0]
    fine = found(open_air, "").copy()
    open_air.replace("type: cast_shadow\n", "type: cast_shadow\n  annotation_noise: 0.1\n")
    exact = found(open_air, "")
    assert exact["status"] == "determined" and exact["confidence_degree"] < fine["confidence_degree"] / 5


def test_shadows_that_disagree_are_named(open_air):
    other = np.array([-0.6, -0.5, -0.3]) / np.sqrt(0.7)
    sun = found(open_air, by_shadows(clicks(), clicks(x=-0.5, z=-8), clicks(other, x=0.5, z=-7), more="  annotation_noise: 0.3\n"))
    assert sun["status"] == "ambiguous"
    assert "the shadows disagree" in sun["messages"][0] and "shadows[2] most" in sun["messages"][0]


def test_direction_by_date_and_place(open_air):
    sun = found(open_air, BY_DATE)
    assert sun["status"] == "determined" and sun["messages"] == []
    # late afternoon in Berlin at midsummer: the sun stands in the west, 30 to 40 degrees high
    assert 260 < sun["azimuth_from_north_degree"] < 280 and 30 < sun["elevation_degree"] < 40
    x, y, z = sun["sun_direction"]
    # the camera looks to 200 degrees: the sun stands 70 degrees to the right, so that its light goes to the left
    assert x < 0 and np.degrees(np.arctan2(-x, z)) == pytest.approx(sun["azimuth_from_north_degree"] - 200, abs=1e-6)
    assert np.degrees(np.arcsin(-y)) == pytest.approx(sun["elevation_degree"], abs=1e-6)


@pytest.mark.parametrize("old, new, text, at, says", [
    ("{type: sunlight}", "{type: sunlight, direction: [0.3, 0.7, -0.4]}", "", "sun:",
     "does not come from above the horizon; let it point from the sun downwards, y < 0"),
    ("{type: sunlight}", "{type: sunlight, direction: [1, 0, 0]}", "", "sun:",
     "sun: direction [1.0, 0.0, 0.0] does not come from above the horizon"),
    ("{type: sunlight}", "{type: sunlight, direction: [0, 0, 0]}", "", "sun:", "points nowhere"),
    ("", "", "", "sun:", "sun: window_patches knows no open ground; choose sun_direction type cast_shadow or solar_position"),
    ("", "", BY_DATE.replace("17:30", "23:30"), "sun_direction:", "degrees below the horizon at 2024-06-21 23:30 Europe/Berlin"),
    ("", "", BY_DATE.replace("Europe/Berlin", "Europe/Atlantis"), "sun_direction:", "time zone 'Europe/Atlantis' is not known"),
    ("", "", BY_DATE.replace("2024-06-21", "2023-02-29"), "sun_direction:", "time '2023-02-29 17:30' does not exist"),
    ("", "", BY_DATE.replace("06-21 17:30", "03-31 02:30"), "sun_direction:", "clocks were put forward over it"),
    ("", "", BY_DATE.replace("2024-06-21 17:30", "yesterday"), "sun_direction:", "sun_direction.time: 'yesterday' is no date and time; write it like '2024-06-21 17:30'"),
    ("", "", BY_DATE.replace("52.5", "152.5"), "sun_direction:", "sun_direction.latitude = 152.5; give a number of 90.0 or less"),
    ("", "", BY_DATE.replace(", heading: 200", ""), "sun_direction:", "'heading' is missing"),
    ("", "", by_shadows("{foot: [40, 10], tip: [40, 5], shadow: [60, 50]}"), "sun_direction:",
     "[40, 10] lies above the horizon; click it on the ground"),
    ("", "", by_shadows("{foot: [40, 50], tip: [40, 20], shadow: [60, 30]}"), "sun_direction:", "[60, 30] lies above the horizon"),
    ("", "", by_shadows("{foot: [40, 50], tip: [40, 58], shadow: [60, 50]}"), "sun_direction:",
     "the tip [40.0, 58.0] is not above its foot [40.0, 50.0]; click the top of something upright"),
    ("", "", by_shadows("{foot: [40, 50], tip: [40, 20]}"), "{foot:", "sun_direction.shadows.0: 'shadow' is missing"),
    ("", "", "sun_direction: {type: cast_shadow, shadows: []}\n", "sun_direction:", "at least 1 entries, not 0"),
    ("", "", by_shadows(clicks(), more="  annotation_noise: 0\n"), "annotation_noise", "annotation_noise = 0"),
], ids=["from below", "level", "nowhere", "no estimator", "night", "zone", "29 February", "clock gap", "no time", "latitude",
        "no heading", "foot in the sky", "shadow in the sky", "tip below foot", "no shadow", "no shadows",
        "no noise"])
def test_mistakes_are_one_line(open_air, capsys, old, new, text, at, says):
    if old:
        open_air.replace(old, new)
    open_air.file.write_text(open_air.file.read_text() + text)
    message = refusal(open_air.run(*BEFORE), capsys.readouterr().err, open_air.root)
    assert message.startswith(f"{open_air.file}:{open_air.line(at)}: "), message
    assert says in message


def test_a_sun_through_windows_needs_windows(tiny_scene, capsys):
    tiny_scene.replace("fog:\n", """\
  sun:
    type: sun
    openings:
      window:
        window: {points: [[-2, 1, -3], [-2, 2, -3], [-2, 2, -2], [-2, 1, -2]]}
        patches: [{points: [[-1, 0, -3], [0, 0, -3], [0, 0, -2], [-1, 0, -2]]}]
fog:
""")
    tiny_scene.file.write_text(tiny_scene.file.read_text() + by_shadows(clicks()))
    message = refusal(tiny_scene.run(*BEFORE), capsys.readouterr().err, tiny_scene.root)
    assert "sun: cast_shadow knows no windows; choose sun_direction type window_patches" in message
