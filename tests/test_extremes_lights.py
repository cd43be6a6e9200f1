"""Lamps and suns where they are awkward, and scenes in any unit, through the command line."""

from __future__ import annotations

import numpy as np
import pytest

from tests.extremes.scenes import BULB, described, even, refusal, run

#: A render is in half floats, 2^-11 each.
HALF_FLOATS = 2e-3
PLACES = {
    "in view": [0, 1.2, -3], "on a surface": [0.5, 2.5, -3], "behind the camera": [0, 1.2, 0.8],
    "outside the frame": [-1.9, 1.2, 0.1], "touching the eye": [0.005, 1.2, 0], "at the eye": [0, 1.2, 0]}


def bulb(place: list[float], strength: float = 1.0) -> dict:
    return {"type": "point", "position": {"point": place}, "intensity": [strength] * 3, "radius": 0.02}


@pytest.mark.parametrize("place", PLACES)
def test_places_of_a_lamp(tmp_path, place):
    """V of a bulb of radius r is below delta p I times the airlight integral of clear air, pi / r at most."""
    found = run(tmp_path, described({"bulb": bulb(PLACES[place])}, even(0, 0.3)))
    bound = 0.3 / (4 * np.pi) * np.pi / 0.02
    assert found.in_scattering.max() <= bound * (1 + HALF_FLOATS)
    # light at the eye and in the room reaches every ray
    assert found.in_scattering.min() > 0
    eye = np.exp(-0.3 * found.depth)[..., None]
    assert (found.transmittance <= eye * (1 + HALF_FLOATS)).all()


WINDOW = np.array([[-2, 1, -3.5], [-2, 2, -3.5], [-2, 2, -2.5], [-2, 1, -2.5]])


def sun(direction: list[float] | None, patch: np.ndarray) -> dict:
    return {"type": "sun", "irradiance": [3, 3, 3], **({"direction": direction} if direction else {}),
            "openings": {"window": {"window": {"points": WINDOW.tolist()}, "patches": [{"points": patch.tolist()}]}}}


@pytest.mark.parametrize("direction,travelled", [
    ([1, -1e-4, 0], 4.0), ([1, 0, 0], 4.0), ([0.8, -0.6, 0], WINDOW[:, 1:2] / 0.6)],
    ids=["at the horizon", "parallel to the floor", "in the image plane"])
def test_places_of_the_sun(tmp_path, direction, travelled):
    """V is what a ray lit all along would show at most, E p delta/kappa (1 - T_eye), and 0 outside the shaft."""
    patch = WINDOW + travelled * np.array(direction)
    found = run(tmp_path, described({"sun": sun(direction, patch)}, even(0, 0.3)))
    bound = 3 / (4 * np.pi) * -np.expm1(-0.3 * found.depth)[..., None]
    assert 0 < found.in_scattering.max() and (found.in_scattering <= bound * (1 + HALF_FLOATS)).all()
    # the shaft ends at z = -3.5 and -2.5; the top row of pixels looks over it to the ceiling before z = -2.5
    assert not found.in_scattering[0].any()


@pytest.mark.parametrize("direction", [[-1, -0.2, 0], [0, -1, 0], [0, 0, -1]])
def test_sun_behind_the_wall(tmp_path, capsys, direction):
    """Light that leaves by its window, or passes along it, is refused in one line."""
    lights = {"sun": sun(direction, WINDOW + [4.0, 0, 0])}
    assert "does not enter through window 'window'" in refusal(tmp_path, described(lights), capsys)


def test_patches_that_no_sun_explains(tmp_path, capsys):
    """A patch on the wall behind its window."""
    lights = {"sun": sun(None, WINDOW + [-1.0, 3.0, 0])}
    assert "no sun direction explains" in refusal(tmp_path, described(lights), capsys)


@pytest.mark.parametrize("scale", [1e-3, 1e-2, 100.0, 1e3])
def test_units(tmp_path, scale):
    """All lengths times s, coefficients times 1/s, intensities times s^2: the same T, V and C."""
    def scene(s):
        at = lambda *point: [s * x for x in point]
        light = {"type": "point", "position": {"point": at(1.2, 1.4, -4)}, "intensity": [0.5 * s * s] * 3,
                 "radius": 0.02 * s}
        return described(
            {"bulb": light}, even(0.1 / s, 0.3 / s),
            camera={"horizontal_field_of_view": 70, "position": at(0, 1.2, 0), "look_at": at(0, 1.2, -5)},
            shapes={"room": {"type": "room", "lower": at(-2, 0, -5), "upper": at(2, 2.5, 1)}})

    metres, other = run(tmp_path / "metres", scene(1.0)), run(tmp_path / "other", scene(scale))
    assert np.allclose(other.depth, scale * metres.depth, rtol=1e-6)  # float32
    for one in ("transmittance", "in_scattering", "foggy"):
        assert np.allclose(getattr(other, one), getattr(metres, one), rtol=HALF_FLOATS), one


def test_superposition(tmp_path):
    """V of two lamps is the sum of each one's; T of both lies between that of each."""
    one, other = bulb([1.2, 1.4, -4]), bulb([-1, 2.2, -2], 0.3)
    alone = [run(tmp_path / name, described({name: light})) for name, light in (("a", one), ("b", other))]
    both = run(tmp_path / "both", described({"a": one, "b": other}))
    # the same renders, added in float64 and stored in float32
    assert np.allclose(both.in_scattering, sum(m.in_scattering for m in alone), rtol=1e-6)
    low, high = (pick(*(m.transmittance for m in alone)) for pick in (np.minimum, np.maximum))
    assert (both.transmittance >= low * (1 - 1e-6)).all() and (both.transmittance <= high * (1 + 1e-6)).all()


def test_mirror(tmp_path):
    """The mirrored scene shows the mirrored maps."""
    left = run(tmp_path / "left", described({"bulb": bulb([1.2, 1.4, -4])}))
    right = run(tmp_path / "right", described({"bulb": bulb([-1.2, 1.4, -4])}))
    for one in ("transmittance", "in_scattering", "depth"):
        assert np.allclose(getattr(left, one), getattr(right, one)[:, ::-1], rtol=HALF_FLOATS), one
