"""The record of an evaluated design."""

import math
from typing import NamedTuple

import numpy as np

from clearance_jax.solve.settings import DYNAMICS

# A limit counts as held if it is violated by at most this share of its bound, as solvers end on the limit itself.
SLACK = 1e-9


class Evaluation(NamedTuple):
    """An evaluated design.

    - `x` (n,): the variables; `objective`; `limits` (m,): value over bound, minus 1, of each limit.
    - `gradient` (n,) of the objective and `jacobian` (m, n) of the limits by x; `None`: not asked for.
    - `fidelity`: the model of the motion by which it was evaluated.
    """

    x: np.ndarray
    objective: float
    limits: np.ndarray
    gradient: np.ndarray | None = None
    jacobian: np.ndarray | None = None
    fidelity: str = DYNAMICS

    @property
    def worst(self) -> float:
        """The most violated limit; minus infinity without limits, infinite if a number is not finite."""
        if not math.isfinite(self.objective) or not np.all(np.isfinite(self.limits)):
            return math.inf
        return float(np.max(self.limits, initial=-math.inf))

    @property
    def feasible(self) -> bool:
        """Whether every limit is held."""
        return self.worst <= SLACK
