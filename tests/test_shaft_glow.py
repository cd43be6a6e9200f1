"""Sunlight scattered in shafts: the closed form against sums over points, and where it may be used."""

import json

import numpy as np
import pytest

from pipeline.geometry.shaft import convex_hull, reaches_into, shaft_hulls
from pipeline.imaging.maps import read_map
from pipeline.physics.shaft_glow import Shaft, in_scattering, interval
from tests.test_light_transport import DESCRIBED, PATCH, SUN, WINDOW, chain, run

NORMAL = np.array([1.0, 0.0, 0.0])  # of the window, into the room
HULL = shaft_hulls(WINDOW, [PATCH])[0]
#: A second patch, of the same window, farther along: the two volumes overlap behind the window.
LOWER = WINDOW - SUN * (WINDOW[:, 1:2] + 0.3) / SUN[1]
HULLS = [HULL, shaft_hulls(WINDOW, [LOWER])[0]]
EYES = {"outside": [0.03, 1.43, 1.3], "inside": (HULL.vertices.mean(0)).tolist(), "in its way": [1.2, 0.3, -1.4],
        "behind the window": [-2.5, 1.6, -2.0]}
POINTS = 40_000


def rays(count=60):
    """Towards the shaft and past it."""
    random = np.random.default_rng(4)
    directions = random.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), random.uniform(0.5, 6, count)


def summed(hulls, eye, directions, depth, extinction):
    """Midpoint rule over points of each ray, [m]."""
    steps = (np.arange(POINTS) + 0.5) / POINTS
    result = []
    for direction, end in zip(directions, depth):
        distance = steps * end
        points = eye + distance[:, None] * direction
        inside = np.any([hull.contains(points) for hull in hulls], axis=0)
        since = np.maximum((points - WINDOW[0]) @ NORMAL / (SUN @ NORMAL), 0)
        result.append((inside * np.exp(-extinction * (distance + since))).mean() * end)
    return np.array(result)


@pytest.mark.parametrize("hulls", [HULLS[:1], HULLS], ids=["one", "overlapping"])
@pytest.mark.parametrize("place", EYES)
@pytest.mark.parametrize("extinction", [1e-9, 0.15, 3.0])
def test_closed_form_is_the_sum_over_points(place, extinction, hulls):
    eye, (directions, depth) = np.array(EYES[place]), rays()
    within = np.random.default_rng(1).dirichlet(np.ones(len(HULL.vertices)), 12)
    towards = np.concatenate([within @ hull.vertices for hull in hulls]) - eye
    directions = np.concatenate([directions, towards / np.linalg.norm(towards, axis=1, keepdims=True)])
    depth = np.concatenate([depth, np.full(len(towards), 5.0)])
    shafts = [Shaft(hull.planes, WINDOW[0], NORMAL) for hull in hulls]
    found = in_scattering(shafts, SUN, eye, directions, depth, np.full(3, extinction), np.full(3, 2.0),
                          np.full(len(depth), 0.5))
    expected = summed(hulls, eye, directions, depth, extinction)
    assert (expected > 0).sum() > 8
    # the sum misses or adds up to a step at each of the ends
    np.testing.assert_allclose(found[:, 0], expected, atol=3 * depth.max() / POINTS, rtol=1e-4)


def test_extremes():
    eye, (directions, depth) = np.array(EYES["outside"]), rays(400)
    towards = HULL.vertices.mean(0) + np.random.default_rng(2).normal(scale=0.3, size=directions.shape) - eye
    directions = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    shafts, before = [Shaft(HULL.planes, WINDOW[0], NORMAL)], None
    for extinction in (0.0, 1e-12, 1e-3, 1.0, 1e4, 1e300):
        one = in_scattering(shafts, SUN, eye, directions, depth, np.full(3, extinction), np.ones(3), np.ones(len(depth)))
        assert np.isfinite(one).all() and (one >= 0).all()
        assert before is None or (one <= before * (1 + 1e-12)).all(), "denser fog lets through no more"
        before = one
    assert not one.any()
    assert not in_scattering(shafts, SUN, eye, directions, np.zeros(400), np.ones(3), np.ones(3), np.ones(400)).any()


def test_rays_along_faces_and_past_corners():
    cube = convex_hull(np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1.0)]), "cube")
    eye = np.array([-1.0, 0.5, 0.5])
    near, far = interval(cube.planes, eye, np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0]]), np.array([9.0, 9.0, 9.0]))
    assert np.allclose(near[0], 1) and np.allclose(far[0], 2) and (far[1:] == near[1:]).all()
    near, far = interval(cube.planes, np.array([-1.0, 2.0, 0.5]), np.array([[1.0, 0, 0]]), np.array([9.0]))
    assert far == near, "parallel to two faces, outside"
    near, far = interval(cube.planes, eye, np.array([[1.0, 0, 0]]), np.array([1.25]))
    assert far - near == pytest.approx(0.25)


@pytest.mark.parametrize("face, inside", [
    (np.array([[-9, 0.5, -9], [9, 0.5, -9], [9, 0.5, 9], [-9, 0.5, 9.0]]), True),  # through all of it
    (HULL.vertices.mean(0) + 0.02 * np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1.0]]), True),  # within
    (np.array([[-9, 0, -9], [9, 0, -9], [9, 0, 9], [-9, 0, 9.0]]), False),  # the floor that it ends on
    (np.array([[-1.5, 0, -3], [-1.5, 2.4, -3], [-1.5, 2.4, 1], [-1.5, 0, 1.0]]), False),  # the window's wall
    (np.array([[1, 2, -2], [1.4, 2, -2], [1.4, 2, -1.5], [1, 2, -1.5]]), False)])
def test_what_reaches_into_a_shaft(face, inside):
    assert reaches_into(face, HULL) is inside
    assert reaches_into(face[::-1], HULL) is inside


def test_what_stands_in_the_light_asks_for_a_render(tmp_path):
    free = chain(tmp_path / "free", {"sun": DESCRIBED["sun"]})
    plan = json.loads(free.plan.read_text())
    assert plan["runs"] == [] and "sun: V in closed form, no render; nothing stands in its way" in plan["reasons"]
    known = read_map(free.in_scattering("sun"))
    run(free, "render.glow=rendered", "render.shaft_samples=400")
    rendered = read_map(free.in_scattering("sun"))
    lit = rendered[..., 0] > 0.05 * rendered.max()
    # half floats, and one of 256 samples, the most that POV-Ray takes, at each end of a ray
    assert np.median(np.abs(known[lit] / rendered[lit] - 1)) < 2e-3

    shaded = chain(tmp_path / "shaded", {"sun": DESCRIBED["sun"]}, box=True)
    assert [one["id"] for one in json.loads(shaded.plan.read_text())["runs"]] == ["in_scattering_sun"]
    assert (read_map(shaded.in_scattering("sun")) < known - 1e-3)[lit].any(), "the box throws a shadow into the shaft"
