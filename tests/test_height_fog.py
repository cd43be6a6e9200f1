"""Fog that depends on height alone, through the whole chain: T and V against dense integration of its density."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from pipeline.imaging.maps import read_map
from pipeline.plugins.registry import registry
from tests.test_light_transport import COLOUR, DESCRIBED, SIZE, chain, reference_rays
from tests.test_noise_fog import POINT, even_path, light_points, shaft_errors, within_bounds

SPECTRAL = {"absorption_coefficient": [0.0, 0.1, 0.4], "scattering_coefficient": [0.3, 0.4, 0.5],
            "phase_function": {"type": "isotropic"}}
FOGS = {
    "height": {"type": "height", "scale_height": 0.6, **SPECTRAL},
    "height with base and top": {"type": "height", "base": 0.5, "scale_height": 0.8, "top_height": 1.9, **SPECTRAL},
    "dense on the floor": {"type": "height", "visibility": 0.6, "scale_height": 0.15,
                           "phase_function": {"type": "isotropic"}},
    "layers": {"type": "layers", "layers": [{"lower": 0.0, "upper": 0.7}, {"lower": 1.2, "upper": 1.5, "density": 2.0}],
               **SPECTRAL},
}


def medium_of(fog):
    return registry("media")[fog["type"]].model_validate(fog)


def integrated(medium, rays, chosen, kind, steps=3000):
    """V and T (n, 3), unoccluded, isotropic: even midpoints along the eye ray; paths are those checked below."""
    extinction, scattering = np.add(*medium.coefficients()), medium.coefficients()[1]
    directions, depth = rays.directions[chosen], rays.depth[chosen]
    ends = rays.origin + directions * depth[:, None]
    points, sends = light_points(kind)
    v, reduced, clear = np.zeros((len(ends), 3)), np.zeros((len(ends), 3)), np.zeros(len(ends))
    for i in range(steps):
        middle = rays.origin + directions * (depth * (i + 0.5) / steps)[:, None]
        weight = scattering / (4 * np.pi) * (medium.density(middle) * depth / steps)[:, None]
        to_eye = medium.density_path(rays.origin, middle)
        for k, point in enumerate(points):
            way = middle - point
            path = to_eye + medium.density_path(point, middle)
            v += weight * sends(k, way, (way**2).sum(-1))[:, None] * np.exp(-extinction * path[:, None])
    for k, point in enumerate(points):
        way = ends - point
        squared = (way**2).sum(-1)
        direct = sends(k, way, squared) * np.maximum(-(way * rays.normals[chosen]).sum(-1), 0) / np.sqrt(squared)
        path = medium.density_path(rays.origin, ends) + medium.density_path(point, ends)
        clear += direct
        reduced += direct[:, None] * np.exp(-extinction * path[:, None])
    return v * COLOUR, reduced / np.maximum(clear, 1e-30)[:, None], clear > 0


@pytest.mark.parametrize("name, kind", [*((name, "point") for name in FOGS), ("height", "area")])
def test_lamps(tmp_path, name, kind):
    """Median 1 %, 99th percentile 3 %, away from the lamp's own image; 8 % where a layer's edges cross the glow."""
    build = chain(tmp_path, {kind: DESCRIBED[kind]}, fog=FOGS[name])
    medium, (rays, _, lamp) = medium_of(FOGS[name]), reference_rays(build)
    beside = binary_dilation(lamp.reshape(SIZE[::-1]), iterations=2).ravel()
    if kind == "point":
        beside = np.linalg.norm(np.cross(rays.directions, POINT - rays.origin), axis=-1) < 0.06
    chosen = np.random.default_rng(5).permutation(np.nonzero(~beside)[0])[:120]
    v, t, lit = integrated(medium, rays, chosen, kind)
    # what fog holds back to a ten-thousandth is black beside the rest
    for path, truth, where in ((build.in_scattering(), v, v > 1e-3 * v.max()),
                               (build.transmittance, t, (t > 1e-4) & lit[:, None])):
        error = np.abs(read_map(path).reshape(-1, 3)[chosen] / np.maximum(truth, 1e-30) - 1)[where]
        largest = 0.08 if name == "layers" else 0.03
        assert np.median(error) <= 0.01 and np.percentile(error, 99) <= largest, (path.name, np.percentile(error, [50, 99]))


@pytest.mark.parametrize("name", ["height", "layers"])
def test_shaft_of_sunlight(tmp_path, name):
    build = chain(tmp_path, {"sun": DESCRIBED["sun"]}, fog=FOGS[name])
    errors = shaft_errors(build, medium_of(FOGS[name]), 500)
    assert within_bounds(errors), errors


@pytest.mark.parametrize("name", FOGS)
def test_paths_are_integrals_of_the_density(name):
    medium = medium_of(FOGS[name])
    random = np.random.default_rng(1)
    start, end = random.uniform([-3, -1, -3], [3, 4, 3], (2, 60, 3))
    end[:20, 1] = start[:20, 1] + random.normal(0, [1e-12] * 10 + [1e-4] * 10)  # nearly level
    # 20,000 midpoints hit a layer's border within a ten-thousandth of the segment
    assert medium.density_path(start, end) == pytest.approx(even_path(medium, start, end, 20000), rel=2e-3, abs=1e-6)
    assert medium.density_path(start, end) == pytest.approx(medium.density_path(end, start), rel=1e-9, abs=1e-12)
    middle = (start + end) / 2
    parts = medium.density_path(start, middle) + medium.density_path(middle, end)
    assert parts == pytest.approx(medium.density_path(start, end), rel=1e-9, abs=1e-12)
