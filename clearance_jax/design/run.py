"""One run of a method: from a point that can be simulated, to one that holds every limit."""

import numpy as np

from clearance_jax.design.methods import Method, method_of
from clearance_jax.design.program import BudgetSpent, Program
from clearance_jax.design.repair import feasible_neighbour

# A point with no larger violation may be pulled inside; what a violation is worth, over the objective.
NEARLY, PRICE = 1e-3, 3.0
INTERRUPTED, SPENT = "interrupted", "stopped: as many evaluations as allowed"


def run(program: Program, method: str | Method, start: np.ndarray, **options) -> str:
    """Run an optimiser, then pull its answer inside the limits.

    **Arguments:** `program`: what is minimised; `method`: a name or a `Method`; `start` (n,): the variables at the
    start; `options`: the method's.

    **Returns:** why it stopped early, or nothing.
    """
    method = method_of(method)
    try:
        # Where a motion has no end there is no slope to follow: smaller clearances rattle less.
        if not np.isfinite(program.at(start, method.gradients).worst):
            found = feasible_neighbour(program, start, method.gradients)
            start = start if found is None else found.x
        said = method.solve(program, start, **options)
        _pull_inside(program, method.gradients)
        return said or ""
    except BudgetSpent:
        return SPENT
    except KeyboardInterrupt:
        if not program.history:
            raise
        return INTERRUPTED


def _pull_inside(program: Program, gradient: bool) -> None:
    """Evaluate a feasible neighbour of the best point that all but holds its limits: solvers end on a limit from both
    sides, and the best point that holds may be an early and poor one.
    """
    near = [p for p in program.history if p.worst < NEARLY]
    if near:
        # A violation is worth some multiple of itself in objective: powers of clearances have small exponents.
        best = min(near, key=lambda p: p.objective + PRICE * abs(p.objective) * max(p.worst, 0.0))
        feasible_neighbour(program, best.x, gradient)
    elif program.nearest is not None:
        feasible_neighbour(program, program.nearest.x, gradient)
