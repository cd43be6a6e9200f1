"""Sun direction: light of known direction is cast through windows of a small room and found again."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from pipeline.errors import InputError
from pipeline.estimation.sun_direction import Opening, estimate_sun_direction, perturbed
from pipeline.estimation.sun_patches import View
from pipeline.geometry.camera import Camera, rotation
from pipeline.geometry.planes import Plane

FLOOR = Plane.across("y", 0.0)
OPPOSITE_WALL = Plane.across("x", 1.5)
CAMERA = Camera(480, 480, 350.0, np.array([240.0, 240.0]), rotation(0, -12), np.array([0.0, 1.5, 1.8]))


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def sun(elevation, azimuth):
    """Direction of sunlight; azimuth [degree] 0 shines along +x, 90 along +z."""
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), -np.sin(e), np.cos(e) * np.sin(a)])


def side_window(z=-1.9, bottom=0.9, width=0.9, height=1.0):
    """A window in the wall x = -1.5."""
    return np.array([[-1.5, bottom, z], [-1.5, bottom + height, z], [-1.5, bottom + height, z + width],
                     [-1.5, bottom, z + width]])


def on_plane(points, direction, plane=FLOOR):
    return points - (plane.distance(points) / (direction @ plane.normal))[:, None] * direction


def floor_part(points, region):
    """A floor polygon cut to a region of (x, z)."""
    cut = shapely.Polygon(points[:, [0, 2]]).intersection(region)
    xz = np.array(cut.exterior.coords)[:-1]
    return np.column_stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]])


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


TRUE = sun(35, 17.5)
WINDOW = side_window()
PATCH = on_plane(WINDOW, TRUE)
OPENING = Opening("left", WINDOW, [(PATCH, FLOOR)])


def test_exact_annotation_gives_the_direction_back():
    estimate = estimate_sun_direction(CAMERA, [OPENING])
    # Exact vertices put the objective's kink at the truth; the goal is 0.1, the optimiser stops at 6e-5.
    assert degrees_between(estimate.sun_direction, TRUE) < 1e-3
    assert estimate.status == "determined" and estimate.messages == () and estimate.notes == ()
    # All angles 0, overlap 1: the paper's objective is -1 for one window.
    assert estimate.objective == pytest.approx(-1, abs=1e-5)
    assert estimate.openings[0].overlap == pytest.approx(1, abs=1e-5)
    assert np.linalg.norm(estimate.sun_direction) == pytest.approx(1, abs=1e-12)


def test_objective_is_the_published_one():
    moved = PATCH + [[0.1, 0, 0], [0, 0, 0.05], [-0.1, 0, 0.1], [0, 0, 0]]
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(moved, None)])], resamples=0)
    d = estimate.sun_direction
    angles = [np.arccos(d @ unit(*(b - a))) for a, b in zip(WINDOW, moved)]
    cast, patch = (shapely.Polygon(CAMERA.project(p)[0]) for p in (on_plane(WINDOW, d), moved))
    ratio = cast.intersection(patch).area / cast.union(patch).area
    # Rounding of arccos near 1: sqrt(float64 epsilon).
    assert estimate.objective == pytest.approx(sum(angles) - ratio, abs=1e-7)
    assert 0.5 < ratio < 0.99


@pytest.mark.parametrize("elevation", [15, 35, 60])
@pytest.mark.parametrize("azimuth", [-50, 0, 20])
def test_exact_over_the_sky(elevation, azimuth):
    true = sun(elevation, azimuth)
    openings = [Opening("left", WINDOW, [(on_plane(WINDOW, true), FLOOR)])]
    estimate = estimate_sun_direction(CAMERA, openings, starts=2, resamples=0)
    assert degrees_between(estimate.sun_direction, true) < 0.1  # the stated goal


def test_patch_may_be_clicked_from_any_corner_either_way_round():
    for start in range(4):
        for sense in (1, -1):
            patch = np.roll(PATCH, start, 0)[::sense]
            estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(patch, FLOOR)])],
                                              starts=1, resamples=0)
            assert degrees_between(estimate.sun_direction, TRUE) < 1e-3, (start, sense)


def test_two_pixels_of_noise_and_what_a_second_window_brings():
    second = Opening("front", (w := side_window(-0.9)), [(on_plane(w, TRUE), FLOOR)])
    rng = np.random.default_rng(1)
    errors = {1: [], 2: []}
    for trial in range(50):
        noisy = [perturbed(CAMERA, o, 2.0, rng) for o in (OPENING, second)]
        for n in (1, 2) if trial < 20 else (1,):
            estimate = estimate_sun_direction(CAMERA, noisy[:n], starts=1, resamples=0)
            assert estimate.status == "determined"
            errors[n].append(degrees_between(estimate.sun_direction, TRUE))
    one, two = np.median(errors[1]), np.median(errors[2])
    print(f"one window: median {one:.2f} degrees, worst {max(errors[1]):.2f}; "
          f"two: median {two:.2f}, worst {max(errors[2]):.2f}")
    # 2 pixels at 3 to 4 m and f = 350 are about 2 cm in 2 m, half a degree, on each of four corners;
    # 1 degree leaves room for another seed, well inside the 3 degrees asked for.
    assert one < 1
    assert two < one


def test_stated_confidence_holds_the_truth():
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(12):
        noisy = perturbed(CAMERA, OPENING, 2.0, rng)
        estimate = estimate_sun_direction(CAMERA, [noisy], starts=1, resamples=20)
        inside.append(degrees_between(estimate.sun_direction, TRUE) <= estimate.confidence)
        assert 0.3 < estimate.confidence < 3
    # A 95 % cone holds 9 or fewer of 12 with a chance of 2 %, and 20 resamples place it only roughly.
    assert sum(inside) >= 10


def test_same_seed_same_answer():
    a, b = (estimate_sun_direction(CAMERA, [OPENING], seed=3, resamples=5) for _ in range(2))
    assert np.array_equal(a.sun_direction, b.sun_direction) and a.confidence == b.confidence


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_unit_of_length_does_not_matter(scale):
    camera = replace(CAMERA, position=CAMERA.position * scale)
    noisy = perturbed(CAMERA, OPENING, 2.0, np.random.default_rng(4))
    large = Opening("left", noisy.window * scale, [(noisy.patches[0][0] * scale, FLOOR)])
    a = estimate_sun_direction(CAMERA, [noisy], resamples=0)
    b = estimate_sun_direction(camera, [large], resamples=0)
    assert degrees_between(a.sun_direction, b.sun_direction) < 0.01  # rounding moves the simplex's steps


def folded_patch(true, window):
    """The patch of a window that runs over the floor and up the wall x = 1.5."""
    inside = floor_part(on_plane(window, true), shapely.box(-1.5, -9, 1.5, 9))
    wall = on_plane(window, true, OPPOSITE_WALL)
    zy = shapely.Polygon(wall[:, [2, 1]]).intersection(shapely.box(-9, 0, 9, 9))
    zy = np.array(zy.exterior.coords)[:-1]
    return [(inside, FLOOR), (np.column_stack([np.full(len(zy), 1.5), zy[:, 1], zy[:, 0]]), OPPOSITE_WALL)]


def test_patch_folded_over_floor_and_wall():
    true = sun(25, 12)
    opening = Opening("left", WINDOW, folded_patch(true, WINDOW))
    estimate = estimate_sun_direction(CAMERA, [opening])
    assert degrees_between(estimate.sun_direction, true) < 0.1  # the stated goal
    assert estimate.status == "determined"
    assert estimate.openings[0].overlap > 0.99, "the cast ends at the fold as the patch does"
    # The fold's two ends are no corners of the window; the four true corners are.
    assert len(estimate.openings[0].matched) == 4


def test_corner_hidden_by_furniture():
    x, z = PATCH[1, [0, 2]]
    crate = shapely.box(x - 0.6, z - 0.6, x + 0.6, z + 0.6)
    patch = floor_part(PATCH, shapely.box(-9, -9, 9, 9) - crate)
    assert len(patch) == 6  # three corners of the window and the crate's outline
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(patch, FLOOR)])])
    assert degrees_between(estimate.sun_direction, TRUE) < 0.1  # three corners agree exactly
    assert estimate.status == "determined"
    assert estimate.notes == ("3 of 4 corners of window 'left' are matched; "
                              "the others count through the overlap alone",)


def test_half_a_patch_is_ambiguous():
    # The far half of the patch is hidden: what remains may be either end of the window's light.
    half = np.array([PATCH[0], (PATCH[0] + PATCH[1]) / 2, (PATCH[2] + PATCH[3]) / 2, PATCH[3]])
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(half, FLOOR)])])
    assert estimate.status == "ambiguous"
    candidates = [estimate.sun_direction, *estimate.alternatives]
    # Two corners agree on the truth exactly, but the overlap of one half pulls at it.
    assert min(degrees_between(c, TRUE) for c in candidates) < 1
    assert "degrees away explains window 'left' nearly as well" in estimate.messages[0]


def test_a_fleck_inside_the_cast_window_is_ambiguous():
    fleck = PATCH.mean(0) + [[0.05, 0, 0.05], [0.05, 0, -0.05], [-0.05, 0, 0]]
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(fleck, FLOOR)])], resamples=5)
    assert any("no corners of the patch match window 'left'" in note for note in estimate.notes)
    # The fleck covers 1 % of the cast window, which alone makes the annotation useless.
    assert estimate.status == "impossible" and "overlaps its patch by" in estimate.messages[0]
    half_size = PATCH.mean(0) + 0.45 * (PATCH[:3] - PATCH[:3].mean(0))
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(half_size, FLOOR)])], resamples=5)
    assert estimate.alternatives


def test_swapped_patches_are_not_accepted():
    other = side_window(0.2)
    swapped = [Opening("back", WINDOW, [(on_plane(other, TRUE), FLOOR)]),
               Opening("front", other, [(PATCH, FLOOR)])]
    estimate = estimate_sun_direction(CAMERA, swapped, resamples=5)
    assert estimate.status in ("ambiguous", "impossible")
    assert any("'back'" in m or "'front'" in m for m in estimate.messages)


def test_one_window_with_a_wrong_patch_is_named():
    second = side_window(-0.6)
    wrong = on_plane(second, sun(60, -60))
    openings = [OPENING, Opening("skewed", second, [(wrong, FLOOR)])]
    estimate = estimate_sun_direction(CAMERA, openings, resamples=5)
    assert estimate.status == "impossible"
    assert any("'skewed' disagree" in m or "'left' disagree" in m for m in estimate.messages)


def test_patch_outside_the_room():
    outside = PATCH * [-1, 1, 1] - [3, 0, 0]  # mirrored at the window's wall
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(outside, FLOOR)])], resamples=5)
    assert estimate.status == "impossible"
    assert any("far side of the window" in m for m in estimate.messages)


def test_sun_below_the_horizon():
    rising = unit(1, 0.1, 0.1)
    low = side_window(bottom=0.2)
    opening = Opening("left", low, [(on_plane(low, rising, OPPOSITE_WALL), OPPOSITE_WALL)])
    estimate = estimate_sun_direction(CAMERA, [opening], resamples=5)
    assert estimate.status == "impossible"
    assert "below the horizon" in estimate.messages[0]


def test_sun_parallel_to_the_window():
    strip = np.array([[-1.5, 0, -2.4], [-1.49, 0, -2.4], [-1.49, 0, -1.5], [-1.5, 0, -1.5]])
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(strip, FLOOR)])], resamples=5)
    assert estimate.status == "impossible"
    assert any("parallel to window 'left'" in m for m in estimate.messages)


def test_patch_of_another_shape_overlaps_too_little():
    tiny = PATCH.mean(0) + 0.1 * (PATCH - PATCH.mean(0))
    estimate = estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(tiny, FLOOR)])], resamples=5)
    assert estimate.status == "impossible"
    assert any("% of their union (at least 10 % needed)" in m for m in estimate.messages)


def test_patch_cut_by_the_frame():
    turned = Camera(480, 480, 350.0, CAMERA.principal_point, rotation(-28, -12), CAMERA.position)
    pixels = shapely.Polygon(turned.project(PATCH)[0]).intersection(shapely.box(0, 0, 480, 480))
    pixels = np.array(pixels.exterior.coords)[:-1]
    rays = turned.directions(pixels)
    seen = turned.position - turned.position[1] / rays[:, 1:2] * rays
    assert len(seen) == 5 or (pixels == 480).any()
    estimate = estimate_sun_direction(turned, [Opening("left", WINDOW, [(seen, FLOOR)])])
    assert degrees_between(estimate.sun_direction, TRUE) < 0.5  # fewer corners, the goal is 1
    assert any("reaches the photograph's frame" in note for note in estimate.notes)
    assert estimate.openings[0].overlap > 0.98


def test_door_whose_threshold_casts_onto_itself():
    door = side_window(bottom=0.0, height=2.0)
    estimate = estimate_sun_direction(CAMERA, [Opening("door", door, [(on_plane(door, TRUE), FLOOR)])])
    assert degrees_between(estimate.sun_direction, TRUE) < 0.1  # two corners agree exactly
    assert len(estimate.openings[0].matched) == 2
    noisy = perturbed(CAMERA, Opening("door", door, [(on_plane(door, TRUE), FLOOR)]), 2.0,
                      np.random.default_rng(5))
    estimate = estimate_sun_direction(CAMERA, [noisy], resamples=5)
    assert degrees_between(estimate.sun_direction, TRUE) < 3  # the stated goal under noise


def test_window_and_patch_partly_behind_the_camera():
    window = side_window(z=1.3)
    opening = Opening("left", window, [(on_plane(window, TRUE), FLOOR)])
    pixels, depth = CAMERA.project(opening.patches[0][0])
    assert (depth <= 0).any() and (depth > 0).any()
    estimate = estimate_sun_direction(CAMERA, [opening], resamples=5)
    assert degrees_between(estimate.sun_direction, TRUE) < 0.1  # the stated goal
    assert np.isfinite(estimate.confidence)


def test_overlap_is_finite_and_zero_beyond_reach():
    view = View(CAMERA, Opening("left", WINDOW, folded_patch(sun(25, 12), WINDOW)))
    rng = np.random.default_rng(6)
    directions = [unit(*v) for v in rng.normal(size=(300, 3))]
    special = [unit(1, 0, 0), unit(0, 0, 1), unit(0, -1, 0), unit(0, 1, 0), unit(1, -1e-12, 0),
               unit(1, 1e-9, 0), unit(1e-15, -1, 0), unit(-1, -0.5, 0)]
    overlaps = np.array([view.overlap(d) for d in directions + special])
    assert np.isfinite(overlaps).all() and (overlaps >= 0).all() and (overlaps <= 1 + 1e-9).all()
    assert view.overlap(unit(-1, 0.5, 0)) == 0
    # Continuous as the cast recedes to infinity: no jump between just below and above the horizon.
    floor_only = View(CAMERA, OPENING)
    assert floor_only.overlap(unit(1, -1e-6, 0.1)) < 1e-3 and floor_only.overlap(unit(1, 1e-6, 0.1)) == 0


@pytest.mark.parametrize("window, patch, message", [
    (WINDOW[:2], PATCH, "window 'left': 2 distinct points"),
    (WINDOW[:, 1:], PATCH, "window 'left': points have 2 coordinates"),
    (WINDOW, PATCH[[0, 1, 1]], "sun patch 1 of window 'left': 2 distinct points"),
    (WINDOW, PATCH[[0, 2, 1, 3]], "sun patch 1 of window 'left': its edges cross"),
    (WINDOW, PATCH + [[0, 0, 0], [0, 0.2, 0], [0, 0, 0], [0, 0, 0]], "m off a common plane"),
    (WINDOW, np.linspace([0, 0, 0], [1, 0, 1], 4), "lie on one line"),
    (WINDOW * [1, np.nan, 1], PATCH, "window 'left': point .* is not finite"),
    (WINDOW, PATCH + [0, 0, 9], "has no area in the photograph"),
])
def test_degenerate_polygons_are_refused(window, patch, message):
    with pytest.raises(InputError, match=message):
        estimate_sun_direction(CAMERA, [Opening("left", window, [(patch, None)])])


def test_other_mistakes_are_refused():
    with pytest.raises(InputError, match="no window with a sun patch"):
        estimate_sun_direction(CAMERA, [])
    with pytest.raises(InputError, match="share the name 'left'"):
        estimate_sun_direction(CAMERA, [OPENING, OPENING])
    with pytest.raises(InputError, match="window 'left' has no sun patch"):
        estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [])])
    with pytest.raises(InputError, match="stands 1.77 m off its plane"):
        estimate_sun_direction(CAMERA, [Opening("left", WINDOW, [(PATCH, OPPOSITE_WALL)])])
