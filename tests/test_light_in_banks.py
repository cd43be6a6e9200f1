"""Sun and sky in fog that stands on a grid, with and without a top, against brute force from its density.

Banks whose skylight is far from that of level layers, and tables of the light's ways against the integrals themselves.
"""

import numpy as np
import pytest

from pipeline.physics import light_volume
from pipeline.physics.density_grid import bounded
from pipeline.plugins.registry import registry
from pipeline.plugins.media.noise import Noise

EYE = np.array([0.0, 1.6, 0.0])
BANKS = {"visibility": 100.0, "scale": 5.0, "detail": 2, "scale_height": 8.0, "top_height": 20.0}


def henyey_greenstein(g, cosine):
    return (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * (1 - cosine)) ** 1.5)


def sun(elevation):
    """The way of the light of a sun so many degrees high."""
    e = np.radians(elevation)
    return -np.array([0.6 * np.cos(e), np.sin(e), -0.8 * np.cos(e)])


def banks(g=0.0, **settings):
    return Noise(**{**BANKS, **settings}, phase_function={"type": "henyey_greenstein", "asymmetry": g})


def some_rays(count=25):
    random = np.random.default_rng(0)
    directions = random.normal(size=(count, 3)) * [1, 0.2, 1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    depth = 10 ** random.uniform(1, 2.6, count)
    ground = np.where(directions[:, 1] < 0, -EYE[1] / np.minimum(directions[:, 1], -1e-9), np.inf)
    return directions, np.minimum(depth, ground)


def along(medium, directions, depth, arriving, steps=700):
    """V (n,) by midpoints of the density, `arriving` (n,) of whose light reaches each point."""
    extinction, scattering = (float(x[0]) for x in (np.add(*medium.coefficients()), medium.coefficients()[1]))
    v, crossed = np.zeros(len(depth)), np.zeros(len(depth))
    for k in range(steps):
        points = EYE + (depth * (k + 0.5) / steps)[:, None] * directions
        amount = medium.density(points) * depth / steps
        v += scattering * amount * np.exp(-extinction * (crossed + amount / 2)) * arriving(points)
        crossed += amount
    return v


@pytest.mark.parametrize("many", [False, True], ids=["few rays", "a photograph"])
@pytest.mark.parametrize("elevation", [pytest.param(1, marks=pytest.mark.slow), 5, 30, 60, 90])
def test_sunlight(elevation, many):
    """With a top. Few rays ask for each way of the light itself, many for a table of them."""
    medium, (directions, depth) = banks(0.6), some_rays()
    extinction = float(np.add(*medium.coefficients())[0])
    light = registry("lights")["sunlight"](type="sunlight", direction=sun(elevation).tolist())
    times = 60 if many else 1
    found = light.in_scattering(medium, EYE, np.tile(directions, (times, 1)), np.tile(depth, times))[:len(depth), 0]
    truth = henyey_greenstein(0.6, -(directions @ sun(elevation))) * along(
        medium, directions, depth, lambda points: np.exp(-extinction * medium.daylight_path(points, sun(elevation))))
    error = np.abs(found / truth - 1)
    # light from the horizon crosses 1 km, which neither follows in steps as fine as the wisps
    assert np.median(error) < (0.01 if elevation == 1 else 2e-3), np.median(error)
    assert np.percentile(error, 99) < (0.06 if elevation == 1 else 0.02), np.percentile(error, 99)


def sky(count, azimuths):
    nodes, weights = np.polynomial.legendre.leggauss(count)
    height, weights = np.repeat((nodes + 1) / 2, azimuths), np.repeat(weights / 2, azimuths) * 2 * np.pi / azimuths
    angle = np.tile((np.arange(azimuths) + 0.5) * 2 * np.pi / azimuths, count)
    level = np.sqrt(1 - height**2)
    return np.stack([level * np.cos(angle), height, level * np.sin(angle)], -1), weights


@pytest.mark.parametrize("g, median, largest", [(0.0, 0.01, 0.04), pytest.param(0.6, 0.02, 0.05, marks=pytest.mark.slow)])
def test_skylight(g, median, largest):
    """All of the sky's directions at every point; straight above alone would be off by 3 %.

    Which of them lie in banks is known of even scattering only: what scatters forward is less exact (g 0.9: 4 %).
    """
    medium, (directions, depth) = banks(g), some_rays(6)
    extinction = float(np.add(*medium.coefficients())[0])
    found = registry("lights")["sky"](type="sky").in_scattering(
        medium, EYE, np.tile(directions, (60, 1)), np.tile(depth, 60))[:6, 0]
    towards, solid_angle = sky(5, 12)
    weight = henyey_greenstein(g, directions @ towards.T) * solid_angle

    def arriving(points):
        paths = np.stack([medium.daylight_path(points, -one) for one in towards], -1)
        return (weight * np.exp(-extinction * paths)).sum(-1)

    truth = along(medium, directions, depth, arriving, steps=60)
    # even fog of this brute force's few directions is off by as much as they are
    even = weight.sum(1)
    share = registry("lights")["sky"](type="sky").in_scattering(
        banks(g, scale_height=None, top_height=None), EYE, directions, np.full(6, 1e6))[:, 0]
    error = np.abs(found / (truth * share / even) - 1)
    assert np.median(error) < median and error.max() < largest, (np.median(error), error.max())


@pytest.mark.parametrize("kind", ["sunlight", "sky", "ground"])
def test_without_a_top_the_light_counts_as_clear(kind):
    medium, (directions, depth) = banks(0.5, scale_height=None, top_height=None), some_rays()
    light = registry("lights")[kind](type=kind, **({"direction": sun(20).tolist()} if kind == "sunlight" else {}))
    found = light.in_scattering(medium, EYE, directions, depth)[:, 0]
    towards, solid_angle = sky(60, 120)
    if kind == "sunlight":
        share = henyey_greenstein(0.5, -(directions @ sun(20)))
    else:
        side = 1 if kind == "sky" else -1
        share = (henyey_greenstein(0.5, side * directions @ towards.T) * solid_angle).sum(1)
    truth = along(medium, directions, depth, lambda points: share)
    assert np.median(np.abs(found / truth - 1)) < 1e-3 and np.abs(found / truth - 1).max() < 5e-3


# --- tables of the light's ways --------------------------------------------------------------------------------------


def box(yaw=25.0):
    x, y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in (24, 16, 20)), indexing="ij")
    values = np.exp(-3 * (x**2 + y**2 + z**2)) * (1.2 + np.sin(5 * x) * np.cos(4 * z))
    return bounded(values, np.array([-3.0, 2.0, -4.0]), np.array([6.0, 4.0, 5.0]), 0.0, yaw)


@pytest.mark.parametrize("grid, lower, upper", [
    (Noise(**BANKS).grid(), [-60, 0, -60], [60, 21, 60]), (box(), [-8, 0, -9], [8, 7, 6])], ids=["banks", "box"])
@pytest.mark.parametrize("elevation", [90, 40, 8, 1])
def test_ways_of_sunlight(grid, lower, upper, elevation):
    """Within 2 % of the longest; from 1 degree the integral itself has steps of a metre. Beside and below a box, too."""
    points = np.random.default_rng(1).uniform(lower, upper, (800, 3))
    found, truth = light_volume.sun_paths(grid, sun(elevation))(points), grid.path_out(points, sun(elevation))
    error = np.abs(found - truth) / truth.max()
    assert (truth > 0.1 * truth.max()).sum() > 20
    assert np.median(error) < 3e-3 and np.percentile(error, 99) < (0.05 if elevation == 1 else 0.02), np.percentile(error, [50, 99])
    above = points + [0, 30, 0]
    assert np.abs(light_volume.sun_paths(grid, sun(elevation))(above)).max() == 0


def test_the_sun_on_the_horizon_is_dark_and_below_it_too():
    for direction in ([1.0, 0.0, 0.0], [0.8, 0.6, 0.0]):
        found = light_volume.sun_paths(Noise(**BANKS).grid(), np.array(direction))(EYE[None])
        assert np.isfinite(found).all() and found[0] > 1e3


@pytest.mark.parametrize("grid", [Noise(visibility=100.0, scale=5.0).grid(), box()], ids=["banks", "box"])
def test_ways_from_a_lamp(grid):
    lamp = np.array([-1.0, 4.0, -2.0])
    random = np.random.default_rng(3)
    directions = random.normal(size=(800, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = lamp + directions * 10 ** random.uniform(-2, 2, (800, 1))
    found, truth = light_volume.lamp_paths(grid, lamp, 200.0)(points), grid.path(lamp, points)
    error, near = np.abs(found - truth), np.linalg.norm(points - lamp, axis=1) < 10
    # two degrees are a small bank at 50 m
    assert np.median(error[near]) < 0.01 and np.percentile(error[near], 99) < 0.4
    assert np.median(error) < 0.05 and np.percentile(error, 99) < 0.1 * truth.max(), np.percentile(error, [50, 99])
    assert light_volume.lamp_paths(grid, lamp, 200.0)(lamp[None]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("extinction", [1e-9, 0.03, 1.0])
def test_skylight_as_level_layers(extinction):
    """Even fog stays what it is, and more fog above is never less."""
    values = np.ones((12, 20, 12), np.float32)
    grid = bounded(values, np.array([-200.0, 0, -200]), np.array([400.0, 10, 400]), 0.0, 0.0)
    # far from the sides of a wide slab; its faces fade over half a metre
    points = np.array([[0.0, 8.0, 0.0], [3.0, 5.0, 1.0], [0.0, 2.0, -5.0]])
    found = light_volume.sky_paths(grid, [extinction])[0](points)
    assert found == pytest.approx(10 - points[:, 1], rel=0.03)
    assert (np.diff(found) > 0).all()
