"""Fog from none to a wall, through the whole chain: closed forms, limits and invariance."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from tests.extreme_scenes import GREY, LIGHTS, depth, fog, fogged, room, sun, written

RADIANCE = np.array(LIGHTS["ambient"]["radiance"])
THINNEST = 1e-12
#: A half float on its way from the renderer: 2^-11, twice, and sampling of a few rays a step.
RENDERED = 5e-3


def only(kind: str) -> dict:
    return {kind: copy.deepcopy(LIGHTS[kind])}


@pytest.mark.parametrize("extinction", [0.0, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 30.0, 1e4])
@pytest.mark.parametrize("albedo", [0.0, 1.0, 0.4])
def test_even_light_in_closed_form(extinction, albedo, tmp_path):
    """V = albedo L (1 - exp(-kappa d)), also where 1 - exp has no digit left of it; T = exp(-kappa d)."""
    build = written(tmp_path, room(only("ambient"), fog(extinction, albedo)))
    t, v, c = fogged(build)
    tau = extinction * depth(build)
    # float32 maps: 6e-8 each of depth, T and V; the depth's is multiplied by tau
    np.testing.assert_allclose(v, albedo * RADIANCE * -np.expm1(-tau), rtol=1e-6)
    # tau in its place in exp(-tau): 1e-7 tau; a T below float32's smallest is 0
    np.testing.assert_allclose(t, np.broadcast_to(np.exp(-tau), t.shape), rtol=1e-6 + 1e-6 * min(tau.max(), 100),
                               atol=1e-37)
    if extinction == 0 or extinction == THINNEST:
        np.testing.assert_allclose(c, GREY, rtol=1e-6)
    if extinction == 1e4:
        np.testing.assert_allclose(c, np.broadcast_to(albedo * RADIANCE, c.shape), rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("tau", [1e-9, 1e-6, 1e-3, 1.0, 1e2, 1e5])
def test_optical_depth(tau, tmp_path):
    build = written(tmp_path, room(only("ambient"), fog(tau / 3.0)))
    t, v, _ = fogged(build)
    expected = -np.expm1(-tau / 3.0 * depth(build)) * RADIANCE
    np.testing.assert_allclose(v, expected, rtol=1e-6)  # as above


@pytest.mark.parametrize("metres", [0.1, 1.0, 1e3, 1e5, 1e7])
@pytest.mark.parametrize("contrast, share", [("meteorological_optical_range", 0.05), ("koschmieder", 0.02)])
def test_visibility(metres, contrast, share, tmp_path):
    medium = {"type": "homogeneous", "visibility": metres, "contrast": contrast,
              "phase_function": {"type": "isotropic"}}
    build = written(tmp_path, room(only("ambient"), medium))
    t, v, _ = fogged(build)
    # definition: at that distance `share` of a contrast is left
    np.testing.assert_allclose(np.broadcast_to(share ** (depth(build) / metres), t.shape), t, rtol=2e-5, atol=1e-37)
    assert v.min() > 0  # even 1e7 m is fog


@pytest.mark.parametrize("kind", ["point", "spot", "area"])
def test_lamps_in_thin_fog_reach_their_limit(kind, tmp_path):
    """V / scattering is one picture for every thin fog: it is not quantised to 0."""
    build = written(tmp_path, room(only(kind), fog(THINNEST)))
    limit = fogged(build)[1] / THINNEST
    assert limit.max() > 0
    for extinction in (1e-9, 1e-6):
        _, v, c = fogged(build, *(f"fog.scattering_coefficient=[{extinction},{extinction},{extinction}]",
                                  "fog.absorption_coefficient=[0,0,0]"))
        np.testing.assert_allclose(v / extinction, limit, rtol=RENDERED, atol=RENDERED * limit.max())
        np.testing.assert_allclose(c, GREY, rtol=1e-3)  # T is a ratio of two half floats, 2^-11 each


@pytest.mark.parametrize("asymmetry", [-0.999, 0.999])
def test_sharpest_phase_functions(asymmetry, tmp_path):
    lights = {kind: copy.deepcopy(LIGHTS[kind]) for kind in ("ambient", "point")}
    build = written(tmp_path, room(lights, fog(0.2, 0.9, asymmetry)))
    t, v, _ = fogged(build)
    # the even light's part does not depend on how fog scatters
    even = 0.9 * RADIANCE * -np.expm1(-0.2 * depth(build))
    assert (v >= even * (1 - 1e-6)).all() and (t <= np.exp(-0.2 * depth(build)) * (1 + 1e-6)).all()


@pytest.mark.parametrize("extinction", [THINNEST, 30.0, 1e4])
@pytest.mark.parametrize("kind", ["point", "area"])
def test_no_scattering_is_no_airlight(extinction, kind, tmp_path):
    build = written(tmp_path, room(only(kind), fog(extinction, albedo=0.0)))
    t, v, _ = fogged(build)
    assert not v.any()
    # the light's own way to the surface takes from T too
    assert (t <= np.exp(-extinction * depth(build)) * (1 + RENDERED) + 1e-30).all()


def test_transmittance_falls_with_extinction(tmp_path):
    build = written(tmp_path, room(only("point"), fog(1e-3)))
    before = np.ones(3)
    for extinction in (1e-3, 0.1, 1.0, 10.0, 1e4):
        stated = f"fog.scattering_coefficient=[{extinction},{extinction},{extinction}]"
        t, _, _ = fogged(build, stated)
        assert (t <= before * (1 + RENDERED)).all(), extinction
        before = t


def scaled(kind: str, scale: float) -> dict:
    """The light in a room `scale` times as large, as bright to the eye."""
    light = copy.deepcopy(LIGHTS[kind] if kind in LIGHTS else sun([0.63, -0.76, 0.11]))
    for key in ("position", "target"):
        if key in light:
            light[key]["point"] = [scale * x for x in light[key]["point"]]
    if "intensity" in light:
        light["intensity"] = [scale**2 * x for x in light["intensity"]]
        light["radius"] = 0.02 * scale
    if "outline" in light:
        light["outline"]["points"] = [[scale * x for x in point] for point in light["outline"]["points"]]
    if "openings" in light:
        for outline in (light["openings"]["window"]["window"], *light["openings"]["window"]["patches"]):
            outline["points"] = [[scale * x for x in point] for point in outline["points"]]
    return {kind: light}


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("kind", ["ambient", "area", "sun", *(pytest.param(kind, marks=pytest.mark.slow)
                                                              for kind in ("point", "spot"))])
def test_units_from_millimetres_to_kilometres(kind, scale, tmp_path):
    pictures = [fogged(written(tmp_path / name, room(scaled(kind, s), fog(0.2 / s, 0.8, 0.5), s)))
                for name, s in (("metres", 1.0), ("scaled", scale))]
    for one, other in zip(*pictures):
        # half floats
        np.testing.assert_allclose(other, one, rtol=2e-3, atol=2e-3 * np.median(one))
