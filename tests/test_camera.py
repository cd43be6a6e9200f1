"""The camera's conventions, and cameras given by hand."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, from_exif_35mm, from_field_of_view, rotation, yaw_pitch_roll


def test_default_view_has_x_right_y_up_and_looks_along_minus_z():
    camera = from_field_of_view(800, 600, 90, camera_height=1.6)
    assert camera.focal_length == pytest.approx(400)
    np.testing.assert_allclose(camera.directions([400, 300]), [0, 0, -1], atol=1e-15)
    pixels, depth = camera.project([[1, 1.6, -2], [0, 2.6, -2], [0, 1.6, 1]])
    np.testing.assert_allclose(pixels[:2], [[600, 300], [400, 100]])
    assert depth.tolist() == [2, 2, -1] and np.isnan(pixels[2]).all()


@pytest.mark.parametrize(
    "angles, forward", [((90, 0, 0), [1, 0, 0]), ((0, 90, 0), [0, 1, 0]), ((-90, 0, 0), [-1, 0, 0])]
)
def test_yaw_turns_right_and_pitch_up(angles, forward):
    np.testing.assert_allclose(rotation(*angles)[:, 2], forward, atol=1e-15)


def test_roll_turns_the_camera_clockwise():
    right = rotation(roll=30)[:, 0]  # the camera's right dips, so the photograph turns the other way
    np.testing.assert_allclose(right, [np.cos(np.radians(30)), -0.5, 0], atol=1e-15)


@pytest.mark.parametrize("seed", range(10))
def test_directions_undo_project(seed):
    rng = np.random.default_rng(seed)
    camera = Camera(
        700,
        1000,
        rng.uniform(300, 2000),
        rng.uniform(300, 600, 2),
        rotation(*rng.uniform([-180, -89, -180], [180, 89, 180])),
        rng.normal(size=3),
    )
    pixels = rng.uniform(-200, 1200, (50, 2))
    distance = rng.uniform(0.1, 50, (50, 1))
    seen, depth = camera.project(camera.position + camera.directions(pixels) * distance)
    np.testing.assert_allclose(seen, pixels, atol=1e-8)  # pixel; rounding, amplified by oblique rays
    assert (depth > 0).all() and np.linalg.det(camera.world_from_camera) == pytest.approx(1)


@pytest.mark.parametrize("seed", range(20))
def test_angles_undo_rotation(seed):
    angles = np.random.default_rng(seed).uniform([-180, -89, -180], [180, 89, 180])
    np.testing.assert_allclose(yaw_pitch_roll(rotation(*angles)), angles, atol=1e-9)  # degree; rounding


@pytest.mark.parametrize("pitch", [90, -90])
def test_straight_up_or_down_the_roll_is_reported_as_yaw(pitch):
    turn = rotation(40, pitch, 0)
    found = yaw_pitch_roll(turn)
    assert found[2] == 0 and found[1] == pytest.approx(pitch)
    np.testing.assert_allclose(rotation(*found), turn, atol=1e-12)


@pytest.mark.parametrize(
    "size, focal_35mm, pixels",
    [
        ((3600, 2400), 50, 5000),  # 3:2: width/36 per millimetre
        ((2400, 3600), 50, 5000),  # portrait: the same lens
        ((4000, 3000), 26, 26 * 5000 / np.hypot(36, 24)),  # 4:3: by the diagonal, not the width
    ],
)
def test_35mm_equivalent_goes_by_the_diagonal(size, focal_35mm, pixels):
    assert from_exif_35mm(*size, focal_35mm).focal_length == pytest.approx(pixels, rel=1e-12)


def test_angles_height_and_principal_point_by_hand():
    for camera in (
        from_field_of_view(
            800, 600, 60, camera_height=1.5, yaw=10, pitch=-5, roll=2, principal_point=(390, 310)
        ),
        from_exif_35mm(800, 600, 28, camera_height=1.5, yaw=10, pitch=-5, roll=2, principal_point=(390, 310)),
    ):
        np.testing.assert_allclose(yaw_pitch_roll(camera.world_from_camera), (10, -5, 2), atol=1e-12)
        assert camera.position.tolist() == [0, 1.5, 0] and camera.principal_point.tolist() == [390, 310]


@pytest.mark.parametrize("angle", [0, -10, 180, np.nan])
def test_impossible_field_of_view_is_refused(angle):
    with pytest.raises(
        InputError, match="horizontal field of view is .* degrees; state an angle between 0 and 180"
    ):
        from_field_of_view(800, 600, angle)


@pytest.mark.parametrize("focal", [0, -1, np.inf])
def test_unknown_35mm_focal_length_is_refused(focal):
    with pytest.raises(InputError, match="EXIF writes 0 for unknown"):
        from_exif_35mm(800, 600, focal)


def test_resized_view_sees_the_same_directions():
    camera = from_field_of_view(800, 600, 60, principal_point=(390, 310), pitch=-10)
    half = camera.resized(400, 300)
    np.testing.assert_allclose(half.directions([[100, 50]]), camera.directions([[200, 100]]), atol=1e-15)
