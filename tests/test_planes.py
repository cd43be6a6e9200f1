"""Points on planes, and polygons as they are clicked."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pipeline.errors import InputError
from pipeline.geometry.camera import from_field_of_view, rotation
from pipeline.geometry.planes import Plane, clean_polygon, polygon_area, polygon_centroid, polygon_normal

CAMERA = from_field_of_view(800, 600, 70, camera_height=1.5, yaw=12, pitch=-8, roll=3)
L_SHAPE = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2.0]])


@pytest.mark.parametrize(
    "plane, points",
    [
        (Plane.across("y", 0), [[0, 0, -3], [1, 0, -6]]),
        (Plane.across("z", -4), [[0, 1, -4], [1, 2, -4]]),
        (Plane(np.array([2.0, 0, -3]), np.array([-0.6, 0, 0.8])), [[2, 1, -3], [3.6, 0.5, -1.8]]),
        (Plane.across("y", 2.5), [[0, 2.5, -5], [1, 2.5, -6]]),
    ],
)
def test_pixels_go_back_to_the_points_they_show(plane, points):
    points = np.array(points, float)
    pixels = CAMERA.project(points)[0]
    np.testing.assert_allclose(plane.seen_at(CAMERA, pixels), points, atol=1e-10)  # metres; rounding
    np.testing.assert_allclose(plane.seen_at(CAMERA, pixels[0]), points[0], atol=1e-10)
    np.testing.assert_allclose(plane.distance(points), 0, atol=1e-12)


def test_pixel_beyond_the_horizon_is_named():
    level = from_field_of_view(800, 600, 70)
    for v in (250, 300):
        with pytest.raises(
            InputError, match=rf"pixel \(10, {v}\) lies on or beyond the horizon of the floor"
        ):
            Plane.across("y", 0).seen_at(level, [[400, 500], [10, v]], name="the floor")


def test_wall_behind_the_camera_and_camera_on_a_plane_are_refused():
    with pytest.raises(InputError, match="never meets it in front of the camera"):
        Plane.across("z", 1.0).seen_at(CAMERA, [400, 300])
    with pytest.raises(InputError, match="the camera lies on the shelf"):
        Plane.across("y", 1.5).seen_at(CAMERA, [400, 500], name="the shelf")


def test_plane_through_points():
    turn = rotation(10, 20, 30)
    points = np.c_[np.random.default_rng(0).normal(size=(6, 2)), np.full(6, 2.0)] @ turn.T
    plane = Plane.through(points)
    np.testing.assert_allclose(plane.distance(points), 0, atol=1e-12)
    assert plane.normal[np.argmax(np.abs(plane.normal))] > 0
    with pytest.raises(InputError, match="span no plane"):
        Plane.through([[0, 0, 0], [1, 1, 1], [2, 2, 2]])


def test_area_normal_and_centroid_of_a_non_convex_polygon():
    turn, shift = rotation(10, 20, 30), np.array([100.0, -50, 3])
    points = np.c_[L_SHAPE, np.zeros(6)] @ turn.T + shift
    assert polygon_area(L_SHAPE) == pytest.approx(4) and polygon_area(points) == pytest.approx(4)
    np.testing.assert_allclose(polygon_normal(points), turn[:, 2], atol=1e-12)
    middle = np.array([(3 * 1.5 + 1 * 0.5) / 4, (3 * 0.5 + 1 * 1.5) / 4])
    np.testing.assert_allclose(polygon_centroid(L_SHAPE), middle)
    np.testing.assert_allclose(polygon_centroid(points), np.r_[middle, 0] @ turn.T + shift)
    np.testing.assert_allclose(polygon_centroid(points[::-1]), polygon_centroid(points))


def test_double_clicks_and_a_closing_point_are_dropped():
    clicked = np.concatenate([L_SHAPE[:2], L_SHAPE[1:2], L_SHAPE[2:], L_SHAPE[:1]])
    np.testing.assert_array_equal(clean_polygon(clicked), L_SHAPE)


def cycle(points):
    points = [tuple(p) for p in np.round(points, 9)]
    start = points.index(min(points))
    return points[start:] + points[:start]


@given(st.lists(st.tuples(st.floats(0.2, 1), st.floats(0.05, 1)), min_size=3, max_size=9), st.booleans())
@settings(max_examples=50, deadline=None)
def test_a_polygon_and_its_reverse_are_the_same_cycle(spokes, in_space):
    """Star-shaped polygons: simple whatever their radii, if no gap reaches half a turn."""
    radius, gaps = np.array(spokes).T
    angles = np.cumsum(np.minimum(gaps / gaps.sum(), 0.45)) * 2 * np.pi
    angles = angles / max(angles[-1] / (2 * np.pi), 1)
    points = np.c_[radius * np.cos(angles), radius * np.sin(angles)] * 100 + 300
    if in_space:
        points = np.c_[points, np.full(len(points), 7.0)] @ rotation(20, 30, 40).T
    try:
        cleaned = clean_polygon(points)
    except InputError:  # three spokes within half a turn may make edges that touch
        with pytest.raises(InputError):
            clean_polygon(points[::-1])
        return
    assert cycle(cleaned) == cycle(clean_polygon(points[::-1]))
    np.testing.assert_array_equal(cleaned[0], points[0])


def test_orientation_is_clockwise_in_the_photograph_and_faces_a_given_point():
    on_screen = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])  # right, then down
    np.testing.assert_array_equal(clean_polygon(on_screen), on_screen)
    np.testing.assert_array_equal(clean_polygon(on_screen[::-1], orient=False), on_screen[::-1])
    floor = np.c_[on_screen[:, 0], np.zeros(4), on_screen[:, 1]]
    for order in (floor, floor[::-1]):
        assert polygon_normal(clean_polygon(order, towards=[0, 1.5, 0]))[1] > 0
        assert polygon_normal(clean_polygon(order, towards=[0, -1.5, 0]))[1] < 0
        assert polygon_normal(clean_polygon(order))[1] > 0


@pytest.mark.parametrize(
    "points, message",
    [
        ([], "lamp: points have shape .*give a list of"),
        ([[0, 0], [5, 5]], "lamp: 2 distinct points, and a polygon needs 3; add points"),
        ([[0, 0], [5, 5], [5, 5], [0, 0]], "lamp: 2 distinct points"),
        ([[3, 3]] * 4, "lamp: 1 distinct points"),
        ([[0, 0], [5, 5], [9, 9]], "lamp: all 3 points lie on one line; add a point off"),
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], "lamp: all 3 points lie on one line"),
        (
            [[0, 0], [10, 10], [10, 0], [0, 10]],
            r"edges cross \(edge from point 1 and edge from point 3\); list the points",
        ),
        ([[0, 0], [10, 0], [4, 0], [5, 5]], "lamp: its edges cross"),
        ([[0, 0], [10, 0], [np.nan, 5]], r"lamp: point \[nan, 5.0\] is not finite"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], "lamp: points are up to .* m off a common plane"),
        ([[0], [1], [2]], r"lamp: points have shape \(3, 1\)"),
    ],
)
def test_polygons_that_are_none_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        clean_polygon(points, name="lamp")


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_do_not_matter(scale):
    np.testing.assert_allclose(clean_polygon(L_SHAPE * scale), L_SHAPE * scale)
    assert polygon_area(clean_polygon(L_SHAPE * scale)) == pytest.approx(4 * scale**2)
