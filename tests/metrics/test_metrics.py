"""Metrics and sensitivities: against the independent reference, dense samples, and differences."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from catalogue import playful_servo
from places import refused
from scipy.optimize import brentq, minimize_scalar

import clearance_jax as cj
from clearance_jax import metrics
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.observed import JointWork, PeakInstants
from clearance_jax.solve.settings import Settings, settings_of
from clearance_jax.solve.simulate import _in_order, run
from clearance_jax.solve.steps.observers import TouchCounter
from experiments.common import slider_crank
from experiments.hard.pin import GRAVITY, pin
from experiments.reference.make import load_variation
from experiments.trust.horizon import REGULAR
from experiments.trust.scenes import scene

CLEARANCE, FRICTION = "wrist.radial_clearance", "wrist.friction.coefficient"
T1, SINCE = 0.012, 6e-4
ERROR = metrics.PositionError("piston")


@pytest.fixture(scope="module")
def mechanism():
    return slider_crank()


def at(metric, mechanism, clearance, rtol=1e-9, t1=T1, solver="auto"):
    return metric(cj.replace(mechanism, {CLEARANCE: clearance}), t1, rtol=rtol, solver=solver)


def difference(metric, mechanism, clearance=5e-4, step=2e-8, **options):
    up, down = (at(metric, mechanism, clearance + s * step, rtol=1e-11, **options) for s in (1, -1))
    return (up - down) / (2 * step)


@pytest.mark.slow
def test_error_at_times_is_the_references_and_so_is_its_derivative(mechanism):
    known = load_variation("slider_crank_0.5mm")
    some = slice(60, 201, 20)
    times, x, dx = known["t"][some], known["y"][some, 1], known["dy"][some, 1, 0]
    crank = 2 * np.pi / T1 * times
    ideal = 0.05 * np.cos(crank) + np.sqrt(0.12**2 - (0.05 * np.sin(crank)) ** 2)
    metric = metrics.At(ERROR, times)
    found = cj.sensitivities(mechanism, metric, [CLEARANCE], T1, rtol=1e-10)
    np.testing.assert_allclose(found.value, np.abs(x - ideal), rtol=1e-6)
    np.testing.assert_allclose(
        found.jacobian[CLEARANCE], np.sign(x - ideal) * dx, rtol=1e-6, atol=1e-6 * float(np.max(np.abs(dx)))
    )


@pytest.mark.slow
def test_peak_is_between_samples_and_follows_its_top(mechanism):
    metric = metrics.Peak(ERROR, 3)
    peaks, slopes = jax.jvp(lambda c: at(metric, mechanism, c), (5e-4,), (1.0,))
    dense = at(metrics.At(ERROR, np.linspace(0, T1, 4001)), mechanism, 5e-4)
    tops = np.flatnonzero((dense[1:-1] > dense[:-2]) & (dense[1:-1] >= dense[2:])) + 1
    expected = np.sort(np.asarray(dense)[tops])[::-1][:3]
    assert np.all(np.asarray(peaks) >= expected - 1e-15)  # a sample is never higher than the top beside it
    np.testing.assert_allclose(peaks, expected, rtol=1e-4)
    times = metric.times(cj.replace(mechanism, {CLEARANCE: 5e-4}), T1, rtol=1e-9)
    order = jnp.argsort(times)
    _, fixed = jax.jvp(lambda c: at(metrics.At(ERROR, times[order]), mechanism, c), (5e-4,), (1.0,))
    np.testing.assert_allclose(slopes[order], fixed, rtol=1e-6)
    np.testing.assert_allclose(slopes[0], difference(metric, mechanism)[0], rtol=1e-5)

    def both(of, rtol, solver="dopri8"):
        return jax.jvp(
            lambda c: of(cj.replace(mechanism, {CLEARANCE: c}), T1, rtol=rtol, solver=solver), (5e-4,), (1.0,)
        )

    # By steps of another length and another interpolation, at given times: a slope changes fast along the time.
    there = metrics.At(ERROR, jnp.sort(times))
    other = both(there, 1e-11, "tsit5")
    for rtol, added in ((1e-8, 0.5), (1e-10, 0.1)):
        for found, expected, error in zip(both(there, rtol), other, (3, 30), strict=True):
            np.testing.assert_allclose(found, expected, rtol=error * rtol)
        # The states at the peaks have errors; the peaks add part of `rtol`, in shorter steps hardly any.
        moments, _ = both(metric.times, rtol)
        order = jnp.argsort(moments)
        peaks, fixed = both(metric, rtol), both(metrics.At(ERROR, moments[order]), rtol)
        np.testing.assert_allclose(peaks[0][order], fixed[0], rtol=added * rtol)
        np.testing.assert_allclose(peaks[1][order], fixed[1], rtol=10 * rtol)


@pytest.mark.slow
def test_nearest_miss_of_a_throw_and_speed_of_its_touch():
    """A pin thrown in a sleeve, in one long step: closed forms of how near it comes to the wall, and how fast it
    reaches it below.
    """
    c, across, up = 1e-3, 0.03, 0.12
    thrown = pin(cj.laws.Hertz(stiffness=1e9), c)
    height: Any = minimize_scalar(lambda t: -np.hypot(across * t, up * t - GRAVITY * t * t / 2), (0, 0.01, 0.02))
    touch: Any = brentq(lambda t: np.hypot(across * t, up * t - GRAVITY * t * t / 2) - c, 0.022, 0.1)
    place, velocity = np.array([across * touch, up * touch - GRAVITY * touch**2 / 2]), [across, up - GRAVITY * touch]
    for solver in ("tsit5", "dopri8"):
        options = settings_of(thrown, 1.0, {"rtol": 1e-9, "solver": solver, "y0": np.array([0, 0, across, up])})
        seen = run(thrown, touch + 1e-5, options, observers=(TouchCounter(0),)).records[0]
        np.testing.assert_allclose(seen.nearest_miss, c + height.fun, rtol=1e-3)  # it is reported to three digits
        np.testing.assert_allclose(seen.slowest, place @ velocity / c, rtol=1e-9)
        assert int(seen.count) == 1


SUMS = {"rms": metrics.Rms(ERROR), "mean": metrics.Mean(ERROR), "lost": metrics.EnergyLost()}
SUMS |= {"rms since": metrics.Rms(ERROR, since=SINCE)}


@pytest.mark.slow
def test_sums_over_the_motion_and_their_gradients(mechanism):
    """Averages and the energy lost, by one solve, against dense samples, the energy balance and differences."""

    def sums(clearance, rtol=1e-9):
        found = cj.measure(cj.replace(mechanism, {CLEARANCE: clearance}), SUMS, T1, rtol=rtol)
        return jnp.stack([found[name] for name in SUMS])

    plain = jax.jit(sums, static_argnums=1)
    up, down = (plain(5e-4 + step, 1e-11) for step in (2e-8, -2e-8))
    slopes = jax.jit(jax.jacrev(sums))(5e-4)
    np.testing.assert_allclose(slopes, (up - down) / 4e-8, rtol=1e-4)
    rms, mean, lost, _ = (float(value) for value in sums(5e-4))
    dense = np.asarray(at(metrics.At(ERROR, np.linspace(0, T1, 4001)), mechanism, 5e-4))
    for value, power in ((rms, 2), (mean, 1)):
        expected = np.mean(0.5 * (dense[1:] ** power + dense[:-1] ** power)) ** (1 / power)
        np.testing.assert_allclose(value, expected, rtol=1e-5)
    energy_balance = cj.to_dataset(mechanism, cj.simulate(mechanism, T1, rtol=1e-9, save_at=2))
    np.testing.assert_allclose(
        lost, float(energy_balance["damping_loss"][-1] + energy_balance["friction_loss"][-1]), rtol=1e-7
    )


@pytest.mark.slow
def test_peak_contact_force_is_the_traces(mechanism):
    value = at(metrics.Peak(metrics.ContactForce("wrist")), mechanism, 5e-4)
    episodes = cj.to_dataset(mechanism, cj.trace(mechanism, T1, rtol=1e-9))
    np.testing.assert_allclose(value, float(episodes["peak_force"].max()), rtol=1e-4)
    assert int(at(metrics.Impacts("wrist"), mechanism, 5e-4)) == episodes.sizes["episode"]


@pytest.mark.slow
def test_a_batch_counts_several_impacts_at_once(mechanism):
    asked = {"all": metrics.Impacts("wrist"), "late": metrics.Impacts("wrist", since=SINCE)}

    def counts(clearance):
        return cj.measure(cj.replace(mechanism, {CLEARANCE: clearance}), asked, 2e-3, rtol=1e-6)

    clearances = jnp.array([3e-4, 5e-4])
    found = jax.jit(jax.vmap(counts))(clearances)
    for i, clearance in enumerate(clearances):
        alone = counts(clearance)
        assert {name: int(count[i]) for name, count in found.items()} == {name: int(alone[name]) for name in asked}
    assert all(found["all"] > 0)


def test_soft_peaks_bound_the_largest_sample(mechanism):
    largest = float(jnp.max(at(metrics.At(ERROR, np.linspace(0, T1, 1001)), mechanism, 5e-4)))
    ready = cj.replace(mechanism, {CLEARANCE: 5e-4})
    for metric in (metrics.SoftPeak(ERROR, 1e5), metrics.PNorm(ERROR, 30.0)):
        low, high = metric.bounds(ready, T1, rtol=1e-9)
        assert float(low) <= largest * (1 + 1e-12)
        assert float(high) >= largest * (1 - 1e-12)
        assert float(high - low) > 0


@pytest.mark.slow
def test_orientation_and_path(mechanism):
    angle = at(metrics.At(metrics.OrientationError("conrod"), [0.003]), mechanism, 5e-4)
    assert 0 < float(angle[0]) < 5e-3  # some clearance over a conrod's length
    path = at(metrics.At(metrics.PathDeviation("piston"), [0.003]), mechanism, 5e-4)
    assert float(path[0]) < 1e-12  # a piston leaves its straight path by nothing but what closes its loop


def test_whole_numbers_have_no_derivative(mechanism):
    with pytest.raises(ClearanceError, match="whole number"):
        jax.grad(lambda c: 1.0 * at(metrics.Impacts("wrist"), mechanism, c))(5e-4)


@pytest.mark.slow
def test_a_failed_lane_is_nan_in_every_metric(mechanism):
    """Lanes: fine; a clearance out of its bounds; not a number."""
    force = metrics.ContactForce("play")
    pin = eqx.tree_at(lambda m: m.points, scene(REGULAR["R1, periodic"]), (cj.Point("tip", "pin"),))
    cases = (
        (
            (pin, "play.radial_clearance", 0.03),
            (
                metrics.Peak(force, 2),
                metrics.Mean(force),
                metrics.At(force, [1e-2, 2e-2]),
                metrics.SoftPeak(force, 1.0, 11),
                metrics.PNorm(metrics.Acceleration("tip"), 8.0, 11),
                metrics.EnergyLost(),
                metrics.Impacts("play"),
            ),
        ),
        ((mechanism, CLEARANCE, 1e-3), (metrics.Peak(ERROR), metrics.Rms(ERROR))),
    )
    for (given, name, end), every in cases:
        asked = {repr(metric): metric for metric in every}

        @jax.jit
        @jax.vmap
        def values(clearance, given=given, name=name, end=end, asked=asked):
            return cj.measure(cj.replace(given, {name: clearance}), asked, end, rtol=1e-6)

        for metric, found in values(jnp.array([5e-4, -5e-4, jnp.nan])).items():
            assert np.all(np.isfinite(found[0])), metric
            assert np.all(np.isnan(found[1:])), metric


def test_an_over_constrained_ideal_mechanism_is_refused():
    pin = eqx.tree_at(lambda m: m.points, scene(REGULAR["R1, periodic"]), (cj.Point("tip", "pin"),))
    with pytest.raises(ClearanceError, match="over-constrained"):
        metrics.Peak(metrics.PositionError("tip"))(pin, 0.01)


@pytest.mark.slow
def test_the_end_moves_a_peak_that_lies_there():
    """A mass on a spring, x = 1 - cos(w t): the acceleration w^2 cos(w t) is highest at the start. Let go from the
    middle at speed v it is v w sin(w t), highest at the end.
    """
    motion = cj.Motion(actuators=(cj.actuators.JointSpring(40.0, 0.0, 1.0),))
    swing = cj.Mechanism(
        bodies=(cj.Body("mass", 1.0),),
        joints=(cj.Prismatic("slide", "ground", "mass", motion=motion),),
        points=(cj.Point("end", "mass"),),
    )
    metric, w = metrics.Peak(metrics.Acceleration("end")), np.sqrt(40.0)
    np.testing.assert_allclose(jax.value_and_grad(lambda t: metric(swing, t))(0.1), (w**2, 0.0), rtol=1e-9)
    y0 = jnp.array([1.0, 0.4])
    late = jax.value_and_grad(lambda t: metric(swing, t, t0=0.3, y0=y0))(0.4)
    np.testing.assert_allclose(late, (0.4 * w * np.sin(0.1 * w), 0.4 * w**2 * np.cos(0.1 * w)), rtol=1e-6)


def test_peaks_of_a_driven_point_beside_a_free_mass():
    """Nothing in the state moves as the drive does: amplitude w^2, twice a period."""
    driven, free = cj.Motion(cj.drives.Harmonic(0.1, 60.0)), cj.Motion(velocity=1.0)
    mechanism = cj.Mechanism(
        bodies=(cj.Body("a", 1.0), cj.Body("b", 1.0)),
        joints=(
            cj.Prismatic("shaker", "ground", "a", motion=driven),
            cj.Prismatic("slide", "ground", "b", motion=free),
        ),
        points=(cj.Point("end", "a"),),
    )
    metric = metrics.Peak(metrics.Acceleration("end"), 3)
    np.testing.assert_allclose(metric(mechanism, 1.0), 0.1 * 60.0**2, rtol=1e-6)
    times = metric.times(mechanism, 1.0) * 60 / np.pi - 0.5
    np.testing.assert_allclose(times, np.round(times), atol=1e-3)


def test_free_ideal_motion_is_solved_for():
    """A servo drives a joint with play: the ideal mechanism moves freely, and the error is against its own motion."""
    mechanism = playful_servo()
    metric = metrics.Peak(metrics.PositionError("tip"))
    value = metric(mechanism, 0.02, rtol=1e-8)
    times = np.linspace(0, 0.02, 2001)
    tips = [
        cj.to_dataset(m, cj.simulate(m, 0.02, save_at=times))["position"].values[:, 0]
        for m in (mechanism, mechanism.ideal())
    ]
    largest = np.max(np.hypot(*(tips[0] - tips[1]).T))
    np.testing.assert_allclose(value, largest, rtol=1e-4)
    with refused("y0"):
        metric(mechanism, 0.02, y0=jnp.zeros(6))


# Sensitivities -------------------------------------------------------------------------------------------------------


def final(mechanism, solution):
    return solution.final[:4]


@pytest.mark.slow
def test_modes_agree_and_screening_says_what_it_is(mechanism):
    names = [CLEARANCE, FRICTION, "conrod.mass", "drive.main.speed"]
    known = load_variation("slider_crank_0.5mm")["dy"][-1]
    forward = cj.sensitivities(mechanism, final, names, T1, rtol=1e-9)
    adjoint = cj.sensitivities(mechanism, final, names, T1, rtol=1e-9, mode="adjoint")
    screening = cj.sensitivities(mechanism, final, names, T1, rtol=1e-9, mode="screening")
    scale = np.max(np.abs(forward.matrix()), axis=0)
    assert np.max(np.abs(forward.matrix() - adjoint.matrix()) / scale) < 1e-5
    np.testing.assert_allclose(forward.jacobian[CLEARANCE][1], known[1, 0], rtol=1e-6)
    assert screening.trusted is False
    assert np.max(np.abs(forward.matrix() - screening.matrix()) / scale) > 1e-6  # it is not the same thing


def oscillator():
    motion = cj.Motion(position=0.0, velocity=0.3, actuators=(cj.actuators.JointSpring(40.0),))
    return cj.Mechanism(
        bodies=(cj.Body("mass", mass=2.0),),
        joints=(cj.Prismatic("slide", "ground", "mass", motion=motion),),
    )


def test_hessian_against_the_oscillators_closed_form():
    """Position (v / w) sin(w t) with w = sqrt(k / m): second derivatives by k and m."""
    mechanism, t1 = oscillator(), 0.9
    names = [n for n in cj.parameters(mechanism) if n.endswith(("stiffness", "mass"))]
    found = cj.analysis.hessian(mechanism, lambda m, s: s.final[0], names, t1, rtol=1e-10)

    def exact(p):
        given = dict(zip(names, p, strict=True))
        k, m = (next(v for n, v in given.items() if n.endswith(word)) for word in ("stiffness", "mass"))
        w = jnp.sqrt(k / m)
        return 0.3 / w * jnp.sin(w * t1)

    truth = jax.hessian(exact)(jnp.array([float(cj.parameters(mechanism)[n].value) for n in names]))
    np.testing.assert_allclose(found.matrix, truth, rtol=1e-5)
    assert np.all(np.abs(found.matrix - truth) <= found.error + 1e-9 * np.abs(truth))
    with refused("simulate"):
        jax.hessian(lambda k: cj.simulate(cj.replace(mechanism, {names[0]: k}), t1).final[0])(40.0)


def test_messages(mechanism):
    with refused("wrist.radal_clearance", allowed=CLEARANCE):
        cj.sensitivities(mechanism, final, ["wrist.radal_clearance"], T1)
    with refused("mode", "backward"):
        cj.sensitivities(mechanism, final, [CLEARANCE], T1, mode="backward")
    with refused("nowhere"):
        metrics.Peak(metrics.PositionError("nowhere"))(mechanism, T1)
    with refused("derivatives", "exact"):
        cj.simulate(mechanism, T1, derivatives="exact")
    with refused("rtoll", allowed="rtol"):
        metrics.Rms(ERROR)(mechanism, T1, **{"rtoll": 1e-6})  # pyright: ignore[reportCallIssue]


class Countdown(metrics.AbstractSignal):
    """Falls all the time."""

    def value(self, time, y, mechanism, reference):
        return 1 - time


@pytest.mark.slow
def test_only_what_comes_after_since_counts(mechanism):
    """One solve with metrics of the whole and of its later part, against dense samples and the trace."""
    force, error = metrics.ContactForce("wrist"), ERROR
    asked = {
        "peak": metrics.Peak(error, since=SINCE),
        "fall": metrics.Peak(Countdown(), since=SINCE),
        "whole": metrics.Peak(force),
        "later": metrics.Peak(force, since=SINCE),
        "rms": metrics.Rms(error, since=SINCE),
        "mean": metrics.Mean(error, since=SINCE),
        "lost": metrics.EnergyLost(since=SINCE),
        "all lost": metrics.EnergyLost(),
        "impacts": metrics.Impacts("wrist", since=SINCE),
        "dense": metrics.At(error, np.linspace(SINCE, T1, 3001)),
    }

    values = cj.measure(mechanism, asked, T1, rtol=1e-9)
    dense = np.asarray(values["dense"])
    h = (T1 - SINCE) / 3000
    assert float(values["peak"]) == pytest.approx(dense.max(), rel=1e-5)
    assert float(values["fall"]) == pytest.approx(1 - SINCE, rel=1e-14)  # what falls from there peaks there
    assert float(values["mean"]) == pytest.approx(np.trapezoid(dense, dx=h) / (T1 - SINCE), rel=1e-5)
    assert float(values["rms"]) == pytest.approx(np.sqrt(np.trapezoid(dense**2, dx=h) / (T1 - SINCE)), rel=1e-5)
    table = cj.to_dataset(mechanism, cj.trace(mechanism, T1, rtol=1e-9))
    later = table.peak_time > SINCE
    assert float(values["whole"]) == pytest.approx(float(table.peak_force.max()), rel=1e-4)
    assert float(values["later"]) == pytest.approx(float(table.peak_force[later].max()), rel=1e-4)
    assert float(values["later"]) < 0.5 * float(values["whole"])
    assert int(values["impacts"]) == int((table.episode_start > SINCE).sum())
    lost = table.damping_loss + table.friction_loss
    expected = float(lost[-1] - np.interp(SINCE, table.time, lost))
    assert float(values["lost"]) == pytest.approx(expected, rel=1e-4)
    assert float(values["lost"]) < float(values["all lost"])


def test_samples_of_one_metric_and_where_it_begins_to_count_are_put_in_order():
    given = jnp.array([7e-4, 9e-4, SINCE])
    settings, places = _in_order(Settings(save_at=given))
    assert settings.save_at is not None
    np.testing.assert_array_equal(settings.save_at, [SINCE, 7e-4, 9e-4])
    np.testing.assert_array_equal(settings.save_at[places], given)
    assert _in_order(settings) == (settings, None)


@pytest.mark.slow
def test_since_lies_before_the_end(mechanism):
    with refused("since", T1):
        metrics.Peak(ERROR, since=T1)(mechanism, T1)
    lanes = jax.vmap(lambda t1: metrics.Mean(ERROR, since=SINCE)(mechanism, t1, rtol=1e-6))(jnp.array([5e-4, 7e-4]))
    assert np.isnan(lanes[0])
    assert np.isfinite(lanes[1])


@pytest.mark.slow
def test_what_a_joint_bears_and_loses_is_in_the_books_and_its_peak_has_an_instant(mechanism):
    """The only joint that loses anything: its share is all of it, damping and friction apart."""
    t1, force = 1.5e-3, metrics.ContactForce("wrist")
    times = jnp.linspace(0.0, t1, 20_001)
    asked = {
        "work": JointWork("wrist"),
        "lost": metrics.EnergyLost(),
        "peak": PeakInstants(metrics.Peak(force)),
        "force": metrics.At(force, times),
    }
    found = jax.jit(lambda m: cj.measure(m, asked, t1, rtol=1e-9))(mechanism)
    work, peak, forces = found["work"], found["peak"], np.asarray(found["force"])
    assert 0 < work.friction_loss < work.contact_loss
    np.testing.assert_allclose(work.friction_loss + work.contact_loss, found["lost"], rtol=1e-8)
    np.testing.assert_allclose(work.mean_force, np.trapezoid(forces, times) / t1, rtol=1e-3)
    (time,), (value,) = peak.times, peak.values
    highest = int(np.argmax(forces))
    assert abs(time - times[highest]) <= times[1]
    np.testing.assert_allclose(value, forces[highest], rtol=1e-3)
    assert value >= forces[highest]
