"""The paper's figures: drawn from what was made, alike at every drawing, and honest about what is missing."""

import csv

import cv2
import numpy as np
import pytest

from pipeline.figures import timing
from pipeline.figures.paper import FIGURES
from pipeline.paths import PROJECT
from tests.conftest import CHAIN, TinyScene, write_tiny

pytest.importorskip("matplotlib", reason="make setup-figures was not run")
from pipeline.figures import book, paper, sheets  # noqa: E402

SUN = """lights:
  sun:
    type: sun
    irradiance: [5, 4, 3]
    openings:
      window:
        window: {points: [[-2, 1, -4], [-2, 2, -4], [-2, 2, -3], [-2, 1, -3]]}
        patches: [{points: [[-1.25, 0, -3.875], [-0.5, 0, -3.75], [-0.5, 0, -2.75], [-1.25, 0, -2.875]]}]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A scene that is called as one of the paper's, with a lamp and sun through a window."""
    scene = TinyScene(tmp_path_factory.mktemp("figures"), "bathroom")
    write_tiny(scene.folder)
    scene.replace("lights:\n", SUN)
    with pytest.MonkeyPatch.context() as patch:
        for name in ("FOG_SCENE", "FOG_NAME", "FOG_OVERRIDES", "FOG_SCENES", "FOG_BUILD"):
            patch.delenv(name, raising=False)
        assert scene.run(*CHAIN, "report") == 0
    return scene


def test_every_figure_of_the_page_has_a_rule():
    rules = (PROJECT / "Makefile").read_text(encoding="utf-8")
    drawn = next(line for line in rules.splitlines() if line.startswith("drawn :="))
    names = drawn.rpartition("png,")[2].rstrip("))").split()
    assert sorted(names) == sorted(one.name for one in FIGURES)
    for one in FIGURES:
        for scene, fog in one.made_from:
            assert (PROJECT / "scenes" / scene / "scene.yaml").exists(), "figures show what the project carries"


@pytest.mark.parametrize("name", ["fig02", "fig05", "fig06"])
def test_two_drawings_are_the_same(made, tmp_path, name):
    folders = [tmp_path / "one", tmp_path / "other"]
    one, other = (paper.draw(name, made.build.scenes, made.build.builds, folder).read_bytes() for folder in folders)
    assert one == other
    picture = cv2.imread(str(folders[0] / f"{name}.png"))
    assert picture.shape[1] == round(sheets.WIDTH * sheets.DPI) and picture.std() > 10


def test_a_scene_that_is_missing_is_named(made, tmp_path):
    path = paper.draw("fig07", made.build.scenes, made.build.builds, tmp_path)
    assert path.stat().st_size > 0 and not (made.build.builds / "building").exists()
    drawn = cv2.imread(str(path))
    sheets.missing(tmp_path / "expected.png", "not drawn: building was not made")
    np.testing.assert_array_equal(drawn, cv2.imread(str(tmp_path / "expected.png")))
    assert paper.draw("fig10", made.build.scenes, made.build.builds, tmp_path).exists(), "no validation was made"


def test_panels_of_a_row_have_one_height(tmp_path):
    black, white = np.zeros((30, 40, 3), np.uint8), np.full((60, 20, 3), 255, np.uint8)
    sheets.grid(tmp_path / "row.png", [[sheets.Panel("wide", black), sheets.Panel("narrow", white)]])
    picture = cv2.imread(str(tmp_path / "row.png"))
    dark = np.flatnonzero((picture.max(-1) < 10).mean(1) > 0.5)
    width, height = (picture[dark[0] + 5].max(-1) < 10).sum(), len(dark)
    # a margin of 0.3 % of the sheet on both sides
    assert width + 2 * 0.003 * picture.shape[1] == pytest.approx(height * 4 / 3, abs=4)


def test_error_curves_follow_the_table(tmp_path):
    folder = tmp_path / "validation"
    folder.mkdir()
    with open(folder / "mse.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["fog", "default", "best"])
        for fog, error in (("homogeneous_a0.00_d0.10", 1e-5), ("homogeneous_a0.05_d0.10", 2e-5), ("homogeneous_a0.05_d0.30", 4e-5),
                           ("height_a0.05_d0.20", 1e-6), ("height_a0.10_d0.40", 2e-6)):
            table.writerow([fog, error, error / 2])
    picture = cv2.imread(str(paper.draw("fig10", tmp_path, tmp_path, tmp_path / "figures")))
    assert picture.shape[0] > 400 and (picture.min(-1) < 60).mean() > 0.005, "axes, curves, a legend"


def test_the_table_adds_up_what_belongs_together():
    cold = {"make": 60.0, "photograph": 1.0, "camera": 0.5, "geometry": 2.0, "sun_direction": 3.0, "illumination": 20.0, "plan": 1.0,
            "emit": 0.25, "render": 4.0, "decompose": 1.5, "composite": 0.5}
    found = {"bathroom": {"cold": cold, "warm": {"make": 7.0, "plan": 1.0, "emit": 0.5, "render": 3.0, "decompose": 1.0,
                                                 "composite": 0.25}, "again": {"make": 0.75}}}
    rows = {row[0]: row[1:] for row in timing.table(found)}
    assert rows["T and V"] == ["20 + 35", "5.5", "4.0"]
    assert rows["geometry"] == ["30", "2.0", ""], "another fog does not redo it"
    assert rows["make in all"] == ["", "60.0", "7.0"] and rows["make once more, nothing changed"][-1] == "0.8"


def test_the_book_has_all_that_is_drawn_in_order(made, tmp_path):
    for name in ("fig05", "fig02"):
        paper.draw(name, made.build.scenes, made.build.builds, tmp_path)
    book.write(made.build.scenes, made.build.builds, tmp_path)
    text, pages = (tmp_path / "figures.html").read_text(), (tmp_path / "figures.pdf").read_bytes()
    assert text.index('id="fig02"') < text.index('id="fig05"') and "Fig. 5." in text and 'id="fig07"' not in text
    assert '"visibility": 6' in text.replace("&#34;", '"') and "POV-Ray 3.7" in text
    assert pages.startswith(b"%PDF")
    book.write(made.build.scenes, made.build.builds, tmp_path)
    assert (tmp_path / "figures.pdf").read_bytes() == pages
