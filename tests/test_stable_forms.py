"""Formulas that would lose digits, against 50-digit decimals; and how many digits the direct form loses."""

from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
import pytest

from pipeline.estimation.spherical import angles_between
from pipeline.physics.light_volume import polar_angle
from pipeline.plugins.media.height import Height
from pipeline.plugins.phase_functions.henyey_greenstein import HenyeyGreenstein

getcontext().prec = 50
#: Some roundings of float64.
ROUNDINGS = 1e-15


def relative(value: float, reference: Decimal) -> float:
    return float(abs(Decimal(float(value)) / reference - 1))


@pytest.mark.parametrize("rise", [1e-12, 1e-8, 1e-3])
def test_column_of_height_fog(rise):
    """Integral of exp(-h/H) over a small rise: expm1 keeps the digits that a difference of exponentials loses."""
    fog = Height(scale_height=100.0, visibility=10.0)
    exact = Decimal(100) * (1 - (-Decimal(rise) / 100).exp())
    direct = 100 * (1 - np.exp(-rise / 100))
    stable = relative(fog.column(np.array(0.0), np.array(rise)), exact)
    assert stable <= ROUNDINGS
    # the difference is rounded to 1e-16 and is rise / 100 long: at 1e-12 hardly two digits are left
    assert relative(direct, exact) >= 0.01 * 1e-16 / (rise / 100) > stable / 10


@pytest.mark.parametrize("g", [0.999, 0.99])
def test_forward_peak(g):
    """At the peak 1 + g^2 - 2 g cos cancels: (1-g)^2 + 2g(1-cos) keeps the digits."""
    exact_g = Decimal(g)
    exact = (1 + exact_g) / (4 * Decimal("3.14159265358979323846264338327950288") * (1 - exact_g) ** 2)
    direct = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g) ** 1.5)
    stable = relative(HenyeyGreenstein(asymmetry=g).value(1.0), exact)
    assert stable <= 1e-13  # 1 - g^2 itself is rounded to 1e-16 of 1
    assert relative(direct, exact) >= 10 * stable


@pytest.mark.parametrize("angle", [1e-9, 1e-7, 1e-5])
def test_small_angles(angle):
    """arctan2 of cross and dot product, where arccos sees nothing below 1e-8."""
    one, other = np.array([0, 0, 1.0]), np.array([np.sin(angle), 0, np.cos(angle)])
    direct = np.arccos(np.clip(one @ other, -1, 1))
    assert abs(angles_between(one, other) / angle - 1) <= ROUNDINGS
    assert abs(direct / angle - 1) >= 1e-8


@pytest.mark.parametrize("offset", [1e-9, 1e-7, 1e-5])
def test_polar_angle_below_a_lamp(offset):
    """Seen from a lamp, a point a little off its axis: arctan2(hypot(x, z), y) keeps the angle, arccos(y/r) loses it."""
    exact = Decimal(offset) - Decimal(offset) ** 3 / 3 + Decimal(offset) ** 5 / 5
    assert relative(polar_angle(np.array(offset), np.array(1.0), np.array(0.0)), exact) <= ROUNDINGS
    assert relative(np.arccos(np.clip(1 / np.sqrt(1 + offset * offset), -1, 1)), exact) >= 1e-8
