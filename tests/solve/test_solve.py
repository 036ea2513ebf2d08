"""The solve against independent references, invariants and limits."""

import dataclasses

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from places import REFERENCE, SCENES, refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.field import energy_residual
from clearance_jax.mechanism.actuators import AbstractActuator
from clearance_jax.solve.drivers.trace import BLOCK

OMEGA = 5000 * np.pi / 30


def absolute(y, t):
    """States with the conrod's absolute angle, as the reference has them."""
    y = np.asarray(y)
    return np.stack([y[:, 0] + OMEGA * t, y[:, 1], y[:, 2] + OMEGA, y[:, 3]], 1)


@pytest.mark.parametrize("solver", ["tsit5", "dopri8"])
def test_slider_crank_error_follows_the_tolerance(solver):
    for clearance in (0.5, 0.2, 0.1):
        reference = np.load(REFERENCE / f"slider_crank_{clearance}mm.npz")
        t, truth = reference["t"], reference["y"]
        scale = np.abs(truth).max(0)
        for rtol in (1e-5, 1e-8, 1e-11):
            s = cj.simulate(catalogue.slider_crank(clearance * 1e-3), t[-1], save_at=t, rtol=rtol, solver=solver)
            error = np.abs(absolute(s.y, t) - truth).max(0) / scale
            assert error[:2].max() <= 100 * rtol
            assert error.max() <= 3000 * rtol
            assert float(s.energy_residual) <= 10 * rtol
        assert error.max() <= 2e-9


@pytest.mark.slow
def test_a_free_pin_does_not_swing_past_the_contacts_of_a_driven_sleeve():
    """Nothing in the state hints at the drive while the pin flies: its steps must be short enough all the same."""
    c, amplitude, frequency, damping, v0, end = 1.873e-3, 1.2944e-3, 16.103, 0.0813, 0.0268, 0.0896
    pin = cj.RevoluteClearance(c, 0.01, laws.HuntCrossley(1e9, damping))
    m = cj.Mechanism(
        bodies=(cj.Body("sleeve", 1.0), cj.Body("pin", 0.1)),
        joints=(
            cj.Prismatic(
                "shaker", "ground", "sleeve", motion=cj.Motion(cj.drives.Harmonic(amplitude, 2 * np.pi * frequency))
            ),
            cj.Prismatic("guide", "ground", "pin", motion=cj.Motion(velocity=v0)),
        ),
        loops=(cj.Revolute("play", "sleeve", "pin", clearance=pin),),
        assemble=False,
    )

    def rate(t, y):
        w = 2 * np.pi * frequency
        off, speed = y[0] - amplitude * np.sin(w * t), y[1] - amplitude * w * np.cos(w * t)
        depth, side = max(abs(off) - c, 0.0), np.sign(off)
        return [y[1], -side * 1e9 * depth**1.5 * max(1 + damping * side * speed, 0.0) / 0.1]

    # Steps too short to miss a contact, by another code.
    truth = scipy.integrate.solve_ivp(rate, (0, end), [0.0, v0], "DOP853", rtol=1e-10, atol=1e-13, max_step=5e-5)
    for solver in ("tsit5", "dopri8"):
        for rtol in (1e-5, 1e-8):
            s = cj.simulate(m, end, rtol=rtol, solver=solver)
            np.testing.assert_allclose(s.final[0], truth.y[0, -1], rtol=0, atol=max(1e-7, 100 * rtol) * c)
            assert float(s.energy_residual) <= 10 * rtol


class Broken(AbstractActuator):
    """A force that is not a number after a while."""

    def __call__(self, time, position, velocity):
        return jnp.where(time > 0.005, jnp.nan, 0.0 * position)


def test_a_force_that_is_not_a_number_ends_the_solve():
    m = catalogue.slider_crank()
    guide = dataclasses.replace(m.joints[2], motion=cj.Motion(position=0.17, actuators=(Broken(),)))
    broken = dataclasses.replace(m, joints=(*m.joints[:2], guide))
    s = cj.simulate(broken, 0.01, throw=False, energy_balance=False, max_steps=5000)
    assert "step size collapsed" in s.message
    assert int(s.rejected) < 500


def test_small_clearances_after_many_turns_are_not_lost_in_round_off():
    m = catalogue.slider_crank(1e-6)
    for rtol in (1e-9, 1e-11):
        assert bool(cj.simulate(m, 1.2001, t0=1.2, rtol=rtol, energy_balance=False).succeeded)


def test_a_step_that_an_event_has_spoiled_is_cut_there():
    """Nearly every step with too large an error crosses an event. It is not shortened by its error, again and again,
    until it does not reach the event.
    """
    s = cj.simulate(catalogue.slider_crank(), 6e-3, rtol=1e-8, solver="dopri8", energy_balance=False)
    assert int(s.rejected) - int(s.cuts) < int(s.cuts)


@pytest.mark.slow
def test_plain_controller_has_a_floor():
    # Whether the plain controller happens to see a contact is luck: the worst of three clearances tells.
    errors: dict[bool, list[float]] = {True: [], False: []}
    for clearance in (0.5, 0.2, 0.1):
        reference = np.load(REFERENCE / f"slider_crank_{clearance}mm.npz")
        t, truth = reference["t"], reference["y"]
        m = catalogue.slider_crank(clearance * 1e-3)
        for events, worst in errors.items():
            s = cj.simulate(
                m, t[-1], save_at=t, rtol=1e-11, solver="dopri8", locate_events=events, energy_balance=False
            )
            worst.append(float(np.max(np.abs(absolute(s.y, t) - truth).max(0) / np.abs(truth).max(0))))
    assert max(errors[True]) < 2e-9
    assert max(errors[False]) > 1e-7


def test_ideal_slider_crank_keeps_its_loop_and_the_closed_form():
    m = catalogue.slider_crank().ideal()
    t = np.linspace(0, 2 * np.pi / OMEGA, 101)
    s = cj.simulate(m, t[-1], save_at=t, rtol=1e-8)
    beta = np.arcsin(0.05 / 0.12 * np.sin(OMEGA * t))
    x = 0.05 * np.cos(OMEGA * t) + 0.12 * np.cos(beta)
    y = np.asarray(s.y)
    phi = y[:, 0] + OMEGA * t
    gap = np.hypot(
        y[:, 1] - 0.05 * np.cos(OMEGA * t) - 0.12 * np.cos(phi), 0.05 * np.sin(OMEGA * t) + 0.12 * np.sin(phi)
    )
    assert gap.max() < 1e-10
    np.testing.assert_allclose(y[:, 1], x, atol=1e-9)


@pytest.mark.slow
def test_batch_equals_loop():
    # Two compiled programs round differently. Steps on a grid keep that from changing the steps that lanes take, but
    # for one or two in a hundred where a touch lies within a round-off of a step's end: another error, as small.
    m = catalogue.slider_crank()
    clearances = jnp.linspace(1e-4, 5e-4, 256)

    def end(c, rtol=1e-7):
        moved = cj.replace(m, {"wrist.radial_clearance": c})
        return cj.simulate(moved, 6e-3, rtol=rtol, energy_balance=False, solver="dopri8").final

    batch = np.asarray(jax.jit(jax.vmap(end))(clearances))
    alone = jax.jit(end)
    loop, exact = (np.stack([alone(c, rtol) for c in clearances]) for rtol in (1e-7, 1e-10))

    def apart(one, other):
        return np.max(np.abs(one - other) / np.abs(loop).max(0), axis=1)

    same = apart(batch, loop) < 1e-9
    assert np.mean(same) > 0.98
    assert apart(batch, exact)[~same].max(initial=0.0) < apart(loop, exact).max() < 5e-5


@pytest.mark.slow
def test_jvp_runs_and_is_finite():
    m = catalogue.slider_crank()
    _, tangent = jax.jvp(
        lambda c: cj.simulate(cj.replace(m, {"wrist.radial_clearance": c}), 1e-3, rtol=1e-7).final[:4],
        (jnp.asarray(3e-4),),
        (jnp.asarray(1.0),),
    )
    assert np.all(np.isfinite(tangent))
    assert np.any(np.asarray(tangent) != 0)


def drop(law, clearance=1e-3, friction=None, gravity=9.81, mass=0.14):
    """A pin that may only fall: joint with a prescribed, resting rotation, payload's centre on the pin."""
    joint = cj.RevoluteClearance(clearance, 0.01, law, friction)
    return cj.Mechanism(
        bodies=(cj.Body("pin", mass),),
        joints=(cj.Revolute("j", "ground", "pin", motion=cj.Motion(cj.drives.ConstantSpeed(0.0)), clearance=joint),),
        gravity=cj.Gravity(y=-gravity),
    )


def test_static_penetration_of_hertz():
    # d = (W/K)^(2/3); a damped law settles there.
    law = laws.HuntCrossley(6.61e10, 100.0)
    s = cj.simulate(drop(law, 1e-6), 0.05, rtol=1e-9)
    assert -float(s.final[1]) - 1e-6 == pytest.approx(75.58e-9, rel=1e-4)


def test_undamped_bouncing_keeps_its_energy():
    s = cj.simulate(drop(laws.Hertz(6.61e10)), 2.0, rtol=1e-11, solver="dopri8")
    assert float(s.energy_residual) < 1e-8


def test_restitution_law_bounces_as_it_says():
    m = drop(laws.exact_restitution(6.61e10, 0.8), gravity=0.0)
    y0 = jnp.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0])
    s = cj.simulate(m, 0.003, y0=y0, rtol=1e-9)
    assert -float(s.final[2]) == pytest.approx(0.4, rel=1e-6)


def test_deviation_from_ideal_falls_in_proportion_to_the_clearance():
    # A stiff pin at low speed, so that penetration is small beside the smallest clearance. With the pin on the rim the
    # slider is at most c / cos(beta) from its ideal place (beta: the conrod's angle); within half a turn it gets there.
    omega = OMEGA / 100
    t = np.linspace(0, np.pi / omega, 401)
    slow = cj.replace(catalogue.slider_crank(), {"drive.main.speed": omega})
    wrist = slow.clearance_joints()[0].clearance
    assert wrist is not None
    law = laws.HuntCrossley(6.61e13, 1000.0)
    slow = slow.with_clearance("wrist", cj.RevoluteClearance(1e-3, 0.01, law, wrist.friction))

    def slider(c):
        return cj.simulate(cj.replace(slow, {"wrist.radial_clearance": c}), t[-1], save_at=t, rtol=1e-7).y[:, 1]

    beta = np.arcsin(0.05 / 0.12 * np.sin(omega * t))
    ideal = 0.05 * np.cos(omega * t) + 0.12 * np.cos(beta)
    alone = jax.jit(slider)
    for c in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7):
        farthest = np.abs(np.asarray(alone(c)) - ideal).max()
        assert farthest == pytest.approx(c / np.cos(beta).min(), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["tsit5", "dopri8"])
def test_joint5_against_its_reference(solver):
    reference = np.load(REFERENCE / "joint5_mu0.3.npz")
    t, truth = reference["t"], reference["y"]
    m = cj.load(SCENES / "joint5_velocity_1.toml")
    m = cj.replace(m, {"joint5.friction.coefficient": 0.3})
    for rtol in (1e-6, 1e-9):
        s = cj.simulate(m, t[-1], save_at=t, rtol=rtol, solver=solver)
        error = np.abs(np.asarray(s.y)[:, :4] - truth).max(0) / np.abs(truth).max(0)
        assert error.max() <= 3000 * rtol
        assert float(s.energy_residual) <= 10 * rtol


@pytest.mark.slow
def test_a_loop_that_closes_only_with_a_pin_outside_its_sleeve_is_open():
    """A guide within the reach of crank and rod, and beyond it by 6 mm, where the play is 0.1 mm."""

    def crank(height):
        joints = (
            cj.Revolute("main", "ground", "crank", motion=cj.Motion(cj.drives.ConstantSpeed(1.0, 0.5))),
            cj.Revolute("crankpin", "crank", "rod", at_parent=cj.Position(0.05)),
            cj.Revolute("wrist", "rod", "slider", at_parent=cj.Position(0.1)),
        )
        bodies = tuple(cj.Body(name, 1.0, 1e-3) for name in ("crank", "rod", "slider"))
        guide = cj.Prismatic("guide", "ground", "slider", at_parent=cj.Position(0.0, height))
        play = {"radial_clearance": 1e-4, "pin_radius": 0.01, "length": 0.01}
        return cj.Mechanism(bodies, joints, (guide,)).with_clearance("crankpin", **play)

    reach = 0.1 + 0.05 * np.sin(0.5)
    begun = cj.simulate(crank(reach - 1e-3), 1e-7)
    assert np.hypot(*np.asarray(begun.initial[:2])) < 1e-6
    with refused("guide"):
        cj.simulate(crank(reach + 6e-3), 1e-7)


def test_a_mechanism_that_cannot_be_assembled_is_refused_or_is_a_failed_lane():
    m = cj.replace(catalogue.slider_crank(), {"drive.main.start": 1.5})
    with refused("wrist"):
        cj.simulate(cj.replace(m, {"wrist.at_parent.x": 0.03}), 1e-3)
    with refused("wrist"):
        cj.trace(cj.replace(m, {"wrist.at_parent.x": 0.03}), 1e-3)

    def reached(length):
        return cj.simulate(cj.replace(m, {"wrist.at_parent.x": length}), 1e-3, save_at=3).succeeded

    assert np.asarray(jax.vmap(reached)(jnp.array([0.03, 0.12]))).tolist() == [False, True]


def test_impossible_lanes_of_a_batch_fail_at_once_and_alone():
    def end(c):
        s = cj.simulate(cj.replace(catalogue.slider_crank(), {"wrist.radial_clearance": c}), 1e-4, rtol=1e-6)
        return s.succeeded, s.steps + s.rejected

    succeeded, attempts = jax.jit(jax.vmap(end))(jnp.array([1e-4, 0.0, jnp.nan, -1e-4]))
    assert np.asarray(succeeded).tolist() == [True, False, False, False]
    assert np.asarray(attempts)[1:].tolist() == [0, 0, 0]


def test_books_of_a_mechanism_without_states_follow_the_tolerance():
    m = cj.load(SCENES / "joint5_velocity_1.toml").ideal()
    for rtol in (1e-6, 1e-9):
        assert float(cj.simulate(m, 3.0, rtol=rtol).energy_residual) <= 10 * rtol


@pytest.mark.slow
def test_a_trace_of_many_blocks_is_the_solve():
    m = cj.load(SCENES / "joint5_velocity_1.toml")
    traced = cj.trace(m, 3.0, rtol=1e-7)
    assert traced.time.size > 2 * BLOCK
    s = cj.simulate(m, 3.0, rtol=1e-7)
    # What is remembered from step to step goes from block to block too.
    assert (int(traced.solution.steps), int(traced.solution.rejected)) == (int(s.steps), int(s.rejected))
    np.testing.assert_allclose(traced.solution.final[:4], s.final[:4], rtol=10 * 1e-7)


@pytest.mark.parametrize(
    ("arguments", "about"),
    [
        ({"rtol": float("nan")}, ("rtol",)),
        ({"rtol": 0.0}, ("rtol", 0.0)),
        ({"t0": 2.0}, ("t1", 1e-3)),
        ({"solver": "tsit"}, ("solver", "tsit", "tsit5")),
        ({"save_at": [0.0, 2.0]}, ("save_at", 2.0)),
        ({"y0": [0.0, 0.0]}, ("y0",)),
    ],
)
def test_bad_arguments_are_refused(arguments, about):
    with refused(*about):
        cj.simulate(catalogue.slider_crank(), 1e-3, **arguments)


def test_energy_books_with_gravity_springs_and_actuators():
    m = cj.Mechanism(
        bodies=(cj.Body("arm", 1.0, 0.05, cj.Position(0.3, 0.01)), cj.Body("tip", 0.5, 0.01, cj.Position(0.1))),
        joints=(
            cj.Revolute("shoulder", "ground", "arm", motion=cj.Motion(cj.drives.Harmonic(0.5, 3.0))),
            cj.Revolute(
                "elbow",
                "arm",
                "tip",
                at_parent=cj.Position(0.6),
                motion=cj.Motion(position=0.4, actuators=(cj.actuators.JointSpring(5.0, 0.1),)),
            ),
        ),
        springs=(cj.Spring("s", "ground", "tip", 20.0, 0.5, 0.2, cj.Position(0.2, -0.5)),),
        gravity=cj.Gravity(y=-9.81),
    )
    s = cj.simulate(m, 2.0, rtol=1e-10)
    assert float(s.energy_residual) < 1e-9


def test_a_preloaded_spring_hides_no_loss_and_round_off_at_rest_is_none():
    """A spring of a kilojoule beside a motion of a joule that stops, and of which nothing is counted."""
    m = cj.Mechanism(
        bodies=(cj.Body("block", 2.0),),
        joints=(cj.Prismatic("guide", "ground", "block"),),
        springs=(cj.Spring("s", "ground", "block", 2e5, 0.0, 0.9, cj.Position(-1.0)),),
    )
    start, times = jnp.zeros(6).at[1].set(1.0), (jnp.zeros(()), jnp.ones(()))
    residual = jax.jit(lambda end: energy_residual(m.prepare(), times, (start, end)))
    assert float(residual(jnp.zeros(6).at[5].set(1.0))) == pytest.approx(1.0, rel=1e-6)
    moved = start.at[:1].set(1e-16)  # and the energies by the round-off of a kilojoule
    assert float(residual(moved)) < 1e-5


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("wrist.radial_clearance", -1e-4, "greater than 0 m"),
        ("slider.mass", float("nan"), "finite"),
        ("wrist.radial_clearence", 1e-4, "wrist.radial_clearance"),
    ],
)
def test_bad_numbers_are_refused(name, value, allowed):
    with refused(name, allowed=allowed):
        cj.simulate(cj.replace(catalogue.slider_crank(), {name: value}), 1e-3)


def test_end_before_start_is_refused():
    with refused("t1", -1.0):
        cj.simulate(catalogue.slider_crank(), -1.0)
