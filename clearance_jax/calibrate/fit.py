"""The fit: least squares over the numbers that are looked for, from one point to the minimum it leads to."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from clearance_jax.calibrate.losses import LOSSES, Loss
from clearance_jax.calibrate.measurement import Measurement
from clearance_jax.calibrate.options import FitOptions
from clearance_jax.calibrate.readings import FitPoint, Instruments

# A trial step that brings less than this part of the decrease that the derivatives promise is a doubtful one.
DOUBTFUL = 0.25
# Of a step whose promise is a smaller part of the cost nothing is said.
WORTH = 1e-6
# How a search ends that has not converged.
INTERRUPTED, SPENT = "it was interrupted", "it had as many trial points as it may"


class Variables(NamedTuple):
    """The numbers that are looked for: `names`, where each starts and its bounds, all (parameters,); `units`."""

    names: tuple[str, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    units: dict[str, str]

    @property
    def scale(self) -> np.ndarray:
        """A size of each number for the search: its own at the start, or else its bounds' distance."""
        width = self.upper - self.lower
        return np.where(self.start != 0, np.abs(self.start), np.where(np.isfinite(width), width, 1.0))

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """What an interval of each number is compared with: half of its bounds' distance, and for a number that its
        bounds keep away from zero also its own value `x`.
        """
        half, magnitude = (self.upper - self.lower) / 2, np.where(x != 0, np.abs(x), 1.0)
        one_sign = (self.lower > 0) | (self.upper < 0)
        return np.where(one_sign, np.minimum(half, magnitude), np.where(np.isfinite(half), half, magnitude))


class FitTask(NamedTuple):
    """What is fitted: the `instruments` read what the `variables` would show of what was measured."""

    instruments: Instruments
    variables: Variables
    measurement: Measurement
    options: FitOptions

    @property
    def loss(self) -> Loss:
        """What a residual costs."""
        return LOSSES[self.options.loss]

    @property
    def given(self) -> np.ndarray:
        """Of which series the deviation is given, shape (series,)."""
        return np.array([series.deviation is not None for series in self.measurement.series])

    def floor(self, values: np.ndarray) -> float:
        """Below which differences of such readings are the solves' own errors."""
        return self.instruments.accuracy * (float(np.max(np.abs(values))) or 1.0)

    def until(self, count: int) -> "FitTask":
        """The same of the first `count` measured instants, by motions that end there."""
        if count == len(self.measurement.times):
            return self
        return self._replace(instruments=self.instruments.until(count), measurement=self.measurement.until(count))

    def weigh(self, point: FitPoint, deviations: np.ndarray) -> "Weighted":
        """The residuals of what is known, model less measurement, over the series' deviations."""
        known = self.measurement.known
        off = (point.values - self.measurement.values) / deviations
        return Weighted(off[known], (point.slopes / deviations[:, None])[known])

    def cost(self, point: FitPoint, deviations: np.ndarray) -> float:
        """What the fit minimises."""
        return self.loss.cost(self.weigh(point, deviations).residuals)


class Weighted(NamedTuple):
    """Residuals over their deviations, shape (known,), and their derivatives by the numbers (known, parameters)."""

    residuals: np.ndarray
    jacobian: np.ndarray


class FitResult(NamedTuple):
    """Where a start has led: the `point`, its `cost`, the `deviations` of the series (series,) by which residuals are
    weighed, whether it has converged, and in words how it ended if it has not; how many trial steps it made, and how
    many of them brought much less than the derivatives had promised.
    """

    point: FitPoint
    cost: float
    deviations: np.ndarray
    converged: bool
    ending: str
    steps: int = 0
    doubtful: int = 0

    def after(self, earlier: "FitResult | None") -> "FitResult":
        """The same with the steps of an earlier part of its search."""
        if earlier is None:
            return self
        return self._replace(steps=self.steps + earlier.steps, doubtful=self.doubtful + earlier.doubtful)


def descend(task: FitTask, first: FitPoint, deviations: np.ndarray, least: float = 1e-8) -> FitResult:
    """The minimum to which a start leads, by a trust region that is reflected at the bounds (Branch, Coleman and Li
    1999, doi 10.1137/S1064827595289108). It ends where a step brings less than the part `least` of the cost.
    """
    variables, loss, trials = task.variables, task.loss, [first]
    scale = variables.scale

    def residuals(u):
        point = task.instruments(u * scale)
        trials.append(point)
        return task.weigh(point, deviations).residuals

    def jacobian(u):
        return task.weigh(task.instruments(u * scale), deviations).jacobian * scale

    # A motion that does not reach its end has no finite residuals, and counts as a step that was too long.
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
    """Of each trial step whether it brought much less than the derivatives had promised."""
    base = trials[0]
    for trial in trials[1:]:
        here, now = task.weigh(base, deviations), task.cost(base, deviations)
        expected = now - task.loss.cost(here.residuals + here.jacobian @ (trial.x - base.x))
        got = now - task.cost(trial, deviations) if trial.reached else -np.inf
        # The last steps promise nothing that could be told from the solves' own errors.
        if expected > WORTH * now:
            yield bool(got < DOUBTFUL * expected)
        if got > 0:
            base = trial
