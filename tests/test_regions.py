"""Regions of a photograph to depth, for cameras and things whose place in the world is known."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings, strategies as st

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera, from_field_of_view, rotation, yaw_pitch_roll
from pipeline.geometry.horizon import pitch_and_roll
from pipeline.geometry.normals import surface_normals
from pipeline.geometry.regions import (
    FARTHEST_BEYOND_FOOT, FEWEST_PIXELS, Region, cut, depth_of_regions, ground_point, painted, polygon_mask, torn)

SKY = 5000.0
HEIGHT = 1.6
#: Metres a metre: all depths here are closed forms, off by rounding alone.
ROUNDING = 1e-9


def camera(pitch=0.0, roll=0.0, yaw=0.0, size=(96, 72), angle=60.0, height=HEIGHT) -> Camera:
    return from_field_of_view(*size, angle, camera_height=height, yaw=yaw, pitch=pitch, roll=roll)


def region(view: Camera, name: str, kind: str, pixels=None, **described) -> Region:
    """A region by its outline, or all of the photograph."""
    if pixels is None:
        pixels = [[0, 0], [view.width, 0], [view.width, view.height], [0, view.height]]
    return Region(name, kind, *cut(polygon_mask((view.height, view.width), np.array(pixels, float))), **described)


def outline(view: Camera, points) -> np.ndarray:
    """Pixels of points in the world, all of which the camera must see."""
    pixels = view.project(np.array(points, float))[0]
    assert np.isfinite(pixels).all()
    return pixels


def points_of(view: Camera, depth: np.ndarray) -> np.ndarray:
    return view.position + depth[..., None] * view.directions(view.pixel_centres())


def named(found, name: str) -> Region:
    return next(region for region in found.regions if region.name == name)


def seen(found, name: str) -> np.ndarray:
    """Pixels (H, W) that show a region."""
    return found.labels == [region.name for region in found.regions].index(name)


# ---- support ---------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("pitch", [-90, -60, -10, 0, 15])
@pytest.mark.parametrize("roll", [0, 7, -30])
def test_level_ground_is_radial_and_metric(pitch, roll):
    view = camera(pitch, roll, yaw=20)
    depth = depth_of_regions(view, [region(view, "ground", "support")], SKY).depth
    # x = d K^-1 [p, 1], turned into the world, with d planar: where y is -HEIGHT, and the ray's length is the depth
    v, u = np.mgrid[:view.height, :view.width] + 0.5
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(view.intrinsic_matrix).T @ view.world_from_camera.T
    with np.errstate(divide="ignore"):
        planar = np.where(rays[..., 1] < 0, -HEIGHT / rays[..., 1], np.inf)
    expected = np.minimum(planar * np.linalg.norm(rays, axis=-1), SKY)
    np.testing.assert_allclose(depth, expected, rtol=ROUNDING)
    assert (expected < SKY).any() and (pitch < -20 or (expected == SKY).any())


def test_ground_straight_down_is_as_far_as_the_camera_is_high():
    view = camera(-90, size=(3, 3))
    assert depth_of_regions(view, [region(view, "g", "support")], SKY).depth[1, 1] == pytest.approx(HEIGHT)


@given(st.floats(-60, 60), st.floats(-70, 70), st.floats(-180, 180))
@settings(max_examples=40, deadline=None)
def test_a_line_along_the_horizon_gives_pitch_and_roll(pitch, roll, yaw):
    view = camera(pitch, roll, yaw)
    level = np.array([[np.sin(a), 0, -np.cos(a)] for a in np.radians([yaw - 20, yaw + 20])])
    horizon = view.project(view.position + level)[0]
    found = pitch_and_roll(horizon, view.focal_length, view.principal_point)
    np.testing.assert_allclose(found, (pitch, roll), atol=1e-7)  # degree; rounding
    np.testing.assert_allclose(pitch_and_roll(horizon[::-1], view.focal_length, view.principal_point), found, atol=1e-9)
    np.testing.assert_allclose(yaw_pitch_roll(rotation(yaw, *found))[1:], (pitch, roll), atol=1e-7)


@pytest.mark.parametrize("horizon, message", [
    ([[10, 20], [10, 20]], "two ends are one point"),
    ([[10, 20], [10, 90]], "from top to bottom"),
])
def test_horizons_that_are_none(horizon, message):
    with pytest.raises(InputError, match=message):
        pitch_and_roll(np.array(horizon, float), 500, np.array([320, 240.0]))


def test_near_and_far_bound_a_plane():
    view = camera(-5, size=(90, 60))
    ground = region(view, "lawn", "support", [[10, 30], [80, 30], [80, 60], [10, 60]], near=4.0, far=60.0)
    found = depth_of_regions(view, [region(view, "sky", "sky"), ground], SKY)
    depth, inside = found.depth, seen(found, "lawn")
    assert (np.diff(depth[30:60, 45]) < 0).all() and 4 < depth[inside].min() < depth[inside].max() < 70
    plane = named(found, "lawn").planes[0]
    for row, expected in ((60, 4), (30, 60)):  # the lower and upper edge, in the middle column
        ray = view.directions([45, row])
        assert (plane.point - view.position) @ plane.normal / (ray @ plane.normal) == pytest.approx(expected)
    points = points_of(view, depth)[inside]
    off = (points - points.mean(0)) @ np.linalg.svd(points - points.mean(0), full_matrices=False)[2][2]
    assert np.abs(off).max() < 1e-6  # metres; it lies on one plane
    # and along a row it is level, as the camera is
    np.testing.assert_allclose(np.diff(points_of(view, depth)[40, 10:80, 1]), 0, atol=1e-9)


def test_near_and_far_are_of_what_was_drawn_not_of_what_is_left_of_it():
    view = camera(size=(40, 40))
    ground = region(view, "lawn", "support", near=2.0, far=50.0)
    bush = region(view, "bush", "vertical", [[0, 30], [40, 30], [40, 40], [0, 40]], depth=1.5)
    alone = depth_of_regions(view, [ground], SKY).depth
    np.testing.assert_array_equal(depth_of_regions(view, [ground, bush], SKY).depth[:30], alone[:30])


def test_ground_drawn_above_the_horizon_is_reported():
    view = camera(size=(40, 40))
    found = depth_of_regions(view, [region(view, "hill", "support")], SKY)
    assert found.messages == ["region hill: 50% of it lies above the horizon, as far as the sky; give it 'near' and"
                              " 'far', or correct the horizon"]
    assert (found.depth[:20] == SKY).all()


def test_camera_must_stand_above_the_ground():
    view = camera(size=(8, 8), height=0.0)
    with pytest.raises(InputError, match="g: the camera lies 0 m above the ground; give the camera a height above 0"):
        depth_of_regions(view, [region(view, "g", "support")], SKY)
    assert ground_point(view, [4, 8]) is None and ground_point(camera(height=-2.0), [48, 72]) is None


def test_ground_that_is_hidden_still_supports():
    view = camera(size=(40, 40))
    lawn = region(view, "lawn", "support", [[0, 30], [40, 30], [40, 40], [0, 40]], near=5.0, far=40.0)
    wall = region(view, "wall", "vertical", [[0, 0], [40, 0], [40, 40], [0, 40]], foot=np.array([[5, 35], [35, 35]]))
    found = depth_of_regions(view, [lawn, wall], SKY)
    assert 5 < np.linalg.norm(named(found, "wall").planes[0].point - view.position) < 40


# ---- upright things ---------------------------------------------------------------------------------------------

def street(view: Camera, wall: Region) -> object:
    ground = region(view, "ground", "support", [[0, 36], [96, 36], [96, 72], [0, 72]])
    return depth_of_regions(view, [region(view, "sky", "sky"), ground, wall], SKY)


FRONTS = {
    "straight": [[-3, -12], [3, -12]],
    "slanted": [[-4, -10], [3, -16]],
    "grazing": [[1.0, -6], [1.4, -40]],
    "outer corner": [[-5, -14], [-1, -9], [4, -13]],
    "inner corner": [[-4, -9], [-1, -15], [4, -11]],
    "three pieces": [[-5, -10], [-2, -13], [1.5, -12], [4, -9]],
}


@pytest.mark.parametrize("pitch, roll", [(0, 0), (-4, 5)])
@pytest.mark.parametrize("turned", [False, True], ids=["left to right", "right to left"])
@pytest.mark.parametrize("front", FRONTS)
def test_a_wall_rises_from_its_foot(front, turned, pitch, roll):
    view = camera(pitch, roll)
    corners = np.insert(np.array(FRONTS[front], float), 1, 0, axis=1)
    top = corners + [0, 2.5, 0]
    foot = outline(view, corners)[::-1 if turned else 1]
    wall = region(view, "wall", "vertical", outline(view, np.concatenate([corners, top[::-1]])), foot=foot)
    found = street(view, wall)
    x, _, z = np.moveaxis(points_of(view, found.depth)[seen(found, "wall")], -1, 0)
    assert len(x) > 20
    # each pixel lies on the piece of the front, in plan, that its own ray meets
    pieces = list(zip(corners[:-1, [0, 2]], corners[1:, [0, 2]]))
    off = np.min([np.abs((x - a[0]) * (b - a)[1] - (z - a[1]) * (b - a)[0]) / np.linalg.norm(b - a)
                  for a, b in pieces], 0)
    assert off.max() < 1e-6  # metres
    # and the front is seen from the eye: the first piece along the ray
    plan = shapely.LineString(corners[:, [0, 2]]).buffer(1e-4)
    clear = [shapely.LineString([[0, 0], [0.999 * a, 0.999 * b]]).distance(plan) > 0 for a, b in zip(x, z)]
    assert all(clear)


def test_a_wall_goes_on_a_little_beyond_its_foot_but_not_to_the_horizon():
    view = camera()
    foot = outline(view, [[-2, 0, -8], [-2, 0, -20]])  # parallel to the line of sight
    wall = region(view, "wall", "vertical", [[0, 20], [96, 20], [96, 40], [0, 40]], foot=foot)
    found = street(view, wall)
    depth = found.depth[seen(found, "wall")]
    farthest = np.linalg.norm(view.position - [-2, 0, -20])
    assert depth.max() == pytest.approx(FARTHEST_BEYOND_FOOT * farthest) and depth.min() > 2


def test_given_depth_is_that_of_the_middle_and_the_thing_stands_upright():
    view = camera(-6, 3)
    post = region(view, "post", "vertical", [[60, 10], [64, 10], [64, 60], [60, 60]], depth=25.0)
    found = street(view, post)
    assert found.depth[34:36, 61:63].mean() == pytest.approx(25, rel=1e-3)  # between four pixels' centres
    points = points_of(view, found.depth)[seen(found, "post")]
    spread = np.linalg.svd(points[:, [0, 2]] - points[:, [0, 2]].mean(0))[1]
    assert spread[1] < 1e-6  # seen from above it is a line


@pytest.mark.parametrize("pitch", [-90, -80, 80])
def test_seen_from_above_or_below_a_given_depth_holds_for_all_of_it(pitch):
    view = camera(pitch)
    found = depth_of_regions(view, [region(view, "roof", "vertical", depth=30.0)], SKY)
    # a plane across the line of sight, over half the diagonal of the view: 1 / cos(36 degrees)
    assert found.depth.min() > 29.9 and found.depth.max() < 30 / np.cos(np.radians(36))


def test_without_any_word_a_thing_stands_where_it_meets_the_ground():
    view = camera(-3)
    at = np.array([1.5, 0, -9.0])
    left, right = view.world_from_camera[:, 0] * -0.4, view.world_from_camera[:, 0] * 0.4
    man = region(view, "man", "vertical", outline(view, [at + left, at + right, at + right + [0, 1.8, 0],
                                                         at + left + [0, 1.8, 0]]))
    depth = street(view, man)
    # the lowest row is a whole pixel: the ground's depth in the row below to that above the foot
    v = outline(view, [at])[0, 1]
    bounds = [np.linalg.norm(ground_point(view, [outline(view, [at])[0, 0], v + dv]) - view.position) for dv in (1, -1)]
    foot = depth.depth[seen(depth, "man")].max()
    assert bounds[0] < foot < bounds[1]


def test_a_thing_whose_foot_is_hidden_stands_where_it_was_drawn():
    view = camera()
    tree = region(view, "tree", "vertical", [[40, 10], [56, 10], [56, 60], [40, 60]])
    bush = region(view, "bush", "vertical", [[30, 50], [66, 50], [66, 64], [30, 64]])
    found = depth_of_regions(view, [region(view, "sky", "sky"),
                                    region(view, "ground", "support", [[0, 64], [96, 64], [96, 72], [0, 72]]), tree,
                                    bush], SKY)
    expected = np.linalg.norm(ground_point(view, [48, 60]) - view.position)
    distance = (named(found, "tree").planes[0].point - view.position)
    assert np.linalg.norm(distance) == pytest.approx(expected)


def test_things_stand_on_ground_that_has_near_and_far_values():
    view = camera()
    lawn = region(view, "lawn", "support", [[0, 36], [96, 36], [96, 72], [0, 72]], near=10.0, far=400.0)
    drawn = {"foot": np.array([[30, 60], [50, 60.0]])}
    for name, described in (("by its foot", drawn), ("by its lowest pixel", {})):
        wall = region(view, name, "vertical", [[30, 20], [50, 20], [50, 60], [30, 60]], **described)
        found = depth_of_regions(view, [region(view, "sky", "sky"), lawn, wall], SKY)
        # the lawn's row below it and the wall's lowest are neighbours: the lawn's own step in a row is 3 %
        np.testing.assert_allclose(found.depth[59, 30:50], found.depth[60, 30:50], rtol=0.03)
    # in a painted picture there is no ground below a wall, and a foot is clicked a little within it
    outline = [[30, 20], [50, 20], [50, 60], [30, 60]]
    base = ~polygon_mask((72, 96), np.array(outline, float)) & (np.arange(72) >= 36)[:, None]
    lawn = Region("lawn", "support", *cut(base), near=10.0, far=400.0)
    wall = region(view, "wall", "vertical", outline, foot=np.array([[30, 59], [50, 59.0]]))
    found = depth_of_regions(view, [region(view, "sky", "sky"), lawn, wall], SKY)
    np.testing.assert_allclose(found.depth[59, 31:50], found.depth[60, 31:50], rtol=0.07)  # a row and a half


@pytest.mark.parametrize("described, message", [
    ({"foot": np.array([[30, 50], [60, 30.0]])}, r"wall: its foot \[60, 30\] lies above the horizon; put it on"),
    ({"foot": np.array([[30, 36], [60, 50.0]])}, r"wall: its foot \[30, 36\] lies above the horizon"),
    ({"foot": np.array([[30, 50], [30, 50.0]])}, "wall: two points of its foot are one; give points apart"),
    ({}, r"wall: nowhere reaches below the horizon; its lowest pixel is \[40.5, 30\]; give its 'depth' \[m\]"),
])
def test_places_that_are_none(described, message):
    view = camera()
    wall = region(view, "wall", "vertical", [[30, 10], [51, 10], [51, 30], [30, 30]], **described)
    with pytest.raises(InputError, match=message):
        street(view, wall)


# ---- together ---------------------------------------------------------------------------------------------------

def test_sky_is_as_far_as_fog_and_later_regions_lie_over_earlier_ones():
    view = camera(size=(20, 20))
    half = [[0, 0], [10, 0], [10, 20], [0, 20]]
    regions = [region(view, "sky", "sky"), region(view, "a", "vertical", half, depth=5.0),
               region(view, "b", "vertical", [[5, 0], [15, 0], [15, 20], [5, 20]], depth=9.0)]
    found = depth_of_regions(view, regions, SKY)
    assert [named(found, n).mask.sum() for n in ("sky", "a", "b")] == [100, 100, 200]
    assert (found.depth[:, 15:] == SKY).all() and (found.depth[:, 6:9] > 8).all()
    turned = depth_of_regions(view, [regions[0], *regions[:0:-1]], SKY)
    assert [named(turned, n).mask.sum() for n in ("sky", "a", "b")] == [100, 200, 100]


def test_hidden_and_outlying_regions_are_reported():
    view = camera(size=(20, 20))
    regions = [region(view, "under", "vertical", [[3, 3], [9, 3], [9, 9]], depth=2.0), region(view, "sky", "sky"),
               region(view, "out", "vertical", [[30, 30], [40, 30], [40, 40]], depth=2.0)]
    found = depth_of_regions(view, regions, SKY)
    assert found.messages == [f"region {name} is hidden by later ones, or outside the photograph"
                              for name in ("under", "out")]
    assert (found.depth == SKY).all()


def test_slits_between_outlines_take_what_is_nearest():
    view = camera(size=(200, 100))
    left = region(view, "left", "vertical", [[0, 0], [99, 0], [99, 100], [0, 100]], depth=5.0)
    right = region(view, "right", "vertical", [[101, 0], [200, 0], [200, 100], [101, 100]], depth=50.0)
    found = depth_of_regions(view, [left, right], SKY)
    assert (found.labels[:, :100] == 0).all() and (found.labels[:, 100:] == 1).all()
    assert (found.depth[:, 99] < 6).all() and (found.depth[:, 100] > 49).all()


def test_more_than_slits_is_refused():
    view = camera(size=(200, 100))
    left = region(view, "left", "vertical", [[0, 0], [190, 0], [190, 100], [0, 100]], depth=5.0)
    with pytest.raises(InputError, match=r"no region covers 5.0% of the photograph, for example pixel \[190, 50\];"
                                         " draw regions over all of it, or give a depth 'map'"):
        depth_of_regions(view, [left], SKY)


def test_known_depth_fills_what_no_region_covers():
    view = camera(size=(40, 30))
    known = np.full((30, 40), 7.0)
    known[:, 20:] = 2 * SKY
    known[10, 10] = np.nan  # a slit in the map takes its neighbour's depth
    person = region(view, "person", "vertical", [[2, 5], [8, 5], [8, 25], [2, 25]], depth=3.0)
    found = depth_of_regions(view, [person], SKY, known)
    assert np.isfinite(found.depth).all()
    assert (found.depth[5:25, 2:8] < 3.2).all() and (found.depth[:, 10:20] == 7).all()
    assert named(found, "map:1").kind == "map" and (found.depth[:, 20:] == SKY).all()
    assert named(found, "map:sky").kind == "sky"  # only the way to the eye counts there
    known[:, :10] = np.nan
    with pytest.raises(InputError, match="neither a region nor the depth map covers 15.1%.*; draw regions over all of"):
        depth_of_regions(view, [person], SKY, known)


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (50, 1), (2, 3)])
def test_photographs_of_few_pixels(size):
    view = camera(-20, size=size)
    known = np.full(size[::-1], 4.0)
    ground, sky = region(view, "ground", "support"), region(view, "sky", "sky")
    for regions, more in (([ground], None), ([sky], None), ([], known)):
        found = depth_of_regions(view, regions, SKY, more)
        assert found.depth.shape == size[::-1] and (found.depth > 0).all() and (found.depth <= SKY).all()
    assert torn(known, 0).shape == (size[1] - 1, size[0]) and not torn(known, 1).any()


def test_units_of_length_do_not_matter():
    def depth(scale):
        view = camera(-4, 2, height=HEIGHT * scale)
        parts = [region(view, "sky", "sky"), region(view, "ground", "support", [[0, 33], [96, 33], [96, 72], [0, 72]]),
                 region(view, "lawn", "support", [[60, 50], [96, 50], [96, 72], [60, 72]], near=2 * scale,
                        far=9 * scale),
                 region(view, "wall", "vertical", [[5, 5], [40, 5], [40, 50], [5, 50]],
                        foot=np.array([[5, 50], [40, 44]])),
                 region(view, "tree", "vertical", [[70, 5], [80, 5], [80, 60], [70, 60]])]
        return depth_of_regions(view, parts, SKY * scale).depth / scale

    for scale in (1e-3, 1e3):
        np.testing.assert_allclose(depth(scale), depth(1.0), rtol=1e-6)


# ---- outlines ---------------------------------------------------------------------------------------------------

@given(st.lists(st.tuples(st.floats(0.1, 1), st.floats(0.05, 1)), min_size=3, max_size=12), st.floats(3, 90))
@settings(max_examples=60, deadline=None)
def test_an_outline_holds_the_pixels_whose_centres_lie_in_it(spokes, size):
    radius, gaps = np.array(spokes).T
    angles = np.cumsum(gaps / gaps.sum()) * 2 * np.pi
    points = np.c_[np.cos(angles), np.sin(angles)] * radius[:, None] * size + [20, 15]
    polygon = shapely.Polygon(points)
    if not polygon.is_valid or polygon.area < polygon.length / 2:  # thinner than a pixel
        return
    u, v = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    mask = polygon_mask((30, 40), points)
    differ = mask != shapely.contains_xy(polygon, u, v)
    # a centre on an edge, to rounding, may fall either way
    assert shapely.distance(polygon.exterior, shapely.points(u[differ], v[differ])).max(initial=0) < 1e-9
    np.testing.assert_array_equal(mask, polygon_mask((30, 40), points[::-1]))


def test_outlines_that_share_an_edge_share_no_pixel_and_leave_none():
    rng = np.random.default_rng(0)
    middle = np.array([[-5, 30], *np.c_[np.linspace(5, 95, 30), rng.uniform(10, 50, 30)], [105, 30.0]])
    above = polygon_mask((60, 100), np.concatenate([middle, [[105, -9], [-5, -9]]]))
    below = polygon_mask((60, 100), np.concatenate([middle, [[105, 70], [-5, 70]]]))
    assert (above ^ below).all()


@pytest.mark.parametrize("points, pixels", [
    ([[2, 2], [5, 2], [5, 5], [2, 5]], 9),                       # by centres: not one more on the right and below
    ([[1, 2], [9, 2], [1, 7.9], [9, 7.9]], 24),                  # crosses itself: both halves
    ([[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6], [-1e6, 1e6]], 100),  # far outside
    ([[20, 20], [30, 20], [30, 30]], 0),
    ([[3, 3], [3, 3], [3, 3]], 0),
    ([[2.5, 1.5], [2.5, 8.5], [2.5, 4.5]], 8),                   # a line is a pixel wide
    ([[4.6, 1.4], [5.4, 1.4], [5.4, 8.6], [4.6, 8.6]], 16),         # and so is a wire between two columns of centres
], ids=["square", "bow tie", "huge", "outside", "point", "line", "wire"])
def test_odd_outlines(points, pixels):
    mask = polygon_mask((10, 10), np.array(points, float))
    assert mask.sum() == pixels


def test_holes_are_cut_out():
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])
    mask = polygon_mask((10, 10), square, [square * 0.4 + 3, square * 0.2 + 3])
    assert mask.sum() == 100 - 16 and not mask[3:7, 3:7].any()


# ---- painted pictures -------------------------------------------------------------------------------------------

def test_painted_patches_stand_each_by_itself():
    labels = np.zeros((30, 60), int)
    labels[5:20, 5:15], labels[8:28, 30:45], labels[2:4, 50:52] = 1, 1, 1
    labels[20, 15] = 1  # joined over a corner
    patches = painted(labels, 1, apart=True)
    assert [mask.sum() for mask, _ in patches] == [300, 151]  # biggest first; the speck is too small
    assert 4 < FEWEST_PIXELS < 151
    (mask, at), = painted(labels, 1, apart=False)
    assert mask.sum() == 455 and mask.shape == labels[at].shape and painted(labels, 7, apart=True) == []


def test_painted_patches_have_depths_of_their_own_and_floating_ones_borrow():
    view = camera()
    labels = np.zeros((72, 96), int)
    labels[36:] = 1
    labels[10:50, 10:20], labels[20:60, 60:70], labels[5:15, 72:80] = 2, 2, 2
    described = [(0, "sky", False), (1, "support", False), (2, "vertical", True)]
    regions = [Region(f"{kind}:{n}", kind, *patch, painted=True) for colour, kind, apart in described
               for n, patch in enumerate(painted(labels, colour, apart))]
    found = depth_of_regions(view, regions, SKY)
    for column, row in ((15, 50), (65, 60)):
        foot = np.linalg.norm(ground_point(view, [column, row]) - view.position)
        assert found.depth[row - 1, column] == pytest.approx(foot, rel=0.05)  # the row above the foot's edge
    assert found.depth[10, 76] == pytest.approx(found.depth[20, 69], rel=0.1)  # across its own line of sight
    assert found.messages == ["region vertical:2 nowhere reaches below the horizon; it counts as far as vertical:1"
                              f" beside it, {found.depth[20, 69]:.3g} m"]
    with pytest.raises(InputError, match=r"vertical:2: the patch painted at \[72, 5\] lies above the horizon; paint"):
        depth_of_regions(view, [r for r in regions if r.name not in ("vertical:0", "vertical:1")], SKY,
                         np.full((72, 96), 9.0))


# ---- tears and normals of depth maps ----------------------------------------------------------------------------

def test_ground_up_to_the_horizon_is_whole_and_poles_are_torn_off_it():
    view = camera(size=(64, 64))
    depth = depth_of_regions(view, [region(view, "ground", "support")], SKY).depth
    assert (depth[33] > 1.15 * depth[34]).all()  # steps as large as those to other things
    assert not torn(depth, 0).any() and not torn(depth, 1).any()
    depth[10:40, 20] = 3.0  # a pole, one pixel wide
    across = torn(depth, 1)
    assert across[10:40, 19:21].all() and across.sum() == 60
    depth[50, 50] = np.nan
    assert torn(depth, 1)[50, 49:51].all() and torn(depth, 0)[49:51, 50].all()


def test_normals_of_a_corner_face_the_eye_and_keep_to_their_walls():
    view = camera(-10, 4, size=(64, 48))
    parts = [region(view, "sky", "sky"), region(view, "ground", "support", [[0, 24], [64, 24], [64, 48], [0, 48]]),
             region(view, "wall", "vertical", [[10, 0], [50, 0], [50, 35], [10, 35]],
                    foot=np.array([[10, 35], [50, 38]]))]
    found = depth_of_regions(view, parts, SKY)
    points = points_of(view, found.depth)
    normals = surface_normals(points, view.position)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, rtol=1e-9)
    assert ((normals * (view.position - points)).sum(-1) >= 0).all()
    wall = named(found, "wall").planes[0].normal
    # in the corner, one row of each, the nearer neighbour may be the other's
    assert (np.abs(normals[seen(found, "wall")] @ wall) > 1 - 1e-9).mean() > 0.95
    below = seen(found, "ground") & (found.depth < SKY)
    assert (normals[below][:, 1] > 1 - 1e-6).mean() > 0.95


def test_normals_are_the_same_in_blocks(monkeypatch):
    points = np.random.default_rng(0).normal(size=(23, 17, 3)) - [0, 0, 5]
    whole = surface_normals(points, np.zeros(3))
    monkeypatch.setattr("pipeline.geometry.normals._BLOCK", 40)
    np.testing.assert_array_equal(surface_normals(points, np.zeros(3)), whole)
    single = surface_normals(points[:1, :1], np.zeros(3))[0, 0]
    np.testing.assert_allclose(single, -points[0, 0] / np.linalg.norm(points[0, 0]))


def test_blocks_of_pixels_are_no_seams(monkeypatch):
    view = camera(-4)
    parts = [region(view, "sky", "sky"), region(view, "ground", "support", [[0, 30], [96, 30], [96, 72], [0, 72]]),
             region(view, "tree", "vertical", [[40, 5], [50, 5], [50, 60], [40, 60]])]
    whole = depth_of_regions(view, parts, SKY).depth
    monkeypatch.setattr("pipeline.geometry.regions._BLOCK", 100)
    np.testing.assert_array_equal(depth_of_regions(view, parts, SKY).depth, whole)
