"""The quadrature reference itself: closed forms, energy laws, brute force, and convergence.

Where a test compares with a closed form the quadrature's own error is far below 1e-6 (its tolerance of
1e-5 compares a 7-point with a 15-point rule and keeps the latter), hence the recurring 1e-6.
"""

import numpy as np
import pytest

from tests.reference import quadrature as q

CLEAR_PHASE = 1 / (4 * np.pi)
FOG = q.Medium((0.03, 0.05, 0.08), (0.07, 0.06, 0.05), q.henyey_greenstein(0.6))


def rays_along(directions, depth, origin=(0.0, 0.0, 0.0), normals=None):
    directions = np.atleast_2d(np.asarray(directions, float))
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    count = len(directions)
    normals = -directions if normals is None else np.broadcast_to(np.asarray(normals, float), (count, 3))
    return q.Rays(np.asarray(origin, float), directions, np.broadcast_to(np.asarray(depth, float), count),
                  normals, np.zeros(count, bool))


def square(centre, a, b):
    """Corners (4, 3) of the parallelogram centre +- a +- b."""
    centre, a, b = np.asarray(centre, float), np.asarray(a, float), np.asarray(b, float)
    return np.array([centre - a - b, centre + a - b, centre + a + b, centre - a + b])


def some_directions(count, seed=3):
    return np.random.default_rng(seed).normal(size=(count, 3))


# --- rules -------------------------------------------------------------------------------------


def test_kronrod_rule_is_exact_for_polynomials():
    powers = np.arange(23)  # the (7, 15) rule has degree 22
    values = (q._NODES[:, None] ** powers * q._WEIGHTS[:, None]).sum(0)
    np.testing.assert_allclose(values, 1 / (powers + 1), rtol=1e-14)  # rounding of 15 terms


@pytest.mark.parametrize("asymmetry", [-0.999, -0.5, 0.0, 0.7, 0.999])
def test_phase_functions_are_normalised_with_mean_cosine_g(asymmetry):
    phase = q.henyey_greenstein(asymmetry)
    # cos = +-(1 - x), x = e^y: resolves peaks of width (1-g)^2 = 1e-6
    y, weight = np.polynomial.legendre.leggauss(400)
    low, high = np.log(1e-14), np.log(2.0)
    x = np.exp(low + (high - low) * (y + 1) / 2)
    cosine = np.sign(asymmetry or 1) * (1 - x)
    measure = 2 * np.pi * weight * (high - low) / 2 * x * phase(cosine)
    # 1e-7: the share of the peak below x = 1e-14 (1e-14 / 1e-6) and the cancellation in 1 - cos there
    assert measure.sum() == pytest.approx(1, abs=1e-7)
    assert (measure * cosine).sum() == pytest.approx(asymmetry, abs=1e-7)


def test_rayleigh_is_normalised():
    cosine, weight = np.polynomial.legendre.leggauss(4)  # exact for the quadratic
    assert 2 * np.pi * (weight * q.rayleigh(cosine)).sum() == pytest.approx(1, rel=1e-14)


# --- point and spot lights ---------------------------------------------------------------------


def test_thin_fog_round_a_point_light_has_the_arctangent_form():
    """kappa -> 0: V = delta p I / h (angle under which the light sees the ray)."""
    height, before, depth = 0.01, 3.0, 8.0
    light = q.PointLight((0, height, -before), 5.0)
    medium = q.Medium(0.0, 1e-9)
    V = q.point_light_in_scattering(rays_along((0, 0, -1), depth), medium, light)
    angle = np.arctan(before / height) + np.arctan((depth - before) / height)
    # 2e-8: the fog's own attenuation, kappa times a path of at most 13 m
    np.testing.assert_allclose(V[0], 1e-9 * CLEAR_PHASE * 5.0 * angle / height, rtol=2e-8)


@pytest.mark.parametrize("radius", [1e-3, 0.3])
def test_bulb_on_the_ray_in_thin_fog(radius):
    """A bulb of radius r seen head on: the integral of 1/(s^2 + r^2)."""
    light = q.PointLight((0, 0, -3), 1.0, radius)
    V = q.point_light_in_scattering(rays_along((0, 0, -1), 8.0), q.Medium(0.0, 1e-9), light)
    expected = 1e-9 * CLEAR_PHASE * (np.arctan(3 / radius) + np.arctan(5 / radius)) / radius
    np.testing.assert_allclose(V[0], expected, rtol=2e-8)  # as above


def test_dense_fog_leaves_the_light_at_the_eye():
    """kappa -> infinity: V -> delta p E(eye) / (kappa (1 - cos)), both paths growing by 1 - cos a metre."""
    kappa, height = 5e4, 0.01
    rays = rays_along([(0, 0, -1), (0, -1, 0), (1, -0.5, 0)], np.inf)
    medium = q.Medium(0.25 * kappa, 0.75 * kappa)
    V = q.point_light_in_scattering(rays, medium, q.PointLight((0, height, 0), 1.0))
    growth = 1 - rays.directions[:, 1]
    at_eye = np.exp(-kappa * height) / height**2
    # the next term of the expansion is a few times 1/(kappa height) = 1/500
    np.testing.assert_allclose(V[:, 0], 0.75 * CLEAR_PHASE * at_eye / growth, rtol=0.01)


def test_once_scattered_fluence_has_its_bipolar_form():
    """V of an isotropic fog summed over all directions at an eye h away from a lamp.

    It is delta I / (4 pi) times the integral over space of exp(-kappa (a + b)) / (a b)^2, with a and b the
    distances to eye and lamp. In bipolar coordinates, with u = a + b and a - b integrated in closed form:
    2 pi / h times the integral over u > h of 2 exp(-kappa u) ln((u + h)/(u - h)) / u.
    """
    h, absorption, scattering = 1.3, 0.1, 0.4
    x, weight = np.polynomial.legendre.leggauss(100)
    theta = np.pi * (x + 1) / 2
    directions = np.stack([np.sin(theta), np.cos(theta), 0 * theta], 1)
    V = q.point_light_in_scattering(rays_along(directions, np.inf), q.Medium(absorption, scattering),
                                    q.PointLight((0, h, 0), 1.0), tolerance=1e-8)
    fluence = 2 * np.pi * (weight * np.pi / 2 * np.sin(theta) * V[:, 0]).sum()
    y = -24 + 15 * (x + 1)  # u = h (1 + e^y) resolves the logarithm at u = h
    u = h * (1 + np.exp(y))
    integrand = 2 * np.exp(-(absorption + scattering) * u) * np.log((u + h) / (u - h)) / u * (u - h)
    expected = scattering * CLEAR_PHASE * 2 * np.pi / h * (weight * 15 * integrand).sum()
    assert fluence == pytest.approx(expected, rel=1e-6)  # 100 nodes: V's cusp towards the lamp


def test_spot_with_a_uniform_cone_is_a_point():
    rays = rays_along(some_directions(50), 4.0)
    point = q.PointLight((0.3, 0.5, -1.0), (1.0, 2.0, 3.0), 0.02)
    spot = q.SpotLight((0.3, 0.5, -1.0), (1.0, 2.0, 3.0), 0.02, axis=(1, 2, 3), cone_breaks=(0.3,))
    np.testing.assert_allclose(q.spot_light_in_scattering(rays, FOG, spot),
                               q.point_light_in_scattering(rays, FOG, point), rtol=1e-6)


def test_narrow_hard_cone_is_the_piece_of_the_ray_inside_it():
    """Two tenths of a degree, crossing the ray at a right angle 3 m ahead, 2 m below the lamp."""
    half = np.radians(0.1)
    spot = q.SpotLight((0, 2.0, -3), 1.0, axis=(0, -1, 0), cone=lambda c: (c >= np.cos(half)) * 1.0,
                       cone_breaks=(np.cos(half),))
    V = q.spot_light_in_scattering(rays_along((0, 0, -1), 100.0), q.Medium(0.0, 1e-9), spot)
    # angle 2 half / h by the arctangent form; 1e-7: thin fog, and cos(half) holds half to 1e-16/half^2
    np.testing.assert_allclose(V[0], 1e-9 * CLEAR_PHASE * 2 * half / 2.0, rtol=1e-7)


def test_two_half_spaces_of_a_spot_sum_to_the_point():
    rays = rays_along(some_directions(60), 4.0)
    position, axis = (0.3, 0.5, -1.0), (0.2, -1, 0.4)
    halves = [q.SpotLight(position, 1.0, axis=axis, cone=cone, cone_breaks=(0.0,))
              for cone in (lambda c: (c >= 0) * 1.0, lambda c: (c < 0) * 1.0)]
    total = sum(q.spot_light_in_scattering(rays, FOG, half) for half in halves)
    whole = q.point_light_in_scattering(rays, FOG, q.PointLight(position, 1.0))
    np.testing.assert_allclose(total, whole, rtol=1e-6)


def test_scaling_lengths_leaves_the_in_scattering():
    """Lengths times s, coefficients over s, intensity (an area in it) times s^2."""
    directions, s = some_directions(20), 1e3
    small = q.point_light_in_scattering(rays_along(directions, 4.0), FOG,
                                        q.PointLight((0.3, 0.5, -1), 1.0, 0.05))
    fog = q.Medium(np.array([0.03, 0.05, 0.08]) / s, np.array([0.07, 0.06, 0.05]) / s, FOG.phase_function)
    large = q.point_light_in_scattering(rays_along(directions, 4.0 * s), fog,
                                        q.PointLight((0.3 * s, 0.5 * s, -s), s * s, 0.05 * s))
    np.testing.assert_allclose(large, small, rtol=1e-9)  # the same nodes up to rounding


@pytest.mark.parametrize("kappa", [0.0, 1e-12, 1.0, 1e4])
@pytest.mark.parametrize("asymmetry", [0.999, -0.999])
def test_extremes_are_finite_and_not_negative(kappa, asymmetry):
    medium = q.Medium(0.0, kappa, q.henyey_greenstein(asymmetry))
    rays = rays_along(some_directions(20), np.linspace(0, 5, 20))
    for light in (q.PointLight((0.3, 0.5, -1), 1.0), q.PointLight((0, 0, 0), 1.0, 0.01)):
        V = q.point_light_in_scattering(rays, medium, light, [square((0, 0.2, 0), (1, 0, 0), (0, 0, 1))])
        assert np.isfinite(V).all() and (V >= 0).all()
        assert (V[0] == 0).all()  # depth 0
        assert kappa > 0 or (V == 0).all()


# --- shadows -----------------------------------------------------------------------------------

ROOM = q.cornell_room()


def visible_by_segments(light, points, polygons):
    """True (n,): separate triangle-by-triangle segment test, Moeller-Trumbore style."""
    seen = np.ones(len(points), bool)
    segment = points - light
    for p in polygons:
        for b, c in zip(p[1:-1], p[2:]):
            e1, e2 = b - p[0], c - p[0]
            cross = np.cross(segment, e2)
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = 1 / (cross @ e1)
                offset = light - p[0]
                u = (cross @ offset) * inverse
                other = np.cross(offset, e1)
                v = (segment @ other) * inverse
                t = (e2 @ other) * inverse
                seen &= ~((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9) & (t < 1 - 1e-9))
    return seen


def test_exact_shadows_agree_with_marching():
    rays, steps = ROOM.rays(8, 8), 20000
    light = q.PointLight((0.1, 1.5, 0.35), (1.0, 0.9, 0.8))
    V = q.point_light_in_scattering(rays, FOG, light, ROOM.polygons)
    partly = 0
    for i in range(len(rays.depth)):
        t = (np.arange(steps) + 0.5) / steps * rays.depth[i]
        points = rays.origin + t[:, None] * rays.directions[i]
        offset = points - light.position
        d = np.linalg.norm(offset, axis=1)
        seen = visible_by_segments(np.asarray(light.position), points, ROOM.polygons)
        partly += 0.01 < seen.mean() < 0.99
        phase = FOG.phase_function(-(offset @ rays.directions[i]) / d)
        f = (seen * phase / d**2)[:, None] * np.exp(-FOG.extinction * (t + d)[:, None])
        marched = FOG.scattering * light.intensity * f.sum(0) * rays.depth[i] / steps
        # each shadow edge may be off by half a step: up to 1e-4 of V for each of a few edges
        np.testing.assert_allclose(V[i], marched, rtol=3e-4)
    assert partly >= 5  # else the test would say nothing about shadows


def test_an_occluder_round_everything_leaves_nothing():
    x, y, z = np.eye(3)
    box = [square(side * a, b, c) for a, b, c in ((x, y, z), (y, z, x), (z, x, y)) for side in (1, -1)]
    rays = rays_along(some_directions(40), 30.0, origin=(0, 0, 5.0))
    outside = rays.directions[:, 2] > -0.5  # these never come near the box
    for light in (q.PointLight((0.2, 0.1, 0.3), 1.0),
                  q.RectangleLight((0, 0, 0), (0.2, 0, 0), (0, 0.2, 0), 1.0)):
        V, free = (q.in_scattering(rays, FOG, light, occluders)[outside] for occluders in (box, ()))
        # where two shadows meet exactly, rounding leaves slivers of some 1e-15 m
        assert (V <= 1e-12 * free).all() and (free > 0).any(0).all()
        assert (q.direct_irradiance(light, rays.points()[outside], rays.normals[outside], box) == 0).all()


def test_an_occluder_in_the_lights_own_plane_or_behind_it_throws_no_shadow():
    rays = rays_along(some_directions(40), 0.9)
    light = q.PointLight((0, 1.0, 0), 1.0)
    walls = [square((0, 1.0, 0), (5, 0, 0), (0, 0, 5)), square((0, 1.5, 0), (5, 0, 0), (0, 0, 5))]
    np.testing.assert_array_equal(q.point_light_in_scattering(rays, FOG, light, walls),
                                  q.point_light_in_scattering(rays, FOG, light))


def test_bad_polygons_are_refused():
    for polygon, message in ((np.zeros((3, 3)), "without area"),
                             ([(0, 0, 0), (1, 0, 0), (1, 1, 0.2), (0, 1, 0)], "not planar"),
                             ([(0, 0, 0), (4, 0, 0), (1, 1, 0), (0, 4, 0)], "not convex")):
        with pytest.raises(ValueError, match=message):
            q.point_light_in_scattering(rays_along((0, 0, -1), 1.0), FOG, q.PointLight((0, 1, 0), 1.0),
                                        [polygon])


# --- rectangle lights --------------------------------------------------------------------------


def test_rectangle_converges_under_refinement():
    rays = ROOM.rays(12, 12)
    default = q.rectangle_light_in_scattering(rays, FOG, ROOM.lamp, ROOM.polygons)
    finer = q.rectangle_light_in_scattering(rays, FOG, ROOM.lamp, ROOM.polygons, tolerance=1e-5, nodes=4,
                                            base=(2, 2))
    error = np.abs(default / finer - 1)
    assert np.median(error) < 1e-5
    assert np.percentile(error, 95) < 1e-4  # what the reference promises
    assert error.max() < 2e-3  # single rays that graze the lamp or a shadow's edge


def test_node_doubling_without_refinement():
    rays = ROOM.rays(12, 12)
    coarse, fine = (q.rectangle_light_in_scattering(rays, FOG, ROOM.lamp, tolerance=1e-3, nodes=nodes,
                                                    max_level=1) for nodes in (3, 6))
    assert np.median(np.abs(coarse / fine - 1)) < 1e-4


def test_rectangle_agrees_with_monte_carlo():
    """Independent estimator: uniform points on lamp and ray, visibility by segment test, 4 sigma."""
    rays, rng, samples = ROOM.rays(4, 4), np.random.default_rng(11), 20000
    lamp = ROOM.lamp
    V = q.rectangle_light_in_scattering(rays, FOG, lamp, ROOM.polygons)
    for i in range(len(rays.depth)):
        u, v, t = rng.random((3, samples))
        light = np.asarray(lamp.corner) + u[:, None] * lamp.edge_a + v[:, None] * lamp.edge_b
        t = t * rays.depth[i]
        points = rays.origin + t[:, None] * rays.directions[i]
        offset = points - light
        d = np.linalg.norm(offset, axis=1)
        seen = visible_by_pairs(light, points, ROOM.polygons)
        cosine = np.maximum(-offset[:, 1] / d, 0)
        phase = FOG.phase_function(-(offset @ rays.directions[i]) / d)
        f = seen * cosine * phase / d**2 * np.exp(-FOG.extinction[1] * (t + d)) * rays.depth[i]
        f = f * FOG.scattering[1] * lamp.radiance[1] * np.linalg.norm(lamp.area_vector)
        assert V[i, 1] == pytest.approx(f.mean(), abs=4 * f.std() / np.sqrt(samples))
        assert f.std() / np.sqrt(samples) < 0.1 * V[i, 1]  # else 4 sigma would prove nothing


def visible_by_pairs(lights, points, polygons):
    seen = np.ones(len(points), bool)
    for p in polygons:
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        above, below = (lights - p[0]) @ normal, (points - p[0]) @ normal
        crossing = above * below < -1e-18
        with np.errstate(divide="ignore", invalid="ignore"):
            at = lights + (above / (above - below))[:, None] * (points - lights)
        turn = np.stack([np.cross(b - a, at - a) @ normal for a, b in zip(p, np.roll(p, -1, 0))])
        seen &= ~(crossing & (turn > 0).all(0))
    return seen


def test_small_rectangle_is_a_point_with_a_cosine():
    rays, size = rays_along(some_directions(40), 3.0), 1e-3
    lamp = q.RectangleLight((0.2, 1.2, -0.7), (size, 0, 0), (0, 0, size), 1.0)
    spot = q.SpotLight(lamp.midpoint, size * size, axis=(0, -1, 0), cone=lambda c: np.maximum(c, 0),
                       cone_breaks=(0.0,))
    # second order in size over distance: 1e-6 at 1 m, more for rays near the lamp
    np.testing.assert_allclose(q.rectangle_light_in_scattering(rays, FOG, lamp),
                               q.spot_light_in_scattering(rays, FOG, spot), rtol=1e-4)


def test_lamp_is_the_sum_of_its_halves_and_mirror_images_agree():
    rays = ROOM.rays(8, 8)
    lamp = ROOM.lamp
    halves = [q.RectangleLight((x, 1.98, -0.2), (0.25, 0, 0), (0, 0, 0.4), lamp.radiance)
              for x in (-0.25, 0.0)]
    whole = q.rectangle_light_in_scattering(rays, FOG, lamp, ROOM.polygons)
    parts = [q.rectangle_light_in_scattering(rays, FOG, half, ROOM.polygons) for half in halves]
    assert np.median(np.abs(sum(parts) / whole - 1)) < 1e-5  # the reference's own median error
    np.testing.assert_allclose(sum(parts), whole, rtol=2e-3)  # its worst ray
    mirror = np.array([-1.0, 1, 1])
    flipped = q.Rays(rays.origin * mirror, rays.directions * mirror, rays.depth,
                     rays.normals * mirror, rays.emitter)
    other = q.rectangle_light_in_scattering(flipped, FOG, halves[1], [p * mirror for p in ROOM.polygons])
    # refinement decisions may fall differently by rounding
    np.testing.assert_allclose(other, parts[0], rtol=2e-3)
    assert np.median(np.abs(other / parts[0] - 1)) < 1e-6


def test_rectangle_shines_from_one_side_only():
    lamp = q.RectangleLight((-1, 0, -1), (2, 0, 0), (0, 0, 2), 1.0)  # faces down
    rays = rays_along([(1, 0, 0), (1, 0, -1)], 3.0, origin=(0, 0.5, 0))
    assert (q.rectangle_light_in_scattering(rays, FOG, lamp) == 0).all()
    below = rays_along([(1, 0, 0), (1, 0, -1)], 3.0, origin=(0, -0.5, 0))
    assert (q.rectangle_light_in_scattering(below, FOG, lamp) > 0).all()


# --- sun ---------------------------------------------------------------------------------------

WINDOW = square((0, 1.5, -1), (0.4, 0, 0), (0, 0.3, 0))


def test_sun_prism_is_the_exponential_integral():
    """Sun straight through a window in z = -1 along +z; eye rays across the prism."""
    sun = q.SunWindow((5.0, 4.0, 3.0), (0, 0, 1), WINDOW)
    rays = rays_along([(1, 0, 0.3), (1, 0, -0.3), (1, 0, 0)], 10.0, origin=(-2, 1.5, 0.5))
    V = q.sun_window_in_scattering(rays, FOG, sun)
    for i, w in enumerate(rays.directions):
        a, b = 1.6 / w[0], 2.4 / w[0]  # where x = -0.4, 0.4
        k = FOG.extinction
        rate = k * (1 + w[2])
        start = np.exp(-k * (a + 1.5 + a * w[2]))
        source = FOG.scattering * sun.irradiance * FOG.phase_function(-w[2])
        expected = source * start * -np.expm1(-rate * (b - a)) / rate
        np.testing.assert_allclose(V[i], expected, rtol=1e-10)  # a smooth integrand: rounding only


def test_sun_shaft_as_polyhedron_and_oblique_prism_agree():
    direction = np.array([0.2, -0.6, 1.0]) / np.linalg.norm([0.2, -0.6, 1.0])
    sun = q.SunWindow(1.0, direction, WINDOW)
    a, b = WINDOW[0], WINDOW[2]  # opposite corners: the four side planes by hand
    planes = []
    for normal, corner in ((np.cross((0, 1, 0), direction), b), (-np.cross((0, 1, 0), direction), a),
                           (-np.cross((1, 0, 0), direction), b), (np.cross((1, 0, 0), direction), a)):
        planes.append(np.append(normal, normal @ corner))
    planes.append(np.array([0, 0, -1, 1.0]))  # z >= -1
    rays = rays_along(some_directions(200), 6.0, origin=(0.1, 0.9, 0.2))
    prism = q.sun_window_in_scattering(rays, FOG, sun)
    shaft = q.sun_window_in_scattering(rays, FOG, q.SunWindow(1.0, direction, WINDOW, np.array(planes)))
    assert (prism > 0).any(1).sum() > 20
    np.testing.assert_allclose(shaft, prism, rtol=1e-9, atol=1e-15)  # the same planes up to rounding


def test_sun_shadow_agrees_with_marching_and_ignores_the_wall_round_the_window():
    direction = np.array([0.3, -0.5, 1.0]) / np.linalg.norm([0.3, -0.5, 1.0])
    sun = q.SunWindow(1.0, direction, WINDOW)
    wall = square((0, 1, -1), (3, 0, 0), (0, 3, 0))  # holds the window, which a polygon cannot show
    table = square((0.2, 1.0, -0.2), (0.3, 0, 0), (0, 0.1, 0.2))
    rays = rays_along(some_directions(60), 4.0, origin=(0.5, 0.8, 0.4))
    V = q.sun_window_in_scattering(rays, FOG, sun, [wall, table])
    free = q.sun_window_in_scattering(rays, FOG, sun)
    assert ((V[:, 0] < 0.98 * free[:, 0]) & (V[:, 0] > 0)).sum() >= 3
    steps = 8000
    for i in np.nonzero(free[:, 0] > 0)[0][:25]:
        t = (np.arange(steps) + 0.5) / steps * 4.0
        points = rays.origin + t[:, None] * rays.directions[i]
        back = (points[:, 2] + 1) / direction[2]
        entered = points - back[:, None] * direction
        lit = (back >= 0) & (np.abs(entered[:, 0]) < 0.4) & (np.abs(entered[:, 1] - 1.5) < 0.3)
        lit &= visible_by_pairs(entered, points, [table])
        f = lit[:, None] * np.exp(-FOG.extinction * (t + back)[:, None])
        step = FOG.scattering * FOG.phase_function(-rays.directions[i] @ direction) * 4.0 / steps
        marched = step * f.sum(0)
        np.testing.assert_allclose(V[i], marched, rtol=1e-6, atol=2 * step.max())  # half a step at four edges


def test_only_what_stands_behind_the_window_shadows_the_sun():
    sun = q.SunWindow(1.0, (0, 0, 1), WINDOW)
    rays = rays_along([(1, 0, 0.3), (1, 0, -0.3)], 10.0, origin=(-2, 1.5, 0.5))
    free = q.sun_window_in_scattering(rays, FOG, sun)
    outside = square((0, 1.5, -2), (5, 0, 0), (0, 5, 0))
    np.testing.assert_array_equal(q.sun_window_in_scattering(rays, FOG, sun, [outside]), free)
    # a board leaning through the window's plane, z = -1, shadows like its part inside (z > -1)
    board = np.array([(-0.1, 1, -1.5), (0.1, 1, -1.5), (0.1, 2.0, -0.5), (-0.1, 2.0, -0.5)])
    inner = np.array([(-0.1, 1.5, -1), (0.1, 1.5, -1), (0.1, 2.0, -0.5), (-0.1, 2.0, -0.5)])
    low = rays_along([(1, 0.05, 0.3)], 10.0, origin=(-2, 1.5, 0.5))
    through, part = (q.sun_window_in_scattering(low, FOG, sun, [p]) for p in (board, inner))
    np.testing.assert_allclose(through, part, rtol=1e-12)
    assert (part < 0.8 * q.sun_window_in_scattering(low, FOG, sun)).all()  # a quarter of its width is dark


def test_sun_irradiance_inside_and_outside_the_patch():
    direction = np.array([0, -1.0, 1.0]) / np.sqrt(2)
    sun = q.SunWindow((3.0, 2.0, 1.0), direction, WINDOW)
    points = np.array([(0.0, 0, 0.5), (0.0, 0, 0.9), (0.5, 0, 0.5)])  # the patch: |x| < .4, .2 < z < .8
    up = np.tile((0.0, 1, 0), (3, 1))
    E = q.direct_irradiance(sun, points, up, medium=FOG)
    path = 1.5 * np.sqrt(2)
    expected = np.array([3, 2, 1]) / np.sqrt(2) * np.exp(-FOG.extinction * path)
    np.testing.assert_allclose(E[0], expected, rtol=1e-12)
    assert (E[1:] == 0).all()
    table = square((0, 0.5, 0), (0.2, 0, 0), (0, 0, 0.3))
    assert (q.direct_irradiance(sun, points, up, [table]) == 0).all()


def test_sun_in_the_windows_plane_gives_nothing():
    sun = q.SunWindow(1.0, (1, 0, 0), WINDOW)
    assert (q.sun_window_in_scattering(rays_along((0, 0.5, -1), 3.0), FOG, sun) == 0).all()


# --- irradiance and transmittance --------------------------------------------------------------


def test_irradiance_under_a_rectangle_is_lamberts_formula():
    """Clear air, no occluder: E = L/2 sum over edges of the angle times the normal of its plane."""
    lamp, rng = ROOM.lamp, np.random.default_rng(5)
    points = rng.uniform((-1, 0, -1), (1, 1.5, 1), (30, 3))
    normals = np.tile((0.0, 1.0, 0.0), (30, 1))  # the whole lamp lies above their planes
    a, b, c = (np.asarray(v, float) for v in (lamp.corner, lamp.edge_a, lamp.edge_b))
    corners = np.array([a, a + b, a + b + c, a + c])
    E = q.direct_irradiance(lamp, points, normals)
    for point, normal, value in zip(points, normals, E):
        r = (corners - point) / np.linalg.norm(corners - point, axis=1, keepdims=True)
        following = np.roll(r, -1, 0)
        across = np.cross(r, following)
        angle = np.arctan2(np.linalg.norm(across, axis=1), (r * following).sum(1))
        vector = (angle[:, None] * across / np.linalg.norm(across, axis=1, keepdims=True)).sum(0)
        np.testing.assert_allclose(value, 0.5 * abs(vector @ normal) * np.array(lamp.radiance), rtol=1e-6)


def test_lamp_over_the_whole_sky_gives_pi():
    lamp = q.RectangleLight((-1e3, 1, -1e3), (2e3, 0, 0), (0, 0, 2e3), 2.0)
    E = q.direct_irradiance(lamp, np.zeros((1, 3)), np.array([[0.0, 1, 0]]))
    np.testing.assert_allclose(E, 2 * np.pi, rtol=3e-6)  # what is missing: h^2/R^2 = 1e-6


def test_penumbra_irradiance_is_the_visible_part():
    """An edge that hides half the lamp from the point below it."""
    lamp = q.RectangleLight((-0.5, 2, -0.5), (1, 0, 0), (0, 0, 1), 1.0)
    half = q.RectangleLight((0, 2, -0.5), (0.5, 0, 0), (0, 0, 1), 1.0)
    edge = square((-5, 1, 0), (5, 0, 0), (0, 0, 5))  # covers x < 0
    point, up = np.zeros((1, 3)), np.array([[0.0, 1, 0]])
    fog = q.Medium(0.1, 0.2)
    for medium in (None, fog):
        np.testing.assert_allclose(q.direct_irradiance(lamp, point, up, [edge], medium),
                                   q.direct_irradiance(half, point, up, (), medium), rtol=1e-5)


@pytest.mark.parametrize("light", [
    q.PointLight((0, 2.0, 0), 4.0), q.SpotLight((0, 2.0, 0), 4.0, axis=(0, -1, 0)),
    q.SunWindow(1.0, (0, -1, 0), square((0, 2, 0), (1, 0, 0), (0, 0, 1)))])
def test_only_what_stands_between_light_and_surface_shadows_it(light):
    point, up = np.zeros((1, 3)), np.array([[0.0, 1, 0]])

    def board(height):
        return square((0.02, height, 0.03), (0.1, 0, 0), (0, 0, 0.1))

    for height in (0.0, -0.5, 2.0, 2.5):  # the surface itself, below it, in the light, behind the light
        np.testing.assert_allclose(q.direct_irradiance(light, point, up, [board(height)]), 1.0, rtol=1e-12)
    assert (q.direct_irradiance(light, point, up, [board(2.5), board(1.0)]) == 0).all()
    assert (q.direct_irradiance(light, point, -up) == 0).all()


def test_transmittance_of_a_point_light_is_both_paths():
    rays = rays_along((0, -1, -1), np.sqrt(2), origin=(0, 1, 1), normals=(0, 1, 0))  # ends at the origin
    light = q.PointLight((0, 3.0, 0), (1.0, 2.0, 3.0))
    expected = np.exp(-FOG.extinction * (np.sqrt(2) + 3))
    for variant in ("area", "midpoint"):
        T = q.transmittance(rays, FOG, [light], variant=variant)
        np.testing.assert_allclose(T[0], expected, rtol=1e-12)


def test_lights_are_weighted_by_their_share():
    rays = rays_along((0, -1, -1), np.sqrt(2), origin=(0, 1, 1), normals=(0, 1, 0))
    near, far = q.PointLight((0, 1.0, 0), 1.0), q.PointLight((0, 4.0, 0), 48.0)  # E = 1 and 3
    sun = q.SunWindow(4.0, (0, -1, 0), square((0, 2, 0), (1, 0, 0), (0, 0, 1)))  # E = 4
    T = q.transmittance(rays, FOG, [near, far, sun])
    k = FOG.extinction
    expected = np.exp(-k * np.sqrt(2)) * (np.exp(-k) + 3 * np.exp(-4 * k) + 4 * np.exp(-2 * k)) / 8
    np.testing.assert_allclose(T[0], expected, rtol=1e-12)


def test_midpoint_of_the_lamp_is_nearly_its_area_in_the_room():
    """Zhao et al. 2013, section 6.1: the midpoint suffices for T."""
    rays = ROOM.rays(12, 12)
    area, midpoint = (q.transmittance(rays, FOG, [ROOM.lamp], ROOM.polygons, v) for v in ("area", "midpoint"))
    lit = ~np.isnan(area)
    assert (lit == ~np.isnan(midpoint)).all() and 0.5 < lit.mean() < 1
    assert (area[lit] > 0).all() and (area[lit] < 1).all()
    assert 1e-9 < np.mean((area[lit] - midpoint[lit]) ** 2) < 1e-5  # measured 3e-6 at most, and not equal
    seen = rays.emitter
    assert seen.any()
    np.testing.assert_allclose(area[seen], np.exp(-FOG.extinction * rays.depth[seen, None]), rtol=1e-12)


def test_no_fog_is_transparent_and_dark():
    rays = ROOM.rays(6, 6)
    none = q.Medium(0.0, 0.0)
    T = q.transmittance(rays, none, [ROOM.lamp], ROOM.polygons)
    assert (q.rectangle_light_in_scattering(rays, none, ROOM.lamp, ROOM.polygons) == 0).all()
    np.testing.assert_allclose(T[~np.isnan(T)], 1, rtol=1e-12)
    missing = rays_along((0, 0, 1), np.inf, origin=(0, 1, 3))
    assert (q.transmittance(missing, none, [ROOM.lamp]) == 1).all()
    assert (q.transmittance(missing, FOG, [ROOM.lamp]) == 0).all()


def test_unknown_variant_is_refused():
    with pytest.raises(ValueError, match="'area' or 'midpoint', not 'mean'"):
        q.transmittance(ROOM.rays(2, 2), FOG, [ROOM.lamp], variant="mean")


# --- the room ----------------------------------------------------------------------------------


def test_room_closes_the_view_and_normals_face_the_camera():
    rays = ROOM.rays(32, 32)
    assert np.isfinite(rays.depth).all()
    assert ((rays.normals * rays.directions).sum(1) < 0).all()
    points = rays.points()
    assert (np.abs(points[:, 0]) < 1 + 1e-9).all() and (points[:, 2] > -1 - 1e-9).all()
    assert len(ROOM.polygons) == len(ROOM.albedos) == 16
    assert ROOM.lamp.normal == pytest.approx([0, -1, 0])
    seen = points[rays.emitter]
    assert len(seen) and np.abs(seen[:, 1] - 1.98).max() < 1e-9
    # the tall block's nearest top corner, by hand: (+-.3, .3) turned by 18 degrees
    corner = max((tuple(c) for c in ROOM.polygons[5]), key=lambda c: c[2])
    angle = np.radians(18)
    assert corner == pytest.approx((-0.33 - 0.3 * np.cos(angle) + 0.3 * np.sin(angle), 1.2,
                                    -0.28 + 0.3 * np.sin(angle) + 0.3 * np.cos(angle)))


def test_rays_start_at_the_top_left():
    directions = q.camera_directions((0, 1, 4), (0, 1, 0), 60.0, 3, 3).reshape(3, 3, 3)
    assert directions[0, 0, 0] < 0 < directions[0, 0, 1]
    assert directions[1, 1] == pytest.approx([0, 0, -1])
    wide = q.camera_directions((0, 1, 4), (0, 1, 0), 60.0, 1001, 1)
    assert np.degrees(np.arccos(wide[0] @ wide[-1])) == pytest.approx(60, abs=0.1)  # centres, not edges
