"""What methods ask of a program: values and slopes in logarithms, feasible neighbours, conditions of optimality.

In logarithms costs and errors are nearly linear, as they are nearly powers of clearances. A design that cannot be
simulated gets large finite numbers there, so that methods go on.
"""

import numpy as np
import scipy.optimize

from clearance_jax.design.search.program import Evaluation, Program

# The steepest slope, in logarithms: the limit changes by its own size if a variable changes by 1 %.
STEEPEST = 100.0
# The same for a lower peak, which can use the slopes of the highest one instead.
LOWER_STEEPEST = 5.0
# Limits below this share of their bounds do not decide.
NEAR = 0.5


class UselessSlopes(Exception):
    """Raised if the slopes of a point do not predict its neighbours; the message says why."""


def followed(program: Program, point: Evaluation) -> Evaluation:
    """A point with the slopes that a search can follow. A lower peak of a motion with useless slopes takes those of the
    highest one, as it never decides before that. A limit far below its bound takes slopes of zero. **Raises**
    `UselessSlopes` if a limit that may decide has useless slopes.
    """
    if point.jacobian is None or not np.all(np.isfinite(point.limits)):
        return point
    with np.errstate(invalid="ignore"):
        steep = np.abs(np.nan_to_num(point.jacobian * point.x, nan=np.inf)).max(axis=1) / (1 + np.abs(point.limits))
    leads = program.leaders == np.arange(len(steep))
    useless = steep > np.where(leads, STEEPEST, LOWER_STEEPEST)
    if not np.any(useless):
        return point
    decides = useless & leads & (point.limits > NEAR - 1)
    if np.any(decides):
        k = int(np.argmax(np.where(decides, steep, 0.0)))
        raise UselessSlopes(
            f"slopes are useless here: by its slope, {program.limit_names[k]} would change {0.01 * steep[k]:.1g} times "
            "its own size where a variable changes by 1 %. Neighbouring motions move apart (chaos, ringing)"
        )
    # Slopes of zero for limits far below their bounds; then the rows of the highest peaks for lower ones.
    jacobian = np.where((useless & leads)[:, None], 0.0, point.jacobian)
    return point._replace(jacobian=np.where((useless & ~leads)[:, None], jacobian[program.leaders], jacobian))


# The share of its bound below which a limit counts as this share.
FLOOR = 1e-3
# Points that differ by less in logarithms are the same; a search stands still after so many repeats.
ROUND_OFF, PATIENCE = 1e-11, 2


class StandsStill(Exception):
    """Raised if a search asks for the same point again and again."""


class ScaledProgram:
    """A `program` in logarithms of its variables, of value over bound of its limits, and of its objective (if that is
    not positive, it is divided by its size at the `start` instead).

    **Arguments:** `gradient`: whether the start is evaluated with gradients.
    """

    def __init__(self, program: Program, start: np.ndarray, gradient: bool = True):
        self.program = program
        self.bounds = np.log(program.lower), np.log(program.upper)
        self.start = np.clip(np.log(start), *self.bounds)
        first = program.at(np.exp(self.start), gradient)
        self.positive = first.objective > 0
        self.size = max(abs(first.objective), 1e-300)
        self._last, self._still = self.start, 0

    def value(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Objective and limits. **Raises** `StandsStill`."""
        self._move(z)
        return self.values_of(self.program.at(np.exp(z)))

    def slopes(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and limits, and their derivatives. **Raises** `StandsStill`, `UselessSlopes`."""
        self._move(z)
        return self.slopes_of(followed(self.program, self.program.at(np.exp(z), True)))

    def values_of(self, point: Evaluation) -> tuple[float, np.ndarray]:
        """Objective and limits of an evaluated point."""
        return self._objective(point), self._limits(point)

    def _move(self, z: np.ndarray) -> None:
        """Count repeats of a point. **Raises** `StandsStill` at the third one that differs by round-off only."""
        if np.array_equal(z, self._last):
            return
        self._still = self._still + 1 if np.allclose(z, self._last, rtol=0.0, atol=ROUND_OFF) else 0
        self._last = np.array(z)
        if self._still >= PATIENCE:
            raise StandsStill

    def slopes_of(self, point: Evaluation) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        """Objective and limits of an evaluated point, and their derivatives."""
        assert point.gradient is not None
        assert point.jacobian is not None
        over = max(point.objective, 1e-12 * self.size) if self.positive else self.size
        ratio = np.maximum(1 + point.limits, FLOOR)
        gradient, jacobian = point.gradient * point.x / over, point.jacobian * point.x / ratio[:, None]
        return self._objective(point), self._limits(point), np.nan_to_num(gradient), np.nan_to_num(jacobian)

    def _objective(self, point: Evaluation) -> float:
        share = point.objective / self.size
        return float(np.nan_to_num(np.log(max(share, 1e-12)) if self.positive else share, nan=1e2))

    def _limits(self, point: Evaluation) -> np.ndarray:
        return np.nan_to_num(np.log(np.maximum(1 + point.limits, FLOOR)), nan=1e1) + self.program.inside


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


# A limit is active, and a variable at its bound, within these shares of the bound.
ACTIVE, AT_BOUND = 1e-4, 1e-6


def optimality(
    program: Program, at: Evaluation, within: float = ACTIVE, at_bound: float = AT_BOUND
) -> tuple[float, np.ndarray]:
    """The residual of the conditions over the norm of the objective's gradient, and the multipliers (m,) of the limits
    over the objective. Limits `within` a share of their bounds are active, and variables within `at_bound` of theirs.
    """
    assert at.gradient is not None
    assert at.jacobian is not None
    size = max(abs(at.objective), 1e-300)
    gradient, jacobian = at.gradient * at.x / size, at.jacobian * at.x
    active = np.flatnonzero(at.limits > -within)
    walls = [(i, -1.0) for i in np.flatnonzero(at.x <= program.lower * (1 + at_bound))]
    walls += [(i, 1.0) for i in np.flatnonzero(at.x >= program.upper * (1 - at_bound))]
    columns = [*jacobian[active], *(sign * np.eye(len(at.x))[i] for i, sign in walls)]
    multipliers = np.zeros(len(at.limits))
    if not columns:
        return float(np.linalg.norm(gradient)), multipliers
    prices, left = scipy.optimize.nnls(np.stack(columns, 1), -gradient)
    multipliers[active] = prices[: len(active)]
    return float(left / max(np.linalg.norm(gradient), 1e-300)), multipliers
