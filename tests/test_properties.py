"""What holds in every fog, of any lights: drawn scenes through the whole chain, and many draws of the pure functions."""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.physics.airlight import veil
from pipeline.physics.composition import combined_transmittance
from pipeline.plugins.media.homogeneous import Homogeneous
from tests.extreme_scenes import LIGHTS, depth, fog, fogged, room, written

#: Each example of the chain is a few starts of the renderer.
CHAIN = settings(max_examples=3, derandomize=True, deadline=None, database=None,
                 suppress_health_check=list(HealthCheck))
PURE = settings(max_examples=200, derandomize=True, deadline=None, database=None)
EXTINCTIONS = st.floats(-12, 4).map(lambda power: 10.0**power)
#: Half floats twice on their way.
RENDERED = 3e-3
place = st.tuples(st.floats(-1.2, 1.2), st.floats(0.2, 2.2), st.floats(-2.8, 1.0))


def bulb(at, intensity=(3.0, 2.0, 1.0)) -> dict:
    return {"type": "point", "position": {"point": list(at)}, "intensity": list(intensity)}


def pictures(*scenes: dict):
    with tempfile.TemporaryDirectory() as folder:
        return [fogged(written(Path(folder) / str(i), scene)) for i, scene in enumerate(scenes)]


@CHAIN
@given(extinction=EXTINCTIONS, albedo=st.floats(0, 1), asymmetry=st.floats(-0.999, 0.999), at=place)
def test_any_fog(extinction, albedo, asymmetry, at):
    """`fogged` says finite, 0 <= T <= 1, V >= 0 and C = R T + V; denser fog lets no more through."""
    thin, dense = pictures(*(room({"bulb": bulb(at)}, fog(k, albedo, asymmetry)) for k in (extinction, 2 * extinction)))
    assert (dense[0] <= thin[0] * (1 + RENDERED) + 1e-30).all()


@pytest.mark.slow
@CHAIN
@given(extinction=st.floats(0.01, 1), one=place, other=place)
def test_lights_superpose_and_channels_permute(extinction, one, other):
    medium = fog(extinction, 0.8, 0.5)
    both, first, second = pictures(
        *(room(lights, medium) for lights in ({"a": bulb(one), "b": bulb(other, (0.5, 1.0, 2.0))}, {"a": bulb(one)},
                                              {"b": bulb(other, (2.0, 0.5, 1.0))})))
    # the second alone has its channels turned by one, and so has its picture
    total = first[1] + np.roll(second[1], -1, axis=-1)
    np.testing.assert_allclose(both[1], total, rtol=RENDERED, atol=1e-4 * total.max())


@CHAIN
@given(extinction=st.floats(0.01, 1), at=place)
def test_left_and_right(extinction, at):
    """The room and its camera mirrored in x show the picture mirrored."""
    one = room({"bulb": bulb(at)}, fog(extinction))
    other = room({"bulb": bulb((-at[0], *at[1:]))}, fog(extinction))
    for key in ("position", "look_at"):
        other["camera"][key][0] *= -1
    for seen, mirrored in zip(*pictures(one, other)):
        np.testing.assert_allclose(mirrored[:, ::-1], seen, rtol=RENDERED, atol=1e-4 * seen.max())


@CHAIN
@given(power=st.floats(-3, 3), extinction=EXTINCTIONS)
def test_units(power, extinction):
    scale = 10.0**power
    lights = {"ambient": copy.deepcopy(LIGHTS["ambient"])}
    for one, other in zip(*pictures(room(lights, fog(extinction)), room(lights, fog(extinction / scale), scale))):
        # depths are float32: 6e-8, times an optical depth of up to 90 before float32's end
        np.testing.assert_allclose(other, one, rtol=2e-5, atol=1e-37)


@PURE
@given(extinction=EXTINCTIONS, albedo=st.floats(0, 1), metres=st.floats(1e-6, 1e7))
def test_veil(extinction, albedo, metres):
    medium = Homogeneous(absorption_coefficient=[(1 - albedo) * extinction] * 3,
                         scattering_coefficient=[albedo * extinction] * 3)
    near, far = (veil(medium, np.zeros(3), np.array([[0, 0, -1.0]]), np.array([d]))[0] for d in (metres, 2 * metres))
    assert (0 <= near).all() and (near <= far).all() and (far <= albedo * (1 + 1e-12) + 1e-300).all()
    # concave in depth; an ulp
    assert (far <= 2 * near * (1 + 1e-12)).all()


@PURE
@given(st.lists(st.tuples(st.floats(0, 1e6), st.floats(0, 1e6), st.floats(0, 1)), min_size=1, max_size=5),
       st.floats(0, 1))
def test_transmittance_lies_between_those_of_the_lights(lights, eye):
    arriving = [(np.full(3, strength), np.full((1, 1, 3), clear), np.full((1, 1, 3), clear * through),
                 np.zeros((1, 1, 3)), np.zeros((1, 1, 3))) for strength, clear, through in lights]
    t = combined_transmittance(np.full((1, 1, 3), eye), arriving)
    lit = [through for strength, clear, through in lights if strength * clear > 1e-290] or [eye]
    if any(strength * clear > 0 and through > 1e-200 and strength * clear * through <= 1e-290
           or 0 < strength * clear <= 1e-290 for strength, clear, through in lights):
        return  # so little light that its products underflow
    # what is below 1e-200 may underflow on the way
    assert min(lit) * (1 - 1e-12) - 1e-200 <= t.min() and t.max() <= max(lit) * (1 + 1e-12)
