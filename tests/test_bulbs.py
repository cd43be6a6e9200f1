"""Glow of bulbs and spots against adaptive quadrature of the airlight integral, which shares nothing with it.

Lamps in view, beside, behind the camera, on a surface, touching the eye and far outside; in even fog, fog that thins
out and layers. Many lamps over a photograph against the sum of single ones.
"""

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.physics import bulbs
from pipeline.plugins.registry import registry
from pipeline.plugins.media.noise import Noise

EYE, RADIUS = np.array([0.0, 1.5, 0.0]), 0.1
#: What each fog is; its relative density by height; the integral of that from 0 up to a height; where it bends.
FOGS = {
    "homogeneous": ({"type": "homogeneous"}, lambda y: 1.0, lambda y: y, ()),
    "height": ({"type": "height", "base": 1.0, "scale_height": 4.0}, lambda y: min(1.0, np.exp(-(y - 1) / 4)),
               lambda y: y if y < 1 else 1 + 4 * (1 - np.exp(-(y - 1) / 4)), (1.0,)),
    "height with a top": ({"type": "height", "scale_height": 8.0, "top_height": 12.0},
                          lambda y: min(1.0, np.exp(-y / 8)) * (y < 12),
                          lambda y: y if y < 0 else 8 * (1 - np.exp(-min(y, 12) / 8)), (0.0, 12.0)),
    "layers": ({"type": "layers", "layers": [{"lower": -2.0, "upper": 2.0}, {"lower": 5.0, "upper": 6.0, "density": 3.0}]},
               lambda y: 1.0 * (-2 <= y < 2) + 3.0 * (5 <= y < 6),
               lambda y: min(max(y, -2), 2) + 3 * (min(max(y, 5), 6) - 5), (-2.0, 2.0, 5.0, 6.0)),
}
#: Lamps by how they lie to the rays below.
PLACES = {"in view": [0.4, 3.0, -12.0], "close to the ray": [0.0, 1.52, -9.0], "beside": [8.0, 4.0, -6.0],
          "behind the camera": [0.5, 2.5, 4.0], "touching the eye": [0.05, 1.5, 0.02], "on the ground": [1.0, 0.05, -15.0],
          "far outside": [150.0, 30.0, -40.0], "far ahead": [-3.0, 5.5, -180.0]}
DIRECTIONS = np.array([[0.0, 0.0, -1.0], [0.03, 0.12, -1.0], [0.05, -0.1, -1.0], [-0.4, 0.5, -0.7], [0.0, 1.0, 0.0]])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
DEPTHS = (2.0, 12.0, 14.9, 400.0)


def henyey_greenstein(g, cosine):
    return (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * (1 - cosine)) ** 1.5)


def fog(name, extinction, g=0.0, albedo=0.9):
    extinction = np.broadcast_to(np.asarray(extinction, float), 3)
    return registry("media")[FOGS[name][0]["type"]].model_validate({
        **FOGS[name][0], "absorption_coefficient": ((1 - albedo) * extinction).tolist(),
        "scattering_coefficient": (albedo * extinction).tolist(),
        "phase_function": {"type": "henyey_greenstein", "asymmetry": g}})


def airlight(name, extinction, g, direction, depth, lamp, cone=None, cone_at=()):
    """V at unit intensity and albedo 0.9, by scipy's adaptive quadrature between all places where it may turn."""
    _, density, column, bends = FOGS[name]
    lamp = np.asarray(lamp, float)

    def path(a, b, length):
        return length * (density(a) if abs(b - a) < 1e-7 * max(length, 1e-9) else (column(b) - column(a)) / (b - a))

    def integrand(t):
        point = EYE + t * direction
        way = point - lamp
        distance = max(np.sqrt(way @ way), 1e-12)
        value = density(point[1]) * henyey_greenstein(g, -(way @ direction) / distance) / (distance**2 + RADIUS**2)
        if cone is not None:
            value *= cone(way / distance)
        return value * np.exp(-extinction * (path(EYE[1], point[1], t) + path(lamp[1], point[1], distance)))

    foot = (lamp - EYE) @ direction
    width = np.sqrt(max((lamp - EYE) @ (lamp - EYE) - foot**2, 0) + RADIUS**2)
    turns = [foot + side * k * width for k in (0, 1, 5, 25, 125) for side in (-1, 1)]
    turns += [(y - EYE[1]) / direction[1] for y in bends if direction[1]] + [depth / 2, depth / 8, *cone_at]
    borders = np.unique([0.0, *(t for t in turns if 0 < t < depth), depth])
    return 0.9 * extinction * sum(quad(integrand, a, b, epsabs=0, epsrel=1e-7, limit=200)[0]
                                  for a, b in zip(borders[:-1], borders[1:]))


def along_rays():
    directions = np.repeat(DIRECTIONS, len(DEPTHS), 0)
    depth = np.tile(DEPTHS, len(DIRECTIONS))
    ground = np.where(directions[:, 1] < 0, -EYE[1] / np.minimum(directions[:, 1], -1e-9), np.inf)
    return directions, np.minimum(depth, ground)


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")  # 1e-7 is asked for and may be just missed
@pytest.mark.parametrize("g", [-0.9, 0.0, 0.7, 0.9])
@pytest.mark.parametrize("name", FOGS)
def test_bulb(name, g):
    """Ten nodes a piece of a ray: 1e-4 for all but one ray in a hundred, half a per cent where light turns right back."""
    directions, depth = along_rays()
    errors = []
    for extinction, places in ((0.04, PLACES), (0.002, ("in view", "behind the camera")), (1.0, ("beside", "touching the eye"))):
        for place in places:
            found = bulbs.bulb(fog(name, extinction, g), EYE, directions, depth, PLACES[place], RADIUS)[:, 0]
            truth = np.array([airlight(name, extinction, g, d, far, PLACES[place]) for d, far in zip(directions, depth)])
            errors.append(np.abs(found - truth) / np.maximum(truth, 1e-4 * truth.max()))
    errors = np.concatenate(errors)
    assert np.median(errors) < 1e-5 and np.percentile(errors, 99) < 1e-3 and errors.max() < 1e-2


CONES = {"ahead of itself at the eye": ([0, 0.2, 1], 7.0, 30.0), "away from the eye": ([0, 0, -1], 7.0, 30.0),
         "across": ([-1, -0.2, -0.3], 15.0, 35.0), "down": ([0, -1, 0], 40.0, 70.0),
         "a narrow beam across": ([-1, -0.2, 0.05], 0.0, 8.0), "nearly all of a half": ([-0.3, 0.2, 1], 60.0, 89.0)}


@pytest.mark.filterwarnings("ignore::scipy.integrate.IntegrationWarning")
@pytest.mark.parametrize("name", ["homogeneous", "height"])
@pytest.mark.parametrize("way", CONES)
def test_spot(way, name):
    """A cone's inner border is a bend within a piece: half a per cent."""
    axis, inner, outer = CONES[way]
    axis = np.array(axis, float) / np.linalg.norm(axis)
    inner, outer = np.cos(np.radians([inner, outer]))

    def cone(direction):
        x = np.clip((direction @ axis - outer) / (inner - outer), 0, 1)
        return x * x * (3 - 2 * x)

    directions, depth = along_rays()
    lit = 0
    for place in ("in view", "close to the ray", "beside", "behind the camera"):
        lamp = np.array(PLACES[place])
        found = bulbs.bulb(fog(name, 0.04, 0.5), EYE, directions, depth, lamp, RADIUS, bulbs.Cone(axis, inner, outer))[:, 0]
        truth = []
        for d, far in zip(directions, depth):
            # fine midpoints find where the ray crosses the borders of the cone
            t = np.linspace(0, far, 20001)
            offset = EYE + t[:, None] * d - lamp
            cosine = offset @ axis / np.linalg.norm(offset, axis=1)
            crossed = [t[np.nonzero(np.diff(cosine > border))[0]] for border in (inner, outer)]
            truth.append(airlight(name, 0.04, 0.5, d, far, lamp, cone, np.concatenate(crossed)))
        truth = np.array(truth)
        lit += (truth > 0).sum()
        error = np.abs(found - truth) / np.maximum(truth, 1e-4 * max(truth.max(), 1e-12))
        assert np.median(error) < 2e-3 and error.max() < 1e-2, (place, error.max())
    assert lit >= 4, "some rays meet the beam"


def test_channels_are_fogs_of_their_own():
    directions, depth = along_rays()
    spectral = fog("height", [0.01, 0.05, 0.3], 0.6)
    together = bulbs.bulb(spectral, EYE, directions, depth, PLACES["in view"], RADIUS)
    for k, extinction in enumerate((0.01, 0.05, 0.3)):
        alone = bulbs.bulb(fog("height", extinction, 0.6), EYE, directions, depth, PLACES["in view"], RADIUS)
        np.testing.assert_allclose(together[:, k], alone[:, k], rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3])
def test_the_unit_of_length_does_not_matter(scale):
    """Lengths times s, coefficients over s: irradiance of a lamp of one intensity, and so V, is over s^2."""
    directions, depth = along_rays()
    one = bulbs.bulb(fog("homogeneous", 0.05, 0.6), EYE, directions, depth, PLACES["beside"], RADIUS)
    other = bulbs.bulb(fog("homogeneous", 0.05 / scale, 0.6), EYE * scale, directions, depth * scale,
                       np.multiply(PLACES["beside"], scale), RADIUS * scale)
    np.testing.assert_allclose(other * scale**2, one, rtol=1e-9)


@pytest.mark.parametrize("g", [-0.999, 0.0, 0.999])
@pytest.mark.parametrize("extinction", [0.0, 1e-12, 1e-3, 1e4])
@pytest.mark.parametrize("name", FOGS)
def test_extremes(name, extinction, g):
    """Finite, not negative, rising with depth, in proportion in thin fog, and with nothing absorbed or all of it."""
    depths = np.array([0.0, 1e-9, 1.0, 1e3, 1e7])
    every = np.repeat(DIRECTIONS, len(depths), 0)
    places = [*PLACES.values(), EYE.tolist(), (EYE + 5 * DIRECTIONS[1]).tolist()]
    for place in places:
        for albedo in (1.0, 0.0):
            v = bulbs.bulb(fog(name, extinction, g, albedo), EYE, every, np.tile(depths, len(DIRECTIONS)), place, 1e-3)
            assert np.isfinite(v).all() and (v >= 0).all() and (albedo > 0 or (v == 0).all())
            by_depth = v.reshape(len(DIRECTIONS), len(depths), 3)
            assert (by_depth[:, 0] == 0).all()
            # a peak of a millionth of the sphere lies between nodes: a tenth of the largest may be lost on the way
            assert (np.diff(by_depth, axis=1) >= -0.1 * by_depth.max()).all()
    if extinction == 1e-12:
        thin, thicker = (bulbs.bulb(fog(name, k, g), EYE, DIRECTIONS, np.full(5, 50.0), PLACES["in view"], RADIUS)
                         for k in (1e-12, 1e-9))
        np.testing.assert_allclose(thicker, 1000 * thin, rtol=1e-6)


# --- fog that varies at every step -------------------------------------------------------------------------------


@pytest.mark.parametrize("settings", [{}, {"top_height": 12.0, "scale_height": 5.0}])
def test_bulb_in_noise(settings):
    """Against thousands of midpoints of the density, each with the integrals of it to eye and lamp."""
    medium = Noise(visibility=80.0, scale=5.0, phase_function={"type": "henyey_greenstein", "asymmetry": 0.6}, **settings)
    extinction = float(np.add(*medium.coefficients())[0])
    directions, depth = along_rays()
    directions, depth = directions[depth < 300], depth[depth < 300]
    errors = []
    for place in ("in view", "close to the ray", "beside", "behind the camera", "on the ground"):
        lamp = np.array(PLACES[place])
        found = bulbs.bulb(medium, EYE, directions, depth, lamp, RADIUS)[:, 0]
        for d, far, one in zip(directions, depth, found):
            foot = (lamp - EYE) @ d
            width = np.sqrt((lamp - EYE) @ (lamp - EYE) - foot**2 + RADIUS**2)
            angle = np.linspace(np.arctan(-foot / width), np.arctan((far - foot) / width), 1500)
            t = np.sort(np.clip(np.concatenate([foot + width * np.tan(angle), np.linspace(0, far, 1500)]), 0, far))
            middle = (t[1:] + t[:-1]) / 2
            points = EYE + middle[:, None] * d
            offset = points - lamp
            distance = np.linalg.norm(offset, axis=1)
            path = medium.density_path(EYE, points) + medium.density_path(lamp, points)
            # the peak of 1 / (d^2 + r^2) over a cell in closed form
            cell = np.diff(np.arctan((t - foot) / width)) / width
            truth = extinction * (medium.density(points) * henyey_greenstein(0.6, -(offset @ d) / distance)
                                  * np.exp(-extinction * path) * cell).sum()
            errors.append(abs(one / truth - 1))
    assert np.median(errors) < 3e-3 and np.percentile(errors, 99) < 0.03, np.percentile(errors, [50, 99])


# --- many lamps over a photograph ----------------------------------------------------------------------------------


def photograph(width=480, height=320):
    """Rays and depths of a street: ground, sky, a wall, houses and two thin posts."""
    v, u = np.mgrid[0:height, 0:width] + 0.5
    focal = width / 2 / np.tan(np.radians(32.5))
    rays = np.stack([(u - width / 2) / focal, (0.45 * height - v) / focal, -np.ones_like(u)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    depth = np.where(rays[..., 1] < 0, np.minimum(1.5 / np.maximum(-rays[..., 1], 1e-9), 2000.0), 2000.0)
    for left, right, z, top in ((-12, -7, -15, 9), (6, 14, -30, 14), (-3, 1, -60, 20), (-0.4, -0.2, -8, 5), (2, 2.15, -12, 6)):
        t = -z / -rays[..., 2]
        x, y = t * rays[..., 0], 1.5 + t * rays[..., 1]
        depth = np.where((x > left) & (x < right) & (y < top), np.minimum(depth, t), depth)
    return rays, depth


def some_lamps(count, seed=5):
    """In view, outside the frame, behind the camera, and behind the houses."""
    random = np.random.default_rng(seed)
    positions = np.stack([random.uniform(-30, 30, count), random.uniform(0.5, 8, count), -random.uniform(4, 150, count)], -1)
    positions[::8, 2] = 5.0
    return positions, random.uniform(0.1, 3.0, count)


@pytest.mark.parametrize("name, extinction, g", [("homogeneous", 0.012, 0.7), ("homogeneous", 0.2, 0.9), ("height", 0.05, 0.7),
                                                 ("layers", 0.03, 0.6)])
def test_many_lamps_are_the_sum_of_single_ones(name, extinction, g):
    """A layer a metre thick is 9 pixels high round a lamp at 40 m: at its edges steps of 2 are off."""
    rays, depth = photograph()
    positions, weights = some_lamps(24 if name == "homogeneous" else 8)
    medium = fog(name, extinction, g)
    assert depth.size > bulbs.FEW_RAYS
    found = bulbs.bulbs(medium, EYE, rays, depth, positions, RADIUS, weights)[..., 0]
    truth = sum(w * bulbs.bulb(medium, EYE, rays, depth, p, RADIUS)[..., 0] for p, w in zip(positions, weights))
    error = np.abs(found / truth - 1)
    p99, most = (0.02, 1.0) if name == "layers" else (0.01, 0.04)
    assert np.median(error) < 2e-3 and np.percentile(error, 99) < p99 and error.max() < most, (
        np.percentile(error, [50, 99, 100]), np.unravel_index(error.argmax(), error.shape))


@pytest.mark.parametrize("lamp", [[-7.0, 4.0, -14.8], [3.0, 3.0, -40.0], [-0.3, 3.0, -9.0], [-1.0, 2.0, -61.0], [0.0, 3.0, 2.0]],
                         ids=["at a house's corner", "before the sky", "behind a post", "behind a wall", "behind the camera"])
def test_one_lamp_over_a_photograph(lamp):
    rays, depth = photograph()
    medium = fog("homogeneous", 0.03, 0.7)
    found = bulbs.bulbs(medium, EYE, rays, depth, np.array([lamp]), RADIUS, [1.0])[..., 0]
    truth = bulbs.bulb(medium, EYE, rays, depth, np.array(lamp), RADIUS)[..., 0]
    error = np.abs(found / truth - 1)
    # between eight pixels V is not quite linear
    assert np.median(error) < 2e-3 and np.percentile(error, 99) < 0.01 and error.max() < 0.03, (
        np.percentile(error, [50, 99, 100]), np.unravel_index(error.argmax(), error.shape))


def test_where_every_pixel_has_a_depth_of_its_own():
    """Leaves before the sky: fewer rays must do, and what is lost stays small."""
    rays, depth = photograph()
    random = np.random.default_rng(2)
    leaves = random.uniform(size=depth.shape) < 0.5
    depth = np.where(leaves, random.uniform(5, 40, depth.shape), depth)
    medium, (positions, weights) = fog("homogeneous", 0.03, 0.7), some_lamps(6)
    found = bulbs.bulbs(medium, EYE, rays, depth, positions, RADIUS, weights)[..., 0]
    truth = sum(w * bulbs.bulb(medium, EYE, rays, depth, p, RADIUS)[..., 0] for p, w in zip(positions, weights))
    error = np.abs(found / truth - 1)
    assert np.median(error) < 0.01 and np.percentile(error, 99) < 0.06, np.percentile(error, [50, 99])


@pytest.mark.parametrize("shape", [(1, 30000), (30000, 1), (2, 15000)])
def test_narrow_photographs(shape):
    rays, depth = photograph()
    at = tuple(np.linspace(0, n - 1, m).astype(int) for n, m in zip(depth.shape, shape))
    rays, depth = rays[np.ix_(*at)], depth[np.ix_(*at)]
    medium, lamp = fog("homogeneous", 0.03), np.array(PLACES["in view"])
    found = bulbs.bulbs(medium, EYE, rays, depth, lamp[None], RADIUS, [1.0])
    truth = bulbs.bulb(medium, EYE, rays, depth, lamp, RADIUS)
    assert found.shape == (*shape, 3)
    assert np.median(np.abs(found / truth - 1)) < 5e-3


def test_depth_zero_and_black():
    rays, depth = photograph()
    medium, lamp = fog("homogeneous", 0.03), np.array([PLACES["in view"]])
    depth[:, :100] = 0.0
    found = bulbs.bulbs(medium, EYE, rays, depth, lamp, RADIUS, [1.0])
    assert np.isfinite(found).all() and (found >= 0).all() and found[:, :100].max() < 1e-9 * found.max()
    assert not bulbs.bulbs(medium, EYE, rays, depth, lamp, RADIUS, [0.0]).any()
    assert not bulbs.bulbs(fog("homogeneous", 0.0), EYE, rays, depth, lamp, RADIUS, [1.0]).any()


# --- what is left out, and what arrives at surfaces ------------------------------------------------------------------


def test_hidden_lamps_are_left_out():
    medium = fog("homogeneous", 0.15)
    positions = np.array([[0.0, 1.0, -100.0], [0.0, 1.0, -110.0], [2.0, 1.0, 110.0]])
    assert bulbs.visible(medium, EYE, positions).tolist() == [True, False, False]
    directions, depth = along_rays()
    kept = bulbs.bulbs(medium, EYE, directions, depth, positions, RADIUS, np.ones(3))
    every = sum(bulbs.bulb(medium, EYE, directions, depth, p, RADIUS) for p in positions)
    # what is left out is exp(-16) of what a lamp gives in the open, at most: delta / (4 pi) pi / r
    assert (every - kept).max() < np.exp(-bulbs.UNSEEN) * 0.9 * 0.15 / (4 * np.pi) * np.pi / RADIUS


def test_light_comes_over_a_thick_layer():
    """Seventeen optical depths lie on the straight way; round by the thinner fog above there are a few."""
    medium = fog("height", 0.3)
    lamp = np.array([[0.0, 1.2, -62.0]])
    assert float(medium.optical_depth(EYE, lamp)[0, 0]) > bulbs.UNSEEN
    assert bulbs.visible(medium, EYE, lamp).all()
    assert not bulbs.visible(medium, EYE, lamp * [1, 1, 20]).any()


def test_what_arrives_at_surfaces():
    points = np.array([[0.0, 0.0, -5.0], [3.0, 0.0, -5.0], [0.0, 0.0, -5.0]])
    normals = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    lamps, weights = np.array([[0.0, 4.0, -5.0], [3.0, 3.0, -5.0]]), np.array([2.0, 1.0])
    irradiance, share = bulbs.arrival(fog("homogeneous", 0.1), points, normals, lamps, 1e-6, weights)
    offsets = lamps - points[:, None]
    distance = np.linalg.norm(offsets, axis=-1)
    cosine = np.abs(offsets[..., 1]) / distance
    one = weights * np.where(normals[:, 1:2] > 0, cosine, 0.02) / distance**2  # what faces away gets a fiftieth
    np.testing.assert_allclose(irradiance, one.sum(1), rtol=1e-9)
    np.testing.assert_allclose(share[:, 1], (one * np.exp(-0.1 * distance)).sum(1) / one.sum(1), rtol=1e-9)


@pytest.mark.parametrize("extinction", [0.0, 1e-12, [0.01, 0.1, 3.0], 1e4])
@pytest.mark.parametrize("name", FOGS)
def test_what_arrives_is_bounded(name, extinction):
    points = np.concatenate([np.random.default_rng(0).uniform([-40, 0, -60], [40, 10, 20], (300, 3)), [PLACES["in view"]],
                             [[0, 0, -1e7]]])
    normals = np.random.default_rng(1).normal(size=points.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for shape in (None, bulbs.Cone(np.array([0.0, -1.0, 0.0]), 0.9, 0.7)):
        irradiance, share = bulbs.arrival(fog(name, extinction), points, normals, np.array(list(PLACES.values())), RADIUS,
                                          np.ones(len(PLACES)), shape)
        assert np.isfinite(irradiance).all() and (irradiance > 0).all() and irradiance.max() <= 8 / RADIUS**2
        assert np.isfinite(share).all() and (share >= 0).all() and (share <= 1 + 1e-12).all()
        if extinction == 0.0:
            np.testing.assert_allclose(share, 1, rtol=1e-12)
