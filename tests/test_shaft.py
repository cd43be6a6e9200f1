"""Shafts: hulls of windows and patches."""

from collections import Counter

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geometry.shaft import convex_hull, planar_polygon, shaft_hulls

SUN = np.array([0.78, -0.575, 0.246]) / np.linalg.norm([0.78, -0.575, 0.246])
WINDOW = np.array([[-1.5, 0.9, -1.9], [-1.5, 1.9, -1.9], [-1.5, 1.9, -1.0], [-1.5, 0.9, -1.0]])
PATCH = WINDOW - WINDOW[:, 1:2] / SUN[1] * SUN
PRISM_VOLUME = 0.9 * 1.0 * 1.4 * SUN[0] / -SUN[1]  # window area times the mean way along x to the floor
BOX = convex_hull(np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3.0)]), "box")


def folded_patch(wall=0.6):
    """PATCH as it continues on the wall x = `wall`: the parts on the floor and on the wall."""
    on_wall = WINDOW + (wall - WINDOW[:, :1]) / SUN[0] * SUN
    floor_near, floor_far = PATCH[[0, 3]], PATCH[[1, 2]]
    share = (wall - floor_near[:, :1]) / (floor_far - floor_near)[:, :1]
    fold = floor_near + share * (floor_far - floor_near)
    return [np.array([floor_near[0], fold[0], fold[1], floor_near[1]]),
            np.array([fold[0], on_wall[1], on_wall[2], fold[1]])]


def assert_watertight(hull):
    for loops in (hull.faces, [tuple(t) for t in hull.triangles]):
        edges = Counter((f[i], f[(i + 1) % len(f)]) for f in loops for i in range(len(f)))
        assert all(n == 1 and edges[(b, a)] == 1 for (a, b), n in edges.items())
    assert len(hull.vertices) - sum(map(len, hull.faces)) // 2 + len(hull.faces) == 2  # Euler


def test_box():
    assert len(BOX.faces) == len(BOX.planes) == 6 and {len(f) for f in BOX.faces} == {4}
    assert_watertight(BOX)
    assert BOX.volume == pytest.approx(6, rel=1e-12)
    assert sorted(map(tuple, np.round(BOX.planes, 12) + 0.0)) == sorted(
        [(1, 0, 0, 1), (-1, 0, 0, 0), (0, 1, 0, 2), (0, -1, 0, 0), (0, 0, 1, 3), (0, 0, -1, 0)])


def test_shaft_of_one_window():
    hulls = shaft_hulls(WINDOW, [PATCH])
    assert len(hulls) == 1
    hull = hulls[0]
    assert_watertight(hull)
    assert len(hull.faces) == 6 and len(hull.vertices) == 8
    assert hull.volume == pytest.approx(PRISM_VOLUME, rel=1e-9)
    for plane, face in zip(hull.planes, hull.faces):
        a, b, c = hull.vertices[list(face[:3])]
        assert np.cross(b - a, c - b) @ plane[:3] > 0, "loops turn counter-clockwise round outward normals"
        assert np.allclose(hull.vertices[list(face)] @ plane[:3], plane[3], atol=1e-12)
    # Rounding of vertices a few metres from the origin.
    assert hull.contains(np.concatenate([WINDOW, PATCH]), tolerance=1e-12).all()
    assert not hull.contains(WINDOW.mean(0) - 0.01 * SUN) and hull.contains(WINDOW.mean(0) + 0.01 * SUN)


def test_patch_order_does_not_matter():
    volumes = [shaft_hulls(WINDOW[::-1], [np.roll(PATCH, k, 0)])[0].volume for k in range(4)]
    assert volumes == pytest.approx([PRISM_VOLUME] * 4, rel=1e-9)


def test_noisy_outlines_still_give_a_closed_hull():
    rng = np.random.default_rng(0)
    for _ in range(50):
        window = WINDOW + rng.normal(scale=0.02, size=WINDOW.shape) * [0, 1, 1]
        patch = PATCH + rng.normal(scale=0.05, size=PATCH.shape) * [1, 0, 1]
        hull = shaft_hulls(window, [patch])[0]
        assert_watertight(hull)
        assert hull.contains(np.concatenate([window, patch]), tolerance=1e-12).all()


def test_patch_folded_up_a_wall_is_one_tight_hull():
    hulls = shaft_hulls(WINDOW, folded_patch())
    assert len(hulls) == 1
    # The same prism less the wedge behind the wall, whose section in the x, y plane is a triangle.
    wall_height = 1.9 + 2.1 * SUN[1] / SUN[0]
    wedge = 0.9 * 0.5 * wall_height * (wall_height * SUN[0] / -SUN[1])
    assert hulls[0].volume == pytest.approx(PRISM_VOLUME - wedge, rel=1e-9)
    assert_watertight(hulls[0])


def test_patch_over_a_step_and_patches_apart_make_one_hull_each():
    step = np.array([[0.3, 0.4, -1.5], [0.3, 0.4, -0.6], [0.6, 0.4, -0.6], [0.6, 0.4, -1.5]])
    assert len(shaft_hulls(WINDOW, [PATCH - [0.5, 0, 0], step])) == 2
    assert len(shaft_hulls(WINDOW, [PATCH, PATCH + [0, 0, 2.0]])) == 2
    assert len(shaft_hulls(WINDOW, [PATCH, PATCH + [0, 0, 0.9]])) == 1, "side by side, edge to edge"


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_unit_of_length_does_not_matter(scale):
    hull = shaft_hulls(WINDOW * scale, [part * scale for part in folded_patch()])[0]
    assert hull.volume / scale**3 == pytest.approx(shaft_hulls(WINDOW, folded_patch())[0].volume, rel=1e-9)


@pytest.mark.parametrize("window, patches, message", [
    (WINDOW, [WINDOW + [0, 0, 2]], "the sunlight shaft of bath has no volume"),
    (WINDOW, [], "bath has no sun patch"),
    (WINDOW[:2], [PATCH], "the outline of bath: 2 distinct points"),
    (WINDOW, [PATCH[[0, 2, 1, 3]]], "sun patch 1 of bath: its edges cross"),
    (WINDOW, [PATCH, np.full((4, 3), 1.0)], "sun patch 2 of bath: "),
    (WINDOW, [PATCH + np.inf], "sun patch 1 of bath: point .* is not finite"),
    (WINDOW, [PATCH[:, [0, 2]]], "sun patch 1 of bath: points have 2 coordinates"),
])
def test_degenerate_shafts_are_refused(window, patches, message):
    with pytest.raises(InputError, match=message):
        shaft_hulls(window, patches, "bath")


def test_plane_of_a_polygon():
    _, plane = planar_polygon(PATCH, "patch")
    assert np.allclose(np.abs(plane), [0, 1, 0, 0], atol=1e-12)
    with pytest.raises(InputError, match="m off a common plane"):
        planar_polygon(PATCH + np.array([[0, 0.1, 0], [0, 0, 0], [0, 0.1, 0], [0, 0, 0]]), "patch")
