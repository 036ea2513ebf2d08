"""One run of a method, with a repair of its start and of its result."""

import numpy as np

from clearance_jax.design.by_values import by_values, is_settled
from clearance_jax.design.methods import Method, method_of
from clearance_jax.design.program import BudgetSpent, Program
from clearance_jax.design.repair import NEARLY, feasible_neighbour, nearly_best
from clearance_jax.design.scaling import StandsStill
from clearance_jax.design.slopes import UselessSlopes

INTERRUPTED, SPENT = "interrupted", "stopped: as many evaluations as allowed"
STILL = "stopped: the search stands still"
USELESS = "stopped: "
BY_VALUES = "So the search went on by values alone, and a better design may exist"


def run(program: Program, method: str | Method, start: np.ndarray, **options) -> str:
    """Run an optimiser, then move its result inside the limits.

    **Arguments:** `program`: what is minimised; `method`: a name or a `Method`; `start` (n,): the variables at the
    start; `options`: the method's.

    **Returns:** why it stopped early, or nothing.
    """
    method = method_of(method)
    try:
        # A motion that does not reach its end has no slopes: start from smaller clearances, with smaller impacts.
        if program.cheap is None and not np.isfinite(program.at(start, method.gradients).worst):
            neighbour = feasible_neighbour(program, start, method.gradients)
            start = start if neighbour is None else neighbour.x
        reason, still = "", False
        try:
            reason = method.solve(program, start, **options) or ""
        except UselessSlopes as why:
            reason = f"{USELESS}{why}"
            if program.cheap is not None:
                return reason
        except StandsStill:
            still = True
        # Solvers end on either side of a limit, and the best feasible point may be an early and poor one.
        if (best := nearly_best(program)) is not None:
            feasible_neighbour(program, best.x, method.gradients)
        went_on = not method.is_mean and by_values(program, method)
        if still:
            return _standing(program)
        if reason and went_on:
            return "" if is_settled(program, method) else f"{reason}. {BY_VALUES}"
        return reason
    except BudgetSpent:
        return SPENT
    except KeyboardInterrupt:
        if not program.history:
            raise
        return INTERRUPTED


def _standing(program: Program) -> str:
    """The stop reason of a search that stands still: empty if a limit is active."""
    best = program.best
    return "" if best is None or np.any(best.limits > -NEARLY) else STILL
