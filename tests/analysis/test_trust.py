"""The report on a gradient's worth: what it trusts, what it does not and what is done then, and its statistics."""

import numpy as np
import pytest
from places import refused

import clearance_jax as cj
from clearance_jax import laws
from clearance_jax.analysis import scatter
from clearance_jax.analysis.scatter import horizon_of, regression
from clearance_jax.analysis.trust import UntrustedGradient
from clearance_jax.errors import ClearanceError
from clearance_jax.solve.settings import Settings
from experiments.trust import __main__ as experiment
from experiments.trust.cases import evaluated
from experiments.trust.horizon import CHAOTIC, FACTOR, REGULAR
from experiments.trust.scenes import NAME, place, scene

CALM, WILD = scene(REGULAR["R2, periodic"]), scene(CHAOTIC["A2"])
# Past four impacts of the one, and past the horizon of the other.
SHORT, LONG = 0.06, 0.2


def test_of_a_peak_the_second_is_looked_at_in_the_same_part_of_the_motion(monkeypatch):
    class Asked(Exception):
        pass

    def lanes(question, _):
        (metric,) = question.metrics.values()
        raise Asked(metric.count, float(metric.since))

    monkeypatch.setattr(scatter, "lanes", lanes)
    plan = scatter.SamplingPlan((NAME,), np.ones(1), 0.02, 8, 0.01, 4, 1e-8, 0)
    with pytest.raises(Asked, match=r"\(2, 0.125\)"):
        scatter.sample(plan, CALM, cj.metrics.Peak(cj.metrics.Acceleration("pin"), since=0.125), SHORT, Settings())


@pytest.mark.slow
def test_a_regular_motion_is_trusted():
    report = cj.gradient_report(CALM, place, [NAME], SHORT, on_untrusted="raise")
    assert report.trusted
    assert report.reasons == ()
    assert not report.smoothed
    assert report.horizon == np.inf
    assert report.impacts[0] > 0
    expected = cj.sensitivities(CALM, place, [NAME], SHORT)
    np.testing.assert_allclose(report.value, expected.value, rtol=1e-6)
    np.testing.assert_allclose(report.gradient, expected.matrix(), rtol=1e-5)
    assert report.gradient_error[0] <= 1e-3 * abs(report.gradient[0])
    assert "trusted" in str(report)
    assert "NOT" not in str(report)


@pytest.mark.slow
def test_a_chaotic_motion_is_not():
    def report(**options):
        return cj.gradient_report(WILD, place, [NAME], LONG, **options)

    with pytest.raises(ClearanceError, match="not to be trusted"):
        report(on_untrusted="raise")
    with pytest.warns(UntrustedGradient, match="Neighbouring motions within the scatter have parted"):
        warned = report()
    assert not warned.trusted
    assert warned.lyapunov > 10
    assert warned.horizon < LONG
    assert warned.signal_to_noise[0] < 3
    assert "NOT TRUSTED" in str(warned)
    smooth = report(on_untrusted="smooth")
    assert smooth.smoothed
    # The slope over the scatter, its draws made anew, and solved without derivatives and far more accurately.
    half = np.random.default_rng(0).standard_normal((8, 1))
    numbers = CHAOTIC["A2"]
    moves = 0.01 * numbers.clearance * np.concatenate([half, -half])
    points = numbers.clearance + moves.T
    values = evaluated("place", np.array([numbers]), np.array([LONG]), points)[0]
    np.testing.assert_allclose(smooth.gradient, regression(moves, values)[0], rtol=1e-2)
    assert abs(smooth.gradient[0]) < 0.5 * abs(warned.gradient[0])
    assert smooth.gradient_error[0] > 0
    assert "slope over the scatter" in str(smooth)


def test_horizon_of():
    times = np.linspace(0, 1, 501)
    rate, horizon = horizon_of(times, 1e-6 * np.exp(20 * times), 0.1)
    np.testing.assert_allclose([rate, horizon], [20, np.log(1e5) / 20], atol=3e-3)
    # Beyond the end it is extrapolated; beats do not matter, nor an early excursion.
    rate, horizon = horizon_of(times, 1e-6 * np.exp(5 * times), 0.1)
    np.testing.assert_allclose([rate, horizon], [5, np.log(1e5) / 5], rtol=1e-9)
    excursion = np.where(np.abs(times - 0.1) < 0.01, 1.0, 1e-6 * np.exp(20 * times))
    np.testing.assert_allclose(horizon_of(times, excursion, 0.1)[1], np.log(1e5) / 20, atol=3e-3)
    # Drift and rest never reach a horizon, however long one waits.
    assert horizon_of(times, 1e-3 * (1 + times), 0.1)[1] == np.inf
    assert horizon_of(times, np.zeros(501), 0.1)[1] == np.inf


def test_regression():
    rng = np.random.default_rng(0)
    moves, slopes = rng.standard_normal((200, 2)) * [1e-5, 3.0], np.array([2e4, -0.5])
    values = 7 + moves @ slopes + 0.1 * rng.standard_normal(200)
    found, error = regression(moves, values)
    assert np.all(np.abs(found - slopes) < 3 * error)
    np.testing.assert_allclose(error * moves.std(0), 0.1 / np.sqrt(200), rtol=0.2)
    np.testing.assert_allclose(regression(moves, moves @ slopes)[0], slopes, rtol=1e-9)


def test_messages():
    with refused("play.radal_clearance", allowed=NAME):
        cj.gradient_report(CALM, place, ["play.radal_clearance"], SHORT)
    with refused("samples"):
        cj.gradient_report(CALM, place, [NAME], SHORT, samples=3)
    with refused("probes", -1):
        cj.gradient_report(CALM, place, [NAME], SHORT, probes=-1)
    with refused("play", "LinearKelvinVoigt"):
        cj.gradient_report(scene(REGULAR["R1, periodic"], laws.LinearKelvinVoigt), place, [NAME], SHORT)
    drive = cj.Motion(cj.drives.StepSum([0.0, 1.0], [0.5, 1.5], [0.1, 0.1]))
    driven = cj.Mechanism((cj.Body("a"),), (cj.Prismatic("slide", "ground", "a", motion=drive),))
    with pytest.raises(ClearanceError, match="entries of an array"):
        cj.gradient_report(driven, place, ["drive.slide.rise"], 1.0)


def test_a_metric_of_several_numbers_is_refused():
    with pytest.raises(ClearanceError, match="one number"):
        cj.gradient_report(CALM, lambda _, solution: solution.final[:2], [NAME], 0.01)


@pytest.mark.slow
@pytest.mark.optimised
def test_experiment(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    horizons, verdicts, islands = experiment.main(quick=True)
    for row in horizons:
        if row.chaotic:
            assert row.factor <= FACTOR
        else:
            assert row.predicted == np.inf
    assert not any(v.trusted for v in verdicts if v.good is False)
    assert any(v.trusted for v in verdicts if v.good)
    # Wider than the distance between two probes, none is missed.
    assert set(islands.values()) == {1.0}
    assert (tmp_path / "out" / "trust_verdicts_quick.md").exists()
