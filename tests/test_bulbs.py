"""Glow of bulbs and spots against adaptive quadrature of the airlight integral, which shares nothing with it.

Lamps in view, beside, behind the camera, on a surface, touching the eye and far outside; in even fog, fog that thins
out and layers. Many lamps over a photograph against the sum of single ones.
"""

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.physics import bulbs
from pipeline.plugins.base import registry
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
    """Where fog leaves anything of it: a per cent at worst, where a sharp layer ends between nodes; hardly any elsewhere."""
    directions, depth = along_rays()
    errors = []
    for extinction, places in ((0.04, PLACES), (0.002, ("in view", "behind the camera")), (1.0, ("beside", "touching the eye"))):
        for place in places:
            found = bulbs.bulb(fog(name, extinction, g), EYE, directions, depth, PLACES[place], RADIUS)[:, 0]
            truth = np.array([airlight(name, extinction, g, d, far, PLACES[place]) for d, far in zip(directions, depth)])
            errors.append(np.abs(found - truth) / np.maximum(truth, 1e-4 * truth.max()))
    errors = np.concatenate(errors)
    assert np.median(errors) < 1e-5 and errors.max() < 1e-2
