"""Views of panoramas agree with the project's camera, wrap round, and average what they cannot resolve."""

import numpy as np
import pytest

from pipeline.geometry.camera import rotation
from pipeline.imaging.panorama import perspective_view, view_camera


def direction_panorama(height=256):
    """A panorama whose three channels are the world direction of each pixel's centre."""
    azimuth = ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    azimuth, elevation = np.meshgrid(azimuth, elevation)
    return np.stack([np.sin(azimuth) * np.cos(elevation), np.sin(elevation),
                     -np.cos(azimuth) * np.cos(elevation)], -1)


@pytest.mark.parametrize("yaw, pitch", [(0, 0), (75, -10), (180, 0), (-179, 30), (20, 90), (-100, -90)])
def test_each_pixel_shows_the_direction_of_its_ray(yaw, pitch):
    view = perspective_view(direction_panorama(), yaw, pitch, 80, 40, 30)
    camera = view_camera(yaw, pitch, 80, 40, 30)
    assert np.array_equal(camera.world_from_camera, rotation(yaw, pitch))
    rays = camera.directions(camera.pixel_centres())
    # Linear interpolation and averaging over a pixel of 0.04 rad bend a direction by about 0.04^2 / 8.
    assert np.abs(view - rays).max() < 5e-4


def test_the_middle_column_is_ahead_and_yaw_turns_right():
    panorama = np.zeros((32, 64, 3), np.float32)
    panorama[:, 31:33, 0] = panorama[:, 47:49, 1] = 1  # ahead; a quarter turn to the right
    assert perspective_view(panorama, 0, 0, 2, 1, 1)[0, 0].argmax() == 0
    assert perspective_view(panorama, 90, 0, 2, 1, 1)[0, 0].argmax() == 1


def test_horizontal_field_of_view_spans_the_width():
    camera = view_camera(0, 0, 90, 200, 100)
    left, right = camera.directions(np.array([[0, 50], [200, 50]]))
    assert np.degrees(np.arccos(left @ right)) == pytest.approx(90)


def test_no_seam_behind_and_at_the_poles():
    smooth = direction_panorama(64)
    for yaw, pitch in [(180, 0), (0, 90), (0, -90)]:
        view = perspective_view(smooth, yaw, pitch, 60, 64, 64)
        # Adjacent rays are at most 0.018 rad apart; a seam would repeat or skip a 0.05 rad pixel.
        assert max(np.abs(np.diff(view, axis=axis)).max() for axis in (0, 1)) < 0.025


def test_minified_stripes_average_out():
    stripes = np.zeros((512, 1024, 3), np.float32)
    stripes[:, ::2] = 1
    # 2.8 to 13 stripes fall into a pixel: without averaging values of 0 and 1 would appear.
    view = perspective_view(stripes, 0, 0, 90, 16, 12)
    assert np.abs(view - 0.5).max() < 0.2
    assert view.mean() == pytest.approx(0.5, abs=0.01)


def test_a_uniform_panorama_stays_exactly_uniform_and_nothing_is_negative():
    assert (perspective_view(np.full((8, 16, 3), 0.25), 30, 20, 100, 9, 7) == 0.25).all()
    lamp = np.zeros((32, 64, 3))
    lamp[16, 32] = 1e4
    assert perspective_view(lamp, 0, 0, 60, 64, 48).min() == 0


@pytest.mark.parametrize("angle", [0, 180, -20, float("nan")])
def test_an_impossible_field_of_view_is_a_bug(angle):
    with pytest.raises(ValueError, match="between 0 and 180"):
        perspective_view(np.zeros((2, 4, 3)), 0, 0, angle, 2, 2)
