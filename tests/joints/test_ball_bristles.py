"""Friction with bristles in a ball's socket: a vector that the plane of contact carries with it."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sleeves import relative

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.joints.contact import Relative

CLEARANCE, RADIUS, STIFFNESS = 1e-4, 0.01, 1e4
LAW: Any = laws.Hertz(1e9)
LUGRE: Any = laws.LuGre(0.4, 0.3, 1e-3, STIFFNESS)
DEEP = 1.5e-4  # from the centre of the socket to that of the ball


def socket(friction) -> Any:
    return cj.SphericalClearance(CLEARANCE, RADIUS, LAW, friction)


def remembered(joint, bend):
    """The memory of a joint whose bristles are bent."""
    return (*(jnp.asarray(float(z)) for z in bend), jnp.ones(()))


def test_it_remembers_a_vector():
    assert socket(LUGRE).remembers == ("bristle_1", "bristle_2", "bristle_3", "touching")
    assert socket(laws.TanhCoulomb(0.1, 0.01)).remembers == ()


@pytest.mark.parametrize("friction", [LUGRE, laws.Dahl(0.4, STIFFNESS)], ids=["lugre", "dahl"])
def test_a_stuck_ball_is_held_by_its_bristles(friction):
    """At rest the traction is -N s0 z, in the plane of contact, whichever way that faces."""
    joint, rng = socket(friction).prepare(), np.random.default_rng(0)
    for normal in (*rng.normal(size=(3, 3)), np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])):
        normal /= np.linalg.norm(normal)
        bend = 1e-5 * np.cross(normal, rng.normal(size=3))
        action = joint.act(relative(DEEP * normal), remembered(joint, bend))
        size = float(action.normal_force)
        assert size == pytest.approx(1e9 * (DEEP - CLEARANCE) ** 1.5)
        np.testing.assert_allclose(np.array(action.force), -size * normal - size * STIFFNESS * bend, rtol=1e-12)
        np.testing.assert_array_equal(np.array(action.memory_rate), 0.0)
        assert float(action.friction_power) == 0.0


@pytest.mark.parametrize("depth", [1e-6, -1e-6])
@pytest.mark.parametrize("touched", [0.0, 1.0])
def test_bristles_bend_while_their_point_has_touched(depth, touched):
    """By what was latched: a rate that followed the penetration would jump inside the step across a touch."""
    joint, slip = socket(LUGRE).prepare(), 0.3
    at = relative((0.0, 0.0, -CLEARANCE - depth), (0.0, 0.0, 0.0), (slip, 0.0, 0.0))
    rates = joint.act(at, (*(jnp.zeros(()),) * 3, jnp.asarray(touched))).memory_rate
    np.testing.assert_allclose(rates, [touched * slip, 0, 0, 0], rtol=1e-12)


def rolled(joint, place, velocity, spin, end, start):
    """The bristle [m] after a motion of the ball with a place and a velocity over time, and the rates of all it does:
    work of friction, and deflection times what gives way.
    """

    @jax.jit
    def flow(t, state):
        at = Relative(tuple(place(t)), 0.0, tuple(velocity(t)), tuple(spin(t)), relative((0, 0, 0)).rows)
        action = joint.act(at, (*state[:3], jnp.ones(())))
        return jnp.append(jnp.stack(action.memory_rate[:3]), action.friction_power)

    return solve_ivp(
        lambda t, y: np.asarray(flow(t, jnp.asarray(y))), (0, end), [*start, 0.0], "DOP853", rtol=1e-11, atol=1e-15
    ).y[:, -1]


def test_a_plane_of_contact_carries_its_bristles_round_a_circle():
    """A ball rolls round a circle of latitude without slip: the deflection keeps its length, and is turned by the solid
    angle of the cap, 2 pi (1 - cos h), as a vector that is carried parallel to itself on a sphere.
    """
    joint, height, rate = socket(LUGRE).prepare(), 0.7, 3.0
    tall, wide = np.cos(height), np.sin(height)

    def unit(t):
        return jnp.stack([wide * jnp.cos(rate * t), wide * jnp.sin(rate * t), jnp.asarray(-tall)])

    def velocity(t):
        return DEEP * rate * wide * jnp.stack([-jnp.sin(rate * t), jnp.cos(rate * t), jnp.zeros(())])

    def spin(t):
        return -jnp.cross(unit(t), velocity(t)) / (RADIUS + CLEARANCE - DEEP)

    east, down = np.array([0.0, 1.0, 0.0]), np.array([-tall, 0.0, -wide])  # at the start, square to the normal
    end = rolled(joint, lambda t: DEEP * unit(t), velocity, spin, 2 * np.pi / rate, 1e-5 * east)
    turned = 2 * np.pi * (1 - tall)
    along = np.array([end[:3] @ east, end[:3] @ down, end[:3] @ [wide, 0.0, -tall]]) / 1e-5
    np.testing.assert_allclose(np.abs(along[:2]), np.abs([np.cos(turned), np.sin(turned)]), rtol=1e-8)
    assert along[0] == pytest.approx(np.cos(turned), rel=1e-8)
    assert abs(along[2]) < 1e-9
    assert abs(end[3]) < 1e-15  # nothing slips


def test_friction_of_a_ball_takes_energy_from_every_motion():
    """At a constant normal force N the work of friction is what the bristles hold, N s0 z^2/2, and what they have given
    up, N s0 r z^2 over time: never less than they hold.
    """
    joint = socket(LUGRE).prepare()

    def unit(t):
        tilt, turn = 0.8 + 0.5 * jnp.sin(7 * t), 11 * t
        return jnp.stack([jnp.sin(tilt) * jnp.cos(turn), jnp.sin(tilt) * jnp.sin(turn), -jnp.cos(tilt)])

    def velocity(t):
        return DEEP * jax.jvp(unit, (t,), (jnp.ones(()),))[1]

    def spin(t):
        return jnp.stack([0.2 * jnp.sin(31 * t), 0.3 * jnp.cos(17 * t), 0.1 + 0.0 * t])

    end = rolled(joint, lambda t: DEEP * unit(t), velocity, spin, 0.3, np.zeros(3))
    size = 1e9 * (DEEP - CLEARANCE) ** 1.5
    held = size * STIFFNESS * end[:3] @ end[:3] / 2
    assert 0 < held < end[3]
    assert np.linalg.norm(end[:3]) <= 0.4 / STIFFNESS
    assert abs(end[:3] @ np.asarray(unit(0.3))) < 1e-9 * np.linalg.norm(end[:3])


def test_rates_of_bristles_have_the_derivatives_of_differences():
    """By place and velocity, where the contact moves, slips and bends its bristles."""
    joint, rng = socket(LUGRE).prepare(), np.random.default_rng(3)
    normal = np.array([0.3, -0.5, -0.81])
    state = np.concatenate([DEEP * normal / np.linalg.norm(normal), [2e-3, 1e-3, 5e-4], [1e-5, -4e-6, 6e-6]])
    spin = relative((0, 0, 0), spin=(0.2, -0.1, 0.4))

    @jax.jit
    def does(state):
        at = spin._replace(place=tuple(state[:3]), velocity=tuple(state[3:6]))
        action = joint.act(at, (*state[6:], jnp.ones(())))
        return jnp.concatenate([jnp.stack(action.memory_rate[:3]), jnp.stack(action.force), jnp.stack(action.torque)])

    size = np.repeat([1e-6, 1e-3, 1e-6], 3)
    for _ in range(3):
        along = size * rng.normal(size=9)
        exact = jax.jvp(does, (jnp.asarray(state),), (jnp.asarray(along),))[1]
        h = 1e-4
        found = (np.asarray(does(state + h * along)) - np.asarray(does(state - h * along))) / (2 * h)
        np.testing.assert_allclose(exact, found, rtol=1e-5, atol=1e-7 * np.abs(exact).max())
