"""Limit cycles: a linear oscillator in closed form, a slider-crank with clearance, and cycles that do not exist."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import SCENES, refused

import clearance_jax as cj
from clearance_jax.analysis.periodic import periodic_motion
from clearance_jax.errors import ClearanceError

MASS, AMPLITUDE = 2.0, 0.1
CRANK = SCENES / "slider_crank.toml"
REVOLUTION = 0.012
TURN = 2 * np.pi


def shaken(numbers):
    """A mass on a spring and damper in a shaken frame, started far from its cycle. **Arguments:** k, c, omega."""
    stiffness, damping, omega = numbers
    spring = cj.actuators.JointSpring(stiffness, damping)
    return cj.Mechanism(
        bodies=(cj.Body("frame", mass=1.0), cj.Body("body", mass=MASS)),
        joints=(
            cj.Prismatic("shaker", "ground", "frame", motion=cj.Motion(cj.drives.Harmonic(AMPLITUDE, omega))),
            cj.Prismatic("slide", "frame", "body", motion=cj.Motion(None, 30.0, -50.0, (spring,))),
        ),
    )


def steady(numbers):
    """Its steady state at t = 0: m x'' + c x' + k x = m A omega^2 sin(omega t)."""
    stiffness, damping, omega = numbers
    swing = MASS * AMPLITUDE * omega**2 / (stiffness - MASS * omega**2 + 1j * damping * omega)
    return jnp.stack([jnp.imag(swing), jnp.imag(1j * omega * swing)])


def searched(numbers):
    motion = periodic_motion(shaken(numbers), TURN / numbers[2], settle=1, max_iterations=8)
    return motion.y, motion


@pytest.mark.slow
def test_the_cycle_of_a_linear_oscillator_is_the_closed_form():
    numbers = jnp.asarray([50.0, 1.5, 4.0])
    search = jax.jit(jax.jacrev(searched, has_aux=True))  # the crank below takes jacfwd
    derivative, motion = search(numbers)
    assert bool(motion.converged)
    assert bool(motion.stable)
    assert motion.message == ""
    assert int(motion.iterations) <= 3
    np.testing.assert_allclose(motion.y, steady(numbers), rtol=0, atol=1e-8)
    exponents = np.roots([MASS, numbers[1], numbers[0]])
    expected = np.exp(exponents * TURN / numbers[2])
    np.testing.assert_allclose(np.sort_complex(motion.multipliers), np.sort_complex(expected), atol=1e-8)
    np.testing.assert_allclose(motion.margin, np.min(np.abs(1 - expected)), atol=1e-8)
    # By stiffness and damping; and by the frequency, on which the period depends too.
    np.testing.assert_allclose(derivative, jax.jacfwd(steady)(numbers), rtol=1e-7, atol=1e-8)

    # Undamped and driven at its own frequency, it has no periodic motion: its swing grows for ever.
    derivative, motion = search(jnp.asarray([MASS * 16.0, 0.0, 4.0]))
    assert not bool(motion.converged)
    assert not bool(motion.stable)
    assert "No periodic motion was found: after 8 iterations" in motion.message
    assert float(motion.margin) < 1e-8
    assert np.all(np.isnan(derivative))


def crank(clearance, damping, friction):
    values = {"radial_clearance": clearance, "normal.damping": damping, "friction.coefficient": friction}
    return cj.replace(cj.load(CRANK), {f"wrist.{name}": value for name, value in values.items()})


@pytest.mark.slow
def test_the_cycle_of_a_crank_with_clearance():
    def cycle(*numbers):
        motion = periodic_motion(crank(*numbers), REVOLUTION, max_iterations=10)
        return motion.y, motion

    search = jax.jit(jax.jacfwd(cycle, has_aux=True))
    clearance, *rest = gentle = (1e-4, 2e4, 0.1)
    derivative, motion = search(*gentle)
    assert bool(motion.converged)
    assert bool(motion.stable)
    assert float(motion.residual) < 1e-9
    np.testing.assert_array_equal(motion.turns, [-1.0, 0.0])  # the conrod stays level while the crank turns

    # Central differences of cycles found anew, extrapolated: contact makes the cycle bend within 1e-7 m of clearance.
    def difference(h):
        return (search(clearance + h, *rest)[1].y - search(clearance - h, *rest)[1].y) / (2 * h)

    differences = (4 * difference(4e-9) - difference(8e-9)) / 3
    np.testing.assert_allclose(derivative, differences, rtol=1e-5)

    # What is left of a disturbance after two periods and after six: its largest multiplier to the fourth power.
    multipliers, directions = np.linalg.eig(motion.monodromy)
    largest = np.argmax(np.abs(multipliers))
    np.testing.assert_allclose(np.abs(motion.multipliers[0]), np.abs(multipliers[largest]))
    start = motion.y + 1e-6 * np.real(directions[:, largest]) / np.abs(directions[0, largest])

    def left(periods):
        end = cj.simulate(crank(*gentle), periods * REVOLUTION, y0=start, rtol=1e-10, energy_balance=False).final
        return float((end - motion.y)[0] - periods * TURN * motion.turns[0])

    np.testing.assert_allclose(left(6) / left(2), np.real(multipliers[largest]) ** 4, rtol=0.02)

    # The same crank as the scene has it never repeats.
    derivative, motion = search(5e-4, 2e3, 0.03)
    assert not bool(motion.converged)
    assert "chaotic" in motion.message
    assert np.all(np.isnan(derivative))


def test_what_cannot_be_searched_raises():
    mechanism = shaken((50.0, 1.5, 4.0))
    with refused("shaker", 1.5):
        periodic_motion(mechanism, 1.5)
    with refused("turns"):
        periodic_motion(mechanism, TURN / 4.0, turns=[0, 0])
    driven = cj.Motion(cj.drives.ConstantSpeed(1.0))
    pivot = cj.Revolute("pivot", "ground", "wheel", motion=driven)
    wheel = cj.Mechanism(bodies=(cj.Body("wheel", inertia=1.0),), joints=(pivot,))
    with pytest.raises(ClearanceError, match="needs a free coordinate"):
        periodic_motion(wheel, TURN)
