"""How much a scene amplifies a small change of its start, measured on the reference: no solve can do better."""

from collections.abc import Callable

import numpy as np

from experiments.hard.case import worst
from experiments.reference.located import Solution, dop853
from experiments.reference.problems import Problem

CHANGE = 1e-9
MOST = 4
"""Of scenes with more states than this, so many changes of all states at once are tried, with random signs."""


def amplified(
    problem: Problem, t: np.ndarray, p: np.ndarray, units: np.ndarray, see: Callable, limit: float | None = None
) -> tuple[Solution, float]:
    """The reference, and its amplification.

    The amplification is the largest change of any state that is compared (`see` takes them from the reference's),
    relative to the largest magnitude of that state, for a change of the start by one of the `units`: for positions the
    clearance, for speeds the speed of the machine; zero for a state that is given.
    """
    start = problem.start(p)
    truth = dop853(problem, t, p, limit=limit)
    changes = (
        np.diag(units) if len(units) <= MOST else units * np.random.default_rng(0).choice([-1, 1], (3, len(units)))
    )
    largest = 1.0
    for change in CHANGE * changes:
        moved = problem._replace(start=lambda _, change=change: start + change)
        other = dop853(moved, t, p, limit=limit)
        largest = max(largest, worst(see(other.y), see(truth.y)) / CHANGE)
    return truth, largest
