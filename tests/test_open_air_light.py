"""In-scattering V of sun, sky and ground in the open air against brute-force quadrature that shares nothing with it.

Eye rays up, level and down, near and far, from below, in and above the fog; sun from 1 to 90 degrees of elevation.
"""

from functools import cache

import numpy as np
import pytest

from pipeline.plugins.registry import registry

ABSORPTION, SCATTERING = 0.002, 0.018
COEFFICIENTS = {"absorption_coefficient": [ABSORPTION] * 3, "scattering_coefficient": [SCATTERING] * 3}
#: What fog each is, its relative density by height for the quadrature, and its top [m].
FOGS = {
    "homogeneous": ({"type": "homogeneous"}, lambda y: np.ones_like(y), None),
    "height": ({"type": "height", "base": 2.0, "scale_height": 15.0}, lambda y: np.exp(-np.maximum(y - 2, 0) / 15), None),
    "height with a top": ({"type": "height", "base": 2.0, "scale_height": 15.0, "top_height": 40.0},
                          lambda y: np.where(y < 40, np.exp(-np.maximum(y - 2, 0) / 15), 0.0), 40.0),
    "layers": ({"type": "layers", "layers": [{"lower": -5.0, "upper": 6.0, "density": 1.5},
                                             {"lower": 20.0, "upper": 30.0, "density": 0.7}]},
               lambda y: 1.5 * ((y >= -5) & (y < 6)) + 0.7 * ((y >= 20) & (y < 30)), 30.0),
}
ELEVATIONS = np.radians([-60, -20, -3, -0.2, 0.0, 0.3, 4, 25, 80])
DEPTHS = (8.0, 120.0, 1500.0)
STEPS = 20001


def henyey_greenstein(g, cosine):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def fog(name, g):
    described, density, top = FOGS[name]
    phase = {"type": "henyey_greenstein", "asymmetry": g}
    medium = registry("media")[described["type"]](**described, **COEFFICIENTS,
                                                  phase_function=registry("phase_functions")["henyey_greenstein"](**phase))
    return medium, density, top


def rays(eye_height):
    directions = np.array([[np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)]
                           for e in ELEVATIONS for a in (0.0, 1.0)])
    directions, depth = np.repeat(directions, len(DEPTHS), 0), np.tile(DEPTHS, len(directions))
    ground = np.where(directions[:, 1] < 0, -eye_height / np.minimum(directions[:, 1], -1e-9), np.inf)
    return np.array([0.0, eye_height, 0.0]), directions, np.minimum(depth, ground)


@cache
def columns(density, top):
    levels = np.linspace(-10, top, 200_001)
    values = density(levels)
    above = np.concatenate([[0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(levels))])
    return levels, above[-1] - above


def column(density, height, top):
    """Integral of the density from each height to the top, by a fine table."""
    return np.interp(height, *columns(density, top), right=0.0)


def along(density, eye, direction, depth, arriving):
    """Integral of scattering times what arrives, by the midpoint rule in steps that grow from the eye."""
    t = depth * np.linspace(0, 1, STEPS) ** 2
    middle = (t[1:] + t[:-1]) / 2
    height = eye[1] + middle * direction[1]
    rho = density(height) * np.diff(t)
    tau = np.cumsum(rho) - rho / 2
    return SCATTERING * (rho * np.exp(-(ABSORPTION + SCATTERING) * tau) * arriving(height)).sum()


def relative_errors(found, truth):
    return np.abs(found - truth) / np.maximum(truth, 1e-3 * truth.max())


@pytest.mark.parametrize("g", [-0.5, 0.0, 0.9])
@pytest.mark.parametrize("eye_height", [1.6, 12.0, 60.0])
@pytest.mark.parametrize("name", FOGS)
def test_sunlight(name, eye_height, g):
    medium, density, top = fog(name, g)
    eye, directions, depth = rays(eye_height)
    for elevation in np.radians([1, 5, 30, 60, 90]):
        travel = -np.array([np.cos(elevation) * 0.6, np.sin(elevation), -np.cos(elevation) * 0.8])
        light = registry("lights")["sunlight"](type="sunlight", direction=travel.tolist())
        found = light.in_scattering(medium, eye, directions, depth)[:, 0]

        def arriving(height):
            if top is None:
                return 1.0
            return np.exp(-(ABSORPTION + SCATTERING) * column(density, height, top) / np.sin(elevation))

        truth = np.array([henyey_greenstein(g, -(d @ travel)) * along(density, eye, d, far, arriving)
                          for d, far in zip(directions, depth)])
        error = relative_errors(found, truth)
        # the quadrature itself is within 2e-4 where a layer begins between its nodes
        assert np.median(error) < 1e-3 and error.max() < 1e-2, np.degrees(elevation)


def sphere(count=480):
    """Directions that cover the upper half of the sphere, and their solid angles; fine towards the horizon."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    height, weights = ((nodes + 1) / 2) ** 2, weights / 2 * (nodes + 1)
    angle = (np.arange(2 * count) + 0.5) * np.pi / count
    level = np.sqrt(1 - height**2)
    directions = np.stack([np.outer(level, np.sin(angle)), np.broadcast_to(height[:, None], (count, 2 * count)),
                           -np.outer(level, np.cos(angle))], -1)
    return directions, weights * np.pi / count


@pytest.mark.parametrize("g", [-0.5, 0.0, 0.9])
@pytest.mark.parametrize("name, eye_height", [("homogeneous", 1.6), ("height", 12.0), ("height with a top", 1.6),
                                              ("height with a top", 60.0), ("layers", 12.0)])
def test_skylight(name, eye_height, g):
    medium, density, top = fog(name, g)
    eye, directions, depth = rays(eye_height)
    found = registry("lights")["sky"](type="sky").in_scattering(medium, eye, directions, depth)[:, 0]
    up, solid_angle = sphere()
    zenith = np.concatenate([[0.0], np.geomspace(1e-5, 3.0, 1200)])
    through = np.exp(-np.outer(zenith, 1 / up[:, 0, 1]))
    truth = []
    for d, far in zip(directions, depth):
        # light that comes from `up` travels along -up, and goes on along -d to the eye
        weight = (henyey_greenstein(g, up @ d) * solid_angle[:, None]).sum(1)
        table = through @ weight

        def arriving(height):
            if top is None:
                return table[0]
            return np.interp((ABSORPTION + SCATTERING) * column(density, height, top), zenith, table)

        truth.append(along(density, eye, d, far, arriving))
    error = relative_errors(found, np.array(truth))
    # at g = 0.9 the peak is 0.06 rad wide: the sphere's 0.007 rad steps are off by some 1e-4
    assert np.median(error) < 2e-3 and error.max() < 1e-2


@pytest.mark.parametrize("name", [name for name, (_, _, top) in FOGS.items() if top is None])
def test_a_uniformly_bright_world_looks_the_same_in_fog_that_absorbs_nothing(name):
    """Furnace: sky and ground of one radiance, their way clear: R T + V = R."""
    described, _, _ = FOGS[name]
    medium = registry("media")[described["type"]](**described, absorption_coefficient=[0.0] * 3,
                                                  scattering_coefficient=[0.001, 0.02, 3.0])
    eye, directions, depth = rays(1.6)
    v = sum(registry("lights")[kind](type=kind).in_scattering(medium, eye, directions, depth) for kind in ("sky", "ground"))
    t = np.exp(-medium.optical_depth(eye, eye + depth[:, None] * directions))
    assert t + v == pytest.approx(np.ones_like(v), abs=1e-6)  # the sky's share is looked up


@pytest.mark.parametrize("name", FOGS)
@pytest.mark.parametrize("kind", ["sunlight", "sky", "ground"])
def test_no_seam_at_the_horizon(name, kind):
    """Neighbouring rays across the horizon, all as far as the sky: V changes by no more than their directions do."""
    medium, _, _ = fog(name, 0.8)
    light = registry("lights")[kind](type=kind, **({"direction": [0.5, -0.4, 0.6]} if kind == "sunlight" else {}))
    elevation = np.radians(np.linspace(-0.5, 0.5, 401))
    directions = np.stack([0 * elevation, np.sin(elevation), -np.cos(elevation)], -1)
    v = light.in_scattering(medium, np.array([0.0, 1.6, 0.0]), directions, np.full(401, 10000.0))[:, 0]
    assert np.abs(np.diff(v)).max() < 0.02 * v.max()


@pytest.mark.parametrize("scattering", [0.0, 1e-12, 1e-3, 1e4])
@pytest.mark.parametrize("g", [-0.999, 0.0, 0.999])
@pytest.mark.parametrize("name", FOGS)
def test_extremes(name, g, scattering):
    """Finite, not negative, rising with depth, and never more than the airlight p E or L."""
    described, _, _ = FOGS[name]
    phase = registry("phase_functions")["henyey_greenstein"](type="henyey_greenstein", asymmetry=g)
    medium = registry("media")[described["type"]](**described, absorption_coefficient=[0.0, 1e-6, scattering],
                                                  scattering_coefficient=[scattering] * 3, phase_function=phase)
    direction = np.array([0.6, -0.48, 0.64])
    directions = np.stack([direction, -direction, [0, -1, 0], [0, 1, 0], [0, 0, -1.0]])
    depths = np.array([0.0, 1e-6, 1.0, 1e3, 1e7])
    every = np.repeat(directions, len(depths), 0)
    for light, most in ((registry("lights")["sunlight"](type="sunlight", direction=direction.tolist()),
                         phase.value(-(every @ direction))[:, None]),
                        (registry("lights")["sky"](type="sky"), 1.0), (registry("lights")["ground"](type="ground"), 1.0)):
        v = light.in_scattering(medium, np.array([0.0, 1.6, 0.0]), every, np.tile(depths, len(directions)))
        assert np.isfinite(v).all() and (v >= 0).all() and (v <= most * (1 + 1e-6)).all()
        by_depth = v.reshape(len(directions), len(depths), 3)
        assert (np.diff(by_depth, axis=1) >= -1e-9 * np.max(most)).all()
        assert (by_depth[:, 0] == 0).all()
