"""Clearances of fits as they run (warm, pressed into a housing) and of rolling bearings, against independent values."""

from itertools import pairwise
from typing import Any

import jax
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax.joints import Fitting, PressFit, rolling_bearing
from clearance_jax.joints.bearings import OF_BALLS, OF_ROLLERS, tabulated_clearance
from clearance_jax.joints.fitting import REFERENCE_TEMPERATURE

pytestmark = pytest.mark.quick

DIAMETER = 0.02


def bounds(fitting, diameter=DIAMETER):
    mean, made = fitting.radial_clearance(diameter)
    return np.array([made.least, mean, made.greatest])


def test_a_fit_at_twenty_degrees_has_the_clearance_of_its_tables():
    """H7/g6 at 20 mm: 7 to 41 um at the diameter (FACTS, section 9); half of it, and half of the mean."""
    np.testing.assert_allclose(bounds(Fitting("H7/g6")), [3.5e-6, 12e-6, 20.5e-6], rtol=1e-12)


def test_warmth_widens_a_sleeve_that_grows_more_than_its_pin():
    """By R (alpha_s - alpha_p) dT, and all sizes by alpha dT where both are of one solid."""
    # At 20 mm the hole H7 is 0 to 21 um larger, the shaft g6 7 to 20 um smaller.
    hole, shaft = 0.02 + np.array([0, 10.5, 21]) * 1e-6, 0.02 - np.array([7, 13.5, 20]) * 1e-6
    warm = bounds(Fitting("H7/g6", REFERENCE_TEMPERATURE + 60, pin_expansion=11e-6, sleeve_expansion=18e-6))
    np.testing.assert_allclose(warm, (hole * (1 + 18e-6 * 60) - shaft * (1 + 11e-6 * 60)) / 2, rtol=1e-10)
    cold = bounds(Fitting("H7/g6"))
    alike = bounds(Fitting("H7/g6", REFERENCE_TEMPERATURE + 60, pin_expansion=11e-6, sleeve_expansion=11e-6))
    np.testing.assert_allclose(alike, cold * (1 + 11e-6 * 60), rtol=1e-12)
    slope = jax.grad(lambda t: Fitting("H7/g6", t).radial_clearance(DIAMETER)[0])(350.0)
    assert float(slope) == pytest.approx(DIAMETER / 2 * (18e-6 - 11.5e-6), rel=5e-3)


def elastic(a, b, c, bush, housing):
    """By what part of their interference at b a bush's bore closes: its field u = A r + B / r, and that of the housing,
    by the equations of equilibrium and compatibility.
    """

    def radial_stress(r, modulus, poisson):
        # Of (A, B): plane stress.
        return modulus / (1 - poisson**2) * np.array([1 + poisson, -(1 - poisson) / r**2])

    rows = np.zeros((4, 4))
    rows[0, :2] = radial_stress(a, *bush)
    rows[1, :2], rows[1, 2:] = radial_stress(b, *bush), -radial_stress(b, *housing)
    rows[2, 2:] = radial_stress(c, *housing)
    rows[3] = [-b, -1 / b, b, 1 / b]
    found = np.linalg.solve(rows / np.abs(rows).max(axis=1, keepdims=True), [0, 0, 0, 1 / np.abs(rows[3]).max()])
    return -(found[0] * a + found[1] / a)


@pytest.mark.parametrize(("bore", "housing"), [(0.020, 0.060), (0.024, 0.030), (0.005, 0.2)])
def test_the_bore_of_a_bush_closes_as_elasticity_has_it(bore, housing):
    press = PressFit("H7/p6", 0.026, housing, 103e9, 0.34, 207e9, 0.29)
    expected = elastic(bore / 2, 0.013, housing / 2, (103e9, 0.34), (207e9, 0.29))
    assert float(press.part(bore)) == pytest.approx(expected, rel=1e-10)


def test_a_bush_of_its_housings_own_solid_has_closed_forms():
    """A / b of the interference in a large housing, (a/b) (c^2 - b^2) / (c^2 - a^2) in one of the radius c."""
    alike: Any = {"bush_modulus": 2e11, "bush_poisson": 0.3, "housing_modulus": 2e11, "housing_poisson": 0.3}
    a, b, c = 0.010, 0.013, 0.030
    assert float(PressFit("H7/p6", 2 * b, **alike).part(2 * a)) == pytest.approx(a / b, rel=1e-12)
    finite = a / b * (c**2 - b**2) / (c**2 - a**2)
    assert float(PressFit("H7/p6", 2 * b, 2 * c, **alike).part(2 * a)) == pytest.approx(finite, rel=1e-12)


def test_a_pressed_bush_narrows_and_a_warm_housing_lets_it_go():
    """H7/p6 at 26 mm interferes by 1 to 35 um, 18 in the mean (p6: +22 to +35; H7: 0 to +21)."""
    press = PressFit("H7/p6", 0.026, 0.06)
    part = float(press.part(DIAMETER))
    loose, pressed = bounds(Fitting("H8/e8")), bounds(Fitting("H8/e8", press=press))
    np.testing.assert_allclose(loose - pressed, part * np.array([35, 18, 1]) * 1e-6 / 2, rtol=1e-9)
    # A housing of aluminium opens by more than the interference: the bore is as if it were free.
    aluminium = PressFit("H7/p6", 0.026, 0.06, housing_expansion=80e-6)
    hot = REFERENCE_TEMPERATURE + 60
    np.testing.assert_allclose(
        bounds(Fitting("H8/e8", hot, press=aluminium)), bounds(Fitting("H8/e8", hot)), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("make", "about"),
    [
        (lambda: Fitting("H7/s6").radial_clearance(0.02), ("fit", "H7/s6")),
        (lambda: Fitting("H7").radial_clearance(0.02), ("name", "H7")),
        (lambda: Fitting("H7/g6").radial_clearance(0.7), ("diameter", 0.7, 0.5)),
        (lambda: Fitting("H7/g6", -5.0).radial_clearance(0.02), ("temperature", -5.0, "greater than 0 K")),
        (
            lambda: Fitting("H7/g6", press=PressFit("H7/p6", 0.026, bush_modulus=-1.0)).radial_clearance(0.02),
            ("press.bush_modulus", -1.0),
        ),
        (
            lambda: jax.grad(lambda d: Fitting("H7/g6").radial_clearance(d)[0])(0.02),
            ("diameter", None),
        ),
        (lambda: PressFit("H7/p6", 0.019).part(0.02), ("diameter", 0.019)),
        (lambda: PressFit("H7/p6", 0.026, 0.025).part(0.02), ("housing_diameter", 0.025)),
    ],
)
def test_what_cannot_be_fitted_is_said(make, about):
    with refused(*about):
        make()


# Bearings ------------------------------------------------------------------------------------------------------------


def test_groups_of_bearings_are_those_of_makers_tables():
    """Entries of makers' tables, um at the diameter; groups and bores grow."""
    assert tabulated_clearance(0.025) == pytest.approx((5e-6, 20e-6))
    assert tabulated_clearance(0.024, "C3") == pytest.approx((13e-6, 28e-6))
    assert tabulated_clearance(0.06, "C5") == pytest.approx((55e-6, 90e-6))
    assert tabulated_clearance(0.045, "C4", rollers=True) == pytest.approx((70e-6, 100e-6))
    for table in (OF_BALLS, OF_ROLLERS):
        assert list(table) == sorted(table)
        for row in table.values():
            assert all(low[0] <= high[0] and low[1] < high[1] for low, high in pairwise(row))
        for smaller, larger in pairwise(table.values()):
            assert all(np.all(np.subtract(y, x) >= 0) for x, y in zip(smaller, larger, strict=False))


def force(bearing, depth):
    """Of a joint without damping and friction, at a penetration [m]."""
    law = bearing.normal
    exponent = 1.5 if law.exponent is None else float(law.exponent)
    return float(law.stiffness) * depth**exponent


def test_the_stiffness_of_bearings_is_that_of_handbooks():
    """dF/dd of K (Z^2 D F)^(1/3) with K = 13e6 of balls, 1e9 l^0.8 Z^0.9 F^0.1 of rollers (Krämer, Dynamics of rotors
    and foundations, 1993; two digits each, for bearings without play: 4.37 and 4.08 in the place of 5).
    """
    ball = rolling_bearing(0.03, balls=8, ball_diameter=0.03)
    depth = 1e-5
    load = force(ball, depth)
    expected = 13e6 * (8**2 * 0.03 * load) ** (1 / 3) * (4.37 / 5) ** (2 / 3)
    assert 1.5 * load / depth == pytest.approx(expected, rel=0.02)
    roller = rolling_bearing(0.03, internal_clearance=1e-5, rollers=12, roller_length=0.01)
    load = force(roller, depth)
    expected = 1e9 * 0.01**0.8 * 12**0.9 * load**0.1 * (4.08 / 5) ** 0.9
    assert 10 / 9 * load / depth == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("internal", "expected"), [(1e-7, 16.9905e-6), (1e-5, 23.224e-6)])
def test_a_bearing_gives_way_as_iso_16281_has_it(internal, expected):
    """Six balls of 11.1 mm under 1 kN, without and with 10 um of clearance: a published calculation by ISO/TS 16281,
    ball by ball, of how far the inner ring goes. (Palmgren's estimate knows no conformity: 5 %.)
    """
    bearing = rolling_bearing(0.03, internal_clearance=internal, balls=6, ball_diameter=0.0111)
    depth = (1000.0 / force(bearing, 1.0)) ** (1 / 1.5)
    assert float(bearing.radial_clearance) + depth == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({}, "needs either `balls`"),
        ({"balls": 9}, "needs either `balls`"),
        ({"balls": 9, "ball_diameter": 0.008, "rollers": 9}, "needs either `balls`"),
        ({"balls": 2, "ball_diameter": 0.008}, "at least 3 `balls`"),
        ({"balls": 9, "ball_diameter": float("nan")}, "`ball_diameter` must be finite"),
        (
            {"balls": 9, "ball_diameter": 0.008, "internal_clearance": -1e-6},
            "`internal_clearance` must be greater than 0 m",
        ),
        (
            {"balls": 9, "ball_diameter": 0.008, "group": "CN", "internal_clearance": 1e-5},
            "`group` has no effect beside the",
        ),
        ({"balls": 9, "ball_diameter": 0.008, "group": "C6"}, "`group` must be one of ISO 5753-1, but it is 'C6'"),
        ({"bore": 0.2, "rollers": 12, "roller_length": 0.02}, "`bore` must be from 2.5 to 100 mm"),
        ({"bore": 0.2, "balls": 9, "ball_diameter": 0.02}, "`bore` must be from 2.5 to 100 mm"),
        ({"bore": 0.005, "group": "C4", "balls": 9, "ball_diameter": 0.001}, "no `group` C4 of a bore of 5 mm"),
    ],
)
def test_what_is_no_bearing_is_said(numbers, words):
    with pytest.raises(cj.ClearanceError, match=words):
        rolling_bearing(**({"bore": 0.025} | numbers))
