"""Scripts as strangers write them: solves that fail under jit, vmap, grad and in batches, minibatches of sample times,
tolerances that floats do not resolve. What did not reach its end is not a number, with its derivatives.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import metrics
from clearance_jax.solve.codes import Result
from clearance_jax.solve.steps.tolerances import SMALLEST

JOINT = cj.Revolute(
    "j",
    "ground",
    "pin",
    motion=cj.Motion(cj.drives.ConstantSpeed(0.0)),
    clearance=cj.RevoluteClearance(1e-3, 0.01, cj.laws.HuntCrossley(6.61e10, 100.0)),
)
# A pin that falls in its sleeve, touches after 14.3 ms and is thrown up again.
PIN = cj.Mechanism((cj.Body("pin", 0.14),), (JOINT,), points=(cj.Point("tip", "pin"),), gravity=cj.Gravity(y=-9.81))
CLEARANCE = "j.radial_clearance"
T1 = 0.02
NAMES = "tip.position", "j.eccentricity", "j.contact_force", "damping_loss"
HOW = {"rtol": 1e-7, "energy_balance": False}


def tip(clearance, **options):
    return cj.simulate(cj.replace(PIN, {CLEARANCE: clearance}), T1, **HOW, **options)["tip.position"][1]


# Solves that fail ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("derivatives", ["controlled", "screening"])
def test_a_solve_that_stops_early_has_no_value_and_no_derivative(derivatives):
    """Too few steps, and a clearance below zero: it was the state where the solve stopped, and a derivative of it."""

    def stopped(clearance):
        return tip(clearance, max_steps=20, derivatives=derivatives)

    if derivatives == "screening":
        assert np.isnan(jax.jvp(stopped, (1e-3,), (1.0,))).all()
        return
    assert np.isnan(jax.value_and_grad(stopped)(1e-3)).all()
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(tip)))(jnp.array([-1e-4, 1e-3]))
    assert np.isnan([values[0], slopes[0]]).all()
    assert np.isfinite([values[1], slopes[1]]).all()
    with pytest.raises(RuntimeError, match=r"largest number of steps was reached, 20 \(`max_steps`\), at t = .*more"):
        stopped(1e-3)
    kept = cj.simulate(PIN, T1, max_steps=20, throw=False, **HOW)
    assert 0 < float(kept.end_time) < T1
    assert np.isfinite(kept["tip.position"]).all()


@pytest.mark.slow
def test_nothing_of_a_failed_motion_looks_like_an_answer():
    """Named quantities, samples and metrics, also those that a norm or a comparison would make a number again."""

    def lane(clearance):
        s = cj.simulate(cj.replace(PIN, {CLEARANCE: clearance}), T1, rtol=1e-7, save_at=3)
        return [s[name] for name in NAMES], s.y, s.final, s.initial, s.time, s.energy_residual, s.code

    found = cj.batch(lane, np.array([-1e-4, 1e-3]))
    assert found[-1].tolist() == [int(Result.IMPOSSIBLE), 0]
    for leaf in jax.tree.leaves(found[:-1]):
        assert np.isnan(leaf[0]).all()
        assert np.isfinite(leaf[1]).all()

    def hiding(solution):
        force = solution["j.contact_force"]
        return jnp.sum(jnp.where(force > 1.0, force, 0.0))

    asked = {
        "hidden": hiding,
        "force": metrics.Peak(metrics.ContactForce("j")),
        "impacts": metrics.Impacts("j"),
        "rms": metrics.Rms(metrics.PositionError("tip")),
        "settling": metrics.SettlingTime(metrics.PositionError("tip"), 1e-4, 1e-3),
        "touch": metrics.CrossingTime(metrics.Quantity("j.penetration")),
    }

    def measured(clearance, asked=asked):
        return cj.measure(cj.replace(PIN, {CLEARANCE: clearance}), asked, T1, rtol=1e-7, save_at=3, max_steps=20)

    assert np.isnan(list(jax.jit(measured)(1e-3).values())).all()

    smooth = {name: metric for name, metric in asked.items() if name != "impacts"}
    value, slope = jax.jvp(lambda c: list(measured(c, smooth).values()), (1e-3,), (1.0,))
    assert np.isnan([*value, *slope]).all()
    times = jax.jit(lambda c: metrics.Peak(metrics.ContactForce("j")).times(
        cj.replace(PIN, {CLEARANCE: c}), T1, rtol=1e-7, max_steps=20
    ))(1e-3)  # fmt: skip
    assert np.isnan(times).all()


@pytest.mark.slow
def test_a_line_search_steps_back_from_what_is_impossible():
    """A clearance below zero had the value 0 and the gradient 0: a search went there, and found nothing better."""
    wanted = float(tip(1e-3))

    def misfit(scaled, _):
        return ((tip(1e-3 * scaled) - wanted) / 1e-4) ** 2

    # The first step, along the gradient, is far too long.
    value, slope = jax.value_and_grad(misfit)(1.05, None)
    assert value > 0
    assert 1.05 - slope < 0
    solver = optimistix.BFGS(rtol=1e-6, atol=1e-6)
    found = optimistix.minimise(misfit, solver, jnp.asarray(1.05), max_steps=40, throw=False)
    assert float(found.value) == pytest.approx(1.0, abs=1e-4)


def test_a_request_that_no_computer_answers_ends_by_default():
    """A spring of 1e16 N/m swings for a second: a thousand million steps. The default allows a million attempts."""
    spring = cj.actuators.JointSpring(stiffness=1e16)
    slide = cj.Prismatic("slide", "ground", "block", motion=cj.Motion(position=0.01, actuators=(spring,)))
    block = cj.Mechanism((cj.Body("block", 1.0, 1e-3),), (slide,))
    s = cj.simulate(block, 1.0, throw=False, energy_balance=False)
    assert s.message == "the largest number of steps was reached"
    assert int(s.steps + s.rejected) == 1_000_000


def test_poses_of_lanes_that_fail_are_none():
    def posed(clearance):
        moved = cj.replace(PIN, {CLEARANCE: clearance})
        s = cj.simulate(moved, T1, save_at=jnp.array([0.01, 0.0]), fidelity="quasi-static")
        return s["tip.position"][:, 1], s.code

    places, slopes, codes = [], [], []
    for clearance in (-1e-4, 1e-3):
        (place, code), (slope, _) = jax.jvp(jax.jit(posed), (clearance,), (1.0,))
        places, slopes, codes = [*places, place], [*slopes, slope], [*codes, int(code)]
    assert codes == [int(Result.NO_POSE), 0]
    for found in (places, slopes):
        assert np.isnan(found[0]).all()
        assert np.isfinite(found[1]).all()


# Sample times --------------------------------------------------------------------------------------------------------

UNSORTED = np.array([0.01, 0.0, 0.02, 5e-3, 5e-3])
BAD = {
    "beyond the end": [0.0, 0.01, 5e-3, 0.03, 0.0],
    "before the start": [-0.01, 0.0, 0.01, 5e-3, 0.0],
    "no number": [0.0, 0.01, np.nan, 0.02, 0.0],
}


def sampled(times, **options):
    s = cj.simulate(PIN, T1, save_at=times, **HOW, **options)
    return s["tip.position"][:, 1], s.time, s.code


@pytest.mark.slow
def test_sample_times_of_a_minibatch_come_back_in_its_order():
    """Of lanes they came back as others' places: .1028 for .0208 m, with code 0."""
    order = np.argsort(UNSORTED[:4])
    expected = np.empty(5)
    expected[order] = sampled(UNSORTED[order])[0]
    expected[4] = expected[3]
    every = np.array([UNSORTED, np.sort(UNSORTED), *BAD.values()])
    for found in (jax.jit(jax.vmap(sampled))(every), cj.batch(sampled, every)):
        places, times, codes = found
        np.testing.assert_allclose(places[0], expected, rtol=1e-9)
        np.testing.assert_allclose(places[1], expected[np.argsort(UNSORTED, kind="stable")], rtol=1e-9)
        np.testing.assert_array_equal(times[0], UNSORTED)
        assert codes.tolist() == [0, 0, *[int(Result.SAMPLE_TIMES)] * len(BAD)]
        assert np.isnan(places[2:]).all()
    np.testing.assert_allclose(sampled(UNSORTED)[0], expected, rtol=1e-12)
    alone = jax.jit(sampled)
    for times in (UNSORTED, *BAD.values()):
        places, _, code = alone(np.asarray(times))
        good = times is UNSORTED
        np.testing.assert_allclose(places, expected if good else np.nan, rtol=1e-9)
        assert int(code) == (0 if good else int(Result.SAMPLE_TIMES))
    for times in BAD.values():
        with refused("save_at"):
            sampled(np.array(times))


@pytest.mark.slow
def test_a_derivative_by_sample_times_is_the_velocity_there():
    def total(times):
        return jnp.sum(sampled(times)[0] * jnp.arange(1.0, 6.0))

    slopes = jax.jit(jax.grad(total))(UNSORTED)
    speeds = cj.simulate(PIN, T1, save_at=UNSORTED, **HOW)["tip.velocity"][:, 1]
    np.testing.assert_allclose(slopes, speeds * np.arange(1.0, 6.0), rtol=1e-6, atol=1e-6 * np.max(np.abs(speeds)))


# Tolerances ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_tolerance_that_floats_do_not_resolve_is_refused():
    """At 1e-16 a solve said that it had succeeded; at 1e-99 it took ten million steps."""
    for rtol in (1e-16, 1e-99, 0.0):
        with refused("rtol", rtol):
            cj.simulate(PIN, T1, rtol=rtol)

    def ending(rtol):
        s = cj.simulate(PIN, 1e-4, rtol=rtol, energy_balance=False)
        return s.code, s.steps, s.final

    codes, steps, final = jax.vmap(ending)(jnp.array([1e-99, 1e-16, SMALLEST, 1e-8]))
    assert codes.tolist() == [int(Result.TOLERANCE)] * 2 + [0, 0]
    assert steps[:2].tolist() == [0, 0]
    assert np.isnan(final[:2]).all()
    # Of a slide and its speed `atol` is all that is allowed.
    slide = cj.Prismatic("slide", "ground", "block", motion=cj.Motion(velocity=1.0))
    block = cj.Mechanism((cj.Body("block", 1.0, 1e-3),), (slide,))
    for found in (cj.simulate(block, 1e-4, atol=1e-40, throw=False), cj.trace(block, 1e-4, atol=1e-40)):
        assert "smaller than 64-bit numbers resolve" in found.message
