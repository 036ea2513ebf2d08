"""What samples say of a yield: the margin of a search against order statistics, how many it takes, and the fits of
parts that are made to it.
"""

import sys
import threading
from typing import Any

import numpy as np
import pytest
import scipy.stats
from catalogue import slider_crank
from made_findings import piston_limit, rows_of
from numpy.testing import assert_allclose
from places import ROOT, SCENES, refused

import clearance_jax as cj
from clearance_jax import design, metrics
from clearance_jax.design.asked.specification import Scenario
from clearance_jax.design.judge.findings import known_findings
from clearance_jax.design.judge.observed import joint_drawings
from clearance_jax.design.search import yields
from clearance_jax.design.search.evaluate import Simulations
from clearance_jax.report.html import render

NAME = "wrist.radial_clearance"
# How far a play that scatters by 10 % may be designed where all that counts is its size.
SCATTER = 0.1


def test_how_many_samples_a_yield_takes():
    """Wilks 1941; of 95 % at 95 % confidence 59."""
    assert [yields.samples_needed(target) for target in (0.9, 0.95, 0.99, 0.999)] == [29, 59, 299, 2995]
    assert_allclose(yields.yield_supported(299), 0.99, atol=5e-5)
    assert [yields.samples_to_search(target) for target in (0.9, 0.95, 0.99)] == [64, 128, 512]
    assert [yields.samples_to_judge(target) for target in (None, 0.9, 0.99)] == [1000, 200, 2000]
    assert design.Yield({}, 0.95).count == 128


@pytest.mark.parametrize(
    ("samples", "target", "worst"), [(299, 0.99, 1.0), (25, 0.9, 2.5), (64, 0.95, 3.2), (7, 0.5, 3.0)]
)
def test_the_confidence_is_that_of_uniform_order_statistics(samples, target, worst):
    """Drawn, and of the worst sample alone in closed form."""
    found = yields.confidence_of(worst, samples, target)
    beyond = np.sort(np.random.default_rng(2).uniform(size=(200_000, samples)), axis=1)[:, : int(np.ceil(worst))]
    weights = np.clip(worst - np.arange(beyond.shape[1]), 0, 1) / worst
    assert_allclose(found, np.mean(beyond @ weights <= 1 - target), atol=4e-3)
    assert_allclose(yields.confidence_of(1.0, samples, target), 1 - target**samples, rtol=1e-9)


def test_the_margin_is_as_large_as_the_confidence_wants():
    for samples, target in ((400, 0.99), (512, 0.99), (64, 0.95), (64, 0.9)):
        worst = yields.worst_parts(samples, target, 0.95)
        assert 1 < worst < (1 - target) * samples
        assert_allclose(yields.confidence_of(worst, samples, target), 0.95, atol=1e-9)
    # Many samples need none, few allow none.
    assert yields.worst_parts(1024, 0.99, 0.95) == pytest.approx(10.24)
    assert yields.worst_parts(64, 0.99, 0.95) == 1
    assert yields.worst_parts(25, 0.9, 0.0) == pytest.approx(2.5)


def test_the_docs_say_how_many():
    text = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    for target in (0.9, 0.95, 0.99):
        ways = (yields.samples_needed, yields.samples_to_search, yields.samples_to_judge)
        assert " | ".join([f"| {100 * target:g} %", *(str(way(target)) for way in ways)]) in text


def _yields(scatter: design.Yield, seeds: int = 100) -> np.ndarray:
    """The true yields of the largest plays whose samples hold a bound, by seeds of the samples."""
    found = []
    for seed in range(seeds):
        sizes = scatter.draws((NAME,), seed=seed)[NAME]
        risk, _ = scatter.judge(sizes[:, None], None)
        found.append(scipy.stats.norm.cdf((risk[0] - 1) / SCATTER))
    return np.array(found)


@pytest.mark.parametrize("target", [0.9, 0.95, 0.99])
def test_of_100_seeds_95_hold(target):
    """64 samples without a margin, as yields of 99 % once were: half of all seeds fall short."""
    assert np.sum(_yields(design.Yield({NAME: SCATTER}, target)) < target) <= 5
    few = _yields(design.Yield({NAME: SCATTER}, 0.99, samples=64, confidence=0.0))
    assert np.sum(few < 0.99) > 30
    # As far as so few samples go, the answer is good: to the yield that they support.
    assert np.sum(_yields(design.Yield({NAME: SCATTER}, 0.99, samples=64)) < yields.yield_supported(64)) <= 5


@pytest.mark.parametrize(
    "quantile", [lambda u: u, scipy.stats.norm.ppf, scipy.stats.expon.ppf, scipy.stats.lognorm(1).ppf]
)
def test_the_confidence_holds_for_any_falling_density(quantile):
    """Random samples; an even density is the worst case, where it is met."""
    part, rng = design.Yield({}, 0.95, samples=100), np.random.default_rng(3)
    shares = rng.uniform(size=(4000, 100))
    risks = np.array([part.judge(quantile(row)[:, None], None)[0][0] for row in shares])
    held = np.mean(risks >= quantile(0.95))
    assert held >= 0.95 - 3 * np.sqrt(0.05 * 0.95 / 4000)


def test_too_few_samples_are_said_before_the_search(monkeypatch):
    few = design.Yield({NAME: SCATTER}, 0.99, samples=64)
    problem = design.ToleranceProblem(
        slider_crank(),
        1e-3,
        {NAME: (1e-5, 1e-3)},
        [design.Limit(metrics.Peak(metrics.PositionError("piston")), 1e-4)],
        manufacture=few,
    )

    class Begun(Exception):
        pass

    def begin(*_, **__):
        raise Begun

    monkeypatch.setattr(sys.modules["clearance_jax.design.asked.problem"], "search", begin)
    said = r"64 samples support a yield of 0.9543 .* at least 299 `samples`"
    with pytest.warns(design.YieldWarning, match=said), pytest.raises(Begun):
        problem.solve()
    assert not design.Yield({NAME: SCATTER}, 0.99).doubt
    with refused("Yield", "(0.99, 1.0, None)"):
        design.Yield({}, confidence=1.0).check()


def test_what_an_estimate_says_of_a_target():
    clean = yields.estimate_yield(np.ones(200, bool))
    assert_allclose(clean.least, 0.9851, atol=5e-5)
    assert clean.against(0.99) == "That does not prove the target, 99.0000%: it takes 299 at least."
    assert clean.against(0.98) == ""
    assert clean.against(None) == ""
    assert "BELOW" in yields.estimate_yield(np.arange(200) >= 3).against(0.99)


def test_samples_that_are_asked_one_by_one_use_every_core(monkeypatch):
    """Those with tables of values were solved one after the other: two meet here, or neither goes on."""
    monkeypatch.setenv("PJRT_NPROC", "4")
    monkeypatch.setattr(sys.modules[Simulations.__module__], "usual_cores", lambda: 2)
    meeting = threading.Barrier(2)

    class Two(Simulations):
        def __init__(self):
            self.place, self._aged = None, {}

        def limits(self, x, scenario, gradient):
            if scenario.title != "first":
                meeting.wait(timeout=60)
            return np.array([len(scenario.title)]), None

    tables = [Scenario(title, {"table": np.zeros((2, 2))}, np.ones(1)) for title in ("first", "a", "bb")]
    found, _ = Two().together(np.ones(1), tables, False)
    np.testing.assert_array_equal(found, [[5], [1], [2]])


# Fits -----------------------------------------------------------------------------------------------------------------

CRANKPIN, WRIST, MASS = "crankpin.radial_clearance", "wrist.radial_clearance", "slider.mass"


class Sum:
    """In the place of simulations: the error is the sum of both plays, times what the slider's mass is of its own."""

    def __init__(self, bound: float, mass: float):
        self.bound, self.mass = bound, mass

    def worst(self, x, scenarios, exact=False):
        masses = [float(s.values.get(MASS, self.mass)) / self.mass for s in scenarios]
        errors = np.array([(x * s.factors).sum() for s in scenarios]) * np.array(masses)
        return errors / self.bound - 1


def fitted(monkeypatch, designed, least=1e-6, manufacture: Any = None) -> design.Design:
    """A design of two pins of 20 mm, whose plays add up to the bound."""
    mechanism = cj.load(SCENES / "slider_crank_loaded.toml")
    between = {CRANKPIN: (least, 1e-3), WRIST: (least, 1e-3)}
    problem = design.ToleranceProblem(
        mechanism, 0.1, between, [piston_limit()], design.Reciprocal(1e-4), manufacture=manufacture
    )
    asked, x = problem.specification, np.array(designed)
    fake = Sum(float(x.sum()), float(cj.parameters(mechanism)[MASS].value))
    evaluate_module = sys.modules["clearance_jax.design.search.evaluate"]
    monkeypatch.setattr(evaluate_module, "simulations_of", lambda *_, **__: fake)

    def evaluate(x, gradient):
        return design.Evaluation(x, float((1e-4 / x).sum()), np.array([-1e-6]), -1e-4 / x**2, np.ones((1, 2)))

    program = design.Program(evaluate, asked.names, *asked.bounds, ["piston"])
    return design.Design(asked, program, design.METHODS["slsqp"], program.at(x, True), "", "")


def test_a_fit_beyond_what_is_allowed_says_so(monkeypatch):
    """One joint takes what the other leaves: its fit is wider than its clearance was designed, and the page says it."""
    answer = fitted(monkeypatch, (33.64e-6, 36.5e-6))
    found = design.nearest_fits(answer, dict.fromkeys((CRANKPIN, WRIST), 0.02))
    assert found is not None
    wide = [name for name, fit in found.fits.items() if fit.radial_clearance[1] > answer.clearances[name]]
    assert wide
    for name, fit in found.fits.items():
        remark = found.remarks.get(name, "")
        assert (" um, as others are tighter" in remark) is (name in wide)
        assert fit.radial_clearance[0] >= 1e-6  # the least of the study is kept
    assert sum(fit.radial_clearance[1] for fit in found.fits.values()) <= 70.14e-6
    drawn = joint_drawings(answer, found.fits, found.remarks)
    rows = rows_of(render(known_findings(answer)._replace(fits=found, drawings=drawn)), "joint")
    cells = {row[0] + ".radial_clearance": row[4] for row in rows if "Ø" in row[1]}
    assert {name for name, cell in cells.items() if "may be above the designed 3" in cell} == set(wide)
    assert "as others are tighter" in str(found)


def test_the_least_play_of_a_study_is_kept_where_fits_can(monkeypatch):
    """H9/h8 holds the limits too, but may leave no play."""
    answer = fitted(monkeypatch, (40e-6, 40e-6), least=10e-6)
    found = design.nearest_fits(answer)
    assert found is not None
    assert all(fit.radial_clearance[0] >= 10e-6 for fit in found.fits.values())
    # Nothing common lies between 10 and 11 um: what comes nearest is said to.
    tight = design.nearest_fits(fitted(monkeypatch, (11e-6, 11e-6), least=10e-6))
    assert tight is not None
    assert all("may be below the least of the study, 10 um" in tight.remarks[name] for name in tight.fits)
    assert "below the least of the study" in str(tight)


def test_fits_of_a_yield_scatter_with_all_that_scatters(monkeypatch):
    """With the slider's mass too few parts hold by the fits that hold as designed, so they are tighter."""
    plain = design.nearest_fits(fitted(monkeypatch, (40e-6, 40e-6)))
    heavy = design.Yield({MASS: 0.6}, target=0.95, samples=128)
    found = design.nearest_fits(fitted(monkeypatch, (40e-6, 40e-6), manufacture=heavy))
    assert plain is not None
    assert found is not None
    assert plain.yield_estimate == (1.0, yields.estimate_yield(np.ones(299, bool)).least, 299)
    assert plain.target is None
    assert found.yield_estimate.samples == 400
    assert found.yield_estimate.least >= 0.95
    ends = [sum(fit.radial_clearance[1] for fit in one.fits.values()) for one in (plain, found)]
    assert ends[1] < ends[0]
