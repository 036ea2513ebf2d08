"""A look beside the end of a search: at cheaper designs that trade one variable against others.

A limit with impacts has ripples, so a search that follows slopes may end in a small part of the designs that hold,
while a better part is a little further along the limit.
"""

from collections.abc import Callable, Iterator

import numpy as np
import scipy.optimize

from clearance_jax.design.methods import Method
from clearance_jax.design.program import BudgetSpent, Program
from clearance_jax.design.run import INTERRUPTED, SPENT, run

# How far away, in logarithms of the variables; by which share the objective there is lower; how often a search goes on.
AWAY, GAIN, ROUNDS = (0.03, 0.1, 0.3), 0.01, 4
# By how much all variables change together at most, in logarithms.
FURTHEST = 0.7


def trade(program: Program, method: Method, objective: Callable[[np.ndarray], float], reason: str, **options) -> str:
    """Go on from a better design beside the best one, as long as there is one.

    **Arguments:** `objective` of variables (n,); `reason`: why the search stopped early, or empty; `options`: the
    method's.

    **Returns:** the reason, or why this stopped early.
    """
    try:
        for _ in range(ROUNDS):
            best = program.found
            if best is None or len(best.x) < 2 or reason in (INTERRUPTED, SPENT):
                return reason
            places = _beside(program, best.x, objective)
            better = next((x for x in places if program.at(x, method.gradients).feasible), None)
            if better is None:
                return reason
            reason = run(program, method, better, **options)
    except BudgetSpent:
        return SPENT
    except KeyboardInterrupt:
        return INTERRUPTED
    return reason


def _beside(program: Program, x: np.ndarray, objective: Callable[[np.ndarray], float]) -> Iterator[np.ndarray]:
    """Designs of a lower objective on both sides of one, further and further away."""
    z, low, high = np.log(x), np.log(program.lower), np.log(program.upper)
    wanted, rng = objective(x) - GAIN * abs(objective(x)), np.random.default_rng(0)
    for away in AWAY:
        # Along the diagonal nothing is traded: the search has looked there.
        way = rng.normal(size=len(z)) if len(z) > 2 else np.array([1.0, -1.0])
        way -= way.mean()
        for side in (away, -away):

            def place(all_by: float, step: np.ndarray = side * way / np.abs(way).max()) -> np.ndarray:
                return np.exp(np.clip(z + step + all_by, low, high))

            def lack(all_by: float, place=place) -> float:
                return objective(place(all_by)) - wanted

            if lack(-FURTHEST) * lack(FURTHEST) < 0:
                yield place(scipy.optimize.brentq(lack, -FURTHEST, FURTHEST, xtol=1e-6))
