"""Reducers by their data sheets: the makers' loop both ways, springs in pieces and closed forms, stages in a row."""

import dataclasses
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ANY, refused

import clearance_jax as cj
from clearance_jax.mechanism.reducer import HARMONIC, StiffnessPieces, piecewise_angle, piecewise_torque

pytestmark = pytest.mark.quick
ARC_MINUTE = math.pi / 10800
# Size 14 with the ratio 100 or so: T1, T2 [N m], K1, K2, K3 [N m/rad].
PIECES = StiffnessPieces((7.0, 25.0), (1.3e4, 1.8e4, 2.3e4))
ENDING = StiffnessPieces((7.0, 25.0), (1.3e4, 1.8e4))


# Springs in pieces ---------------------------------------------------------------------------------------------------


def test_torque_and_angle_are_inverse():
    torques = np.linspace(-60.0, 60.0, 121)
    angles = piecewise_angle(torques, PIECES)
    np.testing.assert_allclose(piecewise_torque(angles, PIECES), torques, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(angles, -angles[::-1], rtol=1e-15)
    # 7 N m at K1, 18 at K2, the rest at K3.
    assert float(piecewise_angle(40.0, PIECES)) == pytest.approx(7 / 1.3e4 + 18 / 1.8e4 + 15 / 2.3e4, rel=1e-14)
    slopes = jax.vmap(jax.grad(lambda x: piecewise_torque(x, PIECES)))(jnp.array([0.0, 1e-4, 1e-3, -1e-3, 2e-3]))
    np.testing.assert_allclose(slopes, [1.3e4, 1.3e4, 1.8e4, 1.8e4, 2.3e4], rtol=1e-13)


def test_one_number_is_one_piece():
    rigid, linear = cj.Reducer(ratio=100), cj.Reducer(ratio=100, stiffness=3e4)
    assert rigid.pieces == ((), (math.inf,))
    assert float(piecewise_angle(10.0, rigid.pieces)) == 0.0
    assert float(piecewise_torque(1e-3, linear.pieces)) == pytest.approx(30.0, rel=1e-15)


def quarter_period(amplitude, inertia, pieces, nodes=60):
    """A quarter of the period of a free swing [s], by quadrature of dx / v, piece by piece."""
    points, weights = np.polynomial.legendre.leggauss(nodes)

    def integral(function, low, high):
        x = low + (high - low) * (points + 1) / 2
        return (high - low) / 2 * np.sum(weights * function(x))

    bounds = [x for x in (0.0, *pieces.angles) if x < amplitude] + [amplitude]

    def speed(x):
        parts = [np.clip((low, high), x, None) for low, high in itertools.pairwise(bounds)]
        work = sum(integral(lambda y: np.asarray(piecewise_torque(y, pieces)), low, high) for low, high in parts)
        return math.sqrt(2 * work / inertia)

    def rate(s):  # x = amplitude - s^2, so that the integrand stays finite where the swing turns
        return np.array([2 * one / speed(amplitude - one**2) for one in s])

    ends = [math.sqrt(amplitude - x) for x in bounds]
    return sum(integral(rate, after, before) for before, after in itertools.pairwise(ends))


def test_free_swing_of_three_pieces():
    """Digits of the closed form: arcs of three circles in the phase plane."""
    amplitude = float(piecewise_angle(40.0, PIECES))
    assert amplitude == pytest.approx(2.19063545150e-3, rel=1e-11)
    assert 4 * quarter_period(amplitude, 1.2, PIECES) == pytest.approx(0.052238050056348, rel=1e-10)
    # The checker itself: a linear spring.
    assert quarter_period(1e-3, 1.2, cj.Reducer(ratio=1, stiffness=3e4).pieces) == pytest.approx(
        math.pi / 2 * math.sqrt(1.2 / 3e4), rel=1e-12
    )


def test_nothing_is_known_beyond_the_last_torque():
    last = ENDING.angles[-1]
    assert float(piecewise_torque(last, ENDING)) == pytest.approx(25.0, rel=1e-14)
    assert float(piecewise_angle(-25.0, ENDING)) == pytest.approx(-last, rel=1e-14)
    with refused("stiffness", ANY, 25.0):
        piecewise_torque(jnp.array([0.0, 1.001 * last]), ENDING)
    with refused("stiffness"):
        piecewise_angle(25.1, ENDING)
    # In a program there is no sentence: the number is none.
    found = jax.jit(lambda x: piecewise_torque(x, ENDING))(jnp.array([0.5, 1.0, 1.001, -2.0]) * last)
    np.testing.assert_array_equal(np.isnan(found), [False, False, True, True])


def test_pieces_may_be_differentiated():
    def torque(k):
        return piecewise_torque(1e-3, StiffnessPieces((7.0,), (k, 1.8e4)))

    # Beyond the first piece the torque is 7 + K2 (x - 7 / K1).
    assert float(jax.grad(torque)(1.3e4)) == pytest.approx(1.8e4 * 7 / 1.3e4**2, rel=1e-12)


# Catalogues ----------------------------------------------------------------------------------------------------------


def test_a_harmonic_drive():
    """CSF-20-50: 1.85 arcmin up to T1 (the catalogue prints 1.8), and 1 arcmin of positioning accuracy."""
    drive = cj.Reducer.harmonic(size=20, ratio=50)
    assert drive.pieces == ((7.0, 25), (13000.0, 18000.0))
    assert drive.pieces.angles[0] / ARC_MINUTE == pytest.approx(1.85, abs=2e-3)
    assert drive.backlash == 0.0
    assert drive.transmission_error == pytest.approx(0.5 * ARC_MINUTE)
    assert drive.friction_torque is drive.rated_torque is drive.efficiency is None
    known = cj.Reducer.harmonic(14, 30)
    np.testing.assert_allclose(known.pieces.stiffnesses, (1900, 2400, 3400), rtol=1e-15)
    accuracies = {(8, 30): 2, (14, 30): 2, (17, 30): 1.5, (32, 30): 1.5, (8, 50): 2, (11, 50): 1.5, (17, 50): 1.5}
    for (size, ratio), accuracy in (accuracies | {(100, 50): 1}).items():
        found = cj.Reducer.harmonic(size, ratio).transmission_error
        assert found == pytest.approx(accuracy / 2 * ARC_MINUTE), (size, ratio)


def test_every_row_of_the_table_is_a_drive():
    """Sizes grow stiffer, and each is stiffer with the ratio 50, and stiffer the more it is loaded."""
    soft = 0.0
    for size, (torques, *both) in HARMONIC.items():
        for ratio, row in zip((30, 50), both, strict=True):
            if row:
                assert cj.Reducer.harmonic(size, ratio).pieces.torques == torques
                assert list(row) == sorted(row)
        assert both[1][0] > max(soft, both[0][0] if both[0] else 0.0)
        soft = both[1][0]


@pytest.mark.parametrize(("size", "ratio"), [(20, 80), (20, 100), (40, 30), (21, 50), (0, 50)])
def test_drives_whose_table_is_not_known(size, ratio):
    with refused("size", size):
        cj.Reducer.harmonic(size, ratio)


# Data sheets ---------------------------------------------------------------------------------------------------------

SHEET = {"ratio": 121, "stiffness": 3e4, "rated_torque": 400.0}


def loop(gap, k, friction, rated, q):
    """The width at zero torque, and the turn of the middle between -q T_N and q T_N [rad], of a slow loop."""

    def angle(torque, way):
        loaded = torque - way * friction
        return math.copysign(gap / 2, loaded) + loaded / k

    width = angle(0.0, -1) - angle(0.0, 1)
    middle = [(angle(sign * q * rated, 1) + angle(sign * q * rated, -1)) / 2 for sign in (1, -1)]
    return width, middle[0] - middle[1]


def test_gap_and_friction_from_a_loop():
    """With k = 3e4 N m/rad, b = 2e-4 rad, T_N = 400 N m, T_f = 4 N m: W = 4.6667e-4, L = 1.0e-3."""
    width, lost = loop(2e-4, 3e4, 4.0, 400.0, 0.03)
    assert (width, lost) == pytest.approx((4.6667e-4, 1.0e-3), rel=1e-5)
    found = cj.Reducer.from_datasheet(**SHEET, lost_motion=lost, hysteresis_loss=width, efficiency=0.85)
    assert (found.backlash, found.friction_torque) == pytest.approx((2e-4, 4.0), rel=1e-11)
    assert (found.ratio, found.stiffness, found.rated_torque, found.efficiency) == (121, 3e4, 400.0, 0.85)
    # The gap itself may be given. Another convention of the test gives another gap.
    assert cj.Reducer.from_datasheet(**SHEET, backlash=2e-4, hysteresis_loss=width).friction_torque == pytest.approx(4)
    with refused("lost_motion"):
        cj.Reducer.from_datasheet(**SHEET, lost_motion=lost, q=0.04)
    assert cj.Reducer.from_datasheet(**SHEET, lost_motion=lost).friction_torque is None


def test_friction_that_hides_the_gap():
    """The same with T_f = 20 N m: W = 1.53333e-3, L = 8.0e-4, whatever the gap is."""
    width, lost = loop(2e-4, 3e4, 20.0, 400.0, 0.03)
    assert (width, lost) == pytest.approx((1.53333e-3, 8.0e-4), rel=1e-5)
    assert loop(7e-4, 3e4, 20.0, 400.0, 0.03)[1] == pytest.approx(lost)
    with refused("hysteresis_loss", width) as caught:
        cj.Reducer.from_datasheet(**SHEET, lost_motion=lost, hysteresis_loss=width)
    # The greatest gap belongs to the least friction that hides it, q T_N = 12 N m.
    assert loop(caught.value.allowed, 3e4, 12.0, 400.0, 0.03)[0] == pytest.approx(width, rel=1e-12)
    assert "from 0 to 0.000733333 rad (2.521 arcmin)" in str(caught.value)
    found = cj.Reducer.from_datasheet(**SHEET, backlash=2e-4, hysteresis_loss=width)
    assert found.friction_torque == pytest.approx(20.0, rel=1e-12)


def test_pieces_in_a_data_sheet():
    sheet = SHEET | {"stiffness": ((7.0, 25.0), (1.3e4, 1.8e4)), "rated_torque": 25.0}
    found = cj.Reducer.from_datasheet(**sheet, lost_motion=3e-4, hysteresis_loss=2e-4, q=0.04)
    assert found.backlash == pytest.approx(3e-4 - 2 / 1.3e4)
    assert found.friction_torque == pytest.approx((2e-4 - found.backlash) * 1.3e4 / 2)
    with refused("stiffness"):
        cj.Reducer.from_datasheet(**sheet, backlash=0.0, hysteresis_loss=1e-3, q=0.04)


@pytest.mark.parametrize(
    ("numbers", "about"),
    [
        ({}, ("lost_motion",)),
        ({"lost_motion": 1e-3, "backlash": 2e-4}, ("lost_motion", 1e-3)),
        ({"lost_motion": 1e-4}, ("lost_motion", 1e-4)),  # less than the wind-up
        ({"backlash": -1e-4}, ("backlash", -1e-4)),
        ({"backlash": 2e-4, "hysteresis_loss": 1e-4}, ("hysteresis_loss", 1e-4)),
        ({"backlash": 2e-4, "q": 0.0}, ("q", 0.0)),
        ({"lost_motion": 1e-3, "q": 3}, ("lost_motion",)),  # per cent
        ({"lost_motion": 1e-3, "stiffness": math.inf}, ("stiffness", math.inf)),
    ],
)
def test_data_sheets_that_contradict_themselves(numbers, about):
    with refused(*about):
        cj.Reducer.from_datasheet(**SHEET | numbers)


@pytest.mark.parametrize(
    ("numbers", "about"),
    [
        ({"ratio": 0}, ("ratio", 0)),
        ({"ratio": math.nan}, ("ratio",)),
        ({"ratio": math.inf}, ("ratio",)),
        ({"ratio": 100, "backlash": -1e-4}, ("backlash", -1e-4)),
        ({"ratio": 100, "rated_torque": 0.0}, ("rated_torque", 0.0)),
        ({"ratio": 100, "friction_torque": -1.0}, ("friction_torque", -1.0)),
        ({"ratio": 100, "efficiency": 1.2}, ("efficiency", 1.2)),
        ({"ratio": 100, "efficiency": 0.0}, ("efficiency", 0.0)),
        ({"ratio": 100, "rotor_inertia": math.inf}, ("rotor_inertia",)),
        ({"ratio": 100, "stiffness": 0.0}, ("stiffness", 0.0)),
        ({"ratio": 100, "stiffness": math.nan}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((7.0, 5.0), (1e4, 2e4, 3e4))}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((7.0, 25.0), (1e4, 2e4, 3e4, 4e4))}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((7.0, 25.0), (1e4,))}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((), ())}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((7.0,), ())}, ("stiffness",)),
        ({"ratio": 100, "stiffness": ((7.0, 25.0), (1e4, -2e4))}, ("stiffness",)),
    ],
)
def test_what_is_no_reducer(numbers, about):
    with refused(*about):
        cj.Reducer(**numbers)


# Stages --------------------------------------------------------------------------------------------------------------


def test_stages_in_a_row():
    """Sums b_i / |n_i| and 1 / (k_i n_i^2), n_i: the speed of a stage's output over that of the link."""
    first = cj.Reducer(
        ratio=-4, stiffness=1e3, backlash=1e-3, friction_torque=0.1, rated_torque=5.0, rotor_inertia=1e-4,
        efficiency=0.97, transmission_error=2e-4,
    )  # fmt: skip
    second = cj.Reducer(
        ratio=5, stiffness=8e3, backlash=5e-4, friction_torque=0.5, rated_torque=40.0, efficiency=0.96,
        transmission_error=1e-4,
    )  # fmt: skip
    found = cj.Reducer.series([first, second])
    assert found.ratio == -20
    assert found.stiffness == pytest.approx(1 / (1 / (1e3 * 25) + 1 / 8e3), rel=1e-14)
    assert found.backlash == pytest.approx(1e-3 / 5 + 5e-4)
    assert found.friction_torque == pytest.approx(5 * 0.1 + 0.5)
    assert found.rated_torque == pytest.approx(25.0)
    assert (found.rotor_inertia, found.efficiency) == (1e-4, pytest.approx(0.97 * 0.96))
    assert found.transmission_error == pytest.approx(2e-4 / 5 + 1e-4)
    assert cj.Reducer.series([first]) == first
    assert cj.Reducer.series([cj.Reducer(ratio=3), cj.Reducer(ratio=2)]) == cj.Reducer(ratio=6)
    # What one stage does not say is not said of all.
    assert cj.Reducer.series([first, cj.Reducer(ratio=2)]).friction_torque is None
    with refused("stages"):
        cj.Reducer.series([])


def test_springs_in_pieces_in_a_row():
    """The deflection of the whole is that of its stages, each under its share of the torque."""
    stages = [
        cj.Reducer(ratio=3, stiffness=((2.0,), (500.0, 900.0))),
        cj.Reducer(ratio=2, stiffness=4e3),
        cj.Reducer(ratio=-2.5, stiffness=PIECES),
    ]
    found, turns = cj.Reducer.series(stages).pieces, (5.0, 2.5, 1.0)
    assert found.torques == pytest.approx((7.0, 10.0, 25.0))
    torques = np.linspace(-40.0, 40.0, 33)
    parts = [piecewise_angle(torques / n, s.pieces) / n for s, n in zip(stages, turns, strict=True)]
    np.testing.assert_allclose(piecewise_angle(torques, found), sum(parts), rtol=1e-12, atol=1e-15)
    # Nothing is known beyond what is known of each.
    ended = cj.Reducer.series([stages[0], cj.Reducer(ratio=50, stiffness=ENDING)]).pieces
    assert ended.torques == pytest.approx((7.0, 25.0))
    assert len(ended.stiffnesses) == 2
    both = cj.Reducer.series([cj.Reducer(ratio=2, stiffness=ENDING), cj.Reducer(ratio=2, stiffness=ENDING)]).pieces
    assert both.torques == pytest.approx((7.0, 14.0, 25.0))
    assert len(both.stiffnesses) == 3


def test_a_reducer_is_a_drive():
    """Its numbers reach the joint, those of the motor by the square of the ratio."""
    sheet = cj.Reducer(
        ratio=-50, stiffness=((7.0, 25.0), (1.3e4, 1.8e4, 2.3e4)), backlash=2e-4, friction_torque=3.0,
        rotor_inertia=1e-4, transmission_error=1e-4,
    )  # fmt: skip
    drive = sheet.compliance(20.0, driven=False)
    assert float(drive.rotor_inertia) == pytest.approx(0.25)
    assert (float(drive.error), float(drive.error_order), float(drive.backlash)) == (1e-4, 50.0, 2e-4)
    joint = cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(actuators=(cj.actuators.ConstantEffort(40.0),)))
    wheel = cj.Mechanism(bodies=(cj.Body("wheel", 1.0, 0.5),), joints=(joint,))
    loose = cj.with_compliance(wheel, "hub", drive)
    assert [gap.name for gap in loose.gaps] == ["hub_drive", "hub_friction"]
    held = cj.with_compliance(wheel.with_drives({"hub": cj.drives.Constant(0.0)}), "hub", sheet.compliance(20.0))
    load = cj.Wrench("load", "wheel", torque=cj.Torque(z=-43.0))
    begun = cj.simulate(dataclasses.replace(held, wrenches=(load,)), 1.0, start="settled", rtol=1e-8)
    # The stiffness in pieces, behind half of the gap: friction at rest bears nothing.
    wound = 7 / 1.3e4 + 18 / 1.8e4 + 18 / 2.3e4
    assert float(begun.initial[0]) == pytest.approx(-wound - 1e-4, rel=1e-6)
    for wrong in (cj.Reducer(ratio=10), cj.Reducer.harmonic(20, 50), cj.Reducer(ratio=10, stiffness=1e4)):
        with pytest.raises(cj.ClearanceError):
            wrong.compliance(1.0, driven=False)
