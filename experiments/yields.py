"""Whether designs have the yield they were searched for: `python -m experiments.yields` writes out/yields.md.

Every problem is searched with 100 sets of samples, and the true yield of each answer is known: in closed form for plays
that add up and scatter normally, from 5000 fresh samples for the slider-crank. A margin of 95 % confidence means that
at most about five of 100 sets may lead to a design below its target. Without it the search bounds the conditional value
at risk of the samples, whatever their number.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.stats

import clearance_jax as cj
from clearance_jax.design import Evaluation, Limit, Program, Reciprocal, ToleranceProblem, Yield
from clearance_jax.design import run as search
from clearance_jax.design.asked.specification import scenarios_of
from clearance_jax.design.search.evaluate import simulations_of
from clearance_jax.design.search.yields import samples_to_search, worst_parts
from clearance_jax.metrics import Peak, PositionError
from experiments.common import SCENES, output, table
from experiments.publish import command

SEEDS = 100
DEVIATION = 0.1
CLEARANCE, MASS = "wrist.radial_clearance", "slider.mass"


class Row(NamedTuple):
    """Of one problem and number of samples: the target, how many seeds end below it, the yields (seeds,), and the mean
    cost over that of the cheapest design with this yield (NaN: not known).
    """

    problem: str
    target: float
    samples: int
    confidence: float
    yields: np.ndarray
    cost: float

    @property
    def below(self) -> int:
        return int(np.sum(self.yields < self.target))


def _sum_of_plays(count: int, spread) -> Program:
    """The cheapest plays x_i whose weighted sum is at most 1; `spread(x, weights)` has the limit and its slopes."""
    weights, factors = np.linspace(1, 2, count), np.linspace(1, 3, count)

    def evaluate(x, gradient):
        value, slopes = spread(x, weights)
        return Evaluation(x, float((factors / x).sum()), np.array([value - 1]), -factors / x**2, slopes[None])

    names = [f"play {i + 1}" for i in range(count)]
    return Program(evaluate, names, np.full(count, 1e-3), np.full(count, 2.0), ["sum"])


def _cheapest(program: Program) -> tuple[np.ndarray, float]:
    search(program, "slsqp", np.full(len(program.names), 0.3 / len(program.names)), tolerance=1e-8)
    assert program.best is not None
    return program.best.x, program.best.objective


def sums(count: int, target: float, samples: int, confidence: float, seeds: int) -> Row:
    """Plays that add up, each with a normal scatter of its own."""
    names = tuple(str(i) for i in range(count))
    quantile = scipy.stats.norm.ppf(target)

    def exact(x, weights):
        spread = DEVIATION * np.linalg.norm(weights * x)
        return weights @ x + quantile * spread, weights + quantile * (DEVIATION * weights) ** 2 * x / spread

    _, least = _cheapest(_sum_of_plays(count, exact))
    yields, costs = [], []
    for seed in range(seeds):
        made = Yield(dict.fromkeys(names, DEVIATION), target, samples, seed, confidence)
        factors = np.stack(list(made.draws(names).values()), 1)

        def sampled(x, weights, made=made, factors=factors):
            rows = factors * weights
            risk, slopes = made.judge((rows @ x)[:, None], rows[:, None])
            return risk[0], slopes[0]

        x, cost = _cheapest(_sum_of_plays(count, sampled))
        weights = np.linspace(1, 2, count)
        yields.append(scipy.stats.norm.cdf((1 - weights @ x) / (DEVIATION * np.linalg.norm(weights * x))))
        costs.append(cost / least)
    return Row(f"{count} plays that add up", target, samples, confidence, np.array(yields), float(np.mean(costs)))


def slider_crank(target: float, seeds: int, fresh: int) -> Row:
    """The wrist's play of a slider-crank whose mass scatters too, searched by the default number of samples."""

    def asked(seed: int) -> ToleranceProblem:
        return ToleranceProblem(
            cj.load(SCENES / "slider_crank.toml"),
            2e-3,
            {CLEARANCE: (1e-5, 1e-3)},
            [Limit(Peak(PositionError("piston")), 2e-4)],
            cost=Reciprocal(1e-4),
            manufacture=Yield({CLEARANCE: 0.1, MASS: 0.05}, target, seed=seed),
            rtol=1e-7,
        )

    # Of each fresh sample the largest designed play with which it holds, between plays that enclose all of them.
    specification, plays = asked(0).specification, np.geomspace(1e-4, 2.4e-4, 12)
    drawn = scenarios_of(specification, fresh, 99)
    simulations = simulations_of(specification)
    worst = np.stack([simulations.worst(np.array([play]), drawn) for play in plays], 1)
    critical = np.array([np.interp(0.0, row, plays) if np.all(np.diff(row) > 0) else np.nan for row in worst])
    assert not np.any(np.isnan(critical))
    found = [asked(seed).solve() for seed in range(seeds)]
    yields = np.array([np.mean(critical >= design.evaluation.x[0]) for design in found])
    return Row("wrist of a slider-crank", target, samples_to_search(target), 0.95, yields, np.nan)


def _show(rows: Sequence[Row], seeds: int, name: str) -> None:
    heads = "problem", "target", "samples", "margin", "worst samples averaged"
    heads = *heads, f"of {seeds} seeds below the target", "lowest yield", "mean yield", "cost over the least"
    lines = [
        (
            row.problem,
            f"{row.target:.0%}",
            f"{row.samples}{' (default)' * (row.samples == samples_to_search(row.target))}",
            f"{row.confidence:.0%}" if row.confidence else "none",
            f"{worst_parts(row.samples, row.target, row.confidence):.2f}",
            row.below,
            f"{row.yields.min():.2%}",
            f"{row.yields.mean():.2%}",
            "" if np.isnan(row.cost) else f"{row.cost:.4f}",
        )
        for row in rows
    ]
    table(heads, lines, output(name))


def main(quick: bool = False) -> list[Row]:
    seeds = 20 if quick else SEEDS
    cases = [(1, 0.99, 64), (3, 0.99, 512)]
    if not quick:
        several = {0.9: (64,), 0.95: (64, 128), 0.99: (64, 128, 256, 512)}
        cases = [(count, target, n) for target, samples in several.items() for count in (1, 4) for n in samples]
    rows = [sums(*case, confidence, seeds) for case in cases for confidence in (0.0, 0.95)]
    _show(rows, seeds, f"yields{'_quick' if quick else ''}.md")
    if not quick:
        rows.append(slider_crank(0.9, seeds, 5000))
        _show(rows[-1:], seeds, "yields_slider_crank.md")
    return rows


if __name__ == "__main__":
    command(main, __doc__, "fewer seeds and cases")
