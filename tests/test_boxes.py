"""Rooms and cuboid proxies: exact corners come back exactly, bad annotations are refused with a remedy."""

import re

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geometry.boxes import AxisBox, Support, corner_names, edge_names, fit_cuboid, fit_room
from pipeline.geometry.camera import Camera, from_field_of_view, rotation
from pipeline.geometry.planes import AXES, polygon_area, polygon_normal

ROOM = AxisBox(np.array([-1.7, 0.0, -3.9]), np.array([1.4, 2.6, 1.0]))
# Least squares that starts at the solution stops within 1e-9; 1e-6 m is what the pipeline asks for.
EXACT = 1e-6


def camera_in_room(seed=0, **changes):
    rng = np.random.default_rng(seed)
    portrait = seed % 2
    width, height = (900, 1400) if portrait else (1400, 900)
    turn = rotation(rng.uniform(-25, 25), rng.uniform(-12, 8), rng.uniform(-6, 6))
    centre = np.array([width / 2, height / 2]) + rng.uniform(-60, 60, 2)
    values = dict(
        width=width,
        height=height,
        focal_length=rng.uniform(600, 1200),
        principal_point=centre,
        world_from_camera=turn,
        position=np.array([rng.uniform(-1, 1), rng.uniform(1, 1.9), 0.0]),
    )
    return Camera(**{**values, **changes})


def pixels(camera, box, names):
    return {name: camera.project(box.corner(name))[0] for name in names}


def edge_points(camera, box, name, at=(0.3, 0.8)):
    """Two pixels on the back-to-middle part of an edge, in front of the camera."""
    words = name.split("_")
    ends = [corner for corner in corner_names(True) if all(word in corner.split("_") for word in words)]
    a, b = (box.corner(end) for end in ends)
    if name.startswith(("floor", "ceiling")) and words[1] in ("left", "right"):
        a, b = sorted((a, b), key=lambda p: p[2])
        b = a + (b - a) * 0.4
    return [camera.project(a + (b - a) * t)[0] for t in at]


# names and faces


def test_names_come_in_the_stated_order():
    assert corner_names()[0] == "front_left_bottom" and corner_names()[-1] == "back_right_top"
    assert "back_left_floor" in corner_names(room=True) and len(set(corner_names())) == 8
    assert {"floor_back", "ceiling_right", "back_left"} <= set(edge_names(True)) and len(
        set(edge_names(True))
    ) == 12
    box = AxisBox(np.array([1.0, 2, 3]), np.array([4.0, 5, 6]))
    assert box.corner("front_left_bottom").tolist() == [1, 2, 6]
    assert box.corner("back_right_ceiling").tolist() == [4, 5, 3]


@pytest.mark.parametrize("yaw", [0.0, 33.0])
def test_faces_look_outwards_and_those_of_a_room_inwards(yaw):
    box = AxisBox(np.array([-1.0, 0.5, -2]), np.array([2.0, 1.5, 1]), yaw)
    for room, sign in ((False, 1), (True, -1)):
        for name, face in box.faces(room).items():
            assert sign * polygon_normal(face) @ (face.mean(0) - box.centre) > 0, name
    areas = {name: polygon_area(face) for name, face in box.faces().items()}
    assert areas == pytest.approx(dict(left=3, right=3, bottom=9, top=9, back=3, front=3))
    front = box.faces()["front"].mean(0) - box.centre
    assert np.degrees(np.arctan2(-front[0], front[2])) == pytest.approx(yaw)  # front turns right with the box
    assert box.contains(box.centre) and not box.contains(box.centre + [0, 0.6, 0])


def test_faces_share_their_corners_to_the_last_bit():
    box = AxisBox(np.array([-1.1, 0.1, -2.3]), np.array([2.7, 1.9, 1.3]), 17.0)
    points = np.concatenate(list(box.faces().values()))
    assert len(np.unique(points, axis=0)) == 8


# rooms


@pytest.mark.parametrize("seed", range(8))
def test_room_from_exact_corners(seed):
    camera = camera_in_room(seed)
    names = ["back_left_floor", "back_right_ceiling"]
    fit = fit_room(camera, pixels(camera, ROOM, names))
    np.testing.assert_allclose(fit.box.lower, ROOM.lower, atol=EXACT)
    np.testing.assert_allclose(fit.box.upper, [1.4, 2.6, camera.position[2] + 1.0], atol=EXACT)
    assert fit.rms < 1e-6 and fit.assumed == ("front",) and not fit.warnings
    assert set(fit.uncertainty) == {"left", "right", "back", "ceiling"}


@pytest.mark.parametrize("seed", range(4))
def test_room_from_edges_alone(seed):
    camera = camera_in_room(seed)
    names = ["floor_back", "floor_left", "floor_right", "ceiling_back"]
    fit = fit_room(camera, edges={name: edge_points(camera, ROOM, name) for name in names}, behind=2.5)
    np.testing.assert_allclose(fit.box.lower, ROOM.lower, atol=EXACT)
    np.testing.assert_allclose(fit.box.upper, [1.4, 2.6, 2.5], atol=EXACT)
    assert set(fit.residuals) == set(names)


def test_vertical_edge_and_known_walls():
    camera = camera_in_room(0)
    fit = fit_room(
        camera,
        edges={"back_left": edge_points(camera, ROOM, "back_left")},
        known={"back": -3.9, "right": 1.4, "ceiling": 2.6, "front": 1.0},
    )
    np.testing.assert_allclose(np.r_[fit.box.lower, fit.box.upper], np.r_[ROOM.lower, ROOM.upper], atol=EXACT)
    assert fit.assumed == () and set(fit.uncertainty) == {"left"}


def test_everything_known_needs_no_click_and_reports_its_residual():
    camera = camera_in_room(0)
    known = dict(left=-1.7, right=1.4, back=-3.9, front=1.0, ceiling=2.6)
    assert fit_room(camera, known=known).rms == 0
    click = pixels(camera, ROOM, ["back_left_floor"])["back_left_floor"] + [3, 4]
    fit = fit_room(camera, {"back_left_floor": click}, known=known)
    assert fit.residuals["back_left_floor"] == pytest.approx(5)


def test_uncertainty_of_a_room_is_that_of_repeated_noisy_clicks():
    camera = camera_in_room(2)
    exact = pixels(
        camera, ROOM, ["back_left_floor", "back_right_ceiling", "back_right_floor", "back_left_ceiling"]
    )
    rng = np.random.default_rng(5)
    fits = [fit_room(camera, {k: p + rng.normal(size=2) for k, p in exact.items()}) for _ in range(150)]
    backs = np.array([fit.box.lower[2] for fit in fits])
    expected = fit_room(camera, exact).uncertainty["back"]
    # 150 samples give a standard deviation to 6 %; 20 % is over three of those
    assert backs.std() == pytest.approx(expected, rel=0.2)
    assert backs.mean() == pytest.approx(-3.9, abs=4 * expected / np.sqrt(150) + 2 * expected**2)
    # four corners, eight numbers, four unknowns: sqrt(2) px a corner shrinks to 1 px
    assert np.sqrt(np.mean([fit.rms**2 for fit in fits])) == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize(
    "corners, edges, known, message",
    [
        (
            {"back_left_floor": None},
            {},
            {},
            r"do not determine the right, ceiling faces .*add corner .*right_ceiling",
        ),
        (
            {"back_left_floor": None, "back_right_floor": None},
            {},
            {},
            r"do not determine the ceiling face \(height\).*(back_left_ceiling|back_right_ceiling)",
        ),
        ({}, {"ceiling_back": None}, {"left": -1.7, "right": 1.4}, r"do not determine the .*back, ceiling"),
        ({"back_left_flor": (1, 1)}, {}, {}, "unknown corner 'back_left_flor'; use one of .*back_left_floor"),
        ({"back_back_floor": (1, 1)}, {}, {}, "unknown corner 'back_back_floor'"),
        (
            {},
            {"floor_ceiling": [[1, 1], [5, 5]]},
            {},
            "unknown edge 'floor_ceiling'; use one of .*floor_back",
        ),
        (
            {},
            {"floor_back": [[100, 800], [100, 800]]},
            {},
            r"edge 'floor_back' has both points at \(100, 800\)",
        ),
        ({"back_left_floor": (1, 2, 3)}, {}, {}, r"'back_left_floor' is \[1, 2, 3\]; give one pixel"),
        ({}, {}, {"roof": 3.0}, "known wall 'roof' does not exist; use one of left, right"),
    ],
)
def test_room_refuses(corners, edges, known, message):
    camera = camera_in_room(0)
    corners = {k: pixels(camera, ROOM, [k])[k] if p is None else p for k, p in corners.items()}
    edges = {k: edge_points(camera, ROOM, k) if p is None else p for k, p in edges.items()}
    with pytest.raises(InputError, match=message):
        fit_room(camera, corners, edges, known)


def test_floor_corner_above_the_horizon_is_refused():
    camera = from_field_of_view(800, 600, 60, camera_height=1.5)
    with pytest.raises(
        InputError, match=r"'back_left_floor' at \(200, 250\) lies above the camera's horizon"
    ):
        fit_room(camera, {"back_left_floor": (200, 250), "back_right_ceiling": (600, 100)})
    with pytest.raises(InputError, match=r"'back_right_ceiling' at \(600, 350\) lies below"):
        fit_room(camera, {"back_left_floor": (200, 450), "back_right_ceiling": (600, 350)})


def test_swapped_walls_are_refused_with_the_corners_that_conflict():
    camera = camera_in_room(0)
    exact = pixels(camera, ROOM, ["back_left_floor", "back_right_ceiling"])
    swapped = {"back_right_floor": exact["back_left_floor"], "back_left_ceiling": exact["back_right_ceiling"]}
    with pytest.raises(
        InputError,
        match=r"width comes out as -3.1 m: left \(back_left_ceiling\) and right "
        r"\(back_right_floor\) conflict",
    ):
        fit_room(camera, swapped)


def test_bad_clicks_give_a_warning_that_names_the_worst():
    camera = camera_in_room(0)
    exact = pixels(
        camera, ROOM, ["back_left_floor", "back_right_ceiling", "back_right_floor", "back_left_ceiling"]
    )
    assert not fit_room(camera, exact).warnings
    exact["back_right_floor"] = exact["back_right_floor"] + [120, 60]
    fit = fit_room(camera, exact)
    assert any("over 1 % of the diagonal" in text and "'back_right_floor'" in text for text in fit.warnings)


def test_camera_outside_the_room_is_pointed_out():
    camera = camera_in_room(0)
    exact = pixels(camera, ROOM, ["back_left_floor", "back_right_ceiling"])
    fit = fit_room(camera, exact, known={"front": -1.5})
    assert any("stands outside the room" in text for text in fit.warnings)
    with pytest.raises(InputError, match="front wall -1 m behind the camera"):
        fit_room(camera, exact, behind=-1.0)


# cuboids

BOXES = {  # box, its support, visible corners
    "on the floor": (
        AxisBox(np.array([-1.2, 0, -3.1]), np.array([-0.4, 0.55, -2.2])),
        Support("y", "lower", 0.0),
    ),
    "on another box": (
        AxisBox(np.array([-1.1, 0.55, -3.0]), np.array([-0.6, 0.9, -2.5])),
        Support("y", "lower", 0.55),
    ),
    "on the back wall": (
        AxisBox(np.array([0.1, 1.1, -3.9]), np.array([0.9, 1.7, -3.6])),
        Support("z", "lower", -3.9),
    ),
    "on the left wall": (
        AxisBox(np.array([-1.7, 1.2, -3.2]), np.array([-1.4, 1.9, -2.4])),
        Support("x", "lower", -1.7),
    ),
    "on the ceiling": (
        AxisBox(np.array([-0.3, 2.3, -3.0]), np.array([0.3, 2.6, -2.3])),
        Support("y", "upper", 2.6),
    ),
}
SEEN = ["front_left_bottom", "front_right_bottom", "front_right_top", "front_left_top", "back_right_top"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("where", BOXES)
def test_cuboid_from_exact_corners(where, seed):
    camera = camera_in_room(seed)
    box, support = BOXES[where]
    fit = fit_cuboid(camera, pixels(camera, box, SEEN), support)
    np.testing.assert_allclose(np.r_[fit.box.lower, fit.box.upper], np.r_[box.lower, box.upper], atol=EXACT)
    assert fit.rms < 1e-6 and set(fit.residuals) == set(SEEN)
    touching = AXES[support.axis] + 3 * (support.side == "upper")
    assert np.r_[fit.box.lower, fit.box.upper][touching] == support.coordinate  # exactly, not fitted


@pytest.mark.parametrize("yaw", [-72.0, -40.0, -8.0, 0.0, 21.0, 45.0, 80.0])
def test_yaw_is_fitted(yaw):
    camera = camera_in_room(1)
    box = AxisBox(np.array([-0.4, 0.0, -0.3]), np.array([0.4, 0.6, 0.3]), yaw)
    shift = box.world_from_box.T @ [-0.3, 0, -3.0]
    box = AxisBox(box.lower + shift, box.upper + shift, yaw)
    clicked = pixels(camera, box, SEEN)
    fit = fit_cuboid(camera, clicked, ("y", "lower", 0.0), yaw="fit")
    assert fit.box.yaw == pytest.approx(yaw, abs=1e-5)
    np.testing.assert_allclose(np.r_[fit.box.lower, fit.box.upper], np.r_[box.lower, box.upper], atol=EXACT)
    given = fit_cuboid(camera, clicked, ("y", "lower", 0.0), yaw=yaw)
    np.testing.assert_allclose(given.box.upper, box.upper, atol=EXACT)


def test_known_height_replaces_a_corner():
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    seen = ["front_left_bottom", "back_right_bottom"]
    with pytest.raises(InputError, match=r"do not determine the top face \(height\); add corner .*_top"):
        fit_cuboid(camera, pixels(camera, box, seen), support)
    fit = fit_cuboid(camera, pixels(camera, box, seen), support, known={"height": 0.55})
    np.testing.assert_allclose(fit.box.upper, box.upper, atol=EXACT)
    # the top alone leaves the scale open, which the known height fixes
    fit = fit_cuboid(
        camera, pixels(camera, box, ["front_left_top", "back_right_top"]), support, known={"height": 0.55}
    )
    np.testing.assert_allclose(fit.box.lower, box.lower, atol=EXACT)


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_top_corners_alone_leave_the_distance_open_noisy_or_not(noise):
    """Noise makes the equations formally solvable; the refusal must not depend on it."""
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    tops = [name for name in corner_names() if name.endswith("top")]
    rng = np.random.default_rng(1)
    clicked = {k: p + noise * rng.normal(size=2) for k, p in pixels(camera, box, tops).items()}
    with pytest.raises(InputError, match=r"bottom|top.*add corner \w+_bottom"):
        fit_cuboid(camera, clicked, support, name="bathtub")


def test_the_suggested_corner_makes_the_refused_box_determined():
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    clicked = pixels(camera, box, ["front_left_top", "back_right_top", "front_right_top"])
    with pytest.raises(InputError) as refusal:
        fit_cuboid(camera, clicked, support)
    corner = re.search(r"add corner (\w+)", str(refusal.value))[1]
    fit = fit_cuboid(camera, clicked | pixels(camera, box, [corner]), support)
    np.testing.assert_allclose(fit.box.upper, box.upper, atol=EXACT)


@pytest.mark.parametrize("where", BOXES)
def test_noisy_clicks_are_fitted_within_their_uncertainty(where):
    camera = camera_in_room(0)
    box, support = BOXES[where]
    exact = pixels(camera, box, SEEN)
    rng = np.random.default_rng(3)
    deviations = []
    for _ in range(40):
        fit = fit_cuboid(camera, {k: p + rng.normal(size=2) for k, p in exact.items()}, support)
        got = dict(
            zip(("left", "bottom", "back", "right", "top", "front"), np.r_[fit.box.lower, fit.box.upper])
        )
        true = dict(zip(got, np.r_[box.lower, box.upper]))
        deviations += [(got[k] - true[k]) / fit.uncertainty[k] for k in fit.uncertainty]
    # 200 numbers of unit variance, five of a fit correlated: the RMS scatters by about 8 %
    assert np.sqrt(np.mean(np.square(deviations))) == pytest.approx(1.0, rel=0.25)


def test_wild_clicks_still_converge_to_a_finite_box_with_a_warning():
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    rng = np.random.default_rng(4)
    for _ in range(20):
        clicked = {k: p + 25 * rng.normal(size=2) for k, p in pixels(camera, box, SEEN).items()}
        fit = fit_cuboid(camera, clicked, support)
        assert (fit.box.size > 0.05).all() and (fit.box.size < 3).all()  # metres; the box is 0.8 x 0.55 x 0.9
        assert (fit.rms > 0.01 * np.hypot(1400, 900)) == any("1 %" in text for text in fit.warnings)


def test_scaling_all_lengths_scales_the_box():
    box, support = BOXES["on another box"]
    for scale in (1e-3, 1e3):
        camera = camera_in_room(0)
        clicked = pixels(camera, box, SEEN)
        camera = camera_in_room(0, position=camera.position * scale)
        fit = fit_cuboid(camera, clicked, (support.axis, support.side, support.coordinate * scale))
        np.testing.assert_allclose(fit.box.upper / scale, box.upper, atol=EXACT)


@pytest.mark.parametrize(
    "changes, message",
    [
        (dict(support=("w", "lower", 0)), r"sofa: support \(w, lower\) is unknown"),
        (dict(support=("y", "under", 0)), r"sofa: support \(y, under\) is unknown"),
        (dict(support=("x", "lower", -1.7), yaw="fit"), "sofa: a box turned by yaw fit cannot stand flat"),
        (dict(known={"heigth": 1.0}), "sofa: known size 'heigth': 1.0; use width, height or depth"),
        (dict(known={"height": -1.0}), "sofa: known size 'height': -1.0"),
        (
            dict(corners={"front_left_bottom": (700, 800)}),
            r"sofa: the annotations do not determine the back, right, top",
        ),
        (dict(corners={}), "sofa: the annotations do not determine"),
    ],
)
def test_cuboid_refuses(changes, message):
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    arguments = dict(corners=pixels(camera, box, SEEN), support=support, name="sofa") | changes
    with pytest.raises(InputError, match=message):
        fit_cuboid(camera, **arguments)


def test_inverted_box_is_refused_with_the_corners_that_conflict():
    camera = camera_in_room(0)
    box, support = BOXES["on the floor"]
    swap = {"left": "right", "right": "left"}
    clicked = {
        "_".join(swap.get(w, w) for w in k.split("_")): p for k, p in pixels(camera, box, SEEN).items()
    }
    with pytest.raises(
        InputError,
        match=r"sofa: the width comes out as -0.8 m: left \(.*front_left_bottom.*\) and "
        r"right \(.*front_right_bottom.*\) conflict; check that left and right",
    ):
        fit_cuboid(camera, clicked, support, name="sofa")


def test_support_above_the_camera_does_not_crash():
    """Bottom corners clicked below the horizon cannot stand on a shelf above the eye."""
    camera = camera_in_room(0)
    box, _ = BOXES["on the floor"]
    with pytest.raises(InputError):
        fit_cuboid(camera, pixels(camera, box, SEEN), ("y", "lower", camera.position[1] + 1.0), name="shelf")
