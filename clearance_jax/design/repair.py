"""From a point that violates a limit to one that does not."""

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# A point with no larger violation may be pulled inside; what a violation is worth, over the objective.
NEARLY, PRICE = 1e-3, 3.0


def nearly_best(program: Program) -> Evaluation | None:
    """The best point asked for that all but holds its limits; where there is none, the one with the least violation."""
    near = [p for p in program.asked if p.worst < NEARLY]
    if not near:
        return min(program.asked, key=lambda p: p.worst, default=None)
    # A violation is worth some multiple of itself in objective: powers of clearances have small exponents.
    return min(near, key=lambda p: p.objective + PRICE * abs(p.objective) * max(p.worst, 0.0))


def feasible_neighbour(program: Program, x: np.ndarray, gradient: bool = False) -> Evaluation | None:
    """A feasible point on the scaling line through `x`, towards smaller clearances and near; nothing where none is."""
    # One that has come to its bound stays there, and the others go on.
    point, shift, low = program.at(x, gradient), 0.0, float(np.min(np.log(program.lower / x)))
    # Errors grow about as clearances do: shrink by the violation, and on from there.
    for _ in range(12):
        if point.feasible:
            return point
        shift = max(low, shift - max(2 * point.worst, 1e-8) if np.isfinite(point.worst) else shift - 0.5)
        point = program.at(x * np.exp(shift), gradient)
        if shift == low:
            break
    return point if point.feasible else None
