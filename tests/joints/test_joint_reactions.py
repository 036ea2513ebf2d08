"""What joints with play hold beside their contacts, what is said of their forces, and what they refuse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.dynamics.quantities import observe

pytestmark = pytest.mark.quick

HERTZ = laws.Hertz(1e9)
RUBBING = laws.TanhCoulomb(0.1, 1e-3)


def test_what_a_pin_without_axial_play_holds_is_in_its_reaction():
    """An arm on an upright pin in mid-play: its weight, and the weight's moment, as of the ideal joint."""
    play = cj.RevoluteClearance(1e-4, 0.01, HERTZ)
    body = cj.Body("arm", 2.0, cj.Inertia(2e-3, 0.03, 0.03), cj.Position(0.2))
    hip = cj.Revolute("hip", "ground", "arm", motion=cj.Motion(cj.drives.Constant(0.0)), clearance=play)
    m = cj.Mechanism((body,), (hip,), gravity=cj.Gravity(z=-9.81)).prepare()
    pressed = jnp.array([-1.02e-4, 0.0, 0.0, 0.0])
    seen = jax.jit(lambda y: observe(jnp.zeros(()), y, m))(pressed)
    np.testing.assert_allclose(seen["joint_reaction"][0], [1e9 * 2e-6**1.5, 0.0, 2.0 * 9.81], rtol=1e-12, atol=1e-9)
    # About the pin's centre: the arm's weight at 0.2 m.
    np.testing.assert_allclose(seen["joint_moment"][0], [0.0, -0.2 * 2.0 * 9.81, 0.0], rtol=1e-12, atol=1e-9)


def test_friction_and_slip_of_a_shaft_that_slides_are_along_it():
    """A pin pressed to its sleeve all along, sliding at 0.3 m/s: its normal force times mu, whatever the direction."""
    sleeve = cj.SleeveClearance(1e-4, 0.01, 0.04, HERTZ, RUBBING)
    body = cj.Body("pin", 2.0, cj.Inertia(2e-3, 0.03, 0.03))
    shaft = cj.Cylindrical("shaft", "ground", "pin", turn=cj.Motion(cj.drives.Constant(0.0)), clearance=sleeve)
    m = cj.Mechanism((body,), (shaft,)).prepare()
    names = [c.name for c in m.free_coordinates()]
    y = np.zeros(2 * len(names))
    y[names.index("shaft.play_x")], y[len(names) + names.index("shaft.slide")] = 1.02e-4, 0.3
    seen = jax.jit(lambda y: observe(jnp.zeros(()), y, m))(jnp.asarray(y))
    force = 1e9 * 2e-6**1.5
    assert float(seen["contact_force"][0]) == pytest.approx(force, rel=1e-9)
    assert float(seen["friction_force"][0]) == pytest.approx(0.1 * force, rel=1e-9)
    assert float(seen["slip_velocity"][0]) == pytest.approx(0.3, rel=1e-12)


def closed(joint):
    """A body that floats in space, with a joint to the ground that closes a loop."""
    body = cj.Body("arm", 2.0, cj.Inertia(0.03, 0.03, 0.03))
    return cj.Mechanism((body,), (cj.Free("float", "ground", "arm"),), (joint,))


def test_a_loop_in_space_that_would_hold_nothing_in_some_direction_is_refused():
    held = cj.SleeveClearance(1e-4, 0.01, 0.04, HERTZ)
    with refused("hip", 5):
        closed(cj.Revolute("hip", "ground", "arm", clearance=held))
    with refused("hip", 3):
        closed(cj.Revolute("hip", "ground", "arm", clearance=cj.RevoluteClearance(1e-4, 0.01, HERTZ)))
    loose = cj.SleeveClearance(1e-4, 0.01, 0.04, HERTZ, axial_clearance=1e-4)
    assert len(closed(cj.Revolute("hip", "ground", "arm", clearance=loose)).loops) == 1


def test_laws_that_have_no_meaning_in_a_joint_are_refused():
    radii = laws.Hertz(laws.InternalHertz(2e11, 1e11))
    with refused("stiffness"):
        cj.GuideClearance(1e-4, 0.06, 0.03, radii).prepare()


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y"])
def test_a_guide_along_any_axis_of_the_plane_stays_in_it(axis):
    play = cj.GuideClearance(1e-4, 0.06, 0.03, HERTZ)
    m = cj.Mechanism(
        (cj.Body("block", 0.5, 2e-4),), (cj.Prismatic("guide", "ground", "block", axis=axis, clearance=play),)
    )
    assert m.is_plane
    along, across, tilt = m.joint("guide").coordinates()
    along, across = np.array(along.slides, float), np.array(across.slides, float)
    np.testing.assert_array_equal(np.cross(across, [0, 0, 1]), along)
    assert abs(tilt.turns[2]) == 1.0
