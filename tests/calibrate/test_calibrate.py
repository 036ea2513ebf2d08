"""Calibration: numbers from measured motion, against closed forms, on synthetic noise, and what data cannot tell."""

import dataclasses
import functools
import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from key_reference import example
from looks import check_texts
from places import ROOT, refused
from scipy import stats
from typer.testing import CliRunner

import clearance_jax as cj
from clearance_jax import laws, metrics
from clearance_jax.calibrate.fit import FitTask, Variables, _memory, _roughness
from clearance_jax.calibrate.measurement import FitPoint, Instruments, Measurement, Series, read_measurement
from clearance_jax.calibrate.options import LOSSES, FitOptions
from clearance_jax.calibrate.result import Minimum, doubts
from clearance_jax.calibrate.run import search, settle, starts_of
from clearance_jax.cli.main import app
from clearance_jax.io.keys import study as calibrate_keys
from clearance_jax.report import calibration_figures
from clearance_jax.solve.settings import settings_of

search_module = importlib.import_module("clearance_jax.calibrate.run")
profile_module = importlib.import_module("clearance_jax.calibrate.confidence")
SCENES = ROOT / "experiments" / "scenes"
HEIGHT, GRAVITY, RTOL = 5e-3, 9.81, 1e-8
RESTITUTION, WALL, WEIGHT = "sleeve.normal.restitution", "sleeve.radial_clearance", "gravity.x"
PLACE, SPEED, STIFFNESS = "guide.position", "guide.velocity", "sleeve.normal.stiffness"
# Until after the third impact, and until before the first one.
LONG, SHORT = np.linspace(0.0, 0.16, 81), np.linspace(0.0, 0.03, 31)
TRUTH = {RESTITUTION: 0.8, WALL: 1.2e-2, WEIGHT: GRAVITY}
BOUNDS = {RESTITUTION: (0.5, 0.95), WALL: (1e-2, 1.5e-2), WEIGHT: (8.0, 12.0)}


@functools.cache
def ball() -> cj.Mechanism:
    """A ball that falls along x and bounces off the wall of a wide sleeve."""
    motion = cj.Motion(position=1.2e-2 - HEIGHT, velocity=0.0)
    play = cj.RevoluteClearance(1.2e-2, 0.02, laws.exact_restitution(1e9, 0.8, exponent=1.5))
    return cj.Mechanism(
        bodies=(cj.Body("ball", 0.14),),
        joints=(cj.Prismatic("guide", "ground", "ball", motion=motion),),
        loops=(cj.Revolute("sleeve", "ground", "ball", clearance=play),),
        gravity=cj.Gravity(x=GRAVITY),
        assemble=False,
    )


def data(times: np.ndarray, name: str = PLACE, noise: float = 0.0, seed: int = 0, **changes: Any) -> xr.Dataset:
    """What would have been measured of the ball."""
    motion = moved(name, tuple(times), **changes)
    return dataset(times, **{name: motion + noise * np.random.default_rng(seed).standard_normal(len(times))})


@functools.cache
def moved(name: str, times: tuple[float, ...], **changes: float) -> np.ndarray:
    mechanism = cj.replace(ball(), TRUTH | changes)
    return np.asarray(cj.simulate(mechanism, times[-1], save_at=np.array(times), rtol=RTOL)[name])


def dataset(times: np.ndarray, **variables: np.ndarray) -> xr.Dataset:
    return xr.Dataset({name: ("time", values) for name, values in variables.items()}, {"time": times})


def start(**changes: float) -> cj.Mechanism:
    """The ball with other numbers than it had when it was measured."""
    return cj.replace(ball(), {RESTITUTION: 0.75, WALL: 1.21e-2, WEIGHT: 9.6} | changes)


# Closed forms --------------------------------------------------------------------------------------------------------

FALL = {PLACE: (-0.02, 0.02), SPEED: (-0.2, 0.2), WEIGHT: (1.0, 20.0)}


def fallen(values: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place, speed and gravity of x0 + v0 t + g t^2 / 2 by the normal equations, and (X^T X)^-1."""
    there = np.isfinite(values)
    design = np.stack([np.ones_like(times), times, times**2 / 2], axis=1)[there]
    inverse = np.linalg.inv(design.T @ design)
    return inverse @ design.T @ values[there], inverse


@pytest.mark.parametrize("given", [False, True])
def test_a_linear_fit_is_the_one_of_the_formula(given):
    measured = data(SHORT, noise=2e-5, seed=3)
    measured[PLACE][[4, 11, 12]] = np.nan
    values, deviation = measured[PLACE].values, {PLACE: 2.5e-5} if given else None
    found = cj.calibrate(start(), measured, FALL, deviations=deviation, rtol=RTOL)
    expected, inverse = fallen(values, SHORT)
    assert found.missing == 3
    assert found.freedom == 25
    np.testing.assert_allclose(list(found.values.values()), expected, rtol=1e-5, atol=1e-8)
    model = expected[0] + expected[1] * SHORT + expected[2] * SHORT**2 / 2
    squares = np.nansum((model - values) ** 2) / 25
    size = 2.5e-5 if given else np.sqrt(squares)
    np.testing.assert_allclose(list(found.deviations.values()), size * np.sqrt(np.diag(inverse)), rtol=1e-4)
    factor = stats.norm.ppf(0.975) if given else stats.t.ppf(0.975, 25)
    low, high = found.intervals[WEIGHT]
    assert (high - low) / 2 == pytest.approx(factor * found.deviations[WEIGHT])
    scale = np.sqrt(np.diag(inverse))
    np.testing.assert_allclose(found.correlation.values, inverse / np.outer(scale, scale), rtol=1e-4)
    assert found.chi_square == pytest.approx(squares / 2.5e-5**2 if given else 1.0)
    assert found.noise[PLACE] == pytest.approx(size)
    np.testing.assert_allclose(found.residuals[f"{PLACE}_model"], model, atol=1e-8)
    assert found.converged
    assert found.notes == ()
    assert float(cj.parameters(found.mechanism)[WEIGHT].value) == found.values[WEIGHT]


# Noise ---------------------------------------------------------------------------------------------------------------


def least_deviations(size: float) -> np.ndarray:
    """The bound of Cramer and Rao, by differences of the motion at the truth."""
    slopes = []
    for name, value in TRUTH.items():
        step = 1e-5 * value
        ends = [moved(PLACE, tuple(LONG), **{name: value + sign * step}) for sign in (-1, 1)]
        slopes.append((ends[1] - ends[0]) / (2 * step))
    return size * np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.array(slopes).T)))


@pytest.mark.slow
@pytest.mark.optimised
def test_the_intervals_hold_the_truth_as_often_as_they_say():
    """100 trials with noise of 1 % of the height of the fall."""
    size = 0.01 * HEIGHT
    held, half = {name: 0 for name in TRUTH}, {name: [] for name in TRUTH}
    for seed in range(100):
        found = cj.calibrate(start(), data(LONG, noise=size, seed=seed), BOUNDS, rtol=RTOL)
        for name, (low, high) in found.intervals.items():
            held[name] += low <= TRUTH[name] <= high
            half[name].append((high - low) / 2)
    least = dict(zip(TRUTH, stats.norm.ppf(0.975) * least_deviations(size), strict=True))
    for name in TRUTH:
        assert held[name] >= 90, (name, held)
        assert 0.5 * least[name] < min(half[name]), name
        assert max(half[name]) < 2 * least[name], name


# What data cannot tell -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_numbers_that_only_count_together_are_named():
    """Speeds tell how far the ball falls, not where: only the wall's place less the ball's counts."""
    names = {RESTITUTION: (0.5, 0.95), PLACE: (5e-3, 9e-3), WALL: (1e-2, 1.5e-2)}
    near = start(**{WEIGHT: GRAVITY, RESTITUTION: 0.79})
    found = cj.calibrate(near, data(LONG, SPEED, noise=2e-3, seed=1), names, rtol=RTOL)
    assert set(found.undetermined) == {PLACE, WALL}
    (said,) = found.notes
    assert f"cannot tell `{PLACE}` and `{WALL}` apart: only one combination" in said
    assert "not determined" in found.row(WALL)
    low, high = found.intervals[RESTITUTION]
    assert low < TRUTH[RESTITUTION] < high < low + 0.02
    # What is undetermined does not shift what is: the fall's height is found.
    assert found.values[WALL] - found.values[PLACE] == pytest.approx(HEIGHT, rel=0.02)


def test_a_number_without_influence_is_named():
    """How stiff the wall is is not seen in how the ball flies."""
    names = {RESTITUTION: (0.5, 0.95), STIFFNESS: (1e8, 1e10)}
    measured = data(LONG, noise=3e-4, seed=1)
    found = cj.calibrate(start(**{WALL: 1.2e-2, WEIGHT: GRAVITY}), measured, names, rtol=RTOL)
    assert found.undetermined == (STIFFNESS,)
    assert any(f"do not determine `{STIFFNESS}`" in note for note in found.notes)
    assert found.values[RESTITUTION] == pytest.approx(TRUTH[RESTITUTION], abs=0.01)


# Data that are not as they should be ---------------------------------------------------------------------------------


@pytest.mark.parametrize("loss", ["huber", "soft_l1", "cauchy", "arctan"])
def test_a_robust_loss_forgives_outliers(loss):
    measured, size = data(SHORT, noise=2e-5, seed=5), 2e-5
    measured[PLACE][3::10] = measured[PLACE][3::10] + 100 * size
    plain = cj.calibrate(start(), measured, FALL, rtol=RTOL)
    robust = cj.calibrate(start(), measured, FALL, loss=loss, rtol=RTOL)
    clean = cj.calibrate(start(), data(SHORT, noise=size, seed=5), FALL, rtol=RTOL)
    assert abs(plain.values[PLACE] - 7e-3) > 10 * clean.deviations[PLACE]
    assert abs(robust.values[PLACE] - clean.values[PLACE]) < 2 * clean.deviations[PLACE]
    assert clean.deviations[PLACE] < robust.deviations[PLACE] < 2.5 * clean.deviations[PLACE]
    assert robust.noise[PLACE] == pytest.approx(size, rel=0.5)


@pytest.mark.parametrize("loss", LOSSES)
def test_losses_are_differentiated_right_and_tuned(loss):
    """Derivatives against differences; an estimator of a mean loses 5 % where the noise is normal."""
    one, z, step = LOSSES[loss], np.array([0.01, 0.5, 2.0, 30.0]), 1e-5
    value, first, second = one.rho(z)
    ends = one.rho(z - step), one.rho(z + step)
    np.testing.assert_allclose(first, (ends[1][0] - ends[0][0]) / (2 * step), rtol=1e-6)
    np.testing.assert_allclose(second, (ends[1][1] - ends[0][1]) / (2 * step), rtol=1e-6, atol=1e-9)
    assert np.all(value <= z)
    noise = np.linspace(-8, 8, 40_001)
    psi, slope = one.influence(noise)
    density = stats.norm.pdf(noise)
    efficiency = np.trapezoid(slope * density, noise) ** 2 / np.trapezoid(psi**2 * density, noise)
    assert efficiency == pytest.approx(1.0 if loss == "linear" else 0.95, abs=1e-3)
    mean, freedom = one.normal_squares()
    assert mean == pytest.approx(np.trapezoid(psi**2 * density, noise), rel=1e-6)
    assert freedom == pytest.approx(2 * mean**2 / np.trapezoid((psi**2 - mean) ** 2 * density, noise), rel=1e-6)
    if loss != "linear":
        assert one.scale**2 * one.rho(np.array([1e-6]))[0] == pytest.approx(one.scale**2 * 1e-6, rel=1e-5)


@pytest.mark.slow
def test_residuals_that_are_no_noise_are_told():
    """The ball fell at another gravity than the model's, which is not looked for."""
    names = {PLACE: (-0.02, 0.02), SPEED: (-0.2, 0.2), RESTITUTION: (0.5, 0.95)}
    wrong, measured = start(**{WEIGHT: 9.3, WALL: 1.2e-2}), data(LONG, noise=2e-5)
    given = cj.calibrate(wrong, measured, names, deviations={PLACE: 2e-5}, rtol=RTOL)
    assert given.chi_square > 3
    assert any("times as large as its noise" in note for note in given.notes)
    assert any("follow each other" in note for note in given.notes)
    wide = cj.calibrate(start(), data(SHORT, noise=2e-5, seed=3), FALL, deviations={PLACE: 2e-4}, rtol=RTOL)
    assert any("only 0.1" in note and "too wide" in note for note in wide.notes)


def test_residuals_as_small_as_the_errors_of_the_solves_are_told():
    found = cj.calibrate(start(), data(SHORT), FALL, rtol=RTOL)
    np.testing.assert_allclose(list(found.values.values()), [1.2e-2 - HEIGHT, 0.0, GRAVITY], rtol=1e-7, atol=1e-7)
    (said,) = found.notes
    assert "no larger than the errors of the solves" in said


def test_signals_that_stand_still_are_signals():
    """A wall that is not touched bears nothing, whatever else is found."""
    measured = data(SHORT, noise=2e-5, seed=3).assign({"sleeve.contact_force": ("time", 0 * SHORT)})
    found = cj.calibrate(start(), measured, FALL, rtol=RTOL)
    expected, _ = fallen(measured[PLACE].values, SHORT)
    np.testing.assert_allclose(list(found.values.values()), expected, rtol=1e-4, atol=1e-7)
    assert found.noise[PLACE] == pytest.approx(2e-5, rel=0.3)
    assert any("`sleeve.contact_force` are no larger than the errors" in note for note in found.notes)


@pytest.mark.slow
def test_several_starts_find_what_one_does_not(monkeypatch):
    """Of a vibration every frequency at which the beat fits is a minimum; a motion that grows has fewer."""
    name, times = "drive.slide.angular_frequency", np.linspace(0.0, 1.0, 101)
    motion = cj.Motion(cj.drives.Harmonic(0.1, 50.0))
    shaker = cj.Mechanism((cj.Body("table", 1.0),), (cj.Prismatic("slide", "ground", "table", motion=motion),))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(101)
    measured = dataset(times, slide=np.asarray(cj.simulate(shaker, 1.0, save_at=times)["slide"]) + noise)
    far, seen = cj.replace(shaker, {name: 30.0}), []
    grown = cj.calibrate(far, measured, {name: (20.0, 80.0)}, starts=1)
    assert grown.values[name] == pytest.approx(50.0, abs=3 * grown.deviations[name])
    monkeypatch.setattr(search_module, "PARTS", ())
    monkeypatch.setattr(profile_module, "FAR", ())
    one = cj.calibrate(far, measured, {name: (20.0, 80.0)}, starts=1)
    assert abs(one.values[name] - 50.0) > 1.0
    assert any("follow each other" in note for note in one.notes)
    for starts in (None, 12):
        many = cj.calibrate(far, measured, {name: (20.0, 80.0)}, starts=starts, progress=seen.append)
        assert many.values[name] == pytest.approx(50.0, abs=3 * many.deviations[name])
        assert many.notes == ()
    assert many.motions < len(seen)
    assert len(many.others) > 3
    assert all(other.ratio > 10 for other in many.others)
    assert f"Another minimum, of {many.others[0].ratio:.3g} times the cost" in many.message
    assert f"{len(many.others) - 3} more minima" in many.message


def test_starts_are_scattered_over_the_bounds_by_a_seed():
    wide = Variables(("a", "b"), np.array([2.0, 0.5]), np.array([1.0, -1.0]), np.array([1e6, 1.0]), {})
    one, same, other = (np.array(list(starts_of(wide, FitOptions(starts=40, seed=seed)))) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.all(one[1:] != other[1:])
    np.testing.assert_array_equal(one[0], [2.0, 0.5])
    assert np.all((wide.lower <= one) & (one <= wide.upper))
    # What is positive and may be of any size is scattered by its logarithm.
    assert np.median(one[1:, 0]) == pytest.approx(1e3, rel=0.5)
    assert np.median(one[1:, 1]) == pytest.approx(0.0, abs=0.1)


# Derivatives that mislead --------------------------------------------------------------------------------------------


def task(
    model: Any, slopes: Any, x: float, seen: np.ndarray, noise: float = 0.01, starts: int | None = None
) -> FitTask:
    """A fit of one number `c` between 0 and 10 to a formula instead of a motion."""

    class Formula:
        accuracy, points = 1e-8, ()

        def until(self, count):
            return self

        def __call__(self, x):
            return FitPoint(x, model(x[0])[:, None], slopes(x[0])[:, None, None], "")

    measured = Measurement(np.arange(float(seen.size)), (Series("y", "y", "", seen, noise),))
    variables = Variables(("c",), np.array([x]), np.zeros(1), np.full(1, 10.0), {"c": ""})
    return FitTask(Formula(), variables, measured, FitOptions(starts=starts))  # pyright: ignore[reportArgumentType]


def said(one: FitTask) -> list[str]:
    fit, known, more = settle(one, search(one)[0])
    return [*doubts(one, fit, known), *more]


def test_steps_that_bring_less_than_promised_are_told():
    """Ripples that are seen by the derivative only, as chaos makes them."""
    times, noise = np.arange(30.0), 0.01 * np.random.default_rng(0).standard_normal(30)
    fast = 1e3

    def model(c):
        return c * times + 2.0 * np.sin(fast * c)

    rippled = task(model, lambda c: times + 2.0 * fast * np.cos(fast * c), 2.0, 3.0 * times + noise, starts=1)
    assert any("brought less than a quarter" in one for one in said(rippled))
    straight = task(lambda c: c * times, lambda c: times, 2.0, 3.0 * times + noise)
    assert said(straight) == []


def test_intervals_that_reach_beyond_what_derivatives_tell_are_told():
    """A kink at the minimum: to one side the readings change ten times as much."""
    times, noise = np.arange(30.0), 0.01 * np.random.default_rng(0).standard_normal(30)

    def model(c):
        return times * (c + 9 * max(c - 3.0, 0.0))

    kinked = task(model, lambda c: times * (10.0 if c > 3.0 else 1.0), 2.0, 3.0 * times + noise)
    assert any("at the ends of the intervals, mainly of `c`" in one.lower() for one in said(kinked))


def test_an_interval_reaches_as_far_as_the_motion_allows():
    """A reading that bends away: where its line has the end of the interval is known in closed form."""
    times, noise = np.arange(30.0), 0.01 * np.random.default_rng(0).standard_normal(30)
    # Without what a line would follow of it.
    noise = noise - times * np.sum(times * noise) / np.sum(times**2)

    def bent(c):
        return c - 1000 * max(min(c - 3.0, 5e-4), 0.0) ** 2

    def slope(c):
        return times * (1 - 2000 * (c - 3.0) * (3.0 < c < 3.0005))

    one = task(lambda c: times * bent(c), slope, 2.9, 3.0 * times + noise)
    fit, known, _ = settle(one, search(one)[0])
    half = stats.norm.ppf(0.975) * 0.01 * np.sqrt(known.inflation / np.sum(times**2))
    end = 3.0 + (1 - np.sqrt(1 - 4e3 * half)) / 2e3
    straight = fit.point.x[0] + known.factor * known.deviations[0]
    assert fit.point.x[0] == pytest.approx(3.0, abs=1e-6)
    assert straight + 5e-6 < end
    assert known.intervals[0, 1] == pytest.approx(end, abs=0.15 * (end - fit.point.x[0]))


def test_intervals_lie_within_the_bounds():
    times, noise = np.arange(30.0), 0.01 * np.random.default_rng(0).standard_normal(30)
    one = task(lambda c: c * times, lambda c: times, 2.0, 1e-4 * times + noise)
    known = settle(one, search(one)[0])[1]
    assert known.intervals[0, 0] == 0.0
    assert 0.0 < known.intervals[0, 1] < 1e-3


def test_residuals_that_follow_each_other_count_as_fewer():
    """Of a first-order process with the correlation f the variance of a mean is (1 + f) / (1 - f) times as large."""
    draws, psi = np.random.default_rng(0).standard_normal(200_000), np.zeros(200_000)
    for i in range(1, len(psi)):
        psi[i] = 0.8 * psi[i - 1] + draws[i]
    assert _memory(psi) == pytest.approx(9.0, rel=0.1)
    assert _memory(draws) == pytest.approx(1.0, abs=0.1)


def test_readings_show_their_noise():
    times = np.linspace(0.0, 1.0, 401)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(401)
    moved = np.sin(10 * times) + np.where(times > 0.5, 1.0, 0.0)
    assert _roughness(times, moved + noise) == pytest.approx(1e-3, rel=0.15)
    assert np.isnan(_roughness(times[:40], noise[:40]))
    assert np.isnan(_roughness(times**2, noise))


@pytest.mark.slow
def test_a_model_that_is_wrong_is_told_without_a_deviation():
    """The ball fell at another gravity than the model's: 61 readings show how large their noise is."""
    times = np.linspace(0.0, 0.03, 61)
    wrong, measured = start(**{WEIGHT: 5.0}), data(times, noise=2e-5)
    found = cj.calibrate(wrong, measured, {PLACE: (-0.02, 0.02), SPEED: (-0.2, 0.2)}, rtol=RTOL)
    assert any("the noise that the readings themselves show" in note for note in found.notes)
    (wider,) = [note for note in found.notes if "follow each other" in note]
    assert "are made wider by the factor" in wider
    assert "may lie outside" in wider


def test_a_shorter_motion_reads_the_same_until_its_end():
    settings = settings_of(ball(), 0.03, {"rtol": RTOL})
    one = Instruments(
        ball(), read_measurement(ball(), data(SHORT)), lambda x: dict(zip(FALL, x, strict=True)), 0.03, settings
    )
    x = np.array([7e-3, 0.01, GRAVITY])
    whole, part = one(x), one.until(12)(x)
    np.testing.assert_allclose(part.values[:12], whole.values[:12], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(part.values[12:], np.broadcast_to(part.values[11], (19, 1)))
    np.testing.assert_allclose(part.slopes[:12], whole.slopes[:12], rtol=0, atol=1e-10)
    assert len(one.points) == 2


def test_a_number_at_its_bound_is_told():
    times = np.arange(30.0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(30)
    beyond = task(lambda c: c * times, lambda c: times, 2.0, 11.0 * times + noise)
    assert any("`c` lies at a bound" in one for one in said(beyond))


@pytest.mark.slow
def test_an_interrupted_search_keeps_its_best():
    seen = []

    def stop(point):
        seen.append(point)
        if len(seen) == 4:
            raise KeyboardInterrupt

    found = cj.calibrate(start(), data(LONG, noise=5e-5), BOUNDS, progress=stop, rtol=RTOL)
    assert not found.converged
    assert "has not converged: it was interrupted" in found.notes[0]
    assert found.motions == len(seen) == 5  # the best of a part of the time is asked for all of it
    first = np.asarray(cj.simulate(start(), LONG[-1], save_at=LONG, rtol=RTOL)[PLACE]) - found.residuals[PLACE].values
    assert np.sum(found.residuals[f"{PLACE}_residual"] ** 2) < 0.5 * np.sum(first**2)


# What is measured ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_data_may_be_a_dataset_of_the_library_or_in_other_units():
    """Coordinates with labels, vectors, signals and units name the same numbers."""
    mechanism, times = cj.load(SCENES / "arm.toml"), np.linspace(0.0, 0.02, 21)
    motion = cj.to_dataset(mechanism, cj.simulate(mechanism, 0.02, save_at=times))
    force = metrics.ContactForce("hip")
    given = motion[["position"]].assign(
        {
            "tip.velocity": motion["velocity"].sel(point="tip"),
            "load": ("time", 1e-3 * motion["contact_force"].values[:, 0], {"units": "kN"}),
        }
    )
    given = given.assign_coords({"time": ("time", 1e3 * times, {"units": "ms"})})
    measured = read_measurement(
        mechanism, given, {name: name for name in ("position", "tip.velocity")} | {"load": force}
    )
    names = [one.name for one in measured.series]
    assert names == ["tip.position.x", "tip.position.y", "tip.velocity.x", "tip.velocity.y", "load"]
    assert [one.unit for one in measured.series] == ["m", "m", "m/s", "m/s", "N"]
    np.testing.assert_allclose(measured.times, times, rtol=1e-12)
    found = cj.calibrate(mechanism, given, ["arm.mass"], signals={"load": force, "tip.velocity": "tip.velocity"})
    assert found.values["arm.mass"] == pytest.approx(2.0, rel=1e-6)
    assert set(found.noise) == {"load", "tip.velocity.x", "tip.velocity.y"}
    assert found.residuals["load"].attrs["units"] == "N"


# What is refused -----------------------------------------------------------------------------------------------------


def changed(**changes: Any) -> dict[str, Any]:
    return {"mechanism": start(), "dataset": data(SHORT), "parameters": FALL, "rtol": RTOL} | changes


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters": {"gravity.z": (1.0, 2.0)}}, "There is no parameter `gravity.z`.*gravity.x"),
        ({"parameters": {}}, "`parameters` is empty"),
        ({"parameters": {WEIGHT: (12.0, 8.0)}}, "must be a lower and an upper one, not 12 and 8"),
        ({"parameters": {WEIGHT: (1.0, 5.0)}}, "starts at the mechanism's own `gravity.x` = 9.6.*between its bounds"),
        ({"parameters": {WALL: (-1.0, 1.0)}}, "A bound of `sleeve.radial_clearance` must be"),
        ({"parameters": [WEIGHT], "starts": 3}, "Several starts are scattered.*`gravity.x` has none"),
        ({"loss": "hubr"}, "no loss 'hubr'. Did you mean `huber`"),
        ({"starts": 0}, "`starts` must be a whole number from 1"),
        ({"deviations": {"x": 1e-3}}, "`deviations`: there is no signal `x`"),
        ({"deviations": {PLACE: 0.0}}, "deviation of `guide.position` must be finite and above zero"),
        ({"signals": {"x": PLACE}}, "has no variable `x`"),
        ({"dataset": dataset(SHORT, x=SHORT)}, "`x` cannot be compared with the motion.*`signals="),
        ({"signals": {PLACE: "guide.speed"}}, "no number `guide.speed`"),
        ({"dataset": data(SHORT).drop_vars("time")}, "lacks a coordinate `time`"),
        ({"dataset": dataset(SHORT[::-1], **{PLACE: SHORT})}, "`time` must increase"),
        ({"dataset": dataset(SHORT - 1e-3, **{PLACE: SHORT})}, "measured times, -0.001 to 0.029 s, must lie inside"),
        ({"t1": 0.02}, "measured times, 0 to 0.03 s, must lie inside the motion, from 0 to 0.02 s"),
        ({"dataset": dataset(SHORT, **{PLACE: SHORT * np.nan})}, "all its values are NaN"),
        ({"dataset": data(SHORT).isel(time=slice(0, 2))}, "2 measured numbers cannot determine 3 parameters"),
        ({"dataset": data(SHORT).isel(time=slice(0, 3))}, "leave none to estimate the noise from"),
        ({"dataset": data(SHORT)[[PLACE]].assign({PLACE: ("time", SHORT, {"units": "kg"})})}, "must be in m"),
        ({"save_at": 3}, "leave `save_at` out"),
        ({"max_steps": 3}, "No motion from which the search could start reaches its end.*number of steps"),
    ],
)
def test_what_cannot_be_calibrated(changes, words):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.calibrate(**changed(**changes))


# A study's section, the command and the report -----------------------------------------------------------------------

STUDY = ROOT / "experiments" / "studies" / "calibration.toml"
PLAY, FRICTION = "hip.radial_clearance", "hip.friction.coefficient"


def written(folder: Path, old: str = "", new: str = "", data: str = "") -> Path:
    """The study of the repository, changed."""
    text = STUDY.read_text().replace("../arm.toml", str(SCENES / "arm.toml"))
    assert old in text
    (folder / "arm_measured.csv").write_text(data or STUDY.with_name("arm_measured.csv").read_text())
    path = folder / "study.toml"
    path.write_text(text.replace(old, new) if old else text)
    return path


def asked_of(path: Path) -> Any:
    return cj.load_study(path).calibrate


@pytest.mark.slow
def test_the_command_calibrates_and_reports(tmp_path):
    path, report, residuals = written(tmp_path), tmp_path / "report.html", tmp_path / "residuals.nc"
    result = CliRunner().invoke(app, ["run", str(path), "--report", str(report), "-o", str(residuals), "--starts", "2"])
    assert result.exit_code == 0, result.output
    shown = " ".join(result.output.split())
    assert "Play of the arm's pin" in shown
    assert "199 numbers compared, 3 missing" in shown
    found = cj.calibrate(**asked_of(path))
    for name, truth in ((PLAY, 1.3e-4), (FRICTION, 0.14)):
        low, high = found.intervals[name]
        assert low < truth < high
        assert found.row(name) in shown
    assert found.notes == ()
    page = report.read_text(encoding="utf-8")
    assert page.count("<svg") == 4
    assert "The residuals look like noise, and every number is determined." in page
    assert f"{1e6 * found.values[PLAY]:.5g} µm" in page
    assert "Correlation of the numbers" in page
    assert "deviation = &#34;5 um&#34;" in page
    saved = cj.load_dataset(residuals)
    np.testing.assert_allclose(saved["x_model"], found.residuals["x_model"], rtol=0, atol=1e-8)


def test_a_report_says_what_is_not_determined(tmp_path):
    names = {RESTITUTION: (0.5, 0.95), STIFFNESS: (1e8, 1e10)}
    measured = data(LONG, noise=3e-4, seed=1)
    found = cj.calibrate(start(**{WALL: 1.2e-2, WEIGHT: GRAVITY}), measured, names, rtol=RTOL)
    other = dataclasses.replace(found, others=(Minimum(found.values, 3.25),))
    cj.calibration_report(other, tmp_path / "r.html", "<ball>")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "&lt;ball&gt;" in page
    assert "not determined" in page
    assert "The data do not determine" in page
    assert "Other minima" in page
    assert "3.25" in page
    # Nothing in its figures is cut off.
    for figure in (
        calibration_figures.signal_fit(found, PLACE),
        calibration_figures.interval_widths(found),
        calibration_figures.correlations(found),
    ):
        check_texts(figure)
    with refused(tmp_path / "no" / "r.html"):
        cj.calibration_report(found, tmp_path / "no" / "r.html")


def test_a_study_maps_columns_to_signals(tmp_path):
    table = '[calibrate.signal.y]\nsignal = "contact-force"\njoint = "hip"\n[calibrate.signal.x]'
    path = written(tmp_path, "[calibrate.signal.x]", table)
    text = path.read_text().replace('[calibrate.signal.y]\nquantity = "tip.position.y"\ndeviation = "5 um"\n', "")
    path.write_text(text.replace("lower = 0.0\nupper = 0.5\n", ""))
    csv = (tmp_path / "arm_measured.csv").read_text().replace("y [mm]", "y [kN]")
    (tmp_path / "arm_measured.csv").write_text(csv)
    asked = asked_of(path)
    assert isinstance(asked["signals"]["y"], metrics.ContactForce)
    assert asked["signals"]["x"] == "tip.position.x"
    assert asked["deviations"] == {"x": pytest.approx(5e-6)}
    assert asked["parameters"] == {PLAY: (pytest.approx(1e-5), 1e-3), FRICTION: None}
    assert asked["loss"] == "huber"
    assert asked["rtol"] == 1e-7
    assert asked["t1"] is None
    # Without a table each column is the quantity of its name; other files are read too.
    cj.save(xr.Dataset({"tip.position.x": ("time", SHORT)}, {"time": SHORT}), tmp_path / "measured.nc")
    bare = text.split("[calibrate.signal")[0].replace("arm_measured.csv", "measured.nc")
    path.write_text(bare + f'[calibrate.parameter."{PLAY}"]\nupper = "1 mm"\n')
    asked = asked_of(path)
    assert asked["signals"] is None
    assert asked["parameters"] == {PLAY: (-np.inf, 1e-3)}
    np.testing.assert_array_equal(asked["dataset"]["tip.position.x"], SHORT)


def test_examples_of_the_section_are_read(tmp_path):
    signal = example(calibrate_keys.SIGNAL_TABLE)
    top = example(calibrate_keys.CALIBRATE, "parameter", "signal")
    parts = {
        "calibrate": top,
        'calibrate.parameter."hip.radial_clearance"': example(calibrate_keys.PARAMETER_TABLE),
        "calibrate.signal.x": {name: signal[name] for name in ("quantity", "deviation")},
        "calibrate.signal.y": {name: signal[name] for name in ("signal", "point")} | {"point": '"tip"'},
    }
    written(tmp_path)
    text = f'scene = "{SCENES / "arm.toml"}"\n'
    for name, values in parts.items():
        text += f"[{name}]\n" + "".join(f"{key} = {value}\n" for key, value in values.items())
    (tmp_path / "s.toml").write_text(text)
    asked = asked_of(tmp_path / "s.toml")
    assert (asked["loss"], asked["starts"], asked["seed"], asked["most"]) == ("huber", 5, 1, 200)
    assert asked["parameters"] == {PLAY: (pytest.approx(1e-5), 1e-3)}
    assert asked["deviations"] == {"x": pytest.approx(2e-5)}
    assert asked["signals"] == {"x": "tip.position.x", "y": metrics.PositionError("tip")}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("arm_measured.csv", "nothing.csv", "calibrate.data: .*nothing.csv.*No such file"),
        ("signal.x]", "signal.z]", "calibrate.signal.z: the data have no column `z`"),
        ("tip.position.x", "tip.place.x", "calibrate.signal.x: .*no number `tip.place.x`"),
        ('quantity = "tip.position.x"', 'signal = "acceleration"', "signal.x lacks the key `point`"),
        ('quantity = "tip.position.x"', 'point = "tip"', "point has no effect without `signal`"),
        ('quantity = "tip.position.x"', 'quantity = "tip.position.x"\nsignal = "acceleration"', "not both"),
        ('deviation = "5 um"', 'deviation = "5 N"', "signal.x.deviation must be in m"),
        ('"huber"', '"hubr"', "calibrate.loss must be one of the allowed words.* `huber`"),
        ("hip.radial_clearance", "hip.clearance", "parameter.hip.clearance: There is no parameter `hip.clearance`"),
        ('name = "Play', 't1 = "50 ms"\nname = "Play', "t1 is 0.05 s, but the data reach to 0.1 s"),
        ("lower = 0.0", 'lower = "0 m"', "lower must be a bare number"),
    ],
)
def test_what_a_study_cannot_say(old, new, words, tmp_path):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.load_study(written(tmp_path, old, new))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time, x, y\n0, 1\n", "line 2 has 2 cells, but the header has 3 columns"),
        ("time, x, y\n0, 1, a\n", "line 2, column `y` must be a number"),
        ("0, 1, 2\n", "must be a header such as `time .s., tip.position.x .mm.`"),
        ("time [kg], x, y\n0, 1, 2\n1, 2, 3\n", "units.* must be in s"),
        ("time, x [s], y\n0, 1, 2\n1, 2, 3\n", "variable `x`, its attribute `units`, must be in m"),
        ("time, x, y\n1, 1, 2\n0, 2, 3\n", "`time` must increase"),
        ("time, x, y\n, 1, 2\n0, 2, 3\n", "`time` has values that are not finite"),
        ("time, x, y\n0, , 2\n1, nan, 3\n", "Nothing of `x` was measured"),
    ],
)
def test_data_that_cannot_be_read(text, words, tmp_path):
    with pytest.raises(cj.ClearanceError, match=words):
        cj.load_study(written(tmp_path, data=text))
