"""A search by values alone, for the end of a search whose slopes were useless or misleading.

It first goes along a line from the best feasible design to where a limit is met, by false position, or by bisection
where that is slow. With several variables it continues by quadratic models of values about that point, and then along
the line again.
"""

from contextlib import suppress

import numpy as np

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.methods import Method, cobyqa
from clearance_jax.design.optimality import optimality
from clearance_jax.design.program import Program
from clearance_jax.design.scaling import FLOOR, ROUND_OFF, StandsStill

# The residual of the conditions of optimality below which a design counts as an optimum.
SETTLED = 0.05
# A line search ends if a limit is so near to its bound, or the interval so short, in logarithms.
MET, SHORT = 1e-5, 1e-4
# The first step along a line, and the factor of the next ones.
STEP, LONGER = 0.01, 2.0
# Radius of the first and the last quadratic model, in logarithms; evaluations for each variable.
RADIUS, LEAST_RADIUS, EACH = 0.1, 1e-3, 15


def is_settled(program: Program, method: Method) -> bool:
    """Whether the best design is at active limits or at the bounds of its variables; if the method uses gradients, also
    whether it satisfies the conditions of optimality.
    """
    best = program.found
    if best is None or np.all(_room(program, best, _gaining(program, best)) <= 0):
        return True
    met = best.worst > -method.slack
    if not method.gradients or best.gradient is None:
        return met
    return met and optimality(program, best, method.slack)[0] <= SETTLED


def by_values(program: Program, method: Method) -> bool:
    """Continue from the best feasible design by values alone, unless it is settled; returns whether it did.

    A program with a `cheap` model has expensive evaluations, and is searched along a line only.
    """
    if is_settled(program, method):
        return False
    _outwards(program, method.gradients)
    if len(program.names) > 1 and program.cheap is None and not is_settled(program, method):
        with suppress(StandsStill):
            cobyqa(program, _best(program).x, LEAST_RADIUS, radius=RADIUS, most=EACH * len(program.names))
        _outwards(program, method.gradients)
    return True


def _best(program: Program) -> Evaluation:
    best = program.found
    assert best is not None
    return best


def _outwards(program: Program, gradient: bool) -> None:
    """Change all variables by the same factor towards a lower objective, until a limit is met or all are at bounds."""
    best = _best(program)
    z, way = np.log(best.x), _gaining(program, best)
    end = float(_room(program, best, way).max())
    low, high, step, narrow = (0.0, _excess(program, best)), None, STEP, np.inf
    while low[0] < end and (high is None or (low[1] < -MET and high[0] - low[0] > SHORT)):
        if high is None:
            # Errors are about proportional to clearances.
            s, step = min(low[0] + max(step, -1.01 * low[1]), end), LONGER * step
        else:
            s, narrow = _between(low, high, narrow), high[0] - low[0]
        value = _excess(program, program.at(np.exp(z + s * way), gradient))
        low, high = ((s, value), high) if value <= 0 else (low, (s, value))


def _between(low: tuple[float, float], high: tuple[float, float], before: float) -> float:
    """The next place in a bracket: by false position, or its middle if the last step hardly narrowed it."""
    width = high[0] - low[0]
    if not np.isfinite(high[1]) or width > 0.5 * before:
        return low[0] + 0.5 * width
    share = -low[1] / (high[1] - low[1])
    # Not near the ends: one of them would be approached again and again.
    return low[0] + width * float(np.clip(share, 0.02, 0.98))


def _excess(program: Program, point: Evaluation) -> float:
    """The logarithm of the most violated limit (value over bound), which is nearly linear in those of clearances."""
    return float(np.log(max(1 + point.worst, FLOOR))) + program.inside


def _room(program: Program, best: Evaluation, way: np.ndarray) -> np.ndarray:
    """How far each variable (n,) is from its bound in a direction, in logarithms."""
    room = np.where(way > 0, np.log(program.upper / best.x), np.log(best.x / program.lower))
    return np.where((way == 0) | (room < ROUND_OFF), 0.0, room)


def _gaining(program: Program, best: Evaluation) -> np.ndarray:
    """The sign of the change of each variable (n,) that lowers the objective."""
    if best.gradient is not None:
        return -np.sign(best.gradient)
    logs = np.log([point.x for point in program.asked])
    values = np.array([point.objective for point in program.asked])
    return -np.sign(np.linalg.lstsq(logs - logs.mean(0), values - values.mean(), rcond=None)[0])
