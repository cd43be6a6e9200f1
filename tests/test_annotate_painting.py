"""Regions painted with a brush: what a stroke makes of an outline, and what a page does with strokes."""

import json
import math

import numpy as np
import pytest
import shapely

from pipeline.annotate.page.brush import CRUMB, MOST_POINTS, Area, painted
from pipeline.errors import InputError
from pipeline.geometry.regions import polygon_mask
from tests.annotate_fixture import Loop, StillPreview, scenes_with

SIZE = 100, 80
SQUARE = Area([[20, 20], [60, 20], [60, 60], [20, 60]], [])


def shape(area: Area) -> shapely.Polygon:
    return shapely.Polygon(area.outline, area.holes)


def test_a_dab_is_a_disc():
    dab = shape(painted(None, [(50, 40)], 10, False, SIZE))
    assert dab.area == pytest.approx(math.pi * 100, rel=0.04) and dab.centroid.distance(shapely.Point(50, 40)) < 0.2


def test_a_stroke_adds_what_it_covers_and_nothing_else():
    stroke = [(50, 30), (80, 30), (80, 60)]
    covered = shapely.LineString(stroke).buffer(6)
    found, wanted = shape(painted(SQUARE, stroke, 6, False, SIZE)), shape(SQUARE).union(covered)
    assert found.is_valid and found.symmetric_difference(wanted).area < 0.02 * wanted.area
    assert found.hausdorff_distance(wanted) < 0.5


def test_a_wide_brush_leaves_what_a_fine_one_painted():
    fine = painted(None, [(10, 10), (30, 10), (30, 30)], 2, False, (400, 300))
    both = painted(fine, [(30, 30), (200, 200)], 25, False, (400, 300))
    away = shapely.LineString([(30, 30), (200, 200)]).buffer(26)
    assert shape(both).difference(away).symmetric_difference(shape(fine).difference(away)).area < 0.5


def test_an_eraser_takes_away_and_cuts_holes():
    bitten = painted(SQUARE, [(60, 40)], 8, True, SIZE)
    assert shape(bitten).area == pytest.approx(1600 - math.pi * 32, rel=0.01) and not bitten.holes
    holed = painted(SQUARE, [(40, 40)], 8, True, SIZE)
    assert len(holed.holes) == 1 and shape(holed).area == pytest.approx(1600 - math.pi * 64, rel=0.01)
    assert shape(painted(holed, [(40, 40)], 9, False, SIZE)).equals(shape(SQUARE)), "painted over, it is whole again"


def test_outlines_are_as_coarse_as_the_brush():
    fine, coarse = (painted(None, [(20, 40), (80, 40)], radius, False, SIZE) for radius in (20, 3))
    assert len(fine.outline) < 60 and len(coarse.outline) < 60
    random = np.random.default_rng(1)
    long = np.cumsum(random.normal(size=(1400, 2)) * 12, 0) % [4000, 3000]
    area = painted(None, list(map(tuple, long.tolist())), 4, False, (4000, 3000))
    assert max(map(len, [area.outline, *area.holes])) <= MOST_POINTS and shape(area).is_valid


def test_nothing_lies_outside_the_photograph():
    area = np.array(painted(SQUARE, [(40, 40), (140, 40), (140, 200)], 9, False, SIZE).outline)
    assert area.min() >= 0 and (area.max(0) <= SIZE).all()
    with pytest.raises(InputError, match="outside the photograph"):
        painted(None, [(300, 300)], 5, False, SIZE)


def test_a_region_is_one_piece():
    with pytest.raises(InputError, match="one piece"):
        painted(SQUARE, [(90, 70)], 5, False, SIZE)
    with pytest.raises(InputError, match="one piece"):
        painted(SQUARE, [(40, 0), (40, 79)], 5, True, SIZE)
    with pytest.raises(InputError, match="nothing of it"):
        painted(SQUARE, [(20, 20), (60, 60), (20, 60), (60, 20)], 40, True, SIZE)
    with pytest.raises(InputError, match="nothing to erase"):
        painted(None, [(40, 40)], 5, True, SIZE)
    # but a crumb in a corner is no piece
    left = shape(painted(SQUARE, [(30, 10), (30, 70)], 9.5, True, SIZE))
    assert left.bounds[0] > 38 and (0.5 * 40) < CRUMB * math.pi * 9.5**2


def test_a_small_hole_stays_where_the_brush_does_not_come():
    holed = painted(SQUARE, [(25, 25)], 2, True, SIZE)
    wide = painted(holed, [(60, 55)], 14, False, SIZE)
    assert len(holed.holes) == 1 and shapely.Polygon(wide.holes[0]).equals(shapely.Polygon(holed.holes[0]))
    assert not painted(holed, [(25, 28)], 14, False, SIZE).holes


def test_an_outline_that_crosses_itself_can_be_painted_on():
    crossed = Area([[20, 20], [60, 60], [60, 20], [20, 60]], [])
    assert shape(painted(crossed, [(40, 30), (40, 50)], 8, False, SIZE)).is_valid


@pytest.fixture
def tab(tmp_path):
    pytest.importorskip("bokeh", reason="no Bokeh: make setup-annotate installs it")
    from bokeh.document import Document

    from pipeline.annotate.page.page import Page
    from pipeline.annotate.page.studio import Studio

    studio = Studio(scenes_with(tmp_path, "building"), tmp_path / "build", tmp_path / "own", "building", Loop(), StillPreview)
    desk = studio.desk("building")
    page = Page(desk, Document(), lambda: True)
    page.loop = studio.loop
    yield page
    studio.close()


def do(page, what, **more):
    page.asked(json.dumps({"do": what, **more}))
    page.loop.turn()


def regions(page):
    return page.data["depth"]["regions"]


def test_a_region_is_painted_from_nothing_and_undone_stroke_by_stroke(tab):
    before = dict(regions(tab))
    do(tab, "stroke", points=[[50, 50]], radius=10)
    assert "no region" in tab.said and regions(tab) == before
    do(tab, "add", kind="upright")
    do(tab, "brush", value="add")
    assert tab.wire.brush == "add" and 'data-value="erase"' not in tab.wire.panels["chosen"]
    do(tab, "stroke", points=[[50, 50], [90, 50]], radius=10)
    (name,) = set(regions(tab)) - set(before)
    first = regions(tab)[name]
    assert first["class"] == "vertical" and tab.chosen == ("depth", "regions", name, "pixels") and tab.wire.brush == "add"
    assert not tab.picture.handles.data["x"], "points are out of the brush's way"
    mask = polygon_mask((200, 200), np.asarray(first["pixels"]))
    assert mask[50, 70] and not mask[65, 70] and mask.sum() == pytest.approx(40 * 20 + math.pi * 100, rel=0.04)
    do(tab, "brush", value="erase")
    do(tab, "stroke", points=[[70, 50]], radius=5)
    assert len(regions(tab)[name]["holes"]) == 1
    do(tab, "undo")
    assert regions(tab)[name] == first
    do(tab, "undo")
    assert regions(tab) == before


def test_the_brush_is_for_outlined_regions_alone(tab):
    do(tab, "choose", place=["camera"])
    do(tab, "brush", value="add")
    assert tab.wire.brush == "off" and "Brush" not in tab.wire.panels["chosen"]
    do(tab, "choose", place=["depth", "regions", "left_house"])
    do(tab, "brush", value="add")
    assert tab.wire.brush == "off", "it is painted in the label image"
    do(tab, "choose", place=None)
    do(tab, "add", kind="ground")
    do(tab, "brush", value="add")
    do(tab, "stroke", points=[[50, 50]], radius=10)
    assert tab.wire.brush == "add" and tab.wire.panels["hint"].startswith("Paint")
    do(tab, "cancel")
    assert tab.wire.brush == "off" and tab.chosen, "Esc leaves the brush first"


@pytest.mark.parametrize("stated", [{}, {"points": []}, {"points": [[1]], "radius": 3}, {"points": [[1, 2]], "radius": "x"},
                                    {"points": [[1, 2]], "radius": -1}, {"points": [[1, float("inf")]], "radius": 3},
                                    {"points": [[1, 2]] * 2000, "radius": 3}, {"points": [[1, 2]], "radius": float("nan")}])
def test_strokes_that_are_none_change_nothing(tab, stated):
    do(tab, "add", kind="ground")
    do(tab, "brush", value="add")
    before = dict(regions(tab))
    do(tab, "stroke", **stated)
    assert regions(tab) == before
