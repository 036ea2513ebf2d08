"""What is asked of a robot: distance from the path as a curve, the error's angle, settling times."""

from pathlib import Path
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import refused
from scipy.optimize import root_scalar

import clearance_jax as cj
from clearance_jax import metrics

SCENES = Path(__file__).parents[2] / "experiments" / "scenes"
T1, LENGTH, SWING, SPEED = 0.1, 0.4, np.deg2rad(20), 30.0
CLEARANCE = "hip.radial_clearance"
TIMES = jnp.linspace(0.002, T1, 50)


@pytest.fixture(scope="module")
def arm():
    return cj.load(SCENES / "arm.toml")


def arc_distance(place):
    """Distance from the arc that the ideal tip draws about the hip: T1 is long enough for both of its ends."""
    angle = jnp.clip(jnp.arctan2(place[:, 1], place[:, 0]), -SWING, SWING)
    nearest = LENGTH * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    return jnp.linalg.norm(place[:, :2] - nearest, axis=1)


def places(solution):
    return solution["tip.position"]


@pytest.mark.slow
def test_path_deviation_is_the_distance_from_the_whole_curve(arm):
    """The ideal tip swings along an arc, and turns at both of its ends."""

    def both(clearance):
        wanted = {
            "path": metrics.At(metrics.PathDeviation("tip"), TIMES),
            "time": metrics.At(metrics.PositionError("tip"), TIMES),
            "place": metrics.Function(places, TIMES),
        }
        found = cj.measure(cj.replace(arm, {CLEARANCE: clearance}), wanted, T1, rtol=1e-9)
        return found["path"], arc_distance(found["place"]), found["time"]

    (path, exact, same_time), (slope, exact_slope, _) = jax.jvp(both, (1e-4,), (1.0,))
    np.testing.assert_allclose(path, exact, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(slope, exact_slope, rtol=1e-5, atol=1e-5 * float(jnp.max(jnp.abs(exact_slope))))
    assert np.all(np.asarray(path) <= np.asarray(same_time) + 1e-12)
    # At an end of the arc a tip beyond it is farther from the curve than normal to it.
    assert float(jnp.min(same_time - path)) < 1e-7 < float(jnp.max(same_time - path))


@pytest.mark.slow
def test_the_peak_of_a_path_deviation_is_the_largest_of_its_samples(arm):
    found = cj.measure(
        arm,
        {
            "peak": metrics.Peak(metrics.PathDeviation("tip")),
            "mean": metrics.Mean(metrics.PathDeviation("tip")),
            "dense": metrics.At(metrics.PathDeviation("tip"), np.linspace(0, T1, 2001)),
        },
        T1,
    )
    dense = np.asarray(found["dense"])
    assert dense.max() * (1 - 1e-12) <= float(found["peak"]) <= dense.max() * (1 + 1e-3)
    assert float(found["mean"]) == pytest.approx(np.mean(0.5 * (dense[1:] + dense[:-1])), rel=1e-4)


@pytest.mark.slow
def test_a_path_that_turns_too_often_for_its_samples_is_refused(arm):
    with refused("samples", 11):
        metrics.At(metrics.PathDeviation("tip", samples=11), [0.05])(arm, T1)
    hidden = jax.jit(
        lambda c: metrics.At(metrics.PathDeviation("tip", 11), [0.05])(cj.replace(arm, {CLEARANCE: c}), T1)
    )
    assert np.isnan(hidden(1e-4)).all()
    with refused("samples", 100):
        metrics.PathDeviation("tip", 100)


def test_the_angle_of_a_tilted_frame_is_that_of_the_relative_rotation():
    """A rotation by two angles about two axes: its angle is that of the product, in space."""
    from clearance_jax.spatial import IDENTITY, X, Y, length_of, rotation_between

    one = IDENTITY.turn(X, jnp.asarray(0.3)).turn(Y, jnp.asarray(-0.2))
    two = one.turn(Y, jnp.asarray(0.01)).turn(X, jnp.asarray(0.02))
    relative = np.array(one.rows).T @ np.array(two.rows)
    assert float(length_of(rotation_between(one, two))) == pytest.approx(
        np.arccos((np.trace(relative) - 1) / 2), rel=1e-6
    )


# Settling times ------------------------------------------------------------------------------------------------------

MASS, STIFFNESS, DAMPING, START = 2.0, 800.0, 4.0, 0.01
DECAY, NATURAL = DAMPING / (2 * MASS), np.sqrt(STIFFNESS / MASS)
DAMPED = np.sqrt(NATURAL**2 - DECAY**2)


class Offset(metrics.AbstractSignal):
    """How far the block is from where its spring is relaxed [m]."""

    unit: ClassVar[str] = "m"

    def value(self, time, y, mechanism, reference):
        return jnp.abs(y[0])


@pytest.fixture(scope="module")
def block():
    spring = cj.actuators.JointSpring(stiffness=STIFFNESS, damping=DAMPING)
    slide = cj.Prismatic("slide", "ground", "block", axis="x", motion=cj.Motion(position=START, actuators=(spring,)))
    return cj.Mechanism((cj.Body("block", MASS, 1e-3),), (slide,))


def swing(time, start=START):
    return start * np.exp(-DECAY * time) * (np.cos(DAMPED * time) + DECAY / DAMPED * np.sin(DAMPED * time))


def exact_entry(band, end, start=START):
    """The last time before `end` at which the exact swing comes into the band."""
    times = np.linspace(0, end, 20001)
    outside = np.flatnonzero(np.abs(swing(times, start)) > band)
    ends = times[outside[-1]], times[outside[-1] + 1]
    return root_scalar(lambda t: abs(swing(t, start)) - band, bracket=ends, xtol=1e-14).root


def settling(block, start=START, band=2e-3, since=0.2, t1=3.0):
    moved = cj.replace(block, {"slide.position": start})
    return metrics.SettlingTime(Offset(), band, since)(moved, t1, rtol=1e-10)


@pytest.mark.slow
def test_the_settling_time_of_a_damped_block_and_its_derivatives(block):
    expected = exact_entry(2e-3, 3.0) - 0.2
    value, slope = jax.value_and_grad(lambda start: settling(block, start))(START)
    assert float(value) == pytest.approx(expected, rel=1e-8)
    step = 1e-7
    up, down = (exact_entry(2e-3, 3.0, START + s * step) for s in (1, -1))
    assert float(slope) == pytest.approx((up - down) / (2 * step), rel=1e-5)
    by_band = jax.grad(lambda band: settling(block, band=band))(2e-3)
    up, down = (exact_entry(2e-3 + s * step, 3.0) for s in (1, -1))
    assert float(by_band) == pytest.approx((up - down) / (2 * step), rel=1e-5)
    assert float(jax.grad(lambda since: settling(block, since=since))(0.2)) == -1.0


def test_what_is_settled_at_once_and_what_never_settles(block):
    value, slope = jax.value_and_grad(lambda start: settling(block, start, since=2.5))(START)
    assert (float(value), float(slope)) == (0.0, 0.0)
    value, slope = jax.value_and_grad(lambda start: settling(block, start, band=1e-9, since=0.2, t1=1.0))(START)
    assert (float(value), float(slope)) == (np.inf, 0.0)


@pytest.mark.slow
def test_a_signal_that_jumps_into_the_band_settles_there(arm):
    """The arm turns at constant acceleration, and stops turning at once when its drive's last piece ends."""
    turn = arm.ideal().with_drives({"hip": cj.drives.StepSum([0.0], [0.05], [0.3])})
    found = metrics.SettlingTime(metrics.Acceleration("tip"), 10.0, 0.01)(turn, T1)
    assert float(found) == pytest.approx(0.04, abs=1e-9)


@pytest.mark.slow
def test_a_settling_time_of_lanes_and_of_poses(block):
    bands = jnp.asarray([1e-3, 2e-3, 1e-9])
    found = jax.vmap(lambda band: settling(block, band=band))(bands)
    expected = [exact_entry(float(band), 3.0) - 0.2 for band in bands[:2]]
    np.testing.assert_allclose(found[:2], expected, rtol=1e-7)
    assert found[2] == np.inf
    with refused("EntryFinder"):
        metrics.SettlingTime(metrics.PositionError("tip"), 1e-6, 0.05)(
            cj.load(SCENES / "arm.toml"), T1, fidelity="quasi-static"
        )
