"""The scene's fogs side by side: names of visibilities, the strip of pictures, the stage, and `make ladder`."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import write_map
from pipeline.imaging.strip import WHOLE, strip
from pipeline.paths import Build
from pipeline.physics.visibility import visibility, visibility_class
from pipeline.scene.artefacts import read_json
from tests.conftest import CHAIN
from tests.test_bad_input import refusal
from tests.test_daylight import OPEN_AIR, picture
from tests.test_make import Made, refused, stages

FOGS = ("fogs:\n  thick: {type: homogeneous, visibility: 20}\n  low: {type: height, visibility: 200, scale_height: 2}\n"
        "  none: {type: homogeneous, visibility: .inf}\n")


# ---- names and drawing -------------------------------------------------------------------------

@pytest.mark.parametrize("metres, name", [
    (0.1, "dense fog"), (49.9, "dense fog"), (50, "thick fog"), (199, "thick fog"), (200, "moderate fog"), (499, "moderate fog"),
    (500, "light fog"), (999.9, "light fog"), (1000, "mist"), (4999, "mist"), (5000, "haze"), (10000, "clear air"),
    (np.inf, "clear air")])
def test_classes_of_visibility(metres, name):
    assert visibility_class(metres) == name


def test_visibility_is_the_meteorological_optical_range():
    assert visibility(np.full(3, -np.log(0.05) / 300)) == pytest.approx(300)
    assert visibility(np.zeros(3)) == np.inf


def panel(colour, size=(60, 90)):
    return np.full((*size, 3), colour, np.uint8)


@pytest.mark.parametrize("count, rows, columns", [(1, 1, 1), (4, 1, 4), (6, 1, 6), (7, 2, 4), (13, 3, 5)])
def test_strip_shows_every_panel_in_order(count, rows, columns):
    colours = [(5 + 10 * i, 200 - 10 * i, 90) for i in range(count)]
    sheet = strip([(panel(colour), [f"fog{i}", "words"]) for i, colour in enumerate(colours)])
    assert sheet.dtype == np.uint8
    for number, colour in enumerate(colours):
        v, u = np.argwhere((sheet == colour).all(-1)).mean(0)
        assert number // columns == int(v * rows / sheet.shape[0]) and number % columns == int(u * columns / sheet.shape[1])
    assert (sheet.min(-1) < 100).any(0).sum() > 10 * columns, "something is written"


@pytest.mark.parametrize("size", [(1, 1), (1, 200), (200, 1), (900, 640)])
def test_strip_of_odd_pictures_stays_on_its_sheet(size):
    sheet = strip([(panel(90, size), ["a" * 40, "words"])] * 6)
    assert sheet.shape[1] <= WHOLE + 200 and (sheet == 90).all(-1).any()
    assert (sheet[:, -3:] == 255).all(), "long names are written smaller, not over the edge"


# ---- the stage ---------------------------------------------------------------------------------

@pytest.fixture
def open_air(tiny_scene):
    tiny_scene.file.write_text(OPEN_AIR.replace("{type: sunlight, ", "{type: sunlight, shadows: false, ") + FOGS)
    write_map(tiny_scene.folder / "photograph.exr", picture())
    return tiny_scene


def test_stage_puts_clear_and_foggy_side_by_side(open_air, capsys):
    for fog in (None, "thick", "low", "none"):
        assert open_air.run(*CHAIN, fog=fog) == 0
    assert open_air.run("ladder") == 0
    assert str(open_air.build.ladder) in capsys.readouterr().out
    sheet = cv2.imread(str(open_air.build.ladder)).astype(int)
    panels = np.split(sheet[: 2 * 64 * 160 // 96 // 2, : sheet.shape[1] // 4 * 4], 4, axis=1)
    contrast = [p[20:90, 10:150].std() for p in panels]
    clear, none, low, thick = contrast
    assert none == pytest.approx(clear, abs=1) and clear > thick and low > thick, "the thinnest first, the thickest last"


def test_names_are_ordered_by_visibility_unless_asked_for(open_air, capsys):
    assert open_air.run("resolve") == 0
    options = ["--scene", "tiny", "--scenes", str(open_air.root / "scenes"), "--build", str(open_air.root / "build"), "--names"]
    assert main(["ladder", *options]) == 0 and capsys.readouterr().out.split() == ["none", "low", "thick"]
    assert main(["ladder", *options, "--fogs", "thick low thick"]) == 0
    assert capsys.readouterr().out.split() == ["thick", "low"]
    assert main(["ladder", *options, "--fogs", "thik"]) == 2
    said = capsys.readouterr().err
    assert f"{open_air.file}:{open_air.line('fogs:')}: no fog is called 'thik'; use some of thick, low, none (did you mean 'thick'?)" in said


def test_fog_that_was_not_made_is_named(open_air, capsys):
    assert open_air.run(*CHAIN) == 0
    capsys.readouterr()
    message = refusal(open_air.run("ladder"), capsys.readouterr().err, open_air.root)
    assert "none/foggy.exr: no such file; run: make ladder scene=tiny" in message


def test_scene_without_named_fogs(open_air, capsys):
    open_air.replace(FOGS, "")
    assert open_air.run("resolve") == 0
    message = refusal(open_air.run("ladder"), capsys.readouterr().err, open_air.root)
    assert message.startswith(f"{open_air.file}:{open_air.line('fog:')}: tiny names no fogs; add some below 'fogs:'")


# ---- make --------------------------------------------------------------------------------------

@pytest.fixture
def made(open_air):
    return Made(open_air.root)


def test_make_ladder(made):
    arguments = "ladder", "fogs=thick low", "lights.sky.gain=0.5"
    said = made.made(*arguments)
    assert stages(said).count("composite") == 2 and stages(said).count("geometry") == 1 and "waiting" not in said
    assert cv2.imread(str(made.build.ladder)) is not None
    for fog in ("thick", "low"):
        build = Build("tiny", fog, made.root / "scenes", made.root / "build")
        assert build.foggy(".png").exists() and read_json(build.input("gains"))["sky"] == 0.5, "overrides reach every fog"
    assert not (made.build.shared / "none").exists()
    assert stages(made.made(*arguments)) == [], "what is up to date is not made again"


@pytest.mark.parametrize("arguments, says", [
    (("ladder",), "no scene is named: make ladder scene=bathroom"),
    (("ladder", "scene=tiny", "fog=thick"), 'a ladder shows several fogs: leave out fog=thick, or say fogs="thick ..."'),
    (("scene=tiny", "fogs=thick"), 'fogs= is for the ladder: make ladder scene=tiny fogs="thick"'),
    (("ladder", "scene=tiny", "fogs=../x"), "fogs='../x': name the fogs with spaces between them"),
    (("ladder", "scene=tiny", "fogs=a,b"), "fogs='a,b': name the fogs with spaces between them"),
    (("ladder", "scene=tiny", "fogs=$(shell touch x)"), "name the fogs with spaces between them"),
    (("ladder", "scene=tiny", "fogs=a; touch x"), "name the fogs with spaces between them"),
    (("ladder", "scene=tiny", "fogs=thick -n"), "name the fogs with spaces between them"),
    (("ladder", "scene=tiny", "fogs=thik"), "no fog is called 'thik'"),
])
def test_mistakes(arguments, says, made):
    assert says in refused(made.make(*arguments))
    assert not (made.build.ladder).exists()
