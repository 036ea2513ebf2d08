"""The fit: least squares over the unknown numbers, from a start to a minimum."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from clearance_jax.calibrate.losses import LOSSES, Loss
from clearance_jax.calibrate.measurement import Measurement
from clearance_jax.calibrate.options import FitOptions
from clearance_jax.calibrate.readings import FitPoint, Instruments

# A trial step is doubtful if it gains less than this part of the decrease that the derivatives predict.
DOUBTFUL = 0.25
# Steps with a smaller predicted decrease, over the cost, are not judged.
WORTH = 1e-6
# Why a search has not converged.
INTERRUPTED, SPENT = "it was interrupted", "it had as many trial points as it may"


class Variables(NamedTuple):
    """The numbers that are fitted: `names`, `start` values and bounds, all (parameters,); `units` by name."""

    names: tuple[str, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    units: dict[str, str]

    @property
    def scale(self) -> np.ndarray:
        """The scale of each number for the search: its start value, or the distance of its bounds if that is zero."""
        width = self.upper - self.lower
        return np.where(self.start != 0, np.abs(self.start), np.where(np.isfinite(width), width, 1.0))

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """The size of each number, with which its interval is compared: half of the distance of its bounds; its value
        `x` if that is smaller and the bounds exclude zero.
        """
        half, magnitude = (self.upper - self.lower) / 2, np.where(x != 0, np.abs(x), 1.0)
        one_sign = (self.lower > 0) | (self.upper < 0)
        return np.where(one_sign, np.minimum(half, magnitude), np.where(np.isfinite(half), half, magnitude))


class FitTask(NamedTuple):
    """A fit problem: `instruments` give the simulated readings at values of the `variables`, to be compared with the
    `measurement`.
    """

    instruments: Instruments
    variables: Variables
    measurement: Measurement
    options: FitOptions

    @property
    def loss(self) -> Loss:
        """The loss function of the residuals."""
        return LOSSES[self.options.loss]

    @property
    def given(self) -> np.ndarray:
        """Whether the deviation of each series is given, shape (series,)."""
        return np.array([series.deviation is not None for series in self.measurement.series])

    def floor(self, values: np.ndarray) -> float:
        """The size of the solves' own errors in such readings."""
        return self.instruments.accuracy * (float(np.max(np.abs(values))) or 1.0)

    def until(self, count: int) -> "FitTask":
        """The same problem with only the first `count` measured instants, by motions that end there."""
        if count == len(self.measurement.times):
            return self
        return self._replace(instruments=self.instruments.until(count), measurement=self.measurement.until(count))

    def weigh(self, point: FitPoint, deviations: np.ndarray) -> "Weighted":
        """The residuals (model minus measurement) of the known values, over the deviations of the series."""
        known = self.measurement.known
        off = (point.values - self.measurement.values) / deviations
        return Weighted(off[known], (point.slopes / deviations[:, None])[known])

    def cost(self, point: FitPoint, deviations: np.ndarray) -> float:
        """The cost of a point, which the fit minimises."""
        return self.loss.cost(self.weigh(point, deviations).residuals)


class Weighted(NamedTuple):
    """Residuals over their deviations, shape (known,), and their derivatives by the numbers (known, parameters)."""

    residuals: np.ndarray
    jacobian: np.ndarray


class FitResult(NamedTuple):
    """The result of a search from one start: the `point`, its `cost`, the `deviations` (series,) that residuals are
    divided by, whether it `converged` and the `ending` in words if not; the number of trial `steps`, and of `doubtful`
    ones, which gained much less than the derivatives had predicted.
    """

    point: FitPoint
    cost: float
    deviations: np.ndarray
    converged: bool
    ending: str
    steps: int = 0
    doubtful: int = 0

    def after(self, earlier: "FitResult | None") -> "FitResult":
        """The same with the steps of an earlier part of the search added."""
        if earlier is None:
            return self
        return self._replace(steps=self.steps + earlier.steps, doubtful=self.doubtful + earlier.doubtful)


def descend(task: FitTask, first: FitPoint, deviations: np.ndarray, least: float = 1e-8) -> FitResult:
    """Search for a minimum from a start, by a reflective trust region (Branch, Coleman and Li 1999, doi
    10.1137/S1064827595289108), until a step gains less than the part `least` of the cost.
    """
    variables, loss, trials = task.variables, task.loss, [first]
    scale = variables.scale

    def residuals(u):
        point = task.instruments(u * scale)
        trials.append(point)
        return task.weigh(point, deviations).residuals

    def jacobian(u):
        return task.weigh(task.instruments(u * scale), deviations).jacobian * scale

    # A motion that does not reach its end has NaN residuals, which count as a step that was too long.
    try:
        solution = least_squares(
            residuals,
            first.x / scale,
            jacobian,
            bounds=(variables.lower / scale, variables.upper / scale),
            x_scale="jac",
            loss=loss.rho,
            f_scale=loss.scale,
            max_nfev=task.options.most,
            ftol=least,
        )
        point, converged, ending = task.instruments(solution.x * scale), solution.status > 0, SPENT
    except KeyboardInterrupt:
        point = min((trial for trial in trials if trial.reached), key=lambda trial: task.cost(trial, deviations))
        converged, ending = False, INTERRUPTED
    doubts = list(_doubts(task, trials, deviations))
    return FitResult(point, task.cost(point, deviations), deviations, converged, ending, len(doubts), sum(doubts))


def _doubts(task: FitTask, trials: list[FitPoint], deviations: np.ndarray) -> Iterator[bool]:
    """Whether each trial step gained much less than the derivatives had predicted."""
    base = trials[0]
    for trial in trials[1:]:
        here, now = task.weigh(base, deviations), task.cost(base, deviations)
        expected = now - task.loss.cost(here.residuals + here.jacobian @ (trial.x - base.x))
        got = now - task.cost(trial, deviations) if trial.reached else -np.inf
        # The gain of the last steps is smaller than the solves' own errors.
        if expected > WORTH * now:
            yield bool(got < DOUBTFUL * expected)
        if got > 0:
            base = trial
