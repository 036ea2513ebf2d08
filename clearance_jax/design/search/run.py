"""One run of a method, with a repair of its start and its end, and what follows it by values alone.

Where slopes were useless or misleading, a search by values first goes along a line from the best feasible design to
where a limit is met, by false position, or by bisection where that is slow. With several variables it continues by
quadratic models of values about that point, and then along the line again.

A limit with impacts has ripples, so a search that follows slopes may end in a small part of the designs that hold,
while a better part is a little further along the limit. So there is also a look beside the end of a search, at cheaper
designs that trade one variable against others.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
import scipy.optimize

from clearance_jax.design.search import scaling
from clearance_jax.design.search.methods import Method, cobyqa, method_of
from clearance_jax.design.search.program import BudgetSpent, Evaluation, Program

INTERRUPTED, SPENT = "interrupted", "stopped: as many evaluations as allowed"
STILL = "stopped: the search stands still"
# The beginning of a reason that says that slopes were useless.
USELESS = "stopped: "
BY_VALUES = "So the search went on by values alone, and a better design may exist"


Searched = TypeVar("Searched", bound=Callable[..., str])


def stopping(search: Searched) -> Searched:
    """A search of a program, for which to be interrupted or to have spent all evaluations is a reason to stop."""

    @functools.wraps(search)
    def stopped(program: Program, *arguments: Any, **options: Any) -> str:
        try:
            return search(program, *arguments, **options)
        except BudgetSpent:
            return SPENT
        except KeyboardInterrupt:
            if not program.history:
                raise
            return INTERRUPTED

    return stopped  # pyright: ignore[reportReturnType]


@stopping
def run(program: Program, method: str | Method, start: np.ndarray, **options) -> str:
    """Run an optimiser, then move its result inside the limits.

    **Arguments:** `program`: what is minimised; `method`: a name or a `Method`; `start` (n,): the variables at the
    start; `options`: the method's.

    **Returns:** why it stopped early, or nothing.
    """
    method = method_of(method)
    # A motion that does not reach its end has no slopes: start from smaller clearances, with smaller impacts.
    if program.cheap is None and not np.isfinite(program.at(start, method.gradients).worst):
        neighbour = scaling.feasible_neighbour(program, start, method.gradients)
        start = start if neighbour is None else neighbour.x
    reason, still = "", False
    try:
        reason = method.solve(program, start, **options) or ""
    except scaling.UselessSlopes as why:
        reason = f"{USELESS}{why}"
        if program.cheap is not None:
            return reason
    except scaling.StandsStill:
        still = True
    # Solvers end on either side of a limit, and the best feasible point may be an early and poor one.
    if (best := scaling.nearly_best(program)) is not None:
        scaling.feasible_neighbour(program, best.x, method.gradients)
    went_on = by_values(program, method)
    if still:
        # It is an optimum if a limit is active.
        best = program.best
        return "" if best is None or np.any(best.limits > -scaling.NEARLY) else STILL
    if reason and went_on:
        return "" if is_settled(program, method) else f"{reason}. {BY_VALUES}"
    return reason


# The residual of the conditions of optimality below which a design counts as an optimum.
SETTLED = 0.05
# A line search ends if a limit is so near to its bound, or the interval so short, in logarithms.
MET, SHORT = 1e-5, 1e-4
# The first step along a line, and the factor of the next ones.
STEP, LONGER = 0.01, 2.0
# Radius of the first and the last quadratic model, in logarithms; evaluations for each variable.
RADIUS, LEAST_RADIUS, EACH = 0.1, 1e-3, 15


def is_settled(program: Program, method: Method) -> bool:
    """Whether the best design is at active limits or at bounds, and an optimum if the method uses gradients."""
    best = program.found
    if best is None or np.all(_room(program, best, _gaining(program, best)) <= 0):
        return True
    if best.worst <= -method.slack:
        return False
    if not method.gradients or best.gradient is None:
        return True
    # A design that is moved inside its limits moves all variables, those at their bounds too.
    return scaling.optimality(program, best, method.slack, method.slack)[0] <= SETTLED


def by_values(program: Program, method: Method) -> bool:
    """Continue from the best design by values alone, unless it is settled (along a line, if there are poses too)."""
    if is_settled(program, method):
        return False
    _outwards(program, method)
    if len(program.names) > 1 and program.cheap is None and not is_settled(program, method):
        with suppress(scaling.StandsStill):
            cobyqa(program, _best(program).x, LEAST_RADIUS, radius=RADIUS, most=EACH * len(program.names))
        _outwards(program, method)
    return True


def _best(program: Program) -> Evaluation:
    best = program.found
    assert best is not None
    return best


def _outwards(program: Program, method: Method) -> None:
    """Change all variables by the same factor towards a lower objective, until a limit is met or all are at bounds.

    Where evaluations are expensive, a limit counts as met within the method's `slack`.
    """
    best, met = _best(program), MET if program.cheap is None else method.slack
    z, way = np.log(best.x), _gaining(program, best)
    end = float(_room(program, best, way).max())
    # Places along the line with their excess: the last one that holds, and the first one that does not.
    low, high, step, last_width = (0.0, _excess(program, best)), None, STEP, np.inf
    while low[0] < end and (high is None or (low[1] < -met and high[0] - low[0] > SHORT)):
        if high is None:
            # Errors are about proportional to clearances.
            s, step = min(low[0] + max(step, -1.01 * low[1]), end), LONGER * step
        else:
            s, last_width = _between(low, high, last_width), high[0] - low[0]
        value = _excess(program, program.at(np.exp(z + s * way), method.gradients))
        low, high = ((s, value), high) if value <= 0 else (low, (s, value))


def _between(low: tuple[float, float], high: tuple[float, float], last_width: float) -> float:
    """The next place in a bracket: by false position, or its middle if the last step hardly narrowed it."""
    width = high[0] - low[0]
    if not np.isfinite(high[1]) or width > 0.5 * last_width:
        return low[0] + 0.5 * width
    share = -low[1] / (high[1] - low[1])
    # Not near the ends: one of them would be approached again and again.
    return low[0] + width * float(np.clip(share, 0.02, 0.98))


def _excess(program: Program, point: Evaluation) -> float:
    """The logarithm of the most violated limit (value over bound), which is nearly linear in those of clearances."""
    return float(np.log(max(1 + point.worst, scaling.FLOOR))) + program.inside


def _room(program: Program, best: Evaluation, way: np.ndarray) -> np.ndarray:
    """How far each variable (n,) is from its bound in a direction, in logarithms."""
    room = np.where(way > 0, np.log(program.upper / best.x), np.log(best.x / program.lower))
    return np.where((way == 0) | (room < scaling.ROUND_OFF), 0.0, room)


def _gaining(program: Program, best: Evaluation) -> np.ndarray:
    """The sign of the change of each variable (n,) that lowers the objective."""
    if best.gradient is None and program.cheap is not None:
        best = program.cheap.at(best.x, True)  # of the same objective
    if best.gradient is not None:
        return -np.sign(best.gradient)
    logs = np.log([point.x for point in program.asked])
    values = np.array([point.objective for point in program.asked])
    return -np.sign(np.linalg.lstsq(logs - logs.mean(0), values - values.mean(), rcond=None)[0])


# How far away, in logarithms of the variables; by which share the objective there is lower; how often a search goes on.
AWAY, GAIN, ROUNDS = (0.03, 0.1, 0.3), 0.01, 4
# By how much all variables change together at most, in logarithms.
FURTHEST = 0.7


@stopping
def trade(program: Program, method: Method, objective: Callable[[np.ndarray], float], reason: str, **options) -> str:
    """Go on from a better design beside the best one, as long as there is one; returns the `reason` why the search
    stopped early (or empty), or why this did. `objective`: of variables (n,); `options`: the method's.
    """
    for _ in range(ROUNDS):
        best = program.found
        if best is None or len(best.x) < 2 or reason in (INTERRUPTED, SPENT):
            break
        places = _beside(program, best, objective)
        better = next((x for x in places if program.at(x, method.gradients).feasible), None)
        if better is None:
            break
        reason = run(program, method, better, **options)
    return reason


def _beside(program: Program, best: Evaluation, objective: Callable[[np.ndarray], float]) -> Iterator[np.ndarray]:
    """Designs of a lower objective on both sides of the best one, further and further away."""
    z, wanted, rng = np.log(best.x), best.objective - GAIN * abs(best.objective), np.random.default_rng(0)
    for away in AWAY:
        # Along the diagonal nothing is traded: the search has looked there.
        way = rng.normal(size=len(z)) if len(z) > 2 else np.array([1.0, -1.0])
        way -= way.mean()
        way *= away / np.abs(way).max()
        for side in (way, -way):
            x = _with_objective(program, z + side, objective, wanted)
            if x is not None:
                yield x


def _with_objective(
    program: Program, z: np.ndarray, objective: Callable[[np.ndarray], float], wanted: float
) -> np.ndarray | None:
    """The design of logarithms `z` (n,), scaled to the objective that is wanted; `None`: no such factor is near."""

    def scaled(by: float) -> np.ndarray:
        return np.clip(np.exp(z + by), program.lower, program.upper)

    def over(by: float) -> float:
        return objective(scaled(by)) - wanted

    if over(-FURTHEST) * over(FURTHEST) >= 0:
        return None
    return scaled(scipy.optimize.brentq(over, -FURTHEST, FURTHEST, xtol=1e-6))
