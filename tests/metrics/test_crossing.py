"""When a signal crosses a value: closed forms, derivatives by hand, under jit, vmap and in batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws, metrics

CLEARANCE, GRAVITY = 1e-3, 9.81
MASS, STIFFNESS, START = 2.0, 800.0, 0.01
NATURAL = np.sqrt(STIFFNESS / MASS)


def falling(clearance=CLEARANCE, gravity=GRAVITY):
    """A pin that falls from the middle of its sleeve."""
    play = cj.RevoluteClearance(clearance, 0.01, laws.HuntCrossley(6.61e10, 100.0))
    still = cj.Motion(cj.drives.ConstantSpeed(0.0))
    joint = cj.Revolute("j", "ground", "pin", motion=still, clearance=play)
    return cj.Mechanism((cj.Body("pin", 0.14),), (joint,), gravity=cj.Gravity(y=-gravity))


TOUCH = metrics.CrossingTime(metrics.Quantity("j.penetration"))


def touch(clearance, gravity=GRAVITY, **options):
    return TOUCH(falling(clearance, gravity), 0.05, rtol=1e-10, **options)


@pytest.mark.slow
def test_a_pin_in_free_fall_touches_when_galileo_says():
    """After sqrt(2 c / g); and its derivatives by both."""
    time, slopes = jax.jit(jax.value_and_grad(touch, (0, 1)))(CLEARANCE, GRAVITY)
    exact = np.sqrt(2 * CLEARANCE / GRAVITY)
    assert float(time) == pytest.approx(exact, rel=1e-9)
    np.testing.assert_allclose(slopes, [exact / (2 * CLEARANCE), -exact / (2 * GRAVITY)], rtol=1e-7)
    step = 1e-8
    assert float(slopes[0]) == pytest.approx(float(touch(CLEARANCE + step) - touch(CLEARANCE - step)) / 2e-8, rel=1e-5)


@pytest.mark.slow
def test_lanes_touch_as_they_do_alone_and_what_does_not_touch_has_no_time():
    clearances = np.array([1e-4, 1e-3, 1e-1])
    exact = np.sqrt(2 * clearances / GRAVITY)

    def both(clearance):
        return jax.value_and_grad(touch)(clearance)

    for times, slopes in (cj.batch(both, clearances), jax.jit(jax.vmap(both))(clearances)):
        np.testing.assert_allclose(times[:2], exact[:2], rtol=1e-9)
        np.testing.assert_allclose(slopes[:2], (exact / (2 * clearances))[:2], rtol=1e-7)
        assert np.isnan([times[2], slopes[2]]).all()


@pytest.fixture(scope="module")
def block():
    spring = cj.actuators.JointSpring(stiffness=STIFFNESS)
    slide = cj.Prismatic("slide", "ground", "block", axis="x", motion=cj.Motion(position=START, actuators=(spring,)))
    return cj.Mechanism((cj.Body("block", MASS, 1e-3),), (slide,))


@pytest.mark.parametrize(
    ("direction", "since", "turns"), [("falling", None, 0.0), ("rising", None, 0.5), ("falling", 0.2, 1.0)]
)
def test_a_block_on_a_spring_passes_a_level(block, direction, since, turns):
    """A cos(w t) first crosses a level L down and up, and down again."""
    level = 0.004

    def passes(start, level):
        metric = metrics.CrossingTime(metrics.Quantity("slide.position"), level, direction, since)
        return metric(cj.replace(block, {"slide.position": start}), 1.0, rtol=1e-10)

    time, (by_start, by_level) = jax.value_and_grad(passes, (0, 1))(START, level)
    angle, root = np.arccos(level / START), np.sqrt(START**2 - level**2)
    sign = -1.0 if direction == "rising" else 1.0
    # Upwards it passes the level as long before the end of the turn as downwards after its beginning.
    expected = (2 * np.pi - angle if direction == "rising" else angle + 2 * np.pi * turns) / NATURAL
    assert float(time) == pytest.approx(expected, rel=1e-8)
    assert float(by_start) == pytest.approx(sign * level / (START * root * NATURAL), rel=1e-6)
    assert float(by_level) == pytest.approx(-sign / (root * NATURAL), rel=1e-6)


def test_a_driven_crank_passes_an_angle():
    """A coordinate that is no state: t = angle / speed; one that begins beyond the angle comes by no more."""
    crank = cj.Revolute("crank", "ground", "wheel", motion=cj.Motion(cj.drives.ConstantSpeed(20.0)))
    wheel = cj.Mechanism((cj.Body("wheel", 1.0, 1e-3),), (crank,), gravity=cj.Gravity(y=-9.81))

    def passes(speed, angle):
        moved = cj.replace(wheel, {"drive.crank.speed": speed})
        return metrics.CrossingTime(metrics.Quantity("crank.position"), angle)(moved, 0.1)

    time, (by_speed, by_angle) = jax.value_and_grad(passes, (0, 1))(20.0, 1.0)
    np.testing.assert_allclose([time, by_speed, by_angle], [0.05, -0.0025, 0.05], rtol=1e-9)
    assert np.isnan(passes(20.0, -1.0))


@pytest.mark.slow
def test_a_quantity_that_is_none_is_refused(block):
    for name in ("slide.positon", "block.position"):
        with refused(name):
            metrics.Peak(metrics.Quantity(name))(block, 0.1)
    with refused("direction", "up"):
        metrics.CrossingTime(metrics.Quantity("slide.position"), direction="up")
    assert float(metrics.Peak(metrics.Quantity("slide.position"))(block, 0.5)) == pytest.approx(START)
    assert jnp.ndim(metrics.Peak(metrics.Quantity("slide.velocity"))(block, 0.5)) == 0
