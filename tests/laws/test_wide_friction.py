"""Friction of a wide contact acts all around the pin: its moment is that of the tractions mu p over the patch."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sleeves import checked, random_states, relative

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.joints.contact import Relative
from clearance_jax.laws.normal import relations

PIN, PLAY, LENGTH, MU, FORCE = 0.01, 1e-4, 0.02, 0.1, 1e3
ZERO = (0.0, 0.0, 0.0)


def quadrature(half: float) -> float:
    """The sum of the pressures over that of their components along the force."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    angle = half * nodes
    pressure = np.cos(angle) - np.cos(half)
    return np.sum(weights * pressure) / np.sum(weights * pressure * np.cos(angle))


def wide(half: float, **changes) -> tuple[cj.RevoluteClearance, float]:
    """A joint that bears 1 kN over a half angle, and how deep."""
    depth = PLAY * (1 / np.cos(half) - 1)
    line = relations.ContactLine(*(jnp.asarray(x) for x in (PLAY, PIN, PIN + PLAY, LENGTH, 1.0)))
    stiffness = FORCE / (LENGTH * (PIN + PLAY) * float(relations.foundation(line, jnp.asarray(depth))))
    friction = laws.TanhCoulomb(MU, 1e-3)
    return cj.RevoluteClearance(PLAY, PIN, laws.Winkler(stiffness), friction, length=LENGTH, **changes), depth


@pytest.mark.parametrize(("degrees", "torque"), [(60.0, 1.115), (80.0, 1.212)])
def test_the_moment_is_that_of_the_pressures(degrees, torque):
    half = np.radians(degrees)
    joint, depth = wide(half)
    turning = (jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(40.0))
    place = (jnp.asarray(PLAY + depth), jnp.asarray(0.0), 0.0)
    action = joint.prepare().act(Relative(place, 0.0, ZERO, turning), ())
    assert float(action.normal_force) == pytest.approx(FORCE, rel=1e-12)
    assert float(-action.torque[2]) == pytest.approx(MU * FORCE * PIN * quadrature(half), rel=1e-9)
    assert float(-action.torque[2]) == pytest.approx(torque, abs=5e-4)
    # Its resultant is that of the pressures' components.
    assert float(action.force[1]) == pytest.approx(-MU * FORCE, rel=1e-9)
    assert float(action.friction_power) == pytest.approx(float(-action.torque[2]) * 40.0, rel=1e-12)
    # The slip that is reported is that of the surfaces, by which they wear.
    assert float(action.points.slip[0]) == pytest.approx(40.0 * (PIN - depth), rel=1e-12)


@pytest.mark.slow
def test_power_balances_in_every_motion():
    """Of a pin that rolls, turns and slides, in the plane and in space with axial play: friction only takes."""
    joint, _ = wide(np.radians(60.0))
    sleeve = cj.SleeveClearance(PLAY, PIN, LENGTH, joint.normal, joint.friction, axial_clearance=1e-4, stations=4)
    rubbed = 0
    for at in random_states(12):
        # Rolling: the surfaces hardly slip at the contact point.
        rolling = at._replace(spin=(*at.spin[:2], -at.velocity[1] / PIN))
        for now in (at, rolling):
            rubbed += float(checked(sleeve, now).friction_power) > 0
            flat = Relative((*now.place[:2], 0.0), 0.0, (*now.velocity[:2], 0.0), (0.0, 0.0, now.spin[2]))
            action = joint.prepare().act(flat, ())
            given = np.dot(action.force[:2], now.velocity[:2]) + action.torque[2] * now.spin[2]
            assert float(given) == pytest.approx(float(-action.absorbed_power - action.friction_power), rel=1e-10)
            assert float(action.friction_power) >= 0
    assert rubbed > 8


def test_stations_of_a_sleeve_that_lies_flat_are_the_joint_of_the_plane():
    joint, depth = wide(np.radians(60.0))
    sleeve = cj.SleeveClearance(PLAY, PIN, LENGTH, joint.normal, joint.friction, axial_clearance=1e-4, stations=4)
    at = relative((PLAY + depth, 0.0, 0.0), spin=(0.0, 0.0, 40.0))
    plane = joint.prepare().act(at._replace(rows=None), ())
    space = sleeve.prepare().act(at, ())
    assert float(space.torque[2]) == pytest.approx(float(plane.torque[2]), rel=1e-12)
    # On its faces a collar rubs where they touch.
    on_face = relative((0.0, 0.0, 1.2e-4), spin=(0.0, 0.0, 40.0))
    pressed = sleeve.prepare().act(on_face, ())
    radius = 1.5 * PIN
    assert float(-pressed.torque[2]) == pytest.approx(MU * float(pressed.normal_force) * radius, rel=1e-9)


def test_the_spread_of_pressures_and_its_slope():
    """Series and closed form are one curve; a narrow contact is a point."""
    line = relations.ContactLine(*(jnp.asarray(x) for x in (PLAY, PIN, PIN + PLAY, LENGTH, 1.0)))
    spread = jax.vmap(lambda d: relations.foundation_spread(line, d))
    halves = np.array([1e-4, 0.05, relations.NARROW - 1e-9, relations.NARROW + 1e-9, 0.7, 1.4])
    depths = 2 * PLAY * np.sin(halves / 2) ** 2 / np.cos(halves)
    np.testing.assert_allclose(spread(jnp.asarray(depths)), [quadrature(half) for half in halves], rtol=1e-12)
    slope = jax.vmap(jax.grad(lambda d: relations.foundation_spread(line, d)))(jnp.asarray(depths))
    h = 1e-4 * depths
    difference = (np.asarray(spread(jnp.asarray(depths + h))) - np.asarray(spread(jnp.asarray(depths - h)))) / (2 * h)
    np.testing.assert_allclose(slope[1:], difference[1:], rtol=1e-5)
    assert np.isfinite(float(jax.grad(lambda d: relations.foundation_spread(line, d))(jnp.asarray(0.0))))


@pytest.mark.parametrize("make", [laws.johnson, laws.liu])
def test_line_contacts_rub_over_the_ellipse_of_hertz(make):
    modulus = 2e11 / 2 / (1 - 0.3**2)
    joint = cj.RevoluteClearance(PLAY, PIN, make(2e11, 2e11), laws.TanhCoulomb(MU, 1e-3), length=LENGTH)
    for depth in (1e-7, 1e-5, 4e-5):
        place, turning = (jnp.asarray(PLAY + depth), jnp.asarray(0.0), 0.0), (*ZERO[:2], jnp.asarray(40.0))
        action = joint.prepare().act(Relative(place, 0.0, ZERO, turning), ())
        force = float(action.normal_force)
        half = np.sqrt(4 * force / LENGTH / (np.pi * modulus * PLAY))
        assert half < np.pi / 2
        x = np.cos(np.pi * (np.arange(400) + 0.5) / 400)  # Gauss and Chebyshev's, of the second kind
        weights = 1 - x * x
        spread = np.sum(weights) / np.sum(weights * np.cos(half * x))
        arm = PIN - depth + PIN * (spread - 1)
        assert float(-action.torque[2]) == pytest.approx(MU * force * arm, rel=1e-5)
        assert float(action.friction_power) == pytest.approx(40.0 * float(-action.torque[2]), rel=1e-12)


@pytest.mark.slow
def test_a_disc_on_a_wide_bearing_comes_to_rest():
    """Its moment about the pin slows it down; all of its energy is friction."""
    joint, depth = wide(np.radians(60.0))
    joint = dataclasses.replace(joint, normal=dataclasses.replace(joint.normal, restitution=jnp.asarray(0.5)))
    mass, inertia, spin = FORCE / 9.81, 0.5, 40.0
    at = cj.Position(0.0, -(PLAY + depth))
    hip = cj.Revolute("hip", "ground", "disc", clearance=joint, motion=cj.Motion(velocity=spin), eccentricity=at)
    disc = cj.Mechanism((cj.Body("disc", mass, inertia),), (hip,), gravity=cj.Gravity(y=-9.81))
    motion = cj.simulate(disc, 0.3, rtol=1e-8, save_at=4)
    assert float(motion.energy_residual) < 1e-6
    # The pin climbs until the wall bears friction too: the normal force is m g / sqrt(1 + mu^2).
    normal = FORCE / np.hypot(1, MU)
    told = spin - 0.3 * MU * normal * PIN * quadrature(np.radians(60.0)) / inertia
    assert float(motion["hip.velocity"][-1]) == pytest.approx(told, rel=2e-3)
