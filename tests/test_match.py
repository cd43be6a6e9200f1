"""Fog found in another photograph: pictures of known fog in closed form give that fog back, and what nothing tells is said."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.estimation.fog_match import Asked, match
from pipeline.estimation.fog_response import Response
from pipeline.imaging.colour import linear_to_srgb, srgb_to_linear
from pipeline.reporting.matched import fog_of, numbers, settings_of, visibility_of, words

WIDTH, HEIGHT = 48, 40
SKY, SUN = np.array([0.80, 0.85, 0.90]), np.array([0.50, 0.40, 0.30])
#: Every half power of two, as coarse as trial fogs are where a match lies.
EXTINCTIONS = 2.0 ** np.arange(-16, 3.5, 0.5)
ASYMMETRIES = (-0.3, 0.0, 0.3, 0.55, 0.75, 0.88)
v, u = (one.ravel() for one in np.mgrid[:HEIGHT, :WIDTH])
#: A street that goes away upwards, with houses.
DEPTH = (3 * np.exp(4 * (1 - v / HEIGHT)) + 5 * (u % 17 > 8))[:, None]
COSINE = np.linspace(-0.5, 1, WIDTH)[u][:, None]
CLEAR = np.abs(0.25 + np.random.default_rng(0).normal(size=(len(v), 1)) * 0.1
               + np.random.default_rng(1).normal(size=(len(v), 3)) * 0.05)
TILES = np.stack([v, u], -1) * 8 // WIDTH
FLAT = Asked(np.ones(3), 0.55)


def fog(extinction, asymmetry=0.55):
    """R T and V of sky and sun in closed form, (3, N, 3): an even sky's V is airlight * (1 - T)."""
    g = asymmetry
    phase = (1 - g**2) / (1 + g**2 - 2 * g * COSINE) ** 1.5
    through = np.exp(-extinction * DEPTH)
    return np.stack([CLEAR * through, SKY * (1 - through), SUN * phase * (1 - through)])


def response(asymmetries=(0.55,)):
    glows = np.stack([np.stack([fog(k, g)[1:] for g in asymmetries]) for k in EXTINCTIONS])
    return Response.of(EXTINCTIONS, asymmetries, CLEAR, np.stack([fog(k)[0] for k in EXTINCTIONS]), glows)


def reference(extinction, albedo=(1, 1, 1), gains=(1, 1), exposure=1.0, asymmetry=0.55, noise=0.01, seed=2):
    made = fog(extinction, asymmetry)
    picture = exposure * (made[0] + np.asarray(albedo) * np.einsum("lnc,l->nc", made[1:], gains))
    return picture * (1 + noise * np.random.default_rng(seed).normal(size=picture.shape))


EVEN, LOBED = response(), response(ASYMMETRIES)


# ---- between the nodes -------------------------------------------------------------------------

@pytest.mark.parametrize("extinction", [3e-5, 1e-3, 0.0271, 0.4, 3.7])
@pytest.mark.parametrize("asymmetry", [0.1, 0.62, 0.8])
def test_response_between_trial_fogs(extinction, asymmetry):
    # a cubic over steps of ln 2 / 2 is good to 1e-4 of a fog's own terms; over the steps in g to 5 % of the sun's V at g = 0.8
    made = LOBED.at(np.log(extinction), asymmetry)
    assert made[:2] == pytest.approx(fog(extinction)[:2], rel=2e-3, abs=1e-5)
    assert made[2] == pytest.approx(fog(extinction, asymmetry)[2], rel=0.05, abs=1e-5)
    at_node = LOBED.at(np.log(EXTINCTIONS[20]), 0.3)
    assert at_node == pytest.approx(fog(EXTINCTIONS[20], 0.3), rel=1e-4, abs=1e-5)


# ---- known fog comes back ----------------------------------------------------------------------

@pytest.mark.parametrize("extinction, exposure", [
    (0.03, 1.0), (0.03, 2 * np.array([1.1, 1.0, 0.9])), (0.03, 0.5 * np.array([0.9, 1.0, 1.15])), (2e-3, 2 * np.array([1.1, 1.0, 0.9])),
    (0.3, 0.5 * np.array([0.9, 1.0, 1.15]))], ids=str)
def test_known_fog_comes_back_whatever_the_exposure(extinction, exposure):
    found = match(EVEN, reference(extinction, (0.95, 0.93, 0.9), exposure=exposure), TILES, FLAT)
    # noise of 1 % on 1920 pixels is 0.1 % of a parameter in the open, ten times that in thin and in dense fog
    assert found.extinction == pytest.approx(extinction, rel=0.02)
    assert found.interval[0] < found.extinction < found.interval[1] and found.determined["visibility"]
    assert found.exposure == pytest.approx(np.ones(3) * exposure, rel=0.02) and found.determined["exposure"]
    assert found.albedo == pytest.approx([0.95, 0.93, 0.9], abs=0.03) and found.determined["albedo"]
    assert found.gains == pytest.approx([1, 1], rel=0.05)


def test_eight_bits_are_enough():
    seen = np.clip(reference(0.03, (0.95, 0.93, 0.9), exposure=0.5), 0, 1).astype(np.float32)
    seen = srgb_to_linear(np.round(255 * linear_to_srgb(seen)).astype(np.float32) / 255)
    found = match(EVEN, seen, TILES, FLAT)
    assert found.extinction == pytest.approx(0.03, rel=0.01) and found.albedo == pytest.approx([0.95, 0.93, 0.9], abs=0.02)


def test_gains_are_told_from_albedo_by_their_limit():
    """Airlight beyond an albedo of 1 takes gains; their ratio is what tells the lights apart."""
    found = match(EVEN, reference(0.03, (0.9, 0.9, 0.95), (2.0, 0.5)), TILES, FLAT)
    assert found.albedo.max() == pytest.approx(1, abs=1e-6)
    assert found.gains[0] / found.gains[1] == pytest.approx(4, rel=0.03)
    assert found.albedo[:, None] * found.gains == pytest.approx(np.outer([0.9, 0.9, 0.95], [2.0, 0.5]), rel=0.03)
    assert found.determined_gains.all()


def test_what_is_not_asked_for_stays():
    asked = Asked(np.array([0.8, 0.8, 0.8]), 0.55, fit_albedo=False, fit_gains=False)
    found = match(EVEN, reference(0.03, (0.8, 0.8, 0.8)), TILES, asked)
    assert found.extinction == pytest.approx(0.03, rel=0.01)
    assert (found.albedo == 0.8).all() and (found.gains == 1).all() and (found.albedo_error == 0).all()


def test_asymmetry():
    asked = Asked(np.ones(3), 0.55, fit_asymmetry=True)
    found = match(LOBED, reference(0.03, asymmetry=0.66), TILES, asked)
    # a cubic through the tried asymmetries is off by up to 0.02 of g
    assert found.asymmetry == pytest.approx(0.66, abs=0.03) and found.determined["asymmetry"]
    assert found.extinction == pytest.approx(0.03, rel=0.02)


def test_passers_by_are_left_out():
    """A tenth of the picture shows something else; least squares alone is far off."""
    seen = reference(0.03)
    seen[(u > 20) & (u < 25)] = [0.02, 0.02, 0.03]
    assert match(EVEN, seen, TILES, FLAT).extinction == pytest.approx(0.03, rel=0.02)


def test_ninety_five_percent_hold_the_truth():
    """Errors that are alike over patches of 6 pixels, as what a real view's light does otherwise: the tiles must see that."""
    inside = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        patches = np.kron(rng.normal(size=(HEIGHT // 5, WIDTH // 6)), np.ones((5, 6))).ravel()[:, None]
        extinction = 0.02 * 2 ** rng.uniform(-1, 1)
        found = match(EVEN, reference(extinction, seed=seed) * (1 + 0.04 * patches), TILES, FLAT)
        inside.append(found.interval[0] <= extinction <= found.interval[1])
    # 11 are expected; fewer than 9 have a chance of 0.3 %
    assert sum(inside) >= 9


# ---- what nothing tells ------------------------------------------------------------------------

@pytest.mark.parametrize("seen", [CLEAR, 0.5 * CLEAR, reference(1e-7)], ids=["the clear photograph", "darker", "hardly foggy"])
def test_no_fog_is_not_given_a_visibility(seen):
    found = match(EVEN, seen, TILES, FLAT)
    assert found.open_ends == (True, False) and not any(found.determined[name] for name in ("visibility", "albedo", "asymmetry"))
    assert not found.determined_gains.any() and found.determined["exposure"]
    stated = numbers(found, ["sky", "sun"], 0.0)
    assert stated["visibility_m"]["value"] is None and stated["visibility_m"]["interval_95"][1] is None
    assert stated["visibility_m"]["interval_95"][0] > 300 * 50, "a fog that dims what is 50 m away by a hundredth would be seen"
    assert "or more; no fog would do as well" in words(found, ["sky", "sun"], 0.0)[0]
    assert all(np.isfinite(one).all() for one in (found.albedo, found.gains, found.exposure, found.albedo_error))


def test_a_grey_wall_has_no_least_visibility():
    found = match(EVEN, reference(60.0, noise=1e-3), TILES, FLAT)
    assert found.open_ends[1] and not found.determined["visibility"]
    assert not found.determined["exposure"], "nothing of the photograph is seen through it"
    stated = numbers(found, ["sky", "sun"], 0.0)
    assert stated["visibility_m"]["interval_95"][0] is None and stated["exposure_ev"]["value"] is None
    assert "or less; any denser fog would do as well" in words(found, ["sky", "sun"], 0.0)[0]


@pytest.mark.parametrize("seen", [np.zeros_like(CLEAR), np.full_like(CLEAR, 0.4), 1e4 * CLEAR], ids=["black", "even grey", "brilliant"])
def test_strange_references_end_in_bounds(seen):
    found = match(EVEN, seen, TILES, FLAT)
    values = np.concatenate([[found.extinction, *found.interval], found.albedo, found.gains, found.exposure])
    assert np.isfinite(values).all() and found.range[0] <= found.extinction <= found.range[1]
    assert (found.albedo >= 0).all() and (found.albedo <= 1).all() and (found.gains > 0).all()


# ---- what is said ------------------------------------------------------------------------------

def test_fog_as_the_scene_file_states_it():
    phase = {"type": "henyey_greenstein", "asymmetry": 0.55}
    found = match(EVEN, reference(0.03, exposure=2.0, gains=(3.0, 1.5)), TILES, FLAT)
    fog = fog_of(found, phase)
    assert fog["type"] == "homogeneous" and fog["phase_function"] == phase
    assert fog["visibility"] == pytest.approx(visibility_of(0.03), rel=0.01)
    settings = dict(one.split("=") for one in settings_of(found, ["sky", "sun"], {"sky": 2.0, "sun": 1.0}))
    assert float(settings["lights.sky.gain"]) == pytest.approx(2 * found.gains[0], rel=0.01), "on top of the stated one"
    assert float(settings["composite.exposure"]) == pytest.approx(1, abs=0.03)
