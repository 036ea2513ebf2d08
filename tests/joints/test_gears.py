"""Backlash of gears against examples of standards, another form of the geometry, and numbers from elsewhere."""

import itertools
import math

import numpy as np
import pytest
from places import ANY, refused

from clearance_jax.joints import gears
from clearance_jax.joints.gears import (
    ARC_MINUTE,
    COMMON,
    PRESSURE_ANGLE,
    assumed_transmission_error,
    backlash,
    flank_tolerances,
    least_normal_backlash,
    normal_backlash,
    thickness_allowances,
)

pytestmark = pytest.mark.quick
SMALL, LARGER = (1e-3, (20, 40)), (2e-3, (20, 40))


def arcmin(angles):
    return np.array(angles) / ARC_MINUTE


def um(lengths):
    return np.array(lengths) * 1e6


# Tables --------------------------------------------------------------------------------------------------------------


def test_the_example_of_the_standard():
    """DIN 3967, 3.1: 27cd at 100 mm. Both orders of the designation are read."""
    for name in ("27cd", "cd27", " cd27 "):
        assert thickness_allowances(0.1, name) == pytest.approx((-170e-6, -70e-6), rel=1e-12)


@pytest.mark.parametrize(
    ("diameter", "name", "lower", "upper"),
    [
        (0.01, "e24", -34, -22),
        (0.0101, "e24", -50, -30),
        (0.05, "c25", -95, -65),
        (0.2, "d26", -160, -80),
        (0.4, "ab21", -290, -280),
        (0.9, "h30", -800, 0),
        (8.0, "a29", -3600, -2000),
    ],
)
def test_other_allowances(diameter, name, lower, upper):
    assert um(thickness_allowances(diameter, name)) == pytest.approx((lower, upper), rel=1e-12)


def test_tables_are_complete_and_monotone():
    assert set(map(len, (*gears.ALLOWANCES.values(), *gears.TOLERANCES.values()))) == {len(gears.RANGES)}
    thick, wide = np.array(list(gears.ALLOWANCES.values())), np.array(list(gears.TOLERANCES.values()))
    assert np.all(np.diff(thick, axis=0) < 0)
    assert np.all(np.diff(wide, axis=0) > 0)
    assert np.all(np.diff(thick[:-1], axis=1) > 0)
    assert np.all(np.diff(wide, axis=1) > 0)
    assert list(gears.TOLERANCES) == list(range(21, 31))


def test_tolerances_of_one_series_are_the_next_finer_ones_of_larger_gears():
    """The standard's tolerances are one row of preferred numbers, through which series and diameters step."""
    preferred = [3, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 130, 160, 200, 250, 300, 400, 500, 600]
    preferred += [800, 1000, 1300, 1600, 2000, 2400]
    assert {x for row in gears.TOLERANCES.values() for x in row} == set(preferred)
    for row in gears.TOLERANCES.values():
        steps = np.diff([preferred.index(x) for x in row])
        assert set(steps[1:]) <= {1, 2}, row


# Backlash ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "arc", "angle"), [("cd25", (108, 168), (18.6, 28.9)), ("22g", (14, 30), (2.4, 5.2))])
def test_backlash_at_the_nominal_centre_distance(name, arc, angle):
    found = backlash(*SMALL, name)
    assert um(found.circumferential) == pytest.approx(arc, rel=1e-9)
    assert arcmin(found.wheel_angle) == pytest.approx(angle, abs=0.05)
    assert arcmin(found.pinion_angle) == pytest.approx(2 * arcmin(found.wheel_angle), rel=1e-12)
    assert found.normal == pytest.approx(np.multiply(found.circumferential, math.cos(PRESSURE_ANGLE)), rel=1e-12)
    # The nominal distance may be given, and both gears may have a class of their own.
    assert backlash(*SMALL, (name, name), centre_distance=0.03) == found
    assert str(backlash(*SMALL, "cd25")) == "cd25: backlash 108 to 168 um, 18.56 to 28.88 arcmin at the wheel"


@pytest.mark.parametrize(
    ("further", "normal", "pinion"),
    [(0.01, 0.0068447033, 1.252), (0.05, 0.0343092750, 6.276), (0.1, 0.0688318290, 12.591)],
)
def test_backlash_of_a_larger_centre_distance(further, normal, pinion):
    """Digits of a computation of the flanks themselves (m = 2 mm, 20/40 teeth), all in mm and arcmin."""
    distance = 0.06 + further * 1e-3
    assert 1e3 * normal_backlash(*LARGER, distance) == pytest.approx(normal, abs=6e-11)
    # Of h, the thickest teeth have no allowance.
    made = backlash(*LARGER, "h25", centre_distance=distance)
    assert 1e3 * made.normal[0] == pytest.approx(normal, abs=6e-11)
    assert arcmin(made.pinion_angle)[0] == pytest.approx(pinion, abs=6e-4)
    assert made.normal[0] == pytest.approx(2 * further * 1e-3 * math.sin(PRESSURE_ANGLE), rel=0.01)


def by_thickness(module, teeth, distance, angle, shifts, allowances):
    """The backlash along the line of action [m] by the thickness of the teeth on the working circles; the diameters of
    a ring are below zero.
    """
    diameters = [module * z for z in teeth]
    distance = math.copysign(distance, sum(teeth))
    working = math.acos(sum(diameters) / 2 * math.cos(angle) / distance)
    opened = (math.tan(working) - working) - (math.tan(angle) - angle)
    pitch, left = [2 * distance * z / sum(teeth) for z in teeth], 0.0
    for d, wide, x, allowance in zip(diameters, pitch, shifts, allowances, strict=True):
        thick = module * (math.pi / 2 + 2 * x * math.tan(angle)) + allowance
        left -= wide * (thick / d - opened)
    return (math.pi * pitch[0] / teeth[0] + left) * math.cos(working)


@pytest.mark.parametrize(
    ("teeth", "shifts", "distance"),
    [
        ((20, 40), (0.0, 0.0), 0.0601),
        ((20, 40), (0.3, 0.25), 0.0611),
        ((17, 60), (-0.2, 0.1), 0.0770),
        ((20, -60), (0.0, 0.0), 0.03998),
        ((20, -60), (0.1, -0.3), 0.0405),
    ],
)
def test_the_formula_is_that_of_the_thickness_of_teeth(teeth, shifts, distance):
    found = normal_backlash(2e-3, teeth, distance, profile_shift=sum(shifts))
    expected = by_thickness(2e-3, teeth, distance, PRESSURE_ANGLE, shifts, (0.0, 0.0))
    assert found == pytest.approx(expected, abs=2e-15)
    loose = [thickness_allowances(2e-3 * abs(z), "c25")[1] for z in teeth]
    made = backlash(2e-3, teeth, "c25", centre_distance=distance, profile_shift=sum(shifts))
    assert made.normal[0] == pytest.approx(
        by_thickness(2e-3, teeth, distance, PRESSURE_ANGLE, shifts, loose), abs=2e-15
    )


def half_angle(radii, module, count):
    """Half of the angle over which a tooth, or the gap of a ring, is wide at some radii [m]."""
    reference = module * count / 2
    turned = np.arccos(reference * math.cos(PRESSURE_ANGLE) / radii)
    middle = math.pi / (2 * count) + math.tan(PRESSURE_ANGLE) - PRESSURE_ANGLE
    return middle - (np.tan(turned) - turned)


def test_flanks_of_a_ring_themselves():
    """A pinion turns in a ring, whose centres are too near, until a sampled point of a tooth reaches a flank."""
    module, count, ring, distance = 2e-3, 20, 60, 0.04 - 50e-6
    reference, outer = module * count / 2, module * ring / 2
    radii = np.linspace(1.0001 * reference * math.cos(PRESSURE_ANGLE), reference + module, 20_001)

    def overlap(turn):
        deepest = []
        for k in range(-3, 4):
            angles = turn + 2 * math.pi * k / count + half_angle(radii, module, count)
            x, y = distance + radii * np.cos(angles), radii * np.sin(angles)
            far = np.hypot(x, y)
            within = np.abs(far - outer) < module
            past = np.arctan2(y, x)[within] - 2 * math.pi * k / ring - half_angle(far[within], module, ring)
            deepest.append(past.max(initial=-1.0))
        return max(deepest)

    low, high = 0.0, 1e-2
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (low, middle) if overlap(middle) > 0 else (middle, high)
    expected = normal_backlash(module, (count, -ring), distance) / (reference * math.cos(PRESSURE_ANGLE))
    assert 2 * low == pytest.approx(expected, rel=1e-6)


def test_both_ends_of_a_centre_distance():
    """A tolerance to both sides, and one with two ends: the least backlash belongs to the tight end, of a ring to the
    wide one.
    """
    for teeth in ((20, 40), (20, -60)):
        nominal = abs(sum(teeth)) * 1e-3
        either = [backlash(2e-3, teeth, "cd25", centre_distance=nominal + x).normal for x in (-2e-5, 2e-5)]
        found = backlash(2e-3, teeth, "cd25", centre_tolerance=2e-5)
        assert found == backlash(2e-3, teeth, "cd25", centre_distance=nominal, centre_tolerance=(-2e-5, 2e-5))
        assert found.normal == pytest.approx((min(either)[0], max(either)[1]), rel=1e-12)
        assert (either[0] < either[1]) == (teeth[1] > 0)


def test_usual_classes_reach_from_loose_to_tight():
    found = [backlash(*LARGER, name) for name in COMMON]
    assert len(set(COMMON)) == len(COMMON)
    # g22 opens far less than every other one, ab25 more than all.
    assert found[-1].wheel_angle[1] < min(one.wheel_angle[1] for one in found[:-1])
    assert found[0].wheel_angle[0] > max(one.wheel_angle[0] for one in found[1:])


# Formulas of ISO -----------------------------------------------------------------------------------------------------


def test_the_least_backlash_that_is_recommended():
    for module, distance, gap in ((1, 30, 0.070), (2, 100, 0.113), (5, 150, 0.190)):
        assert 1e3 * least_normal_backlash(module * 1e-3, distance * 1e-3) == pytest.approx(gap, abs=5e-4)


def test_flank_tolerances():
    found = flank_tolerances(3e-3, 40, 6)
    assert 1e6 * found["single_pitch"] == pytest.approx(8.94, abs=5e-3)
    assert found["profile"] == pytest.approx(math.hypot(found["profile_slope"], found["profile_form"]))
    # Class 5 has the factor 1: the formulas by hand, in um.
    by_hand = {"single_pitch": 6.32, "cumulative_pitch": 20.364949, "profile_slope": 5.32, "profile_form": 6.65}
    middle = flank_tolerances(3e-3, 40, 5)
    assert {name: 1e6 * middle[name] for name in by_hand} == pytest.approx(by_hand, rel=1e-7)
    for fine, coarse in itertools.pairwise(flank_tolerances(3e-3, 40, k)["profile"] for k in range(1, 12)):
        assert coarse / fine == pytest.approx(math.sqrt(2))


def test_the_error_that_is_assumed():
    tolerances, radius = flank_tolerances(3e-3, 40, 6), 0.06 * math.cos(PRESSURE_ANGLE)
    found = assumed_transmission_error(3e-3, 40, 6)
    halves = [tolerances[name] / 2 / radius for name in ("cumulative_pitch", "single_pitch")]
    assert found == pytest.approx(halves, rel=1e-12)


# Mistakes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "about"),
    [
        ((0.0, (20, 40), "cd25"), ("module", 0.0)),
        ((-1e-3, (20, 40), "cd25"), ("module", -1e-3)),
        ((float("nan"), (20, 40), "cd25"), ("module", ANY, "finite")),
        ((1e-3, (4, 40), "cd25"), ("teeth",)),
        ((1e-3, (20, 4), "cd25"), ("teeth",)),
        ((1e-3, (True, 40), "cd25"), ("teeth",)),
        ((1e-3, (20, -22), "cd25"), ("teeth",)),
        ((1e-3, (20, -12), "cd25"), ("teeth",)),
        ((1e-3, (20, 40), "dc25"), ("tolerance_class", "dc25", "cd25")),
        ((1e-3, (20, 40), "cd31"), ("tolerance_class", "cd31", "cd30")),
        ((1e-3, (20, 40), "H7"), ("tolerance_class", "H7")),
        ((1e-3, (20, 40), ("cd25", "")), ("tolerance_class", ANY, "h30")),
        ((1.0, (20, 15000), "cd25"), ("diameter", 20.0)),
    ],
)
def test_what_is_no_gear(arguments, about):
    with refused(*about):
        backlash(*arguments)


@pytest.mark.parametrize(
    ("mounting", "about"),
    [
        ({"centre_distance": 30.0}, ("centre_distance", 30.0, 0.03)),  # millimetres
        ({"centre_distance": 0.0321}, ("centre_distance", 0.0321)),
        ({"centre_distance": 0.028}, ("centre_distance", 0.028)),
        ({"centre_distance": -0.03}, ("centre_distance", -0.03)),
        ({"centre_tolerance": -1e-5}, ("centre_tolerance",)),
        ({"centre_tolerance": (1e-5, -1e-5)}, ("centre_tolerance",)),
        ({"centre_tolerance": float("nan")}, ("centre_tolerance",)),
        ({"centre_tolerance": 2e-4}, ("tolerance_class", "cd25")),  # it may jam
        ({"pressure_angle": 20.0}, ("pressure_angle", 20.0)),  # degrees
        ({"pressure_angle": float("nan")}, ("pressure_angle",)),
        ({"profile_shift": 0.5}, ("centre_distance",)),
        ({"profile_shift": float("nan"), "centre_distance": 0.03}, ("centre_distance",)),
        ({"profile_shift": 0.5, "centre_distance": 0.03}, ("tolerance_class", "cd25")),
    ],
)
def test_how_gears_are_not_mounted(mounting, about):
    with refused(*about):
        backlash(*SMALL, "cd25", **mounting)


def test_a_misspelt_class_is_corrected():
    with refused("tolerance_class", "cx25") as caught:
        backlash(*SMALL, "cx25")
    assert "Did you mean" in str(caught.value)
    assert "`cd25`" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "about"),
    [
        ((3e-3, 40, 0), ("flank_class", 0)),
        ((3e-3, 40, 12), ("flank_class", 12)),
        ((3e-3, 4, 6), ("teeth", 4)),
        ((3e-3, 1001, 6), ("teeth", 1001)),
        ((3e-3, -60, 6), ("teeth", -60)),
        ((0.4e-3, 40, 6), ("teeth", 40)),
        ((0.5e-3, 9, 6), ("teeth", 9)),
        ((-1.0, 40, 6), ("module", -1.0)),
    ],
)
def test_what_iso_1328_does_not_have(arguments, about):
    with refused(*about):
        flank_tolerances(*arguments)
    with refused(*about):
        assumed_transmission_error(*arguments)
