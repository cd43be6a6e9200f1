"""Fog by others beside ours: their laws and known answers, and `compare` with and without a ground truth."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.imaging.photograph import averaged
from pipeline.physics.comparison import measured
from pipeline.physics.constant_light import constant_light_fog, fitted_airlight
from pipeline.plugins import baseline
from pipeline.plugins.registry import registry
from pipeline.plugins.baseline import EFFECTS, ClearView, OtherFog, Wanted
from pipeline.plugins.baselines.euler_preprocess import planar
from pipeline.plugins.baselines.ibpm import Ibpm
from pipeline.plugins.baselines.koschmieder import Koschmieder, brightest_of_the_dark_channel
from pipeline.scene.artefacts import read_json
from pipeline.stages import compare
from tests.conftest import CHAIN

AIRLIGHT = np.array([0.5, 0.6, 0.8])


def view(rng_seed: int = 1, size=(40, 60), kappa=(0.05, 0.05, 0.05), visibility: float = 60.0) -> ClearView:
    """A random photograph of things 1 to 80 m away."""
    rng = np.random.default_rng(rng_seed)
    codes = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    radiance, depth = (codes / 255.0) ** 2.2, rng.uniform(1, 80, size)
    f = 50.0
    return ClearView(radiance, codes, depth, np.zeros(size, bool), depth[..., None] * np.array(kappa), np.ones(3), visibility,
                     np.array([[f, 0, size[1] / 2], [0, f, size[0] / 2], [0, 0, 1]]),
                     Wanted("ground truth", radiance, np.ones(size, bool), lambda picture: picture))


def wanting(one: ClearView, picture, counted=None, shrunk=lambda picture: picture) -> ClearView:
    picture = shrunk(picture)
    counted = np.ones(picture.shape[:2], bool) if counted is None else counted
    return replace(one, wanted=Wanted("ground truth", picture, counted, shrunk))


# ---- fog lit alike everywhere ------------------------------------------------------------------

def test_constant_light_in_two_steps_is_that_in_one():
    one = view()
    near, far = 0.3 * one.optical_depth, 0.7 * one.optical_depth
    whole = constant_light_fog(one.radiance, one.optical_depth, AIRLIGHT)
    np.testing.assert_allclose(constant_light_fog(constant_light_fog(one.radiance, far, AIRLIGHT), near, AIRLIGHT), whole,
                               rtol=1e-12)  # rounding


def test_constant_light_extremes():
    radiance = np.array([[0.2, 0.4, 3.0]])
    assert np.array_equal(constant_light_fog(radiance, np.zeros((1, 3)), AIRLIGHT), radiance), "no fog, nothing changed"
    assert np.array_equal(constant_light_fog(radiance, np.full((1, 3), 1e5), AIRLIGHT)[0], AIRLIGHT)
    # what thin fog adds: kappa d A to first order, of which expm1 keeps the digits
    thin = constant_light_fog(np.zeros((1, 3)), np.full((1, 3), 1e-12), AIRLIGHT)[0]
    np.testing.assert_allclose(thin, 1e-12 * AIRLIGHT, rtol=1e-11)


def test_as_bright_as_its_surroundings_a_thing_does_not_change_in_fog():
    radiance = np.broadcast_to(AIRLIGHT, (5, 3))
    found = constant_light_fog(radiance, np.linspace(0, 9, 5)[:, None], AIRLIGHT)
    np.testing.assert_allclose(found, radiance, rtol=1e-14)


def test_airlight_is_the_least_squares_one():
    one, rng = view(), np.random.default_rng(3)
    survives, share = one.radiance * np.exp(-one.optical_depth), -np.expm1(-one.optical_depth)
    wanted = survives + AIRLIGHT * share + 0.05 * rng.normal(size=share.shape)
    counted = rng.random(one.depth.shape) < 0.5
    best, error = fitted_airlight(survives, share, wanted, counted)
    for change in (0.99, 1.01):
        assert ((wanted - survives - change * best * share)[counted] ** 2).mean() > error
    assert fitted_airlight(survives, share, np.zeros_like(wanted), counted)[0].min() == 0, "no negative light"


# ---- IBPM --------------------------------------------------------------------------------------

@pytest.mark.parametrize("factor", [1.0, 0.3, 4.0])
def test_ibpm_finds_the_parameters_of_its_own_pictures(factor):
    one = view()
    true = constant_light_fog(one.radiance, factor * one.optical_depth, AIRLIGHT)
    # averaged over blocks, as ground truth of a smaller size asks
    made = Ibpm().foggy(wanting(one, true, shrunk=lambda picture: averaged(picture, (30, 20))))
    # the search ends at 1e-3 in the logarithm of the density
    assert made.parameters["density_over_the_fogs_own"] == pytest.approx(factor, rel=3e-3)
    np.testing.assert_allclose(made.parameters["airlight"], AIRLIGHT, rtol=3e-3)
    assert measured(made.picture, true, np.ones(true.shape[:2], bool))[0] < 1e-3


def test_ibpm_is_no_worse_than_with_the_fogs_own_density_or_any_other():
    one, rng = view(), np.random.default_rng(5)
    true = rng.random(one.radiance.shape) * np.linspace(0.2, 1, 60)[None, :, None]
    counted = rng.random(one.depth.shape) < 0.7
    made = Ibpm().foggy(wanting(one, true, counted))
    error = measured(made.picture, true, counted)[0]
    for factor in np.exp(np.linspace(np.log(1 / 16), np.log(16), 40)):
        through = np.exp(-factor * one.optical_depth)
        assert error**2 <= fitted_airlight(one.radiance * through, 1 - through, true, counted)[1] * (1 + 1e-4)


def test_ibpm_keeps_the_fogs_own_density_where_no_other_is_better():
    one = view()
    true = constant_light_fog(one.radiance, one.optical_depth, AIRLIGHT)
    assert Ibpm().foggy(wanting(one, true)).parameters["density_over_the_fogs_own"] == 1.0


# ---- Koschmieder -------------------------------------------------------------------------------

def test_koschmieder_on_code_values():
    one = replace(view(), depth=np.full((40, 60), 60.0))
    made = Koschmieder().foggy(one)
    airlight = np.array(made.parameters["airlight_srgb"])
    # at the visibility's distance 5 % of the contrast is left (WMO), in their encoding
    np.testing.assert_allclose(made.picture / 255, 0.05 * one.encoded / 255 + 0.95 * airlight, atol=0.5 / 255 + 1e-9)


def test_airlight_is_the_median_of_the_brightest_thousandth_of_the_dark_channel():
    codes = np.full((90, 120, 3), 40, np.uint8)
    codes[20:60, 30:80] = [120, 130, 200]      # large and bright in its darkest channel
    codes[70:75, 100:105] = 255                # brighter, but smaller than the patch
    codes[65:85, 2:22, 0] = 255                # bright red, whose darkest channel is dark
    assert brightest_of_the_dark_channel(codes).tolist() == [120, 130, 200]
    assert brightest_of_the_dark_channel(np.full((1, 1, 3), 7, np.uint8)).tolist() == [7, 7, 7]


# ---- packages ----------------------------------------------------------------------------------

def test_planar_depth_of_a_radial_one():
    one = view()
    radial = planar(one.depth, one.intrinsics)
    assert radial[20, 30] == pytest.approx(one.depth[20, 30]), "on the axis they are the same"
    assert radial[20, 0] == pytest.approx(one.depth[20, 0] * 50 / np.hypot(50, 30))


@pytest.mark.parametrize("name", ["random_fog", "common_corruptions", "euler_preprocess"])
def test_installed_tools_are_repeatable_and_leave_no_trace(name):
    cls = registry("baselines")[name]
    pytest.importorskip(cls.package)
    np.random.seed(7)
    expected = np.random.random(3)
    np.random.seed(7)
    for size in ((40, 60), (20, 31)):
        one = view(size=size)
        first, again = (cls().foggy(one).picture for _ in range(2))
        assert first.shape == one.encoded.shape and np.array_equal(first, again)
        assert not np.array_equal(first, one.encoded)
    assert np.array_equal(np.random.random(3), expected), "the generator of others goes on as it was"


def test_euler_is_koschmieder_with_the_scenes_depth_and_visibility():
    pytest.importorskip("euler_preprocess")
    one = view()
    made = registry("baselines")["euler_preprocess"]().foggy(one)
    assert made.parameters["beta_per_m"] == pytest.approx(-np.log(0.05) / one.visibility, rel=1e-6)
    # contrast falls by exp(-beta d), whatever its airlight and encoding are: so much for depth along the ray
    same = replace(one, depth=np.full(one.depth.shape, 1e-3))
    near, far = (registry("baselines")["euler_preprocess"]().foggy(replace(same, depth=planar_to_ray(d, one))).picture.astype(float)
                 for d in (1e-3, 2 * one.visibility))
    assert far.std((0, 1)).max() < 0.05 * near.std((0, 1)).min()


def planar_to_ray(depth: float, one: ClearView) -> np.ndarray:
    return depth / planar(np.ones(one.depth.shape), one.intrinsics)


def test_every_baseline_states_what_it_does():
    for cls in registry("baselines").values():
        assert issubclass(cls, OtherFog) and cls.title and cls.effects <= set(EFFECTS)


# ---- the stage ---------------------------------------------------------------------------------

def rows(build: Build) -> dict[str, dict[str, str]]:
    with open(build.compare / "compare.csv", newline="", encoding="utf-8") as file:
        return {row["method"]: row for row in csv.DictReader(file)}


@pytest.fixture
def alone(monkeypatch):
    """As if nothing of `make setup-compare` were there."""
    monkeypatch.setattr(baseline.importlib.util, "find_spec", lambda name: None)


def with_truth(build: Build, picture, **changed) -> None:
    write_map(build.truth, picture.astype(np.float32))
    facts = {"fog": read_json(build.input("fog")), "about": "known", **changed}
    build.truth.with_suffix(".json").write_text(json.dumps(facts))


def test_compare(tiny_scene, alone, capsys):
    assert tiny_scene.run(*CHAIN, "compare") == 0
    build = tiny_scene.build
    said, found = capsys.readouterr().out, rows(build)
    assert set(found) == {"ours", *registry("baselines")}
    assert "no ground truth" in said and "make truth scene=tiny" in said
    for name, cls in registry("baselines").items():
        made = (build.compare / f"{name}.png").exists(), (build.compare / f"{name}.exr").exists()
        if cls.package:
            assert found[name]["note"] == "not installed: make setup-compare" and made == (False, False)
            assert f"{cls.title}" in said and "not installed: make setup-compare" in said
        else:
            assert found[name]["rmse"] == "" and float(found[name]["seconds"]) >= 0 and made == (True, True)
    assert "fitted_to=our result" in found["ibpm"]["parameters"]
    page = (build.compare / "compare.html").read_text()
    assert all(cls.title in page for cls in registry("baselines").values()) and all(effect in page for effect in (
        "lamps&#39; glow", "shafts", "metres"))
    sheet = cv2.imread(str(build.compare / "side_by_side.png"))
    assert sheet.shape[1] > 3 * 160, "the photograph, ours, and what needs no package"
    ours = read_map(build.compare / "ours.exr")
    assert np.array_equal(ours, read_map(build.foggy(".exr")))

    # what is true: our own picture, smaller; IBPM gets its parameters from it
    true = averaged(ours, (12, 9))
    with_truth(build, true)
    assert tiny_scene.run("compare") == 0
    found = rows(build)
    assert float(found["ours"]["rmse"]) < 1e-6 < float(found["ibpm"]["rmse"])  # rounding of float32
    assert "fitted_to=ground truth" in found["ibpm"]["parameters"]
    # known: an error of 0.1 everywhere
    with_truth(build, true + 0.1)
    assert tiny_scene.run("compare") == 0
    assert float(rows(build)["ours"]["rmse"]) == pytest.approx(0.1, rel=1e-4)
    assert float(rows(build)["ours"]["times_ours"]) == pytest.approx(1)
    # the photograph exposed anew is compared as it was
    assert tiny_scene.run("resolve", "composite", "compare", overrides=("composite.exposure=1",)) == 0
    assert float(rows(build)["ours"]["rmse"]) == pytest.approx(0.1, rel=1e-3)
    # relit fog, or a truth of another fog, is held against nothing
    capsys.readouterr()
    assert tiny_scene.run("resolve", "decompose", "composite", "compare", overrides=("lights.bulb.gain=2",)) == 0
    assert "gains other than 1" in capsys.readouterr().out and rows(build)["ours"]["rmse"] == ""
    assert tiny_scene.run("resolve", "decompose", "composite") == 0
    with_truth(build, true, fog={"type": "homogeneous"})
    assert tiny_scene.run("compare") == 0
    assert "is of another fog" in capsys.readouterr().out and rows(build)["ours"]["rmse"] == ""


def test_lamps_and_burnt_out_pixels_are_not_counted():
    clipped = np.zeros((4, 6))
    clipped[0, 0] = 1
    counted = ~(clipped > 0)
    wanted = compare._wanted(np.zeros((2, 3, 3)), np.zeros((4, 6, 3)), counted)
    assert not wanted.counted[0, 0] and wanted.counted.sum() == 5


def test_a_tool_that_fails_is_left_out_by_name(tiny_scene, alone, monkeypatch):
    assert tiny_scene.run() == 0
    monkeypatch.setattr(Koschmieder, "foggy", lambda self, view: 1 / 0)
    assert tiny_scene.run("compare") == 0
    found = rows(tiny_scene.build)
    assert found["koschmieder"]["note"] == "fails: ZeroDivisionError: division by zero" and found["ibpm"]["note"] == ""


def test_clear_fog_is_refused(tiny_scene, capsys):
    assert tiny_scene.run(*CHAIN, overrides=("fog={type: homogeneous, visibility: .inf}",)) == 0
    capsys.readouterr()
    assert tiny_scene.run("compare") == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("scene.yaml: the fog is clear: nothing to compare; pick a denser fog")
