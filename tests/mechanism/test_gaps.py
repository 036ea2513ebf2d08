"""Backlash of drives and couplings, stops, and friction that sticks: against closed forms, exact limit cycles, and
programs of their own; starts, datasets, derivatives, and what is refused.

The numbers of Modelica's example, of the limit cycles and of the swings were computed apart, with 13 digits and more,
by other programs (piecewise exact solutions, and DOP853 with events).
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import clearance_jax as cj
from clearance_jax.design.judge.budget import error_budget
from clearance_jax.design.judge.static import static_error, static_weights
from clearance_jax.dynamics.field import slope
from clearance_jax.mechanism.actuators import Wave
from clearance_jax.mechanism.state import layout
from clearance_jax.report.design_figures import budget_figure
from clearance_jax.solve.steps.problem import Problem

TIGHT: Any = {"rtol": 1e-11, "solver": "dopri8"}


def hub(*actuators, inertia=5.0, drive=None, **motion):
    joint = cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(drive, actuators=actuators, **motion))
    return cj.Mechanism(bodies=(cj.Body("wheel", 1.0, inertia),), joints=(joint,))


def started(mechanism, place, speed=0.0):
    """The mechanism whose link starts at a place in its gap."""
    joint = mechanism.joint("hub")
    motion = dataclasses.replace(joint.motion, position=place, velocity=speed)
    return mechanism.with_joint(dataclasses.replace(joint, motion=motion))


def loose(compliance, place=0.0, speed=0.0, inertia=5.0):
    """A wheel on a motor that stands still."""
    still = hub(inertia=inertia, drive=cj.drives.Constant(0.0))
    return started(cj.with_compliance(still, "hub", compliance), place, speed)


@pytest.mark.parametrize(
    ("limited", "place", "speed"),
    [(False, 0.103475039596, -6.21339713847), (True, -0.155581413573, -7.02293727584)],
)
def test_the_example_of_modelica(limited, place, speed):
    law = cj.Compliance(2e4, 50.0, backlash=np.radians(45), limited=limited)
    solution = cj.simulate(loose(law, np.radians(90)), 1.0, **TIGHT)
    assert float(solution["hub.position"]) == pytest.approx(place, abs=2e-11)
    assert float(solution["hub.velocity"]) == pytest.approx(speed, abs=1e-10)
    assert float(solution.energy_residual) < 1e-12


# Two inertias, the stiffness between them, half of the gap, and the speed in it.
FIRST, SECOND, STIFF, HALF, SPEED = 0.002, 0.005, 4000.0, 1e-3, 0.6


def pair(ratio=1.0, backlash=2 * HALF, flank=None, first=None, speed=SPEED):
    """Two wheels that mesh; the second starts in the middle of the gap with a speed in it."""
    motion = cj.Motion() if first is None else cj.Motion(first)
    joints = (
        cj.Revolute("pinion", "ground", "small", motion=motion),
        cj.Revolute("wheel", "ground", "large", motion=cj.Motion(velocity=speed)),
    )
    flank = cj.laws.Flank(STIFF) if flank is None else flank
    mesh = cj.Coupling("mesh", "wheel", "pinion", ratio, backlash=backlash, flank=flank)
    bodies = cj.Body("small", 1.0, FIRST), cj.Body("large", 1.0, SECOND)
    return cj.Mechanism(bodies=bodies, joints=joints, couplings=(mesh,))


def free_drive(backlash=2 * HALF, damping=0.0, limited=True, torque=0.0):
    """The same two inertias, as a motor and its link."""
    motor = hub(cj.actuators.ConstantEffort(torque), inertia=SECOND)
    return cj.with_compliance(motor, "hub", cj.Compliance(STIFF, damping, FIRST, backlash=backlash, limited=limited))


def test_free_oscillation_through_the_gap():
    """T = 2 pi / w + 4 h / v; momentum is kept; once between a motor and its link, once between two gears."""
    period = 2 * np.pi / np.sqrt(STIFF * (1 / FIRST + 1 / SECOND)) + 4 * HALF / SPEED
    assert period == pytest.approx(0.0104215880851, rel=1e-11)
    geared = cj.simulate(pair(), 20 * period, **TIGHT)
    small, large = (float(geared[f"{name}.velocity"]) for name in ("pinion", "wheel"))
    assert large - small == pytest.approx(SPEED, rel=1e-10)
    assert FIRST * small + SECOND * large == pytest.approx(SECOND * SPEED, rel=1e-12)
    assert float(geared["mesh.position"]) == pytest.approx(0.0, abs=1e-11)
    driven = cj.simulate(started(free_drive(), 0.0, SPEED), 20 * period, **TIGHT)
    assert float(driven["hub.velocity"]) == pytest.approx(SPEED, rel=1e-10)
    assert float(driven["hub_motor.velocity"]) == pytest.approx(small, abs=1e-10)


def test_damped_contacts_take_the_same_share_of_the_speed():
    """After n contacts the speed is e^n v; the fourth ends where the closed form says."""
    drive = started(free_drive(damping=0.3, limited=False), -HALF, SPEED)
    restitution = 0.827267735349
    solution = cj.simulate(drive, 0.0255698190781, **TIGHT)
    assert float(solution["hub.velocity"]) == pytest.approx(restitution**4 * SPEED, rel=1e-9)
    table = cj.to_dataset(drive, cj.trace(drive, 0.0259, rtol=1e-9))
    assert table.sizes["gap_episode"] == 4
    np.testing.assert_allclose(table.gap_impact_speed, SPEED * restitution ** np.arange(4), rtol=1e-7)
    np.testing.assert_allclose(table.gap_separation_speed / table.gap_impact_speed, restitution, rtol=1e-6)
    assert list(table.gap.values) == ["hub_drive"]
    assert [table[f"gap_{name}"].attrs["units"] for name in ("position", "effort")] == ["rad", "N m"]


def test_small_bounces_on_a_loaded_flank():
    """A constant torque presses one flank: T = (2 / w) (pi - atan(v / (w d))) + 2 v / a."""
    torque, bounce, period = 3.0, 0.05, 3.7549465897403e-3
    reduced = FIRST * SECOND / (FIRST + SECOND)
    # The motor pushes with so much that its link's share is the torque.
    push = torque * FIRST / reduced
    drive = started(free_drive(torque=push), -HALF, -bounce)
    solution = cj.simulate(drive, period, **TIGHT)
    assert float(solution["hub.position"]) == pytest.approx(-HALF, abs=1e-13)
    assert float(solution["hub.velocity"]) == pytest.approx(-bounce, rel=1e-10)


@pytest.mark.parametrize(
    ("compliance", "amplitude", "period"),
    [
        (cj.Compliance(np.array([1.3e4, 1.8e4, 2.3e4]), efforts=np.array([7.0, 25.0])), 2.19063545150e-3,
         0.052238050056348),
        (cj.Compliance(1.3e4, cubic=5e8), 2e-3, 0.05717199774862),
    ],
)  # fmt: skip
def test_swings_on_a_stiffness_in_pieces_and_on_a_cubic_one(compliance, amplitude, period):
    solution = cj.simulate(loose(compliance, amplitude, inertia=1.2), period, rtol=1e-13, solver="dopri8")
    assert float(solution["hub.position"]) == pytest.approx(amplitude, rel=1e-10)
    assert float(solution["hub.velocity"]) == pytest.approx(0.0, abs=1e-9)


def test_a_transmission_error_shakes_the_link():
    """Its amplitude is A / (1 - (w / w0)^2), and both sides of the gear bear it."""
    inertia, stiffness, error, shake, order = 5.0, 5e4, 1e-4, 120.0, 30.0
    answer = error / (1 - shake**2 / (stiffness / inertia))
    assert answer == pytest.approx(-2.2727272727e-4, rel=1e-10)
    turning = hub(inertia=inertia, drive=cj.drives.ConstantSpeed(shake / order))
    wavy = cj.with_compliance(turning, "hub", cj.Compliance(stiffness, error=error, error_order=order))
    solution = cj.simulate(started(wavy, 0.0, answer * shake), 0.5, rtol=1e-13, solver="dopri8", save_at=11)
    np.testing.assert_allclose(solution["hub.position"], answer * np.sin(shake * solution.time), atol=1e-13)
    # The drive does the work that the swinging link takes up.
    assert float(solution.energy_residual) < 1e-9
    work = stiffness * (error * np.sin(shake * solution.time) - np.asarray(solution["hub.position"]))
    np.testing.assert_allclose(
        solution["hub_motor.drive_force"], work * (1 + order * error * np.cos(shake * solution.time)), atol=2e-9
    )


# Servo on the link's place and the motor's speed: motor and link, stiffness, half of the gap.
MOTOR, LINK, TEETH, GAP = 2.0, 5.0, 5e4, 5e-4
# Gains, damping of the teeth, exact period, state at touch (motor, link, their speeds, integral of the error).
# fmt: off
INTEGRAL = 3e4
CYCLES = [
    ((1e4, 200.0), 0.0, 0.168021626822516, (-1.01781502096e-4, -6.01781502096e-4, 0.0204070525212, -0.0195485579962)),
    ((1e4, 200.0), 20.0, 0.172860264760407, (-1.16734162897e-4, -6.16734162897e-4, 0.0213573414917, -0.0190971243762)),
    ((3e4, 400.0), 0.0, 0.0828182608281348, (-1.30265436006e-4, -6.30265436006e-4, 0.0152835299717, -0.10085424040521)),
    ((1e4, 200.0, INTEGRAL), 0.0, 0.171032389035013,
     (-1.91983960545e-4, -6.91983960545e-4, 0.0215956597366, -0.0220681331338, -9.02501964517e-6)),
]
# fmt: on


def steered(gain, damping, integral=None, teeth=0.0, **numbers):
    target, both = cj.drives.Constant(0.0), ("hub_motor", "hub")
    servo = cj.actuators.Servo(target, gain, damping, both, rate_encoder=("hub_motor",), integral=integral)
    numbers = {"stiffness": TEETH, "backlash": 2 * GAP, "limited": False} | numbers
    compliance = cj.Compliance(damping=teeth, rotor_inertia=MOTOR, **numbers)
    return cj.with_compliance(hub(servo, inertia=LINK), "hub", compliance)


@pytest.mark.parametrize(("gains", "teeth", "period", "touch"), CYCLES)
def test_limit_cycles_of_a_servo(gains, teeth, period, touch):
    """From the exact state at touch it is back there after the exact period."""
    motor, link, motor_speed, link_speed, *integral = touch
    y0 = jnp.array([motor, link - motor, motor_speed, link_speed - motor_speed, *integral])
    solution = cj.simulate(steered(*gains, teeth=teeth), period, y0=y0, **TIGHT)
    np.testing.assert_allclose(solution.final[: y0.size], y0, rtol=0, atol=2e-13)
    assert float(solution.energy_residual) < 1e-12


def test_the_search_finds_the_limit_cycle_of_a_servo_with_an_integral():
    """From the describing function; the state at touch is that of the exact cycle; and what the integral changes."""
    (gain, damping, integral), _, period, touch = CYCLES[3]
    # k N(A) = c J w^4 / (c w^2 - Ki) and w^2 = Kp / J - Jm Ki / (c J): link J, motor Jm, gain c of the rate.
    square = gain / LINK - MOTOR * integral / (damping * LINK)
    assert 2 * np.pi / np.sqrt(square) == pytest.approx(0.1426523740, rel=1e-9)
    share = damping * LINK * square**2 / (damping * square - integral) / TEETH
    r = brentq(lambda r: 1 - (np.arcsin(r) + r * np.sqrt(1 - r * r)) * 2 / np.pi - share, 1e-3, 1.0)
    place = GAP / float(np.asarray(r))
    assert place == pytest.approx(7.39601e-4, rel=1e-5)

    def cycle(gains, off=0.98):
        drive = cj.replace(steered(gain, damping, integral, limited=True), {"hub_motor.0.integral": gains})
        guess = jnp.array([0.0, place, 0.0, 0.0, 0.0])
        return cj.periodic_motion(drive, off * period, guess=guess, free_period=True, rtol=1e-10, solver="dopri8")

    found = cycle(integral)
    assert bool(found.converged)
    assert bool(found.stable)
    assert float(found.period) == pytest.approx(period, rel=1e-11)
    drive = steered(gain, damping, integral, limited=True)
    on = cj.trace(drive, 2 * period, y0=found.y, save_at=jnp.linspace(0, 2 * period, 2), **TIGHT)
    # Both flanks are touched in turn, with opposite states.
    contacts = cj.to_dataset(drive, on)
    at = float(contacts["gap_episode_start"].values[-1])
    at_touch = cj.simulate(drive, at, y0=found.y, **TIGHT).final[:5]
    motor, link, motor_speed, link_speed, error = touch
    exact = np.array([motor, link - motor, motor_speed, link_speed - motor_speed, error])
    np.testing.assert_allclose(at_touch, exact * np.sign(exact[1] * at_touch[1]), rtol=0, atol=1e-11)
    # Wherever on the cycle the search ends, though the integral is a hundred thousandth of the other scales.
    slopes, step = [float(jax.jacfwd(lambda g, off=off: cycle(g, off).period)(integral)) for off in (0.98, 1.0)], 10.0
    difference = (cycle(integral + step).period - cycle(integral - step).period) / (2 * step)
    assert slopes == pytest.approx(2 * [float(difference)], rel=1e-7)


@pytest.mark.slow
def test_a_motion_that_dies_out_has_no_period_of_its_own():
    """A servo comes to rest; as long as it moves, it misses itself by a part of its own size, however small."""
    damped = hub(cj.actuators.Servo(cj.drives.Constant(0.0), 5e3, 20.0))
    for place, settle in ((1e-3, 1), (1e-3, 20), (0.0, 1)):
        begin = jnp.array([place, 0.0])
        found = cj.periodic_motion(damped, 0.2, guess=begin, free_period=True, settle=settle, max_iterations=6)
        assert not bool(found.converged)
        assert "No periodic motion was found" in found.message
        assert found.message.endswith("the mechanism is at rest.") == (place == 0)
        assert float(found.residual) > 1e-3


# Gain, damping, exact period, amplitude and period by the describing function.
OWN_PERIODS = [
    (1e4, 200.0, 0.168021626822516, 7.27750e-4),
    (3e4, 400.0, 0.0828182608281348, 1.564008e-3),
    (1e3, 60.0, 0.66037627633783, 5.35141e-4),
]


def test_the_search_finds_limit_cycles_with_periods_of_their_own():
    """All three by one program, from guesses that are off by 3 %; and how the first period depends on the gains."""

    def cycle(gain, damping, guess, place):
        drive = cj.replace(
            steered(1e4, 200.0, limited=True), {"hub_motor.0.stiffness": gain, "hub_motor.0.damping": damping}
        )
        begin = jnp.stack([0.0 * place, place, 0.0 * place, 0.0 * place])
        return cj.periodic_motion(drive, guess, guess=begin, free_period=True, rtol=1e-10, solver="dopri8")

    for gain, damping, period, place in OWN_PERIODS:
        found = cycle(gain, damping, 1.03 * period, jnp.asarray(place))
        assert bool(found.converged)
        assert bool(found.stable)
        assert float(found.period) == pytest.approx(period, rel=1e-11)
        assert abs(complex(found.multipliers[0])) == pytest.approx(1.0, abs=1e-7)
        assert float(found.margin) > 0.3
    gain, damping, period, place = OWN_PERIODS[0]
    # The cycle is a thousandth of a turn; so is what its search may be off by.
    drive, begin = steered(gain, damping, limited=True), jnp.array([0.0, place, 0.0, 0.0])
    for rtol in (1e-5, 1e-6, 1e-9):
        for guess in (0.85 * period, 1.06 * period, 1.15 * period):
            found = cj.periodic_motion(
                drive, guess, guess=begin, free_period=True, rtol=jnp.asarray(rtol), solver="dopri8"
            )
            assert bool(found.converged)
            assert float(found.period) == pytest.approx(period, rel=max(rtol, 1e-10))

    def own_period(gain, damping):
        return cycle(gain, damping, period, jnp.asarray(place)).period

    by_gain, by_damping = jax.jacfwd(own_period, (0, 1))(gain, damping)
    assert float(by_gain) == pytest.approx(
        float(own_period(gain + 1, damping) - own_period(gain - 1, damping)) / 2, rel=1e-6
    )
    assert float(by_damping) == pytest.approx(
        float(own_period(gain, damping + 0.1) - own_period(gain, damping - 0.1)) / 0.2, rel=1e-4
    )


def lifted(speed, backlash=None, efficiency=0.8):
    """A wheel under a load of 40 N m, on a motor of constant speed."""
    driven = hub(drive=cj.drives.ConstantSpeed(speed))
    loaded = dataclasses.replace(driven, wrenches=(cj.Wrench("load", "wheel", torque=cj.Torque(z=-40.0)),))
    return cj.with_compliance(loaded, "hub", cj.Compliance(5e4, 20.0, backlash=backlash, efficiency=efficiency))


@pytest.mark.parametrize("backlash", [None, 1e-3])
@pytest.mark.parametrize("speed", [2.0, -2.0, 0.005])
def test_the_loss_of_a_gear_that_lifts_and_lowers_a_load(backlash, speed):
    solution = cj.simulate(lifted(speed, backlash), 0.1, start="settled")
    share = np.tanh(speed / 0.01)
    # Lifting takes (2 - eta) T of the motor, lowering leaves eta T to be held.
    assert float(solution["hub_motor.drive_force"]) == pytest.approx(40 * (1 + 0.2 * share), rel=1e-12)
    assert float(solution["friction_loss"]) == pytest.approx(0.2 * 40 * share * speed * 0.1, rel=1e-12)
    assert float(solution["damping_loss"]) == pytest.approx(0.0, abs=1e-12)
    assert float(solution.energy_residual) < 1e-12


def test_a_motor_delivers_the_share_of_its_power_that_a_sheet_says():
    sheet = cj.Reducer(ratio=100, stiffness=5e4, efficiency=0.75)
    driven = hub(drive=cj.drives.ConstantSpeed(2.0))
    loaded = dataclasses.replace(driven, wrenches=(cj.Wrench("load", "wheel", torque=cj.Torque(z=-40.0)),))
    solution = cj.simulate(cj.with_compliance(loaded, "hub", sheet.compliance(20.0)), 0.1, start="settled")
    assert 40 / float(solution["hub_motor.drive_force"]) == pytest.approx(0.75, rel=1e-12)
    with refused("efficiency", 0.4):
        dataclasses.replace(sheet, efficiency=0.4).compliance(20.0)


@pytest.mark.parametrize(("solver", "rtol"), [("tsit5", 1e-9), ("dopri8", 1e-10)])
def test_the_loss_of_a_gear_whose_prescribed_motor_feels_nothing_of_it(solver, rtol):
    """Its effort and its motor turn round several times, and no other part of the motion shows where."""
    stiffness, damping, inertia, swing, pace = 2e3, 1.0, 0.4, 0.7, 6.0
    moved = hub(drive=cj.drives.Harmonic(swing, pace), inertia=inertia)
    drive = cj.with_compliance(moved, "hub", cj.Compliance(stiffness, damping, efficiency=0.8))

    def rate(t, y):
        place, speed, _ = y
        motor, bend = swing * pace * np.cos(pace * t), -swing * pace**2 * np.sin(pace * t)
        passed = -stiffness * place - damping * speed
        return speed, passed / inertia - bend, 0.2 * abs(passed) * np.tanh(abs(motor) / 0.01) * abs(motor)

    own = solve_ivp(rate, (0, 1), (0.0, 0.0, 0.0), "DOP853", rtol=1e-11, atol=1e-13, max_step=1e-4).y[2, -1]
    found = cj.simulate(drive, 1.0, rtol=rtol, solver=solver)
    assert float(found["friction_loss"]) == pytest.approx(own, rel=10 * rtol)
    assert float(found.energy_residual) < 100 * rtol


@pytest.mark.parametrize("backlash", [None, 4e-3])
def test_the_loss_of_a_gear_under_an_actuated_motor(backlash):
    """Against a program of its own, with the derivative by the efficiency."""
    efficiency, stiffness, damping, push, load = 0.7, 2e3, 6.0, 30.0, -12.0
    moved = dataclasses.replace(
        hub(cj.actuators.ConstantEffort(push), inertia=0.4),
        wrenches=(cj.Wrench("load", "wheel", torque=cj.Torque(z=load)),),
    )
    numbers = {"rotor_inertia": 0.9, "backlash": backlash, "efficiency": efficiency, "efficiency_speed": 0.05}
    drive = cj.with_compliance(moved, "hub", cj.Compliance(stiffness, damping, **numbers))
    half = 0.0 if backlash is None else backlash / 2

    def rate(t, y, efficiency):
        motor, link, motor_speed, link_speed = y
        place, speed = link - motor, link_speed - motor_speed
        side = 1.0 if place >= 0 else -1.0
        elastic, damper = stiffness * (side * place - half), damping * side * speed
        if backlash is not None:
            pressed = max(elastic + min(elastic, damper), 0.0) if elastic > 0 else 0.0
        else:
            pressed = elastic + damper
        passed = side * pressed
        lost = (1 - efficiency) * abs(passed) * np.tanh(motor_speed / 0.05)
        return motor_speed, link_speed, (push + passed - lost) / 0.9, (load - passed) / 0.4

    def own(efficiency):
        begin = (0.0, 0.0, 0.0, 0.0)
        limits: Any = {"rtol": 1e-11, "atol": 1e-13, "max_step": 2e-5}
        motor, link, *speeds = solve_ivp(rate, (0, 0.15), begin, "DOP853", args=(efficiency,), **limits).y[:, -1]
        return np.array([motor, link - motor, speeds[0], speeds[1] - speeds[0]])

    def end(efficiency):
        loss = cj.replace(drive, {"hub.actuator.compliance.efficiency": efficiency})
        return cj.simulate(loss, 0.15, rtol=1e-10, solver="dopri8").final[:4]

    np.testing.assert_allclose(end(efficiency), own(efficiency), rtol=0, atol=3e-8)
    slope = (end(efficiency + 1e-5) - end(efficiency - 1e-5)) / 2e-5
    np.testing.assert_allclose(jax.jacfwd(end)(efficiency), slope, rtol=2e-6, atol=1e-8)
    assert float(cj.simulate(drive, 0.15, rtol=1e-10, solver="dopri8").energy_residual) < 1e-9


def test_efficiencies_that_cannot_be():
    with refused("hub.efficiency"):
        lifted(1.0, efficiency=1.2)
    with refused("hub.actuator.compliance.efficiency", 0.0):
        cj.simulate(lifted(1.0, efficiency=0.0), 0.1)
    with refused("efficiency_speed"):
        cj.Compliance(5e4, efficiency_speed=0.1)
    made = cj.Reducer(ratio=50, stiffness=5e4, efficiency=0.8).compliance(20.0, friction_speed=0.02)
    assert (float(made.efficiency), float(made.efficiency_speed)) == (pytest.approx(0.75), 0.02)  # pyright: ignore[reportArgumentType]
    # What is meant, and the ideal mechanism, have no losses.
    ideal = cj.simulate(lifted(2.0).ideal(), 0.1, start="settled")
    assert float(ideal["hub_motor.drive_force"]) == pytest.approx(40.0)


def test_a_driven_motion_has_no_period_of_its_own():
    with refused("free_period", True):
        cj.periodic_motion(pair(first=cj.drives.Harmonic(0.1, 20.0)), 0.3, free_period=True)


def test_the_boundary_of_stability_of_a_servo():
    """Without a gap it is stable where the stiffness is above the gain; with the speed of the link it never is."""

    def growth(servo):
        soft = cj.with_compliance(hub(servo, inertia=LINK), "hub", cj.Compliance(1e4, rotor_inertia=MOTOR)).prepare()
        rates = jax.jacfwd(lambda y: slope(jnp.zeros(()), y, soft))(jnp.zeros(layout(soft).size))
        return float(np.max(np.linalg.eigvals(np.asarray(rates)).real))

    both = ("hub_motor", "hub")
    for part, found in ((0.9, -1.844), (1.0, 0.0), (1.1, 1.6246)):
        servo = cj.actuators.Servo(cj.drives.Constant(0.0), part * 1e4, 200.0, both, rate_encoder=("hub_motor",))
        assert growth(servo) == pytest.approx(found, abs=6e-4)
    assert growth(cj.actuators.Servo(cj.drives.Constant(0.0), 5e3, 200.0, both)) > 0.1


def test_gears_follow_a_driven_pinion():
    """A wheel with a load behind a pinion: against a program of its own; the drive bears what the teeth do."""
    ratio, backlash, stiffness, damping, load = -0.5, 2e-3, 3e4, 8.0, 0.4
    swing = cj.drives.Harmonic(0.5, 20.0)
    flank = cj.laws.Flank(stiffness, damping)
    geared = pair(ratio, backlash, flank, swing, speed=0.0)
    pull = cj.Wrench("pull", "large", torque=cj.Torque(z=load))
    geared = dataclasses.replace(geared, wrenches=(pull,))
    until = np.linspace(0, 0.2, 21)
    solution = cj.simulate(geared, 0.2, rtol=1e-10, solver="dopri8", save_at=jnp.asarray(until))

    def flanks(place, speed):
        side = 1.0 if place >= 0 else -1.0
        depth, rate = side * place - backlash / 2, side * speed
        pressed = stiffness * depth + min(stiffness * depth, damping * rate)
        return -side * max(pressed, 0.0) if depth > 0 else 0.0

    def rate(t, y):
        place, speed = y[0] - ratio * 0.5 * np.sin(20 * t), y[1] - ratio * 10 * np.cos(20 * t)
        return y[1], (flanks(place, speed) + load) / SECOND

    begin = 0.0, ratio * 10.0
    own = solve_ivp(rate, (0, 0.2), begin, "DOP853", until, rtol=1e-12, atol=1e-14, max_step=2e-5)
    np.testing.assert_allclose(solution["wheel.position"], own.y[0], atol=2e-8)
    np.testing.assert_allclose(solution["mesh.torque"], solution["mesh.effort"])
    inertial = FIRST * -200 * np.sin(20 * until)
    np.testing.assert_allclose(
        solution["pinion.drive_force"], inertial + ratio * np.asarray(solution["mesh.torque"]), atol=1e-10
    )
    # Without the gap it is the ideal coupling.
    firm = cj.simulate(geared.ideal(), 0.2, save_at=jnp.asarray(until))
    np.testing.assert_allclose(firm["wheel.position"], ratio * 0.5 * np.sin(20 * until), atol=1e-14)


@pytest.mark.parametrize("ends", [{"upper": 0.1}, {"lower": -0.1, "upper": 0.1}, {"lower": 0.0, "upper": 0.1}])
def test_a_stop_throws_a_wheel_back(ends):
    """Half a period in an elastic stop, and back to where it was."""
    stops = cj.Stops(**ends, flank=cj.laws.Flank(1e4))
    solution = cj.simulate(hub(inertia=0.005, velocity=2.0, stops=stops), 0.1 + np.pi / np.sqrt(1e4 / 0.005), **TIGHT)
    assert float(solution["hub.position"]) == pytest.approx(0.0, abs=1e-11)
    assert float(solution["hub.velocity"]) == pytest.approx(-2.0, rel=1e-10)


def test_a_stop_meets_the_link_and_not_the_motor():
    """Of a drive that gives way the link hits it, and motor and drive bear the rest."""
    stops = cj.Stops(upper=0.05, flank=cj.laws.Flank(2e4))
    turning = hub(inertia=0.03, drive=cj.drives.Constant(0.06))
    turning = turning.with_joint(cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(stops=stops)))
    turning = turning.with_drives({"hub": cj.drives.Constant(0.06)})
    soft = cj.with_compliance(turning, "hub", cj.Compliance(1e3, 5.0))
    solution = cj.simulate(soft, 1.0, rtol=1e-9, start="settled")
    # It rests where the spring holds it against the stop: k x = K (0.06 + x - 0.05).
    assert float(solution["hub.position"]) == pytest.approx(-2e4 * 0.01 / (2e4 + 1e3), rel=1e-6)
    assert float(solution["hub_motor.drive_force"]) == pytest.approx(
        float(solution["hub_stop.effort"]) * -1.0, rel=1e-5
    )


def pendulum(backlash=1e-2, stiffness=500.0):
    arm = cj.Mechanism(
        bodies=(cj.Body("wheel", 4.0, 0.03, cj.Position(0.3)),),
        joints=(cj.Revolute("hub", "ground", "wheel", motion=cj.Motion(cj.drives.Constant(0.4))),),
        gravity=cj.Gravity(0.0, -9.81),
        points=(cj.Point("tip", "wheel", cj.Position(0.6)),),
    )
    return cj.with_compliance(arm, "hub", cj.Compliance(stiffness, 1.0, backlash=backlash))


def test_a_settled_start_is_on_the_flank_that_bears_the_load():
    load = 4.0 * 9.81 * 0.3
    place = brentq(lambda x: 500.0 * (x + 5e-3) + load * np.cos(0.4 + x), -1.0, -5e-3, xtol=1e-15)
    solution = cj.simulate(pendulum(), 0.5, start="settled", rtol=1e-9)
    assert float(solution.initial[0]) == pytest.approx(place, rel=1e-11)
    assert float(solution["hub.position"]) == pytest.approx(place, rel=1e-9)
    # Nothing loads it: it starts in the middle.
    weightless = dataclasses.replace(pendulum(), gravity=cj.Gravity())
    assert float(cj.simulate(weightless, 0.1, start="settled")["hub.position"]) == 0.0
    # Where gears are loaded, the wheel is behind by half the gap and the teeth's depth.
    pull = cj.Wrench("pull", "large", torque=cj.Torque(z=0.4))
    geared = dataclasses.replace(pair(-0.5, 2e-3, first=cj.drives.Constant(0.3), speed=0.0), wrenches=(pull,))
    begun = cj.simulate(geared, 0.1, start="settled", rtol=1e-9)
    assert float(begun["wheel.position"]) == pytest.approx(-0.15 + 1e-3 + 0.4 / STIFF, rel=1e-10)


def test_errors_refer_to_a_rigid_drive_without_backlash():
    table = cj.to_dataset(pendulum(), cj.simulate(pendulum(), 0.02, start="settled", save_at=3))
    off = float(cj.simulate(pendulum(), 1e-4, start="settled").initial[0])
    np.testing.assert_allclose(table.position_error[:, 0], 2 * 0.6 * np.sin(abs(off) / 2), rtol=1e-6)
    weights = static_weights(pendulum(), "tip", 1.0)
    assert weights == {"hub_drive": pytest.approx(0.6)}
    assert static_error(pendulum(), weights) == pytest.approx(0.6 * 5e-3)


def test_poses_of_drives_are_where_the_motion_settles():
    """With and without play in the same joint; and their derivatives."""
    posed: Any = {"fidelity": "quasi-static"}
    arm = pendulum()
    worn = arm.with_joint(
        dataclasses.replace(arm.joint("hub"), clearance=cj.joints.pin_clearance(2e-5, pin_radius=0.015))  # pyright: ignore
    )
    for mechanism in (arm, worn):
        pose = cj.simulate(mechanism, 0.1, **posed)
        motion = cj.simulate(mechanism, 0.1, start="settled", rtol=1e-9)
        places = layout(mechanism).q
        np.testing.assert_allclose(pose.final[places], motion.final[places], atol=1e-9)
        # f = sqrt(k / J) / (2 pi) of the arm about its hub, less the weight's part and the pin's.
        validity: Any = pose.validity
        assert 0.95 * 5.75 < float(validity.frequency) < 5.75

    def height(backlash, stiffness):
        numbers = {"hub.backlash": backlash, "hub.actuator.compliance.stiffness": stiffness}
        return cj.simulate(cj.replace(arm, numbers), 0.1, **posed)["tip.position.y"]

    by_backlash, by_stiffness = jax.grad(height, (0, 1))(1e-2, 500.0)
    wider, narrower = height(1.0001e-2, 500.0), height(0.9999e-2, 500.0)
    assert float(by_backlash) == pytest.approx(float(wider - narrower) / 2e-6, rel=1e-7)
    stiffer, softer = height(1e-2, 501.0), height(1e-2, 499.0)
    assert float(by_stiffness) == pytest.approx(float(stiffer - softer) / 2, rel=1e-5)
    geared = dataclasses.replace(
        pair(-0.5, 2e-3, first=cj.drives.Constant(0.3), speed=0.0),
        wrenches=(cj.Wrench("pull", "large", torque=cj.Torque(z=0.4)),),
    )
    assert float(cj.simulate(geared, 0.1, **posed)["wheel.position"]) == pytest.approx(-0.149 + 0.4 / STIFF, rel=1e-10)
    weightless = cj.simulate(dataclasses.replace(arm, gravity=cj.Gravity()), 0.1, **posed)
    floats: Any = weightless.validity
    assert floats.word == "not valid"


def test_the_budget_has_a_line_for_every_drive():
    """Half the gap and the wind-up of the hub, and the pin's offset; play and elasticity apart."""
    arm = pendulum()
    arm = arm.with_joint(
        dataclasses.replace(arm.joint("hub"), clearance=cj.joints.pin_clearance(2e-5, pin_radius=0.015))  # pyright: ignore
    )
    budget = error_budget(arm, "tip", 0.1, dynamics=False)
    assert set(budget.shares) == {"hub", "hub_drive"}
    place = float(cj.simulate(pendulum(), 1e-4, start="settled").initial[0])
    assert budget.shares["hub_drive"] == pytest.approx(2 * 0.6 * np.sin(-place / 2), rel=2e-3)
    assert budget.play_shares["hub_drive"] == pytest.approx(0.6 * 5e-3, rel=2e-3)
    assert budget.shares["hub"] == pytest.approx(2e-5, rel=0.1)


def test_the_budget_tells_the_transmission_error_from_the_play():
    """At rest: half the gap, the wind-up, and A sin(n q) of the motor; each alone makes its part of the arm's turn."""
    error, order, angle = 2e-3, 30.0, 0.4
    arm = pendulum()
    joint: Any = arm.joint("hub")
    wavy = dataclasses.replace(joint.motion.actuators[0], wave=Wave(jnp.asarray(error), jnp.asarray(order)))
    arm = arm.with_joint(dataclasses.replace(joint, motion=dataclasses.replace(joint.motion, actuators=(wavy,))))
    budget = error_budget(arm, "tip", 0.1, dynamics=False)
    wave = error * np.sin(order * angle)
    place: Any = brentq(lambda x: 500.0 * (x - wave + 5e-3) + 4.0 * 9.81 * 0.3 * np.cos(angle + x), -1.0, wave - 5e-3)
    # The error points down, and the wave lifts or lowers the arm.
    parts = [budget.shares, budget.play_shares, budget.transmission_shares]
    assert parts[0]["hub_drive"] == pytest.approx(2 * 0.6 * np.sin(-place / 2), rel=2e-3)
    assert parts[1]["hub_drive"] == pytest.approx(0.6 * 5e-3, rel=3e-3)
    assert parts[2]["hub_drive"] == pytest.approx(-0.6 * wave, abs=0.6 * 2e-3 * 5e-3)
    assert budget.peaks["transmission_error"] == pytest.approx(0.6 * abs(wave), abs=0.6 * 2e-3 * 5e-3)
    table = str(budget).splitlines()
    assert any(line.startswith("  transmission error alone: ") for line in table)
    assert "of transmission" in str(budget)
    assert "of transmission" not in str(error_budget(pendulum(), "tip", 0.1, dynamics=False))
    legend: Any = budget_figure(budget).axes[1].get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["play", "elasticity", "transmission error"]


def test_derivatives_by_backlash_stiffness_and_gain():
    def place(backlash, stiffness, gain):
        drive = started(steered(1e4, 200.0, 0.0), 0.0, 0.02)
        names = {"hub.backlash": backlash, "hub.actuator.compliance.stiffness": stiffness}
        drive = cj.replace(drive, names | {"hub_motor.0.stiffness": gain})
        return cj.simulate(drive, 0.15, **TIGHT | {"rtol": 1e-9})["hub_motor.position"]

    at = (2 * GAP, TEETH, 1e4)
    found = jax.grad(place, (0, 1, 2))(*at)
    for i, derivative in enumerate(found):
        h = 1e-4 * at[i]
        ahead, back = (place(*(x + sign * h * (k == i) for k, x in enumerate(at))) for sign in (1, -1))
        assert float(derivative) == pytest.approx(float(ahead - back) / (2 * h), rel=1e-5)


def test_a_batch_is_its_members():
    def final(backlash):
        drive = started(free_drive(damping=0.2), 0.0, SPEED)
        return cj.simulate(cj.replace(drive, {"hub.backlash": backlash}), 0.05, rtol=1e-8).final

    sizes = jnp.array([5e-4, 2e-3, 8e-3])
    together, alone = jax.vmap(final)(sizes), jnp.stack([final(size) for size in sizes])
    np.testing.assert_allclose(together, alone, atol=2e-7)


def test_laws_with_memory_and_sampled_servos_meet_gaps():
    """A law that remembers its impacts, in a gear whose pinion a digital servo holds."""
    flank = cj.laws.lankarani_nikravesh(STIFF, 0.6, exponent=1.0)
    servo = cj.actuators.Servo(cj.drives.Harmonic(0.2, 15.0), 40.0, 0.4, period=1e-3)
    geared = pair(flank=flank, speed=0.0)
    geared = geared.with_joint(cj.Revolute("pinion", "ground", "small", motion=cj.Motion(actuators=(servo,))))
    trace = cj.trace(geared, 0.1, rtol=1e-8)
    table = cj.to_dataset(geared, trace)
    assert table.sizes["gap_episode"] > 3
    assert float(trace.solution.energy_residual) < 1e-7
    # A restitution of less than one, whatever the servo does meanwhile.
    assert np.nanmax(table.gap_restitution) < 1.0
    cut = cj.simulate(geared, 0.04, rtol=1e-8)
    rest = cj.simulate(geared, 0.1, t0=0.04, y0=cut.final[: Problem(geared.prepare()).size], rtol=1e-8)
    np.testing.assert_allclose(rest.final[:4], trace.solution.final[:4], atol=1e-5)


def test_friction_with_bristles_holds_a_load():
    law = cj.laws.LuGre(1.0, 0.8, 0.01, 1e4, 10.0)

    def held(torque, law):
        rub = cj.actuators.JointFriction(2.0, law=law, name="seal")
        return cj.simulate(hub(cj.actuators.ConstantEffort(torque), rub, inertia=0.03), 1.0, rtol=1e-8)

    stuck = held(1.0, law)
    # The bristles bend and sink: z = T / (s0 f) of a law that is linear far below its limit.
    assert 0.5e-4 < float(stuck["hub.position"]) < 1.3e-4
    assert abs(float(stuck["hub.velocity"])) < 1e-8
    creeping = held(1.0, None)
    assert float(creeping["hub.velocity"]) == pytest.approx(0.01 * np.arctanh(0.5), rel=1e-4)
    assert max(float(creeping.energy_residual), float(stuck.energy_residual)) < 1e-9
    assert float(creeping["friction_loss"]) == pytest.approx(float(creeping["drive_work"]), rel=2e-3)


def test_the_loop_of_a_reducer_is_as_wide_as_its_gap_and_friction_say():
    """Motor locked, a slow torque to and fro: b + 2 T_f / k at zero torque."""
    stiffness, backlash, friction, swing, period = 3e4, 2e-4, 4.0, 400.0, 4.0
    course = cj.drives.Harmonic(1.0, 2 * np.pi / period)
    load = cj.Wrench("load", "wheel", torque=cj.Torque(z=swing), course=course)
    still = dataclasses.replace(hub(inertia=0.5, drive=cj.drives.Constant(0.0)), wrenches=(load,))
    rub = cj.actuators.JointFriction(friction, 1e-4)
    locked = cj.with_compliance(still, "hub", cj.Compliance(stiffness, 3.0, backlash=backlash, friction=rub))
    assert [gap.name for gap in locked.gaps] == ["hub_drive", "hub_friction"]
    until = jnp.linspace(period, 2 * period, 2001)
    place = np.asarray(cj.simulate(locked, 2 * period, rtol=1e-6, save_at=until)["hub.position"])
    torque = swing * np.sin(2 * np.pi / period * np.asarray(until))
    forth = np.interp(0.0, torque[1500:], place[1500:])
    back = np.interp(0.0, -torque[500:1500], place[500:1500])
    assert back - forth == pytest.approx(backlash + 2 * friction / stiffness, rel=0.02)


REFUSED = {
    "a negative gap": lambda: cj.simulate(loose(cj.Compliance(1e3, backlash=-1e-3)), 0.1),
    "a gap without flanks": lambda: cj.Gear("mesh", "wheel", "pinion", [20, 40], backlash=1e-3),
    "flanks without a gap": lambda: cj.Gear("mesh", "wheel", "pinion", [20, 40], flank=cj.laws.Flank(1e3)),
    "stops nowhere": lambda: cj.Stops(flank=cj.laws.Flank(1e3)),
    "stops that cross": lambda: cj.simulate(
        hub(stops=cj.Stops(0.2, 0.1, flank=cj.laws.Flank(1e3))), 0.1
    ),
    "one stiffness too few": lambda: loose(cj.Compliance(np.array([1e3, 2e3]), efforts=np.array([1.0, 2.0]))),
    "a factor without a gap": lambda: loose(cj.Compliance(1e3, damping_factor=1.0)),
    "half an error": lambda: cj.Compliance(1e3, error=1e-4),
    "a motor that is none": lambda: cj.simulate(
        hub(cj.actuators.Servo(cj.drives.Constant(0.0), 1.0, 1.0, ("hub_motor", "hub"))), 0.1
    ),
    "a derivative of a jump": lambda: jax.grad(
        lambda b: cj.simulate(
            cj.replace(loose(cj.Compliance(1e3, 1.0, backlash=1e-3, limited=False)), {"hub.backlash": b}), 0.1
        )["hub.position"]
    )(1e-3),
}  # fmt: skip


@pytest.mark.parametrize("wrong", REFUSED)
def test_what_cannot_be_is_refused(wrong):
    with pytest.raises(cj.ClearanceError):
        REFUSED[wrong]()


def test_gaps_have_names_of_their_own():
    names = cj.parameters(pendulum())
    assert names["hub.backlash"].unit == "rad"
    assert "hub.actuator.compliance.backlash" not in names
    solution = cj.simulate(pendulum(), 0.01)
    assert {"hub_drive.position", "hub_drive.effort", "hub_drive.penetration"} <= set(solution.names)
    with refused("hub_drive.force", allowed="hub_drive.effort"):
        solution["hub_drive.force"]


def toothed(backlash=1e-3, torque=5.0, clearance=None, turned=0.7, angle=None, module=2e-3, law=None):
    """A driven pinion and a loaded wheel on pins, whose centres are apart in a direction of the plane."""
    law = cj.laws.HuntCrossley(1e8, 0.5, 1.0) if law is None else law
    play = None
    if clearance is not None:
        play = cj.joints.RevoluteClearance(clearance, 0.01, cj.laws.HuntCrossley(1e9, 0.5, 1.0), None)
    distance = 2e-3 * 30
    at = cj.Position(distance * np.cos(turned), distance * np.sin(turned))
    load = cj.actuators.ConstantEffort(torque)
    turning, loaded = cj.Motion(cj.drives.ConstantSpeed(10.0)), cj.Motion(actuators=(load,))
    joints = (
        cj.Revolute("pinion", "ground", "small", motion=turning, clearance=play, angle=angle),
        cj.Revolute("wheel", "ground", "large", at, motion=loaded, clearance=play, angle=angle),
    )
    mesh = cj.Gear("mesh", "wheel", "pinion", (20, 40), backlash=backlash, flank=law, module=module)
    bodies = cj.Body("small", 0.2, 2e-5), cj.Body("large", 0.8, 3e-4)
    return cj.Mechanism(bodies, joints, couplings=(mesh,))


BASE = 2e-3 * 20 * np.cos(np.radians(20))


def test_teeth_load_their_bearings():
    """F = T / r_b along the line of action, on both bearings; its direction turns with that of the centres."""
    solution = cj.simulate(toothed(), 0.05, rtol=1e-9)
    force = float(solution["mesh.torque"]) / -BASE
    assert force == pytest.approx(5.0 / BASE, rel=3e-3)  # it still rings a little
    line = 0.7 + np.pi / 2 - np.radians(20)  # of the force on the wheel by the ahead flank
    direction = np.array([np.cos(line), np.sin(line)])
    for name, sign in (("wheel", -1.0), ("pinion", 1.0)):
        np.testing.assert_allclose(solution[f"{name}.joint_reaction"], sign * force * direction, rtol=1e-9)
    # Without play of the bearings it is the coupling of angles with the same stiffness about the wheel.
    angles = cj.laws.HuntCrossley(1e8 * BASE**2, 0.5 * BASE, 1.0)
    same = cj.simulate(toothed(module=None, law=angles), 0.05, rtol=1e-9)
    assert float(solution["wheel.position"]) == pytest.approx(float(same["wheel.position"]), abs=1e-9)
    assert float(solution["pinion.drive_force"]) == pytest.approx(float(same["pinion.drive_force"]), rel=1e-6)


@pytest.mark.parametrize("angle", [None, 0.4])
def test_play_of_the_bearings_widens_the_gap_of_their_gears(angle):
    """Both pins are pressed along the line of action: the wheel lags by half the gap, both plays and three depths."""
    solution = cj.simulate(toothed(clearance=5e-5, angle=angle), 0.2, rtol=1e-7)
    force = 5.0 / BASE
    lag = 0.5e-3 + (2 * 5e-5 + force / 1e8 + 2 * force / 1e9) / BASE
    assert float(solution["wheel.position"]) + 1.0 == pytest.approx(lag, rel=1e-5)
    assert float(solution["wheel.contact_force"]) == pytest.approx(force, rel=1e-5)
    assert float(solution.energy_residual) < 1e-8


def test_what_teeth_are_not_known_of_is_refused():
    flank: Any = {"backlash": 1e-3, "flank": cj.laws.Flank(1e7), "module": 2e-3}
    inside = cj.Gear("mesh", "wheel", "pinion", (20, 40), internal=True, **flank)
    ring = dataclasses.replace(toothed(), couplings=(inside,))
    with pytest.raises(cj.ClearanceError):
        cj.simulate(ring, 0.01)
    with refused("mesh.base_radius"):
        cj.Gear("mesh", "wheel", "pinion", (20, 40), module=2e-3)


def test_a_robot_gets_stops_at_its_limits():
    robot = cj.load(SCENES / "six_axes.urdf")
    flank = cj.laws.Flank(1e4, 10.0)
    with pytest.raises(cj.ClearanceError):  # its jaws slide
        cj.with_stops(robot, flank)
    turns = [joint for joint in robot.joints if isinstance(joint, cj.Revolute)]
    axes = [joint.name for joint in turns if joint.motion.limits.upper is not None]  # pyright: ignore
    assert len(axes) > 3
    stopped = cj.with_stops(robot, flank, axes)
    assert [gap.name for gap in stopped.gaps] == [f"{name}_stop" for name in axes]
    limits: Any = robot.joint(axes[0])
    place = cj.parameters(stopped)[f"{axes[0]}.stops.upper"].value
    assert float(place) == pytest.approx(limits.motion.limits.upper)
    with refused("hub"):
        cj.with_stops(hub(), cj.laws.Flank(1e4), ["hub"])
