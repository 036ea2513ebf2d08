"""The Karush-Kuhn-Tucker conditions of optimality, in logarithms of the variables."""

import numpy as np
import scipy.optimize

from clearance_jax.design.evaluation import Evaluation
from clearance_jax.design.program import Program

# A variable is at a bound within this share of it, as a design that is moved inside its limits moves all variables.
AT_BOUND = 1e-6
# A limit is active within this share of its bound.
ACTIVE = 1e-4


def optimality(program: Program, at: Evaluation, within: float = ACTIVE) -> tuple[float, np.ndarray]:
    """The residual of the conditions over the norm of the objective's gradient, and the multipliers (m,) of the limits
    over the objective. Limits `within` this share of their bounds are active.
    """
    assert at.gradient is not None
    assert at.jacobian is not None
    size = max(abs(at.objective), 1e-300)
    gradient, jacobian = at.gradient * at.x / size, at.jacobian * at.x
    active = np.flatnonzero(at.limits > -within)
    walls = [(i, -1.0) for i in np.flatnonzero(at.x <= program.lower * (1 + AT_BOUND))]
    walls += [(i, 1.0) for i in np.flatnonzero(at.x >= program.upper * (1 - AT_BOUND))]
    columns = [*jacobian[active], *(sign * np.eye(len(at.x))[i] for i, sign in walls)]
    multipliers = np.zeros(len(at.limits))
    if not columns:
        return float(np.linalg.norm(gradient)), multipliers
    prices, left = scipy.optimize.nnls(np.stack(columns, 1), -gradient)
    multipliers[active] = prices[: len(active)]
    return float(left / max(np.linalg.norm(gradient), 1e-300)), multipliers
