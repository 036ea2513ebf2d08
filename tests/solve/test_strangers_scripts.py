"""Scripts as strangers write them: solves that fail under jit, vmap, grad and in batches, minibatches of sample times,
tolerances that floats do not resolve. What did not reach its end is not a number, with its derivatives.
"""

import catalogue
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest

import clearance_jax as cj
from clearance_jax import ClearanceError, metrics
from clearance_jax.solve.codes import Result
from clearance_jax.solve.tolerances import SMALLEST
from clearance_jax.solve.trace import trace

CRANK = catalogue.slider_crank()
CLEARANCE = "wrist.radial_clearance"
T1 = 2e-3


def piston(clearance, **options):
    moved = cj.replace(CRANK, {CLEARANCE: clearance})
    return cj.simulate(moved, T1, rtol=1e-7, energy_balance=False, **options)["piston.position"][0]


# Solves that fail ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("derivatives", ["controlled", "screening"])
def test_a_solve_that_stops_early_has_no_value_and_no_derivative(derivatives):
    """Too few steps, and a clearance below zero: it was the state where the solve stopped, and a derivative of it."""

    def stopped(clearance):
        return piston(clearance, max_steps=20, derivatives=derivatives)

    value, slope = jax.jvp(stopped, (3e-4,), (1.0,))
    assert np.isnan([value, slope]).all()
    if derivatives == "controlled":
        assert np.isnan(jax.value_and_grad(stopped)(3e-4)).all()
        values, slopes = jax.jit(jax.vmap(jax.value_and_grad(piston)))(jnp.array([-1e-4, 3e-4]))
        assert np.isnan([values[0], slopes[0]]).all()
        assert np.isfinite([values[1], slopes[1]]).all()
        # The lane beside has what it has alone.
        assert float(values[1]) == pytest.approx(float(piston(3e-4)), rel=1e-9)
    with pytest.raises(RuntimeError, match=r"largest number of steps was reached, 20 \(`max_steps`\), at t = .*more"):
        stopped(3e-4)
    kept = cj.simulate(CRANK, T1, max_steps=20, throw=False, rtol=1e-7, energy_balance=False)
    assert 0 < float(kept.end_time) < T1
    assert np.isfinite(kept["piston.position"]).all()


def test_nothing_of_a_failed_motion_looks_like_an_answer():
    """Every named quantity, sample and metric, also those that a norm or a comparison would make a number again."""

    def lane(clearance, most):
        moved = cj.replace(CRANK, {CLEARANCE: clearance})
        s = cj.simulate(moved, T1, rtol=1e-7, save_at=3)
        return {name: s[name] for name in s.names}, s.y, s.final, s.initial, s.time, s.energy_residual, s.code

    found = cj.batch(lambda x: lane(x, 20), np.array([-1e-4, 3e-4]))
    assert found[-1].tolist() == [int(Result.IMPOSSIBLE), 0]
    for leaf in jax.tree.leaves(found[:-1]):
        assert np.isnan(leaf[0]).all()
        assert np.isfinite(leaf[1]).all()

    def hiding(solution):
        force = solution["wrist.contact_force"]
        return jnp.sum(jnp.where(force > 1.0, force, 0.0))

    asked = {
        "hidden": hiding,
        "force": metrics.Peak(metrics.ContactForce("wrist")),
        "impacts": metrics.Impacts("wrist"),
        "rms": metrics.Rms(metrics.PositionError("piston")),
        "settling": metrics.SettlingTime(metrics.PositionError("piston"), 1e-3, 1e-3),
        "touch": metrics.CrossingTime(metrics.Quantity("wrist.penetration")),
    }

    def measured(clearance):
        return cj.measure(cj.replace(CRANK, {CLEARANCE: clearance}), asked, T1, rtol=1e-7, save_at=3, max_steps=20)

    assert np.isnan(list(jax.jit(measured)(3e-4).values())).all()

    def smooth(clearance):
        found = measured(clearance)
        return [found[name] for name in ("hidden", "force", "rms", "settling", "touch")]

    assert np.isnan(jax.jvp(smooth, (3e-4,), (1.0,))).all()
    times = jax.jit(lambda c: metrics.Peak(metrics.ContactForce("wrist")).times(
        cj.replace(CRANK, {CLEARANCE: c}), T1, rtol=1e-7, max_steps=20
    ))(3e-4)  # fmt: skip
    assert np.isnan(times).all()


def test_a_line_search_steps_back_from_what_is_impossible():
    """A clearance below zero had the value 0 and the gradient 0: a search went there, and found nothing better."""
    wanted = float(piston(3e-4))

    def misfit(scaled, _):
        return ((piston(1e-4 * scaled) - wanted) / 1e-4) ** 2

    solver = optimistix.BFGS(rtol=1e-6, atol=1e-6)
    # Its first step, along the gradient, is far too long.
    found = optimistix.minimise(misfit, solver, jnp.asarray(4.0), max_steps=40, throw=False)
    assert float(found.value) > 0
    assert float(piston(1e-4 * found.value)) == pytest.approx(wanted, abs=1e-8)


def test_a_request_that_no_computer_answers_ends_by_default():
    """A spring of 1e16 N/m swings for a second: a thousand million steps. The default allows a million attempts."""
    spring = cj.actuators.JointSpring(stiffness=1e16)
    slide = cj.Prismatic("slide", "ground", "block", motion=cj.Motion(position=0.01, actuators=(spring,)))
    block = cj.Mechanism((cj.Body("block", 1.0, 1e-3),), (slide,))
    s = cj.simulate(block, 1.0, throw=False, energy_balance=False)
    assert s.message == "the largest number of steps was reached"
    assert int(s.steps + s.rejected) == 1_000_000


def test_poses_of_lanes_that_fail_are_none():
    arm = cj.load("experiments/scenes/arm.toml")

    def tip(clearance):
        moved = cj.replace(arm, {"hip.radial_clearance": clearance})
        s = cj.simulate(moved, 0.1, save_at=jnp.array([0.05, 0.0]), fidelity="quasi-static")
        return s["tip.position"][:, 1], s.code

    (places, codes), (slopes, _) = jax.jvp(jax.vmap(tip), (jnp.array([-1e-4, 1e-4]),), (jnp.ones(2),))
    assert codes.tolist() == [int(Result.NO_POSE), 0]
    for found in (places, slopes):
        assert np.isnan(found[0]).all()
        assert np.isfinite(found[1]).all()


# Sample times --------------------------------------------------------------------------------------------------------

UNSORTED = np.array([1e-3, 0.0, 2e-3, 5e-4, 5e-4])
BAD = {
    "beyond the end": [0.0, 1e-3, 5e-4, 3e-3, 0.0],
    "before the start": [-1e-3, 0.0, 1e-3, 5e-4, 0.0],
    "no number": [0.0, 1e-3, np.nan, 2e-3, 0.0],
}


def sampled(times, **options):
    s = cj.simulate(CRANK, T1, save_at=times, rtol=1e-8, energy_balance=False, **options)
    return s["piston.position"][:, 0], s.time, s.code


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
    for times in (UNSORTED, *BAD.values()):
        places, _, code = jax.jit(sampled)(np.asarray(times))
        good = times is UNSORTED
        np.testing.assert_allclose(places, expected if good else np.nan, rtol=1e-9)
        assert int(code) == (0 if good else int(Result.SAMPLE_TIMES))
    for times in BAD.values():
        with pytest.raises(ClearanceError, match=r"must lie between t0 = 0 s and t1 = 0\.002 s"):
            sampled(np.array(times))


def test_a_derivative_by_sample_times_is_the_velocity_there():
    def total(times):
        return jnp.sum(sampled(times)[0] * jnp.arange(1.0, 6.0))

    slopes = jax.jit(jax.grad(total))(UNSORTED)
    speeds = cj.simulate(CRANK, T1, save_at=UNSORTED, rtol=1e-8, energy_balance=False)["piston.velocity"][:, 0]
    np.testing.assert_allclose(slopes, speeds * np.arange(1.0, 6.0), rtol=1e-6, atol=1e-6 * np.max(np.abs(speeds)))


# Tolerances ----------------------------------------------------------------------------------------------------------


def test_a_tolerance_that_floats_do_not_resolve_is_refused():
    """At 1e-16 a solve said that it had succeeded; at 1e-99 it took ten million steps."""
    for rtol in (1e-16, 1e-99, 0.0):
        with pytest.raises(ClearanceError, match="`rtol` must be between 1e-14"):
            cj.simulate(CRANK, T1, rtol=rtol)

    def ending(rtol):
        s = cj.simulate(CRANK, 1e-4, rtol=rtol, energy_balance=False)
        return s.code, s.steps, s.final

    codes, steps, final = jax.vmap(ending)(jnp.array([1e-99, 1e-16, SMALLEST, 1e-8]))
    assert codes.tolist() == [int(Result.TOLERANCE)] * 2 + [0, 0]
    assert steps[:2].tolist() == [0, 0]
    assert np.isnan(final[:2]).all()
    # Positions of the piston are controlled by `atol` alone.
    for solve in (cj.simulate, trace):
        found = solve(CRANK, 1e-4, atol=1e-40, **({"throw": False} if solve is cj.simulate else {}))
        assert "smaller than 64-bit numbers resolve" in found.message
