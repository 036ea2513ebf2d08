"""Allocations of clearances whose exact answer is known: `python -m optimize.exponential_cost_closed_form`.

Minimise sum B_i / c_i^k, or sum exp(-B_i c_i), under sum S_i c_i <= eps (worst case) or sqrt(sum (S_i c_i)^2) <= eps
(statistical). The Karush-Kuhn-Tucker conditions give each answer in closed form.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from clearance_jax.design import METHODS, Evaluation, Method, Program, run
from clearance_jax.report.figures import save_figure
from experiments.common import output, table
from experiments.publish import command
from optimize.optax_methods import AUGMENTED_LAGRANGIAN

BOUND = 0.1
COUNTS = (2, 5, 20, 50)
COST_ERROR, VIOLATION = 1e-6, 1e-8
COMPARED = (METHODS["slsqp"], AUGMENTED_LAGRANGIAN)


class KnownAllocation(NamedTuple):
    """A problem and its answer: `program()`, best clearances `x` (n,), least `cost`."""

    name: str
    kind: str
    weights: np.ndarray
    factors: np.ndarray
    exponent: float
    x: np.ndarray
    cost: float

    def program(self) -> Program:
        n = len(self.weights)
        names = [f"c{i + 1}" for i in range(n)]
        return Program(self._evaluate, names, np.full(n, 1e-6), np.full(n, 1e2), ["error"])

    def _evaluate(self, x, gradient):
        s, b, k = self.weights, self.factors, self.exponent
        if self.kind == "statistical":
            size = np.linalg.norm(s * x)
            limit, row = size, s * s * x / size
        else:
            limit, row = s @ x, s
        if self.kind == "exponential":
            objective, slope = np.sum(np.exp(-b * x)), -b * np.exp(-b * x)
        else:
            objective, slope = np.sum(b / x**k), -k * b / x ** (k + 1)
        limits = np.array([limit / BOUND - 1])
        return Evaluation(x, float(objective), limits, *((slope, row[None] / BOUND) if gradient else ()))


def allocation(kind: str, count: int, exponent: float = 1.0) -> KnownAllocation:
    """A problem with seeded numbers; 3 variables: those of the literature's example."""
    rng = np.random.default_rng(count)
    s, b = rng.uniform(0.3, 3.0, count), rng.uniform(1.0, 5.0, count)
    if count == 3:
        s, b = np.array([1.0, 0.5, 2.0]), np.array([1.0, 3.0, 2.0])
    if kind == "exponential":
        b = b * 10 * count  # clearances of some 1 / b share the bound
        # b_i exp(-b_i c_i) = multiplier s_i, and the s_i c_i add up to the bound
        logarithm = (np.sum(s / b * np.log(b / s)) - BOUND) / np.sum(s / b)
        x = (np.log(b / s) - logarithm) / b
        cost = np.sum(np.exp(-b * x))
    else:
        power = exponent + (2 if kind == "statistical" else 1)
        shape = (exponent * b / (s * s if kind == "statistical" else s)) ** (1 / power)
        total = np.linalg.norm(s * shape) if kind == "statistical" else s @ shape
        x = shape * BOUND / total
        cost = np.sum(b / x**exponent)
    return KnownAllocation(f"{kind}, k = {exponent:g}, n = {count}", kind, s, b, exponent, x, float(cost))


class Row(NamedTuple):
    """One solver on one problem: errors of its answer, and evaluations with gradients: in all, and until the cost was
    right to `COST_ERROR` at a violation below `VIOLATION`.
    """

    name: str
    method: str
    cost_error: float
    violation: float
    gradients: int
    needed: int


def solve_by(problem: KnownAllocation, method: Method) -> Row:
    program = problem.program()
    run(program, method, np.full(len(problem.x), BOUND / np.sum(problem.weights) / 2))
    best = program.best
    assert best is not None
    needed = [
        i + 1
        for i, p in enumerate(program.history)
        if p.worst <= VIOLATION and abs(p.objective / problem.cost - 1) <= COST_ERROR
    ]
    error = best.objective / problem.cost - 1
    return Row(problem.name, method.name, error, best.worst, program.gradients, needed[0] if needed else -1)


def problems(quick: bool) -> list[KnownAllocation]:
    out = []
    for count in (3, *COUNTS) if not quick else (2, 20):
        for kind in ("worst case", "statistical"):
            out += [allocation(kind, count, k) for k in ((1.0,) if quick else (0.5, 1.0, 2.0))]
        out.append(allocation("exponential", count))
    return out


def main(quick: bool = False) -> list[Row]:
    asked = problems(quick)
    rows = [solve_by(problem, method) for problem in asked for method in COMPARED]
    table(
        ("problem", "method", "cost error", "limit violated by", "gradients", f"until {COST_ERROR:g}"),
        [(r.name, r.method, f"{r.cost_error:.1e}", f"{max(r.violation, 0):.0e}", r.gradients, r.needed) for r in rows],
        output(f"allocation_closed_form{'_quick' if quick else ''}.md"),
    )
    fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
    for method in COMPARED:
        needed = [row.needed for row in rows if row.method == method.name]
        ax.plot([len(problem.x) for problem in asked], needed, "o", ms=4, alpha=0.6, label=method.name)
    ax.set(xlabel="clearances", ylabel=f"evaluations until right to {COST_ERROR:g}")
    ax.legend()
    save_figure(fig, output(f"allocation_closed_form{'_quick' if quick else ''}.png"))
    plt.close(fig)
    return rows


if __name__ == "__main__":
    command(main, __doc__, "few problems")
