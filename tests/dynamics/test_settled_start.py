"""A start at the wall: static and moving reactions by hand, an equilibrium that stays, derivatives, the ideal limit."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import slider_crank
from places import refused

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.dynamics.reactions import joint_reactions
from clearance_jax.dynamics.seated import Seated
from clearance_jax.errors import ClearanceError
from clearance_jax.solve.first_state import closed_start, initial_state
from clearance_jax.solve.start import rest_words

CLEARANCE, GRAVITY = "wrist.radial_clearance", 9.81
STIFFNESS, MASS, SPEED = 1e9, 2.0, 5000 * np.pi / 30


def hanging(normal, friction=None, **gravity) -> cj.Mechanism:
    """A pendulum that hangs straight down from a pin with play."""
    play = cj.RevoluteClearance(1e-4, 0.01, normal, friction)
    return cj.Mechanism(
        bodies=(cj.Body("bob", MASS, 0.01, cj.Position(0.3)),),
        joints=(cj.Revolute("hip", "ground", "bob", motion=cj.Motion(position=-np.pi / 2), clearance=play),),
        gravity=cj.Gravity(**gravity),
    )


REST = [
    (laws.HuntCrossley(STIFFNESS, 0.5), laws.TanhCoulomb(0.3, 1e-2)),
    (laws.exact_restitution(STIFFNESS, 0.7), laws.LuGre(0.4, 0.3, 1e-3, 1e5, 1e-2, 0.0)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("normal", "friction"), REST, ids=["no memory", "memory"])
def test_a_pin_under_its_weight_starts_in_its_equilibrium_and_stays_there(normal, friction):
    mechanism = hanging(normal, friction, y=-GRAVITY)
    solution = cj.simulate(mechanism, 0.05, save_at=51, rtol=1e-9, start="settled")
    depth = (MASS * GRAVITY / STIFFNESS) ** (2 / 3)
    at_rest = [0.0, -1e-4 - depth, -np.pi / 2, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(solution.initial[:6], at_rest, rtol=1e-12, atol=1e-18)
    # A fall from the middle would reach 0.04 m/s; the tolerance leaves a billionth of that.
    np.testing.assert_allclose(solution.y[:, :3], np.tile(at_rest[:3], (51, 1)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(solution.y[:, 3:6], 0.0, atol=1e-9)
    dataset = cj.to_dataset(mechanism, solution)
    energy = dataset.kinetic_energy + dataset.potential_energy + dataset.elastic_energy
    np.testing.assert_allclose(energy, energy[0], rtol=1e-14)
    np.testing.assert_allclose(dataset.contact_force, MASS * GRAVITY, rtol=1e-7)
    assert bool(np.all(dataset.penetration > 0))


@pytest.mark.parametrize(
    "normal",
    [laws.LinearKelvinVoigt(1e7, 500.0), laws.Hertz(STIFFNESS, 1.8), laws.AdamsImpact(STIFFNESS, 2000.0, 1e-5)],
    ids=lambda law: type(law).__name__,
)
def test_every_law_is_pressed_as_deep_as_it_bears_the_weight(normal):
    mechanism = hanging(normal, y=-GRAVITY).prepare()
    (joint,) = mechanism.clearance_joints()
    place, pressed = joint.clearance.seat((jnp.asarray(0.0), jnp.asarray(MASS * GRAVITY)))
    assert bool(pressed)
    assert float(joint.clearance.normal.force(-place[1] - 1e-4, jnp.zeros(()), ())) == pytest.approx(MASS * GRAVITY)


def test_a_pin_that_nothing_presses_starts_in_the_middle():
    mechanism = hanging(laws.Hertz(STIFFNESS), x=0.0)
    np.testing.assert_array_equal(initial_state(mechanism.prepare(), jnp.zeros(()), "settled")[:2], 0.0)


def test_a_payload_that_has_not_come_presses_no_pin():
    bare = hanging(laws.Hertz(STIFFNESS), y=-GRAVITY)
    load, grip = cj.Body("load", 1.0, picked_up=0.5), cj.Fixed("grip", "bob", "load")
    mechanism = cj.Mechanism((*bare.bodies, load), (*bare.joints, grip), gravity=bare.gravity)
    for time, mass in ((0.0, MASS), (1.0, MASS + 1.0)):
        force = joint_reactions(mechanism.prepare(), jnp.asarray(time), jnp.asarray([-np.pi / 2, 0.0]))["hip"].force
        np.testing.assert_allclose(np.asarray(force[:2], float), [0.0, mass * GRAVITY], atol=1e-12)


def test_the_moving_reaction_of_the_slider_crank():
    """At the dead centre the slider is braked with r w^2 (1 + r/l), by the wrist alone."""
    mechanism = slider_crank()
    y = jnp.asarray([0.0, 0.17, -SPEED * (1 + 0.05 / 0.12), 0.0])
    reaction = joint_reactions(mechanism.prepare(), jnp.zeros(()), y)["wrist"]
    braking = 0.05 * SPEED**2 * (1 + 0.05 / 0.12)
    np.testing.assert_allclose(np.asarray(reaction.force), [-0.14 * braking, 0.0, 0.0], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(np.asarray(reaction.at), [0.17, 0.0, 0.0], rtol=1e-14, atol=1e-14)
    # Held off the middle, the pin is where it is held, in the axes of the conrod.
    held = joint_reactions(mechanism.prepare(), jnp.zeros(()), y, {"wrist": (jnp.asarray(5e-4), jnp.asarray(0.0))})
    np.testing.assert_allclose(np.asarray(held["wrist"].on_pin), [-0.14 * braking, 0.0, 0.0], rtol=1e-2, atol=1e-9)


def start(values, mechanism):
    return initial_state(cj.replace(mechanism, values).prepare(), jnp.asarray(1e-3), "settled")


@pytest.mark.slow
def test_a_settled_loop_presses_with_its_reaction_and_rides_along():
    mechanism = slider_crank()
    now, later = (initial_state(mechanism.prepare(), jnp.asarray(t), "settled") for t in (1e-3, 1e-3 + 1e-7))
    # What starts a moment later has gone on from what starts now, with the speed that this has.
    np.testing.assert_allclose((later - now)[:2] / 1e-7, 0.5 * (now + later)[2:], rtol=1e-5)
    solution = cj.simulate(mechanism, 1e-3 + 2e-6, t0=1e-3, save_at=3, rtol=1e-8, start="settled")
    seen = cj.to_dataset(mechanism, solution)
    reaction = joint_reactions(
        mechanism.prepare(), jnp.asarray(1e-3), closed_start(mechanism.ideal().prepare(), jnp.asarray(1e-3))[0]
    )
    assert float(seen.contact_force[0, 0]) == pytest.approx(float(np.hypot(*reaction["wrist"].force[:2])), rel=2e-2)
    assert abs(float(seen.penetration_rate[0, 0])) < 1e-2 * 5e-4 * SPEED


@pytest.mark.slow
def test_the_first_revolution_is_like_the_second():
    mechanism = slider_crank()
    peak = metrics.Peak(metrics.ContactForce("wrist"))
    first = {word: float(peak(mechanism, 0.012, rtol=1e-6, start=word)) for word in ("centre", "settled")}
    both = float(peak(mechanism, 0.024, rtol=1e-6, start="settled"))
    # Impacts go on in every revolution, and no two are the same.
    assert first["settled"] == pytest.approx(both, rel=0.25)
    assert first["centre"] > 3 * first["settled"]


@pytest.mark.slow
@pytest.mark.parametrize("t0", [0.0, 1e-3])
def test_derivatives_of_a_settled_start_and_of_a_motion_from_it(t0):
    mechanism = slider_crank()

    def begin(c):
        return initial_state(cj.replace(mechanism, {CLEARANCE: c}).prepare(), jnp.asarray(t0), "settled")

    slope, step = jax.jacfwd(begin)(5e-4), 1e-7
    difference = (begin(5e-4 + step) - begin(5e-4 - step)) / (2 * step)
    np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-6)

    def error(c, rtol=1e-10):
        metric = metrics.At(metrics.PositionError("piston"), [t0, t0 + 2e-4])
        moved = cj.replace(mechanism, {CLEARANCE: c})
        return metric(moved, t0 + 2e-4, t0=t0, rtol=rtol, start="settled")

    found = jax.jacfwd(error)(5e-4)
    difference = (error(5e-4 + step) - error(5e-4 - step)) / (2 * step)
    np.testing.assert_allclose(found, difference, rtol=1e-5)


def test_a_vanishing_clearance_starts_as_the_ideal_mechanism():
    mechanism, t0 = slider_crank(), jnp.asarray(1e-3)
    ideal = closed_start(mechanism.ideal().prepare(), t0)[0]
    off = []
    for c in (1e-5, 1e-6, 1e-7):
        # Of a wall so stiff that the penetration vanishes with the clearance.
        stiff = {CLEARANCE: c, "wrist.normal.stiffness": 1e9 * c**-1.5}
        off.append((initial_state(cj.replace(mechanism, stiff).prepare(), t0, "settled") - ideal) / c)
    np.testing.assert_allclose(off[0], off[1], rtol=2e-3)
    np.testing.assert_allclose(off[1], off[2], rtol=2e-4)


def test_what_cannot_start_settled_is_refused():
    mechanism = slider_crank()
    loose = cj.Mechanism(mechanism.bodies, mechanism.joints, mechanism.loops, assemble=False)
    play = mechanism.clearance_joints()[0].clearance
    twice = cj.Revolute("twin", "conrod", "slider", cj.Position(0.12), clearance=play)
    tight = cj.Mechanism(mechanism.bodies, mechanism.joints, (*mechanism.loops, twice))
    with refused("assemble", False):
        cj.simulate(loose, 1e-3, start="settled")
    with refused("start", "center"):
        cj.simulate(mechanism, 1e-3, start="center")
    with pytest.raises(ClearanceError, match="over-constrained"):
        cj.simulate(tight, 1e-3, start="settled")


def test_a_start_says_which_joints_begin_at_relative_rest():
    mechanism = hanging(*REST[0], y=-GRAVITY)
    (name,) = (joint.name for joint in mechanism.clearance_joints())
    assert rest_words(mechanism, None) == ""
    rides, rests = (Seated(jnp.asarray([rest]), jnp.asarray([70.0]), jnp.asarray(5.0)) for rest in (0.0, 1.0))
    assert rest_words(mechanism, rides) == ""
    said = rest_words(mechanism, rests)
    assert f"begins at relative rest at the wall: `{name}` (70 of its play a second)" in said
    assert "up to 31.4 of its play a second, 2 pi times the lowest frequency of the pose, 5 Hz." in said
    # A loop's pin that could follow says why it does not.
    assert "together" in rest_words(mechanism, rests._replace(frequency=jnp.asarray(50.0)))
    solution = cj.simulate(mechanism, 0.05, save_at=51, rtol=1e-9, start="settled")
    assert solution.seated is not None
    assert not np.any(solution.seated.rest)
    assert solution.rests == ""
    assert "start" not in cj.to_dataset(mechanism, solution).attrs
    found = dataclasses.replace(solution, seated=rests)
    assert cj.to_dataset(mechanism, found).attrs["start"] == said
    for shown in (found, cj.Trace(found, np.zeros(1), np.asarray(solution.y)[:1], "")):
        assert said in repr(shown)


@pytest.mark.slow
def test_lanes_of_a_batch_start_as_single_solves_do():
    """A driven pendulum from rest: its load turns by r J / g for a jerk J, and its pin swings with sqrt(g / c)."""
    play = cj.RevoluteClearance(1e-4, 0.01, laws.HuntCrossley(STIFFNESS, 0.5))
    drive = cj.Motion(cj.drives.Quintic([0.0, 0.1], [0.0, 0.1]))
    hip = cj.Revolute("hip", "ground", "bob", motion=drive, clearance=play)
    bob = cj.Body("bob", MASS, 0.01, cj.Position(y=-0.3))
    mechanism = cj.Mechanism((bob,), (hip,), gravity=cj.Gravity(y=-GRAVITY))
    fastest = np.sqrt(GRAVITY / 1e-4) * GRAVITY / 0.3
    rises = fastest * 0.1**3 / 60 * np.array([0.2, 0.9, 1.1, 1.5, 3.0])

    def started(rise):
        moved = mechanism.with_drives({"hip": cj.drives.Quintic([0.0, 0.1], jnp.stack([0.0 * rise, rise]))})
        return cj.simulate(moved, 1e-5, rtol=1e-6, energy_balance=False, start="settled")

    single = jax.jit(started)
    alone = [single(jnp.asarray(rise)) for rise in rises]
    together = cj.batch(started, rises)
    np.testing.assert_array_equal(together.seated.rest[:, 0], [0, 0, 1, 1, 1])
    np.testing.assert_array_equal(together.seated.rest, [one.seated.rest for one in alone])
    for name in ("pace", "frequency"):
        expected = [getattr(one.seated, name) for one in alone]
        np.testing.assert_allclose(getattr(together.seated, name), expected, rtol=1e-12)
    np.testing.assert_allclose(together.initial, [one.initial for one in alone], rtol=1e-12, atol=1e-18)
    lanes = jax.tree.map(jnp.asarray, together)
    assert "3 of them begin with pins at relative rest." in repr(lanes)
    assert jax.tree.map(lambda x: x[2], lanes).rests == alone[2].rests != ""
    assert alone[2].rests in repr(alone[2])
