"""What the studies share: the command line, and an allocation solved in several ways with its proof and its figures."""

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import clearance_jax as cj
from clearance_jax.design import (
    Certificate,
    Design,
    Limit,
    Method,
    Reciprocal,
    ToleranceProblem,
    nearest_fits,
    responses,
    tradeoff,
)
from clearance_jax.metrics import Peak, PositionError
from clearance_jax.report.design_figures import contributions, trade
from clearance_jax.report.figures import save_figure
from experiments.common import output, table
from experiments.publish import say


def cheapest(
    mechanism: cj.Mechanism, t1: float, costs: Mapping[str, float], point: str, bound: float, least: float = 1e-5
) -> ToleranceProblem:
    """The cheapest clearances, from `least` to 1 mm, that keep a point within a bound [m]; `costs` are
    times the clearance [m].
    """
    return ToleranceProblem(
        mechanism,
        t1,
        dict.fromkeys(costs, (least, 1e-3)),
        [Limit(Peak(PositionError(point)), bound, point)],
        cost={name: Reciprocal(factor) for name, factor in costs.items()},
    )


class Allocation(NamedTuple):
    """Answers of several solvers to one problem, the first one's certificate, and seconds of each."""

    designs: dict[str, Design]
    certificate: Certificate
    seconds: dict[str, float]


def allocate(name: str, problem: ToleranceProblem, methods: Sequence[str | Method], quick: bool) -> Allocation:
    """Solve by each method from the same start; table, certificate and figures of the first one's answer."""
    asked, designs, seconds = problem.specification, {}, {}
    for method in methods:
        clock = time.perf_counter()
        found = problem.solve(method)
        designs[found.method.name], seconds[found.method.name] = found, time.perf_counter() - clock
        print(found, flush=True)
    table(
        (
            "method",
            *asked.variables,
            "cost",
            "solves with gradients",
            "without",
            "seconds, compiling included",
        ),
        [
            (
                method,
                *(f"{1e6 * c:.3f} um" for c in found.clearances.values()),
                f"{found.objective:.6f}",
                found.program.gradients,
                found.program.evaluations,
                f"{seconds[method]:.0f}",
            )
            for method, found in designs.items()
        ],
        output(f"{name}{'_quick' if quick else ''}.md"),
    )
    design = next(iter(designs.values()))
    # In quick mode by the same solver, which is compiled already.
    certificate = design.verify(sweep=4, solver=asked.solver) if quick else design.verify(reoptimise=True)
    say(certificate)
    why = responses(design)
    say(*why)
    save_figure(contributions(why), output(f"{name}{'_quick' if quick else ''}_contributions.png"))
    if not quick:
        say(nearest_fits(design) or "No combination of common fits holds the limits.")
        save_figure(trade(tradeoff(design), design), output(f"{name}_tradeoff.png"))
    return Allocation(designs, certificate, seconds)
