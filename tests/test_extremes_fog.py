"""Fog at its extremes, through the command line: closed forms, limits and monotonicity."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.imaging.maps import read_map
from tests.extremes.scenes import BULB, described, even, run

POSITION = np.array(BULB["position"]["point"])
EYE = np.array([0, 1.2, 0])
#: A render is in half floats, 2^-11 each, and T is a ratio of two.
HALF_FLOATS = 2e-3


def paths(found) -> np.ndarray:
    """Lengths [m] of the light's and the eye's path together, (H, W)."""
    height, width = found.depth.shape
    focal = width / 2 / np.tan(np.radians(35))
    v, u = np.mgrid[0:height, 0:width] + 0.5
    rays = np.stack([(u - width / 2) / focal, -(v - height / 2) / focal, -np.ones_like(u)], -1)
    points = EYE + found.depth[..., None] * rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return found.depth + np.linalg.norm(points - POSITION, axis=-1)


@pytest.mark.parametrize("extinction", [0.0, 1e-12, 1e-10, 1e-3, 1.0, 1e4, 2.5e4])
def test_transmittance_of_a_bulb(tmp_path, extinction):
    """T = exp(-kappa (eye path + light path)), from optical depth 0 and 1e-9 to 1e5."""
    found = run(tmp_path, described(fog=even(0.2 * extinction, 0.8 * extinction)))
    expected = np.exp(-extinction * paths(found))[..., None]
    seen = np.broadcast_to(expected > 1e-30, found.transmittance.shape)
    # below that float32 and the render's half floats hold nothing; nothing must come out
    assert (found.transmittance[~seen] <= 1e-30).all()
    error = np.abs(found.transmittance / np.where(seen, expected, 1) - 1)[seen]
    assert not error.size or error.max() <= HALF_FLOATS * (1 + extinction), error.max()


@pytest.mark.parametrize("scattering", [1e-12, 1e-8])
def test_thin_fog_scatters_in_proportion(tmp_path, scattering):
    """V/delta tends to its limit, neither to 0 nor to steps of half floats."""
    thin = run(tmp_path / "thin", described(fog=even(0, scattering)))
    known = run(tmp_path / "known", described(fog=even(0, 1e-4)))
    ratio = thin.in_scattering / scattering / (known.in_scattering / 1e-4)
    # eye and light path are below 12 m: 1e-4/m dims what is known by 0.12 %; half floats do the rest
    assert ratio.min() >= 1 - HALF_FLOATS and ratio.max() <= 1 + 1.2e-3 + HALF_FLOATS, (ratio.min(), ratio.max())


@pytest.mark.parametrize("absorption", [1e-12, 0.3, 1e4])
def test_fog_that_does_not_scatter(tmp_path, absorption):
    """delta = 0: V is exactly 0."""
    assert not run(tmp_path, described(fog=even(absorption, 0))).in_scattering.any()


def test_fog_that_does_not_absorb(tmp_path):
    """alpha = 0: T depends on the extinction alone, and V is larger than with the same extinction partly absorbed."""
    white = run(tmp_path / "white", described(fog=even(0, 0.4)))
    grey = run(tmp_path / "grey", described(fog=even(0.1, 0.3)))
    assert np.array_equal(white.transmittance, grey.transmittance)
    # V is proportional to delta at one extinction
    assert np.allclose(grey.in_scattering, 0.75 * white.in_scattering, rtol=HALF_FLOATS)


@pytest.mark.parametrize("asymmetry", [-0.999, 0.999])
def test_narrowest_phase_functions(tmp_path, asymmetry):
    """Uniform light: what is scattered is the same whatever the phase function, delta/kappa L (1 - T)."""
    lights = {"reflected": {"type": "ambient", "radiance": [2.0, 1.0, 0.5]}, "bulb": BULB}
    phase = {"type": "henyey_greenstein", "asymmetry": asymmetry}
    found = run(tmp_path, described(lights, even(0.1, 0.3, phase)))
    ambient = read_map(found.scene.build.in_scattering("reflected")).astype(float)
    expected = 0.75 * np.array([2.0, 1.0, 0.5]) * -np.expm1(-0.4 * found.depth)[..., None]
    assert np.allclose(ambient, expected, rtol=1e-5)  # float32 maps of depth and V


@pytest.mark.parametrize("visibility", [0.1, 1e7])
def test_visibility(tmp_path, visibility):
    """Fog stated by visibility is that of the coefficient -ln(0.05)/visibility."""
    stated = run(tmp_path / "visibility", described(fog={
        "type": "homogeneous", "visibility": visibility, "phase_function": {"type": "isotropic"}}))
    same = run(tmp_path / "coefficient", described(fog=even(0, -np.log(0.05) / visibility)))
    assert np.allclose(stated.transmittance, same.transmittance, rtol=1e-6, atol=0)
    assert np.allclose(stated.in_scattering, same.in_scattering, rtol=1e-6, atol=0)


def test_denser_is_never_clearer(tmp_path):
    """T falls with extinction at every pixel, from 1e-12 to 1e4/m."""
    before = None
    for k, extinction in enumerate([1e-12, 1e-2, 1.0, 10.0, 1e4]):
        found = run(tmp_path / str(k), described(fog=even(0, extinction))).transmittance
        assert before is None or (found <= before * (1 + HALF_FLOATS)).all(), extinction
        before = found


@pytest.mark.parametrize("lower,upper,crosses", [(-1, 0.5, "below"), (0.9, 1.6, "in"), (1.9, 2.4, "above")])
def test_camera_above_in_and_below_a_layer(tmp_path, lower, upper, crosses):
    """Along the level middle ray only the layer round the camera dims; ambient V is delta/kappa L (1 - T_eye)."""
    lights = {"reflected": {"type": "ambient", "radiance": [1.0, 1.0, 1.0]}, "bulb": BULB}
    found = run(tmp_path, described(lights, {**even(0, 0.5), "type": "layers",
                                             "layers": [{"lower": lower, "upper": upper}]}))
    ambient = read_map(found.scene.build.in_scattering("reflected")).astype(float)
    # the two middle rows look level within 2 degrees: 5 m away they are 0.15 m higher or lower
    middle, depth = ambient[8:10], found.depth[8:10, :, None]
    expected = -np.expm1(-0.5 * depth) if crosses == "in" else 0.0
    assert np.allclose(middle, expected, rtol=1e-4, atol=1e-7)
