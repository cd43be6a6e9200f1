"""T and V against Mitsuba 3 where it is installed, and how its noise is known."""

import sys

import numpy as np
import pytest

from pipeline.cli import main
from pipeline.imaging.maps import read_map, write_map
from pipeline.plugins.registry import registry
from pipeline.rendering.describe import describe
from pipeline.rendering.second_opinion import Estimate
from pipeline.scene.artefacts import read_fog, read_json, read_placed, read_strengths
from tests.test_exporters import arguments
from tests.test_light_transport import DESCRIBED, chain

MITSUBA = registry("exporters")["mitsuba"]
ALL = np.ones((8, 10), bool)


def passes(count, noise, seed=0):
    """Pictures (8, 10, 3) of radiance 2 with Gaussian noise."""
    return list(2 + noise * np.random.default_rng(seed).normal(size=(count, 8, 10, 3)))


def test_the_noise_is_the_standard_error_of_the_mean():
    for count in (4, 16, 64):
        found = Estimate.of(passes(count, 0.4))
        # the median over 240 values of what is known to 1/sqrt(2 (count - 1))
        assert found.noise(ALL) == pytest.approx(0.4 / 2 / np.sqrt(count), rel=0.15)
        assert np.abs(found.mean - 2).mean() == pytest.approx(0.4 / np.sqrt(count) * np.sqrt(2 / np.pi), rel=0.15)


def test_a_ratio_of_passes_that_vary_together_has_no_noise():
    under = passes(8, 0.4)
    over = [0.5 * one for one in under]
    assert np.allclose(Estimate.ratio(over, under).mean, 0.5) and Estimate.ratio(over, under).noise(ALL) < 1e-12
    apart = Estimate.ratio(passes(64, 0.2, 1), passes(64, 0.2, 2))
    assert apart.noise(ALL) == pytest.approx(np.sqrt(2) * 0.1 / 8, rel=0.15)
    quotient = Estimate.quotient(Estimate.of(passes(64, 0.2, 1)), Estimate.of(passes(64, 0.2, 2)))
    assert np.allclose(quotient.mean, apart.mean) and quotient.noise(ALL) == pytest.approx(apart.noise(ALL), rel=0.1)
    black = Estimate.ratio([np.zeros((8, 10, 3))] * 4, [np.zeros((8, 10, 3))] * 4)
    assert not black.used(ALL).any() and black.noise(ALL) == 0


def test_black_and_unseen_pixels_do_not_count():
    one = Estimate.of([np.concatenate([np.full((8, 5, 3), 2.0), np.full((8, 5, 3), 1e-4)], 1)] * 4)
    assert one.used(ALL)[:, :5].all() and not one.used(ALL)[:, 5:].any()
    seen = ALL.copy()
    seen[:, :5] = False
    assert one.used(seen)[:, 5:].all(), "black is what is black beside the brightest of what is seen"


def test_without_mitsuba_it_is_said_how_to_install_it(tmp_path, capsys, monkeypatch):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    capsys.readouterr()
    assert main(arguments(build, "crosscheck")) == 2
    assert "Mitsuba 3 is not installed; run: make setup-mitsuba" in capsys.readouterr().err
    assert not build.crosscheck.exists()


@pytest.mark.parametrize("value", ["0", "-1", "many", "1e3", "9" * 40])
def test_settings_from_the_environment(tmp_path, capsys, monkeypatch, value):
    build = chain(tmp_path, {"point": DESCRIBED["point"]})
    monkeypatch.setenv("FOG_CROSSCHECK_SAMPLES", value)
    capsys.readouterr()
    assert main(arguments(build, "crosscheck")) == 2
    assert f"FOG_CROSSCHECK_SAMPLES={value}" in capsys.readouterr().err


def test_crosscheck_tells_right_from_wrong(tmp_path, capsys, monkeypatch):
    pytest.importorskip("mitsuba")
    build = chain(tmp_path, {kind: DESCRIBED[kind] for kind in ("point", "area", "spot")}, box=True, render={"glow": "rendered"})
    monkeypatch.setenv("FOG_CROSSCHECK_SIZE", "8")
    assert main(arguments(build, "crosscheck")) == 0
    found = read_json(build.crosscheck)
    assert {"V point", "V area", "V total", "T point", "T area", "T total", "depth"} == set(found["maps"])
    assert found["not_compared"] == ["spot (spot): not stated in Mitsuba"] and found["failed"] == []
    assert found["maps"]["V point"]["noise_of_theirs"] <= 0.005 and found["maps"]["T total"]["noise_of_theirs"] <= 0.0025
    assert build.crosscheck.with_suffix(".png").is_file()
    # a V of the point that is 5 % too bright, as a wrong render would be
    run = build.runs / "in_scattering_point.exr"
    write_map(run, read_map(run) * np.float32(1.05))
    capsys.readouterr()
    assert main(arguments(build, "crosscheck")) == 2
    assert "V point" in capsys.readouterr().err and read_json(build.crosscheck)["failed"][0] == "V point"


def test_few_samples_say_nothing(tmp_path, capsys, monkeypatch):
    pytest.importorskip("mitsuba")
    sun = chain(tmp_path, {"sun": DESCRIBED["sun"]})
    monkeypatch.setenv("FOG_CROSSCHECK_SIZE", "16")
    monkeypatch.setenv("FOG_CROSSCHECK_SAMPLES", "1")
    capsys.readouterr()
    assert main(arguments(sun, "crosscheck")) == 2
    assert "noise is too large to tell" in capsys.readouterr().err and "V sun" in read_json(sun.crosscheck)["too_noisy"]


@pytest.mark.parametrize("kind", ["point", "area"])
def test_depth_and_in_scattering_are_mitsubas(tmp_path, kind):
    """A few coarse pixels: the median of the ratio averages over the noise of single ones."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    build = chain(tmp_path, {kind: DESCRIBED[kind]}, box=True)
    exporter = MITSUBA(samples=128)
    description = describe("in_scattering", read_placed(build), read_fog(build), read_strengths(build), [kind], {}, exporter)
    for file, content in exporter.export("one", description).items():
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    scene = mitsuba.load_file(str(tmp_path / "one.xml"))
    theirs, ours = np.array(mitsuba.render(scene, seed=1)), read_map(build.in_scattering())
    # a standard error of about 0.5 % over all pixels; the sum is not swayed by their spread
    away = (theirs.max(-1) < np.percentile(theirs.max(-1), 95)) & (read_map(build.surfaces)[..., 1] < 0)
    assert abs(ours[away].sum() / theirs[away].sum() - 1) < 0.03
    depth, sensor = read_map(build.depth), scene.sensors()[0]
    for v, u in ((3, 5), (17, 24), (30, 40)):
        ray, _ = sensor.sample_ray(0, 0, [(u + 0.5) / 48, (v + 0.5) / 36], [0.5, 0.5])
        # rays begin at the near plane, a millimetre along the axis
        assert abs(scene.ray_intersect(ray).t - depth[v, u]) < 0.005
