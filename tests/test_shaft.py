"""Shafts: hulls of windows and patches, ray clipping, and the closed integral of directional light."""

from collections import Counter

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.errors import InputError
from pipeline.geometry.shaft import convex_hull, planar_polygon, shaft_hulls
from pipeline.physics.directional import attenuated_path_integral, window_distance

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


def test_rays_through_the_box():
    directions = np.array([[[1.0, 0, 0], [-1, 0, 0], [0, 0, 1]], [[1, 0, 0.5], [0.5, 1, 0], [2, 0, 0]]])
    entry, leave = BOX.clip_rays(np.array([-1.0, 1, 1.5]), directions)
    assert np.allclose(entry, [[1, 0, 0], [1, 0, 0.5]]) and np.allclose(leave, [[2, 0, 0], [2, 0, 1]])


def test_camera_inside_and_rays_along_faces():
    entry, leave = BOX.clip_rays(np.array([0.5, 1, 1]), np.array([[0.0, 0, 1], [0, -1, 0]]))
    assert np.array_equal(entry, [0, 0]) and np.allclose(leave, [2, 1])
    # In the plane of a face, just outside it, and nearly parallel: no NaN, and the right side of it.
    for x, tilt, hits in [(0.0, 0.0, True), (-1e-9, 0.0, False), (0.5, 1e-300, True), (0.5, -1e-17, True),
                          (-1e-9, -1e-300, False), (0.0, 5e-324, True)]:
        entry, leave = BOX.clip_rays(np.array([x, 1, -1]), np.array([[tilt, 0, 1.0]]))
        assert (leave > entry).tolist() == [hits], (x, tilt)
        assert np.allclose([entry, leave], [[1.0], [4.0]] if hits else 0)


def test_clipping_agrees_with_points_tested_one_by_one():
    hull = shaft_hulls(WINDOW, folded_patch())[0]
    rng = np.random.default_rng(1)
    eye = np.array([0.3, 1.5, 1.8])
    targets = rng.uniform([-1.6, -0.2, -2.2], [1.2, 2.0, 0.2], (40, 50, 3))
    directions = (targets - eye) / np.linalg.norm(targets - eye, axis=-1, keepdims=True)
    entry, leave = hull.clip_rays(eye, directions)
    s = np.linspace(0, 6, 601)
    inside = hull.contains(eye + s[:, None, None, None] * directions)
    expected = (s[:, None, None] > entry) & (s[:, None, None] < leave)
    # Samples on the surface itself may round either way: 1.2 million samples, 1e-12 m of doubt.
    assert (inside != expected).mean() < 1e-5
    assert 0.2 < (leave > entry).mean() < 0.95


@pytest.mark.parametrize("kappa", [0, 1e-12, 1e-6, 0.07, 1.0, 50.0, 1e4])
@pytest.mark.parametrize("slope", [-0.999, -1e-9, 0.0, 1e-9, 1.0, 40.0])
@pytest.mark.parametrize("start, end", [(0.0, 5.0), (2.0, 2.0000001), (1.5, 9.0)])
def test_path_integral_against_quadrature(kappa, slope, start, end):
    depth, gradient = kappa * 9.0, kappa * slope
    got = attenuated_path_integral(start, end, depth, gradient)
    # Quadrature of the integrand over its greatest value, cut at 745 where exp underflows to zero.
    least = depth + min(gradient * start, gradient * end)
    width = min(end - start, 745 / abs(gradient)) if gradient else end - start
    expected, _ = quad(lambda t: np.exp(-abs(gradient) * t), 0, width, epsabs=0, epsrel=1e-12,
                       points=None if width * abs(gradient) < 40 else [20 / abs(gradient)], limit=200)
    assert np.isfinite(got)
    # exp(-x) has a relative rounding error of x times float64 epsilon; quad is asked for 1e-12.
    assert got == pytest.approx(np.exp(-least) * expected, rel=1e-11 + 4e-16 * least, abs=1e-300)


def test_path_integral_extremes():
    kappa = np.array([0, 5e-324, 1e-12, 1e-3, 1, 1e4, 1e8])
    with np.errstate(all="raise"):
        got = attenuated_path_integral(0.0, 10.0, 0.0, kappa)
    assert np.all(np.diff(got) <= 0) and got[0] == 10 and got[-1] == pytest.approx(1e-8, rel=1e-12)
    assert attenuated_path_integral(0, 10, 1e5, -1e4 + 1e-3) == pytest.approx(np.exp(-0.01) / 1e4, rel=1e-6)
    assert attenuated_path_integral(3.0, 3.0, 1.0, 1.0) == 0 and attenuated_path_integral(3, 1, 0, 0) == 0
    assert attenuated_path_integral(2.0, np.inf, 0.5, 4.0) == pytest.approx(np.exp(-8.5) / 4)
    assert attenuated_path_integral(0, np.inf, 1e6, 1.0) == 0
    assert np.isinf(attenuated_path_integral(0, np.inf, 0, [0, -1])).all()


def test_path_integral_is_additive_and_free_of_units():
    whole = attenuated_path_integral(1.0, 4.0, 0.3, 0.7)
    parts = attenuated_path_integral([1.0, 2.5], [2.5, 4.0], 0.3, 0.7)
    assert parts.sum() == pytest.approx(whole, rel=1e-14)
    assert attenuated_path_integral(1e3, 4e3, 0.3, 0.7e-3) == pytest.approx(1e3 * whole, rel=1e-14)
    assert attenuated_path_integral(np.zeros((4, 5, 1)), 1.0, 0.0, np.ones(3)).shape == (4, 5, 3)


def test_window_distance():
    rng = np.random.default_rng(2)
    way = rng.uniform(0, 3, (5, 6))
    points = WINDOW[0] + rng.uniform(-1, 1, (5, 6, 2)) @ [[0, 1, 0], [0, 0, 1.0]] + way[..., None] * SUN
    for normal in ([1, 0, 0], [-3.0, 0, 0]):
        assert np.allclose(window_distance(points, WINDOW[0], np.array(normal), SUN), way, atol=1e-12)
    assert window_distance(WINDOW[0] - 2 * SUN, WINDOW[0], np.array([1, 0, 0]), SUN) == pytest.approx(-2)
    with pytest.raises(InputError, match="parallel to the window's plane"):
        window_distance(points, WINDOW[0], np.array([1, 0, 0]), np.array([0, -1.0, 0]))


def test_sunlit_segment_against_marching():
    """Attenuation to the window and to the eye along one eye ray, as the shaft's in-scattering needs it."""
    hull, kappa = shaft_hulls(WINDOW, [PATCH])[0], 0.4
    eye, normal = np.array([0.3, 1.5, 1.8]), np.array([1, 0, 0])
    ray = np.array([-0.2, 0.8, -1.3]) - eye
    ray /= np.linalg.norm(ray)
    entry, leave = hull.clip_rays(eye, ray)
    assert leave > entry > 0
    gradient = kappa * (1 + ray @ normal / (SUN @ normal))
    depth = kappa * window_distance(eye, WINDOW[0], normal, SUN)
    got = attenuated_path_integral(entry, leave, depth, gradient)
    n = 4000
    s = (np.arange(n) + 0.5) / n * 6
    x = eye + s[:, None] * ray
    marched = np.exp(-kappa * (s + window_distance(x, WINDOW[0], normal, SUN))) * hull.contains(x)
    assert got == pytest.approx(marched.sum() * 6 / n, rel=2e-3)  # half a step at either end of 1.5 m
