"""Repair of points that violate a limit: find a feasible point nearby."""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# The largest violation of a point that may be pulled inside; the price of a violation, over the objective.
NEARLY, PRICE = 1e-3, 3.0


def nearly_best(program: Program) -> Evaluation | None:
    """The best of the points asked for that nearly hold their limits; if there is none, that of least violation."""
    near = [p for p in program.asked if p.worst < NEARLY]
    if not near:
        return min(program.asked, key=lambda p: p.worst, default=None)
    # A violation costs a small multiple of itself in the objective, as costs are small powers of clearances.
    return min(near, key=lambda p: p.objective + PRICE * abs(p.objective) * max(p.worst, 0.0))


def feasible_neighbour(program: Program, x: np.ndarray, gradient: bool = False) -> Evaluation | None:
    """A feasible point near `x` (n,), by scaling all variables down; `None` if there is none."""
    # Variables at their bounds stay there, while the others shrink further.
    point, shift, low = program.at(x, gradient), 0.0, float(np.min(np.log(program.lower / x)))
    # Errors are about proportional to clearances: shrink by the violation, and repeat.
    for _ in range(12):
        if point.feasible:
            return point
        shift = max(low, shift - max(2 * point.worst, 1e-8) if np.isfinite(point.worst) else shift - 0.5)
        point = program.at(x * np.exp(shift), gradient)
        if shift == low:
            break
    return point if point.feasible else None
