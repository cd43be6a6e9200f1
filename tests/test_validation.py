"""What `make validation` draws its figures from, small."""

import numpy as np
import pytest

from pipeline.scene.load import load_scene
from tests.validation import all_light
from tests.validation.chart import BOTTOM, COLOURS, HEIGHT, TOP, chart
from tests.validation.truth import DELTAS, HEIGHTS, Truth


@pytest.mark.parametrize("fog", [DELTAS[2], HEIGHTS[1]], ids=lambda fog: fog.name)
def test_each_step_adds_light(fog):
    found = all_light.picture(Truth(8), fog, 64, 1)
    pictures = [found[name] for name in all_light.STEPS]
    assert not pictures[0].any()
    for less, more in zip(pictures, pictures[1:]):
        assert (more >= less - 1e-12).all() and more.sum() > 1.05 * less.sum()


def test_pairs_are_independent():
    one, other = all_light.pair(Truth(8), DELTAS[1], 64, 1)
    a, b = (picture["all orders"] for picture in (one, other))
    assert np.array_equal(a, all_light.picture(Truth(8), DELTAS[1], 64, 1)["all orders"]), "told by their seed"
    assert not np.allclose(a, b) and abs(a.sum() / b.sum() - 1) < 0.2


def test_the_scenes_differ_by_photograph_and_ambient_light(tmp_path):
    for light, wanted in (("lamp alone", {"lamp"}), ("with ambient", {"lamp", "reflected"})):
        place = all_light.write_scenes(tmp_path / light.replace(" ", "_"), np.ones((8, 8, 3)), light)
        for name, fog in (("cornell", DELTAS[0].name), ("cornell_height", HEIGHTS[0].name)):
            scene = load_scene(place / name / "scene.yaml", fog=fog)
            assert set(scene.lights) == wanted and scene.photograph.file == "photograph.exr"


@pytest.mark.parametrize("logarithmic", [False, True])
def test_charts_show_what_is_above_zero(logarithmic):
    picture = chart("title", [0.1, 1.0, 3.0], {"some": [1e-9, 0.0, 1e-3], "none": [0.0, float("nan"), -1.0]},
                    logarithmic=logarithmic)[:HEIGHT - BOTTOM]
    assert (picture == COLOURS[0]).all(-1).any() and not (picture == COLOURS[1]).all(-1).any()
    level = chart("title", [0.1, 3.0], {"grid": [1e-2, 1e-4], "level": [1e-3, 1e-3]}, logarithmic=logarithmic)
    rows = np.flatnonzero((level[:HEIGHT - BOTTOM] == COLOURS[1]).all(-1).sum(1) > 400)
    assert len(rows) and abs(rows.mean() - (TOP + HEIGHT - BOTTOM) / 2) < 3, "half way between the powers of ten"
