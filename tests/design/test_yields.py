"""What samples say of a yield: the margin of a search against order statistics, and how many it takes."""

import sys

import numpy as np
import pytest
import scipy.stats
from catalogue import slider_crank
from numpy.testing import assert_allclose

from clearance_jax import design, metrics
from clearance_jax.design import yields
from clearance_jax.errors import ClearanceError

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

    monkeypatch.setattr(sys.modules["clearance_jax.design.problem"], "search", begin)
    said = r"64 samples support a yield of 0.9543 .* at least 299 `samples`"
    with pytest.warns(design.YieldWarning, match=said), pytest.raises(Begun):
        problem.solve()
    assert not design.Yield({NAME: SCATTER}, 0.99).doubt
    with pytest.raises(ClearanceError, match="a confidence from 0"):
        design.Yield({}, confidence=1.0).check()


def test_what_an_estimate_says_of_a_target():
    clean = yields.estimate_yield(np.ones(200, bool))
    assert_allclose(clean.least, 0.9851, atol=5e-5)
    assert clean.against(0.99) == "That does not prove the target, 99.0000%: it takes 299 at least."
    assert clean.against(0.98) == ""
    assert clean.against(None) == ""
    assert "BELOW" in yields.estimate_yield(np.arange(200) >= 3).against(0.99)
