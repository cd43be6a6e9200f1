"""Formulas that must not lose digits, against 50-digit or long double arithmetic, and what the direct form would keep."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from pipeline.estimation.spherical import angles_between
from pipeline.physics.airlight import _logarithmic_mean, veil
from pipeline.physics.bulbs import bulb
from pipeline.physics.bulb_integral import Lamp, _met
from pipeline.plugins.media.height import Height
from pipeline.plugins.media.homogeneous import Homogeneous
from pipeline.plugins.phase_functions.henyey_greenstein import HenyeyGreenstein

LONG = np.longdouble


def digits(value, reference) -> float:
    """Decimal digits that agree, at most 16."""
    return float(min(16.0, -np.log10(max(abs(LONG(value) / LONG(reference) - 1), LONG(1e-16)))))


def even(extinction: float) -> Homogeneous:
    return Homogeneous(absorption_coefficient=[0.0] * 3, scattering_coefficient=[extinction] * 3,
                       phase_function={"type": "isotropic"})


@pytest.mark.parametrize("tau, lost", [(1e-3, 2), (1e-9, 6), (1e-12, 3), (1e-16, 15)])
def test_veil_of_thin_fog(tau, lost):
    with localcontext() as context:
        context.prec = 50
        reference = 1 - (-Decimal(tau)).exp()
    value = veil(even(tau), np.zeros(3), np.array([[0.0, 0, -1]]), np.ones(1))[0, 0]
    direct = 1 - np.exp(-tau)
    assert digits(value, reference) > 15
    assert digits(direct, reference) < 16 - lost


@pytest.mark.parametrize("rise", [1e-3, 1e-6])
def test_column_of_a_thin_rise_in_high_fog(rise):
    """Fog that falls off over 10 km, across a rise of a millimetre."""
    fog = Height(absorption_coefficient=[0.0] * 3, scattering_coefficient=[1.0] * 3, scale_height=1e4)
    low, high = np.float64(100.0), np.float64(100.0) + rise
    with localcontext() as context:
        context.prec = 50
        reference = Decimal(10**4) * ((-Decimal(float(low)) / 10**4).exp() - (-Decimal(float(high)) / 10**4).exp())
    direct = 1e4 * (np.exp(-low / 1e4) - np.exp(-high / 1e4))
    assert digits(fog.column(low, high), reference) > 14.5
    assert digits(direct, reference) < 12


@pytest.mark.parametrize("asymmetry", [0.999, -0.999])
@pytest.mark.parametrize("off_peak", [0.0, 1e-12, 1e-6])
def test_peak_of_the_sharpest_phase_function(asymmetry, off_peak):
    cosine = np.sign(asymmetry) * (1 - off_peak)
    with localcontext() as context:
        context.prec = 50
        g, mu = Decimal(asymmetry), Decimal(float(cosine))
        squared = 1 + g * g - 2 * g * mu
        reference = (1 - g * g) / (4 * squared * squared.sqrt())
    value = HenyeyGreenstein(asymmetry=asymmetry).value(cosine) * np.pi
    direct = (1 - asymmetry**2) / (4 * (1 + asymmetry**2 - 2 * asymmetry * cosine) ** 1.5)
    # 1 - 0.999 keeps 13 of its digits, whose cube stands below the line
    assert digits(value, reference) > 12, digits(value, reference)
    assert digits(direct, reference) < 11


@pytest.mark.parametrize("distance, lost", [(1e3, 3), (1e5, 7), (1e7, 12)])
def test_how_near_a_ray_passes_a_far_lamp(distance, lost):
    aside = 0.05
    lamp = Lamp(np.array([aside, 0.0, -distance]), 0.02)
    rays, _, _ = _met(np.zeros(3), np.array([[0.0, 0.0, -1.0]]), np.array([5.0]), lamp)
    turned = np.array([[np.sin(1e-9), 0.0, -np.cos(1e-9)]])
    slanted, _, _ = _met(np.zeros(3), turned, np.array([5.0]), lamp)
    assert digits(rays.aside[0], LONG(aside) ** 2) > 15
    exact = (LONG(aside) * LONG(turned[0, 2]) + LONG(distance) * LONG(turned[0, 0])) ** 2
    # the offset's own rounding: 1e-16 of the distance
    assert abs(slanted.aside[0] - float(exact)) <= 1e-14 * distance * max(np.sqrt(float(exact)), 1e-14 * distance)
    direct = (lamp.position**2).sum() - (turned[0] @ lamp.position) ** 2
    assert digits(direct, exact) < 16 - lost


@pytest.mark.parametrize("distance, lost", [(1e2, 4), (1e4, 8), (1e6, 12)])
def test_glow_of_a_far_lamp_in_thin_fog(distance, lost):
    """Of the first five metres: V = extinction / (4 pi) (atan - atan) / H."""
    width = LONG(0.02)
    value = bulb(even(1e-15), np.zeros(3), np.array([[0.0, 0.0, -1.0]]), np.array([5.0]),
                 np.array([0.0, 0.0, -distance]), 0.02)[0, 0]
    turn = np.arctan2(width * 5, width**2 + (LONG(distance) - 5) * LONG(distance))
    reference = LONG(1e-15) / (4 * np.pi) * turn / width
    direct = np.arctan((5 - distance) / 0.02) - np.arctan(-distance / 0.02)
    # the fog takes 1e-15 of it a metre, on the way to the lamp too; the node's own place keeps eight digits
    assert digits(value, reference) > (12.5 if distance < 1e4 else 8.5)
    assert digits(direct, turn) < 16 - lost


@pytest.mark.parametrize("drop", [0.0, 1e-12, 1e-6, 1e-3, 50.0])
def test_mean_between_nearly_equal_logarithms(drop):
    value = _logarithmic_mean(np.array([0.0, -drop]))[0]
    with localcontext() as context:
        context.prec = 50
        reference = Decimal(1) if drop == 0 else (1 - (-Decimal(drop)).exp()) / Decimal(drop)
    assert digits(value, reference) > 12  # the series leaves drop^2 / 6 at 1e-6


@pytest.mark.parametrize("angle", [1e-3, 1e-6, 1e-9])
def test_small_angles(angle):
    a, b = np.array([0.0, 0, -1]), np.array([np.sin(angle), 0, -np.cos(angle)])
    assert digits(angles_between(a, b), angle) > 15
    assert digits(np.arccos(np.clip(a @ b, -1, 1)) or 1e-300, angle) < 12
