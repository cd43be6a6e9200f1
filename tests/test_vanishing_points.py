"""Cameras recovered from the images of parallel lines."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, rotation, yaw_pitch_roll
from pipeline.geometry.planes import AXES, Plane
from pipeline.geometry.vanishing_points import calibrate, scale_from_known_length, scaled, vanishing_point


def random_camera(seed, **changes):
    """Portrait for odd seeds; principal point off the centre, roll, pitch enough for verticals to meet."""
    rng = np.random.default_rng(seed)
    width, height = (1000, 1500) if seed % 2 else (1600, 1000)
    pitch = rng.choice([-1, 1]) * rng.uniform(8, 30)
    turn = rotation(rng.choice([-1, 1]) * rng.uniform(15, 50), pitch, rng.uniform(-12, 12))
    values = dict(
        width=width,
        height=height,
        focal_length=rng.uniform(700, 2200),
        principal_point=np.array([width, height]) * rng.uniform(0.4, 0.6, 2),
        world_from_camera=turn,
        position=np.array([0, 1.0, 0]),
    )
    return Camera(**{**values, **changes})


def drawn(camera, axes="xyz", count=4, seed=0, noise=0.0):
    """Segments {axis: (count, 2, 2)}, a third of the photograph long, towards the true vanishing points."""
    rng = np.random.default_rng(seed + 1000)
    reach, result = camera.width / 6, {}
    for axis in axes:
        point = camera.intrinsic_matrix @ camera.world_from_camera.T[:, AXES[axis]]
        middles = rng.uniform([0.15, 0.15], [0.85, 0.85], (count, 2)) * [camera.width, camera.height]
        towards = point[:2] - middles * point[2]
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        result[axis] = np.stack([middles - reach * towards, middles + reach * towards], 1)
        result[axis] += noise * rng.normal(size=result[axis].shape)
    return result


def same_camera(found, true, *, angle=1e-6, focal=1e-6):
    np.testing.assert_allclose(found.focal_length, true.focal_length, rtol=focal)
    np.testing.assert_allclose(found.world_from_camera, true.world_from_camera, atol=angle)
    assert np.linalg.det(found.world_from_camera) == pytest.approx(1, abs=1e-12)


# vanishing points


def test_two_segments_meet_where_they_cross():
    point = vanishing_point([[[0, 0], [1, 1]], [[4, 0], [3, 1]]])
    np.testing.assert_allclose(point[:2] / point[2], [2, 2], atol=1e-9)  # pixel


def test_lines_parallel_in_the_photograph_meet_at_infinity():
    point = vanishing_point([[[10, 20], [110, 70]], [[300, 500], [500, 600]], [[0, 900], [200, 1000]]])
    assert abs(point[2]) < 1e-12
    assert abs(point[1] / point[0]) == pytest.approx(0.5, rel=1e-9)


def test_order_of_end_points_and_a_shift_do_not_matter():
    segments = drawn(random_camera(0), "z", seed=3, noise=1.0)["z"]
    point = vanishing_point(segments)
    flipped = vanishing_point(segments[:, ::-1])
    moved = vanishing_point(segments + [5000, -300])
    np.testing.assert_allclose(flipped[:2] / flipped[2], point[:2] / point[2], rtol=1e-6)  # the solver's stop
    np.testing.assert_allclose(moved[:2] / moved[2], point[:2] / point[2] + [5000, -300], rtol=1e-6)


def test_end_points_not_algebra_are_minimised():
    """Long and short segments, equally uncertain: the estimate beats the unweighted algebraic one."""
    rng = np.random.default_rng(2)
    target, errors = np.array([2500.0, 300.0]), {"likelihood": [], "algebraic": []}
    for _ in range(100):
        middles = rng.uniform(0, 1000, (6, 2))
        towards = (target - middles) / np.linalg.norm(target - middles, axis=1, keepdims=True)
        reach = np.array([400, 300, 200, 30, 20, 15])[:, None]
        segments = np.stack([middles - reach * towards, middles + reach * towards], 1) + rng.normal(
            size=(6, 2, 2)
        )
        ends = np.concatenate([segments, np.ones((6, 2, 1))], -1)
        lines = np.cross(ends[:, 0], ends[:, 1])
        lines /= np.hypot(lines[:, 0], lines[:, 1])[:, None]
        algebraic = np.linalg.lstsq(lines[:, :2], -lines[:, 2], rcond=None)[0]
        found = vanishing_point(segments)
        errors["likelihood"].append(np.linalg.norm(found[:2] / found[2] - target))
        errors["algebraic"].append(np.linalg.norm(algebraic - target))
    assert np.median(errors["likelihood"]) < 0.5 * np.median(errors["algebraic"])


@pytest.mark.parametrize(
    "segments, message",
    [
        ([], "the lines: 0 segments, and at least 2"),
        ([[[0, 0], [9, 9]]], "the lines: 1 segment, and at least 2"),
        ([[[0, 0], [9, 9]], [[5, 5], [5, 5]]], r"segment 2 from \(5, 5\) to \(5, 5\) has no length"),
        ([[[0, 0], [9, 9]], [[20, 20], [30, 30]]], "all 2 segments lie on one line.*another, parallel edge"),
        ([[0, 0], [9, 9]], "give a list of"),
        ([[[0, 0], [np.nan, 9]], [[5, 5], [50, 5]]], "give a list of"),
    ],
)
def test_degenerate_segments_are_refused(segments, message):
    with pytest.raises(InputError, match=message):
        vanishing_point(segments)


# cameras


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("axes", ["xyz", "xz", "yz", "xy"])
def test_focal_length_and_rotation_from_exact_lines(axes, seed):
    camera = random_camera(seed)
    estimate = calibrate(
        width=camera.width,
        height=camera.height,
        lines=drawn(camera, axes, seed=seed),
        principal_point=camera.principal_point,
    )
    same_camera(estimate.camera, camera)
    assert estimate.residual_rms < 1e-6 and estimate.principal_point_sigma is None


@pytest.mark.parametrize("seed", range(8))
def test_principal_point_from_three_axes(seed):
    camera = random_camera(seed)
    estimate = calibrate(
        width=camera.width, height=camera.height, lines=drawn(camera, seed=seed), principal_point="estimate"
    )
    same_camera(
        estimate.camera, camera, angle=1e-5, focal=1e-5
    )  # six unknowns: worse conditioned, f to 0.02 px
    np.testing.assert_allclose(estimate.camera.principal_point, camera.principal_point, atol=0.02)
    assert (estimate.principal_point_sigma > 0).all()


def test_centre_is_the_default_principal_point():
    camera = random_camera(3, principal_point=np.array([500.0, 750.0]))
    estimate = calibrate(width=1000, height=1500, lines=drawn(camera), camera_height=1.62)
    same_camera(estimate.camera, camera)
    assert estimate.camera.principal_point.tolist() == [500, 750] and estimate.camera.position[1] == 1.62


@pytest.mark.parametrize("axes, seed", [("xz", 2), ("xyz", 5)])
def test_stated_deviation_is_that_of_repeated_noisy_clicks(axes, seed):
    camera = random_camera(seed)
    size = dict(width=camera.width, height=camera.height, principal_point=camera.principal_point)
    stated = calibrate(lines=drawn(camera, axes, 6, seed), **size).focal_length_sigma
    exact = drawn(camera, axes, 6, seed)
    rng = np.random.default_rng(seed)
    runs = [
        calibrate(lines={a: s + rng.normal(size=s.shape) for a, s in exact.items()}, **size)
        for _ in range(60)
    ]
    focal = np.array([run.camera.focal_length for run in runs])
    # 60 samples tell a standard deviation to 9 %; 30 % is three of those
    assert focal.std() == pytest.approx(stated, rel=0.3)
    assert (
        abs(focal.mean() - camera.focal_length) < 4 * stated / np.sqrt(60) + stated**2 / camera.focal_length
    )
    # a distance has variance 1/2 and each axis spends two degrees of freedom of its six
    assert np.median([run.residual_rms for run in runs]) == pytest.approx(np.sqrt(0.5 * 4 / 6), rel=0.2)


@pytest.mark.parametrize("axis", "xz")
def test_one_axis_and_a_focal_length_assume_no_roll(axis):
    camera = random_camera(2, world_from_camera=rotation(25, -14, 0))
    estimate = calibrate(
        width=camera.width,
        height=camera.height,
        lines=drawn(camera, axis),
        principal_point=camera.principal_point,
        focal_length=camera.focal_length,
    )
    same_camera(estimate.camera, camera)
    assert estimate.focal_length_sigma is None and "roll 0" in estimate.assumptions[0]


def test_vertical_lines_and_a_focal_length_assume_no_yaw():
    camera = random_camera(2, world_from_camera=rotation(0, -14, 5))
    estimate = calibrate(
        width=camera.width,
        height=camera.height,
        lines=drawn(camera, "y"),
        principal_point=camera.principal_point,
        focal_length=camera.focal_length,
    )
    same_camera(estimate.camera, camera)
    assert "yaw 0" in estimate.assumptions[0]


def test_frontal_room_with_one_converging_axis():
    """The commonest photograph of a room: only front-back lines converge."""
    camera = random_camera(0, world_from_camera=rotation(0, 0, 0))
    size = dict(width=camera.width, height=camera.height, principal_point=camera.principal_point)
    for axes in ("z", "xz", "yz", "xyz"):
        estimate = calibrate(lines=drawn(camera, axes), focal_length=camera.focal_length, **size)
        same_camera(estimate.camera, camera)
    with pytest.raises(
        InputError,
        match=r"'x' \(left-right\) are parallel in the photograph.*focal length stays open;"
        r".*'y' \(vertical\).*field of view",
    ):
        calibrate(lines=drawn(camera, "xz"), **size)


@pytest.mark.parametrize("axis", "xy")
def test_a_single_line_along_a_second_axis_tells_the_roll(axis):
    camera = random_camera(4)
    lines = drawn(camera, "z") | drawn(camera, axis, count=1)
    estimate = calibrate(
        width=camera.width,
        height=camera.height,
        lines=lines,
        principal_point=camera.principal_point,
        focal_length=camera.focal_length,
    )
    same_camera(estimate.camera, camera)
    assert estimate.assumptions == []


def test_direction_of_drawing_does_not_matter():
    camera = random_camera(6)
    lines = {axis: segments[:, ::-1] for axis, segments in drawn(camera).items()}
    same_camera(
        calibrate(
            width=camera.width, height=camera.height, lines=lines, principal_point=camera.principal_point
        ).camera,
        camera,
    )


def test_badly_conditioned_focal_length_is_visible():
    camera = random_camera(2, world_from_camera=rotation(2, 0, 0), focal_length=1500.0)
    lines = drawn(camera, "xz", seed=1)
    estimate = calibrate(
        width=camera.width, height=camera.height, lines=lines, principal_point=camera.principal_point
    )
    assert estimate.focal_length_sigma > 0.1 * 1500
    assert any("known to +-" in text for text in estimate.warnings)


def test_bent_line_is_named():
    camera = random_camera(2)
    lines = drawn(camera)
    lines["z"][2, 0] += [60, -80]
    estimate = calibrate(
        width=camera.width, height=camera.height, lines=lines, principal_point=camera.principal_point
    )
    assert any("segment 3 along 'z'" in text for text in estimate.warnings)


@pytest.mark.parametrize(
    "lines, options, message",
    [
        ({}, {}, "no lines are drawn"),
        ({"w": [[[0, 0], [9, 9]]] * 2}, {}, "lines along 'w'; use the axes x"),
        (
            {"z": [[[0, 0], [900, 400]], [[0, 990], [900, 600]]]},
            {},
            r"'z' \(front-back\) alone leave the focal length open",
        ),
        (
            {"z": [[[0, 0], [900, 400]]], "x": [[[0, 0], [9, 400]]]},
            {},
            r"'x' \(left-right\): 1 segment, and at least 2",
        ),
        (
            {
                "x": [[[0, 10], [900, 10]], [[0, 500], [900, 500]]],
                "y": [[[10, 0], [10, 900]], [[500, 0], [500, 900]]],
            },
            {},
            r"'x' \(left-right\) and 'y' \(vertical\) are parallel.*'z' \(front-back\) that visibly converge",
        ),
        (
            {
                "x": [[[0, 0], [400, 200]], [[0, 900], [400, 700]]],
                "z": [[[0, 100], [400, 200]], [[0, 800], [400, 700]]],
            },
            {},
            r"'x' \(left-right\) and 'z' \(front-back\) cannot be at right angles",
        ),
        (
            {"x": [[[0, 10], [900, 10]], [[0, 500], [900, 500]]]},
            {"focal_length": 900.0},
            r"'x' \(left-right\) are level and parallel.*pitch stays open; draw lines along 'y'",
        ),
        (
            {"y": [[[500, 100], [500, 300]], [[100, 500], [300, 500]]]},
            {"focal_length": 900.0},
            r"'y' \(vertical\) meet at the principal point.*draw lines along 'x' \(left-right\) or 'z'",
        ),
        (
            {"x": [[[0, 10], [900, 10]], [[0, 500], [900, 500]]]},
            {"focal_length": -1.0},
            "focal length is -1.0 px",
        ),
        (
            {"z": [[[0, 0], [900, 400]], [[0, 990], [900, 600]]]},
            {"principal_point": "estimate"},
            r"needs lines that converge along all three axes; 'x' \(left-right\) and 'y' .* are missing",
        ),
        (
            {"z": [[[0, 0], [900, 400]], [[0, 990], [900, 600]]]},
            {"principal_point": "guess"},
            "principal point 'guess'",
        ),
    ],
)
def test_degenerate_annotations_are_refused_with_the_axis(lines, options, message):
    with pytest.raises(InputError, match=message):
        calibrate(width=1000, height=1000, lines=lines, **options)


@pytest.mark.parametrize("seed", range(40))
def test_noisy_weak_lines_give_a_camera_or_a_refusal(seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(seed, world_from_camera=rotation(rng.uniform(-3, 3), rng.uniform(-3, 3)))
    try:
        found = calibrate(
            width=camera.width,
            height=camera.height,
            lines=drawn(camera, "xyz"[: 2 + seed % 2], 2, seed, noise=3.0),
        ).camera
    except InputError:
        return
    assert np.isfinite(found.world_from_camera).all() and 0 < found.focal_length < np.inf
    yaw, _, roll = yaw_pitch_roll(found.world_from_camera)
    assert abs(yaw) <= 90 and abs(roll) <= 90


# scale


@pytest.mark.parametrize("axis, coordinate", [("y", 0.0), ("z", -4.0), ("x", 2.0)])
def test_metric_scale_from_a_known_length(axis, coordinate):
    camera = random_camera(0, world_from_camera=rotation(15, -12, 3), position=np.array([0, 1.7, 0]))
    plane = Plane.across(axis, coordinate)
    ends = {
        "y": [[-0.5, 0, -4], [1, 0, -5]],
        "z": [[-1, 1, -4], [1, 2, -4]],
        "x": [[2, 0.5, -4], [2, 2, -6]],
    }[axis]
    pixels = camera.project(np.array(ends))[0]
    unit = scaled(camera, 1 / 1.7)
    length = np.linalg.norm(np.subtract(*np.array(ends, float)))
    factor = scale_from_known_length(unit, Plane.across(axis, coordinate / 1.7), pixels, length)
    assert factor == pytest.approx(1.7, rel=1e-9)
    np.testing.assert_allclose(scaled(unit, factor).position, camera.position)
    np.testing.assert_allclose(plane.seen_at(camera, pixels), ends, atol=1e-9)


def test_impossible_lengths_are_refused():
    camera = random_camera(0, world_from_camera=rotation(0, 0, 0))
    floor, (cx, cy) = Plane.across("y", 0), camera.principal_point
    with pytest.raises(InputError, match="known length on the floor is 0 m"):
        scale_from_known_length(camera, floor, [[cx, cy + 50], [cx, cy + 90]], 0, name="the floor")
    with pytest.raises(InputError, match="same pixel"):
        scale_from_known_length(camera, floor, [[cx, cy + 50], [cx, cy + 50]], 2.0)
    with pytest.raises(InputError, match="beyond the horizon of the floor"):
        scale_from_known_length(camera, floor, [[cx, cy + 50], [cx, cy - 50]], 2.0, name="the floor")
