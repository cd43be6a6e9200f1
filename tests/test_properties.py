"""Laws over generated scenes: few of them through the whole chain, many through the plugins' own values."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.physics.composition import composite
from pipeline.plugins.lights.point import Point
from pipeline.plugins.media.height import Height
from pipeline.plugins.media.layers import Layers
from pipeline.plugins.phase_functions.henyey_greenstein import HenyeyGreenstein
from tests.extremes.scenes import described, run

#: Renders are in half floats, 2^-11 each.
HALF_FLOATS = 2e-3
SMALL = (16, 12)
FEW = settings(max_examples=3, derandomize=True, deadline=None)
MANY = settings(max_examples=200, derandomize=True, deadline=None)
places = st.tuples(st.floats(-1.8, 1.8), st.floats(0.2, 2.3), st.floats(-4.8, -0.5))
colours = st.tuples(*[st.floats(0.05, 5)] * 3)
#: From nothing the eye sees to an optical depth of some ten across the room.
coefficients = st.tuples(*[st.floats(-6, 0).map(lambda x: 10.0**x)] * 3)
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1).map(
    lambda d: np.array(d) / np.linalg.norm(d))


def fog(scattering, absorption=(0.0, 0.0, 0.0)) -> dict:
    return {"type": "homogeneous", "absorption_coefficient": list(absorption),
            "scattering_coefficient": list(scattering), "phase_function": {"type": "isotropic"}}


def bulb(place, colour) -> dict:
    return {"type": "point", "position": {"point": list(place)}, "intensity": list(colour)}


def shown(lights: dict, medium: dict):
    """Maps of a scene in a folder of its own; that they are finite and sane is checked there."""
    with tempfile.TemporaryDirectory() as folder:
        return run(Path(folder), described(lights, medium), SMALL)


@FEW
@given(places, colours, coefficients)
def test_channels_do_not_mix(place, colour, scattering):
    """Channels permuted in light and fog: permuted in T and V."""
    order = [2, 0, 1]
    one = shown({"a": bulb(place, colour)}, fog(scattering))
    other = shown({"a": bulb(place, np.take(colour, order))}, fog(np.take(scattering, order)))
    for name in ("transmittance", "in_scattering"):
        assert np.allclose(getattr(one, name)[..., order], getattr(other, name), rtol=HALF_FLOATS, atol=1e-12), name


@FEW
@given(places, colours, coefficients)
def test_mirror(place, colour, scattering):
    mirrored = (-place[0], *place[1:])
    one, other = (shown({"a": bulb(p, colour)}, fog(scattering)) for p in (place, mirrored))
    for name in ("transmittance", "in_scattering", "depth"):
        # a bulb within a pixel's ray is sampled at the same places from either side
        assert np.allclose(getattr(one, name), getattr(other, name)[:, ::-1], rtol=HALF_FLOATS, atol=1e-12), name


@FEW
@given(places, coefficients, st.floats(1.0, 100.0))
def test_denser_is_never_clearer(place, scattering, factor):
    thin, thick = (shown({"a": bulb(place, (1, 1, 1))}, fog(np.multiply(scattering, f))) for f in (1.0, factor))
    assert (thick.transmittance <= thin.transmittance * (1 + HALF_FLOATS)).all()


@pytest.mark.parametrize("medium", [
    Height(scale_height=3.0, visibility=10.0), Height(scale_height=1e-3, visibility=0.1, top_height=0.01),
    Layers(layers=[{"lower": -1, "upper": 1, "density": 3}, {"lower": 0.5, "upper": 2}], visibility=10.0)],
    ids=["height", "thin height", "layers"])
@MANY
@given(directions, st.floats(-5, 5), st.floats(0, 1e4), st.floats(0, 1))
def test_paths_add_up(medium, direction, height, length, share):
    """Optical depth of a way is that of its two parts, and never negative."""
    start = np.array([0, height, 0])
    middle, end = start + share * length * direction, start + length * direction
    whole, first, second = (float(medium.density_path(a, b)) for a, b in (
        (start, end), (start, middle), (middle, end)))
    assert np.isfinite(whole) and whole >= 0
    # heights are rounded at their ends' own size; a way nearly level is `length / rise` times as sensitive to that
    rise = abs(end[1] - start[1])
    sensitive = 1e-14 * (1 + abs(height) + length) * (1 + length / max(rise, 1e-9 * length, 1e-300)) * 3e3
    assert first + second == pytest.approx(whole, rel=1e-9, abs=sensitive)


@MANY
@given(st.floats(-0.999, 0.999), st.floats(-1, 1))
def test_phase_function_lies_between_its_ends(g, cosine):
    """p is monotone in the cosine: between p(-1) and p(1), finite and positive."""
    phase = HenyeyGreenstein(asymmetry=g)
    low, high = sorted((float(phase.value(-1.0)), float(phase.value(1.0))))
    # some roundings at the narrow peak, (1-g)^2 of 1
    assert 0 < low * (1 - 1e-9) <= phase.value(cosine) <= high * (1 + 1e-9) < np.inf


@MANY
@given(places, places, st.floats(-3, 3).map(lambda x: 10.0**x))
def test_light_in_any_unit(place, point, scale):
    """Irradiance of unit intensity falls with the square of the unit, the path grows with it."""
    one, other = (Point(position={"point": [s * x for x in place]}, radius=0.02 * s) for s in (1.0, scale))
    irradiance, path = one.incident(np.array(point))
    scaled, longer = other.incident(scale * np.array(point))
    assert scaled * scale**2 == pytest.approx(irradiance, rel=1e-9)
    assert longer == pytest.approx(scale * path, rel=1e-9, abs=1e-12 * scale)


@MANY
@given(colours, st.tuples(*[st.floats(0, 1)] * 3), colours)
def test_composite_lies_between(clear, through, added):
    """V <= R T + V <= R + V."""
    clear, through, added = (np.array(x, float).reshape(1, 1, 3) for x in (clear, through, added))
    foggy = composite(clear, through, added)
    assert (foggy >= added * (1 - 1e-6)).all() and (foggy <= (clear + added) * (1 + 1e-6)).all()
