"""Retinex against rendered shading, and segments of one albedo."""

import numpy as np
import pytest

from pipeline.estimation.albedo import albedo_segments, log_reflectance, mean_albedo_per_surface

HEIGHT, WIDTH = 60, 80
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(float)
ONE_FACE = np.zeros((HEIGHT, WIDTH), np.int32)
ALL = np.ones((HEIGHT, WIDTH), bool)


def _grey(values):
    return np.repeat(values[..., None], 3, -1)


def _two_lights(shadow_at=50):
    """Irradiance of a lamp on the left and of one on the right that a shadow cuts at a column."""
    left = 1 / (1 + (COLUMNS / 40) ** 2)
    right = np.where(COLUMNS < shadow_at, 0.05, 1 / (1 + ((WIDTH - COLUMNS) / 40) ** 2))
    return np.log(np.stack([_grey(left), _grey(right)]))


def _shading(log_basis, intensity):
    return np.log(np.einsum("lhwc,l->hwc", np.exp(log_basis), intensity))


@pytest.mark.parametrize("intensity", [(1, 0.01), (1, 1), (0.01, 1), (3, 0.5)])
def test_shading_of_any_lights_is_not_reflectance(intensity):
    """A plain wall comes out plain at every mixture of the lights, shadow edge and all."""
    basis = _two_lights()
    photograph = _shading(basis, intensity) + np.log(0.6)
    found = log_reflectance(photograph, basis, ONE_FACE, ALL, _shading(basis, (1, 1)))
    assert np.ptp(found) < 0.03  # the pull towards the guess is felt this much over 80 pixels
    assert len(albedo_segments(found, ONE_FACE, ALL)[1]) == 1


def test_displaced_shadow_is_not_reflectance():
    photograph = _shading(_two_lights(51), (1, 1))
    basis = _two_lights(50)
    found = log_reflectance(photograph, basis, ONE_FACE, ALL, _shading(basis, (1, 1)))
    assert np.ptp(found) < 0.05
    far_off = log_reflectance(photograph, _two_lights(40), ONE_FACE, ALL, _shading(basis, (1, 1)))
    assert np.ptp(far_off) > 0.3  # ten pixels off is no longer the same edge


@pytest.mark.parametrize("other", [(0.2, 0.2, 0.2), (0.6, 0.35, 0.2)], ids=["darker", "coloured"])
def test_painted_half_is_found_under_uneven_light(other):
    painted = ROWS < 25
    albedo = np.where(painted[..., None], other, 0.6)
    basis = _two_lights()
    photograph = _shading(basis, (1, 0.4)) + np.log(albedo)
    found = log_reflectance(photograph, basis, ONE_FACE, ALL, _shading(basis, (1, 1)))
    difference = np.median(found[painted], 0) - np.median(found[~painted], 0)
    # At most the chroma and lightness that a shading gradient of the same place could have hidden.
    assert difference == pytest.approx(np.log(np.array(other) / 0.6), abs=0.08)
    segment, faces = albedo_segments(found, ONE_FACE, ALL)
    assert faces.tolist() == [0, 0]
    for half in (painted, ~painted):
        counts = np.bincount(segment[half], minlength=2)
        assert counts.max() > 0.97 * half.sum()  # the row that straddles the edge may go either way


def test_light_colour_does_not_cut_a_wall():
    """Warm lamp on one side, blue daylight on the other: a gradual change of colour is shading."""
    basis = _two_lights(0)
    tinted = basis + np.log(np.array([[1.3, 1, 0.7], [0.7, 1, 1.3]]))[:, None, None]
    photograph = _shading(tinted, (1, 1)) + np.log(0.5)
    found = log_reflectance(photograph, basis, ONE_FACE, ALL, _shading(basis, (1, 1)))
    assert len(albedo_segments(found, ONE_FACE, ALL)[1]) == 1


def test_ramp_is_never_cut_and_steps_are():
    ramp = _grey(COLUMNS / WIDTH * 2)
    assert len(albedo_segments(ramp, ONE_FACE, ALL)[1]) == 1
    rng = np.random.default_rng(0)
    noise = _grey(rng.normal(0, 0.03, (HEIGHT, WIDTH)))
    steps = _grey(np.floor(COLUMNS / 20)) + noise
    segment, faces = albedo_segments(steps, ONE_FACE, ALL)
    assert len(faces) == 4
    assert all(len(np.unique(segment[:, 20 * k : 20 * k + 20])) == 1 for k in range(4))
    assert len(albedo_segments(noise, ONE_FACE, ALL)[1]) == 1


def test_faces_stay_apart_and_unusable_pixels_are_left_out():
    surface = np.where(COLUMNS < 40, 3, 7).astype(np.int32)
    usable = ALL & (ROWS > 10)
    segment, faces = albedo_segments(np.zeros((HEIGHT, WIDTH, 3)), surface, usable)
    assert faces.tolist() == [3, 7]
    assert (segment[~usable] == -1).all()
    assert (segment[usable] == np.where(surface == 3, 0, 1)[usable]).all()


def test_gradient_across_faces_says_nothing():
    """Each face keeps its own level from the guess, so that a corner is neither step nor link."""
    surface = np.where(COLUMNS < 40, 0, 1).astype(np.int32)
    basis = np.zeros((1, HEIGHT, WIDTH, 3))
    photograph = np.where((surface == 0)[..., None], -1.0, 1.0) + np.zeros((HEIGHT, WIDTH, 3))
    guess = np.zeros_like(photograph)
    found = log_reflectance(photograph, basis, surface, ALL, guess)
    assert found == pytest.approx(photograph, abs=1e-6)  # rounding of the factorisation
    scaled = log_reflectance(photograph, basis, surface, ALL, guess + 0.5)
    assert scaled == pytest.approx(photograph - 0.5, abs=1e-6)


def test_mean_albedo_per_surface():
    surface = np.array([[0, 0, 2], [2, 5, -1]], np.int32)
    albedo = np.array([[0.2] * 3, [0.8] * 3, [0.4] * 3])
    means = mean_albedo_per_surface(albedo, [0, 0, 2], [30, 10, 40], surface)
    assert sorted(means) == [0, 2, 5]
    assert means[0] == pytest.approx(0.35) and means[2] == pytest.approx(0.4)
    assert means[5] == pytest.approx(0.375)  # unseen: (30*0.2 + 10*0.8 + 40*0.4) / 80
    assert mean_albedo_per_surface(np.zeros((0, 3)), [], [], surface)[0] == pytest.approx(0.5)
