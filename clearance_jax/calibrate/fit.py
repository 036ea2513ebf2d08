"""The fit: least squares over the numbers that are looked for, from one start or several."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc

from clearance_jax.calibrate.losses import LOSSES, Loss
from clearance_jax.calibrate.measurement import Measurement, Series
from clearance_jax.calibrate.options import FitOptions
from clearance_jax.calibrate.readings import Instruments, Point
from clearance_jax.errors import ClearanceError

# From so many times between its bounds on a positive number is scattered by its logarithm.
WIDE = 10.0
# Refits by deviations that residuals have shown, at most, and how much these may change in the last one.
REFITS, SETTLED = 8, 0.01
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
        half, own = (self.upper - self.lower) / 2, np.where(x != 0, np.abs(x), 1.0)
        one_sign = (self.lower > 0) | (self.upper < 0)
        return np.where(one_sign, np.minimum(half, own), np.where(np.isfinite(half), half, own))


class Task(NamedTuple):
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
        return np.array([one.deviation is not None for one in self.measurement.series])

    def floor(self, values: np.ndarray) -> float:
        """Below which differences of such readings are the solves' own errors."""
        return self.instruments.accuracy * (float(np.max(np.abs(values))) or 1.0)

    def weigh(self, point: Point, deviations: np.ndarray) -> "Weighted":
        """The residuals of what is known, model less measurement, over the series' deviations."""
        known = self.measurement.known
        off = (point.values - self.measurement.values) / deviations
        return Weighted(off[known], (point.slopes / deviations[:, None])[known])

    def cost(self, point: Point, deviations: np.ndarray) -> float:
        """What the fit minimises."""
        return self.loss.cost(self.weigh(point, deviations).residuals)


class Weighted(NamedTuple):
    """Residuals over their deviations, shape (known,), and their derivatives by the numbers (known, parameters)."""

    residuals: np.ndarray
    jacobian: np.ndarray


class Fit(NamedTuple):
    """Where a start has led: the `point`, its `cost`, the `deviations` of the series (series,) by which residuals are
    weighed, whether it has converged, and in words how it ended if it has not; how many trial steps it made, and how
    many of them brought much less than the derivatives had promised.
    """

    point: Point
    cost: float
    deviations: np.ndarray
    converged: bool
    ending: str
    steps: int = 0
    doubtful: int = 0


def search(task: Task) -> list[Fit]:
    """Where every start led, the best first, its deviations estimated where none are given.

    **Raises:** `ClearanceError` where no motion of a start reaches its end.
    """
    spread = np.array([_first_deviation(task, one) for one in task.measurement.series])
    fits, why = [], ""
    try:
        for start in starts_of(task.variables, task.options):
            first = task.instruments(start)
            if first.reached:
                fits.append(_descend(task, first, spread))
            why = why or first.why
            if fits and fits[-1].ending == INTERRUPTED:
                break
    except KeyboardInterrupt:
        if not fits:
            raise
        fits = [fit._replace(converged=False, ending=INTERRUPTED) for fit in fits]
    if not fits:
        variables = task.variables
        at = ", ".join(f"{name} = {value:.4g}" for name, value in zip(variables.names, variables.start, strict=True))
        raise ClearanceError(
            f"No motion from which the search could start reaches its end ({at}): "
            f"{why or 'a reading or a derivative is not finite'}. Change the mechanism's numbers, or the bounds."
        )
    fits.sort(key=lambda fit: fit.cost)
    return [_refine(task, fits[0]), *fits[1:]]


def _first_deviation(task: Task, series: Series) -> float:
    """By what residuals are weighed at first: the noise, or how far the signal moves, or how large it is."""
    values = series.values[np.isfinite(series.values)]
    spread = float(np.std(values))
    return series.deviation or (spread if spread > task.floor(values) else float(np.max(np.abs(values))) or 1.0)


def starts_of(variables: Variables, options: FitOptions) -> Iterator[np.ndarray]:
    """The mechanism's own numbers, and points scattered over the bounds."""
    yield np.clip(variables.start, variables.lower, variables.upper)
    if options.starts == 1:
        return
    lower, upper = variables.lower, variables.upper
    by_log = (lower > 0) & (upper > WIDE * lower)
    low, high = np.where(by_log, np.log(lower, where=by_log, out=lower.copy()), lower), upper.copy()
    high[by_log] = np.log(upper[by_log])
    for draw in qmc.LatinHypercube(len(lower), rng=np.random.default_rng(options.seed)).random(options.starts - 1):
        between = low + draw * (high - low)
        yield np.where(by_log, np.exp(np.where(by_log, between, 0.0)), between)


def _descend(task: Task, first: Point, deviations: np.ndarray) -> Fit:
    """The minimum to which a start leads, by a trust region that is reflected at the bounds (Branch, Coleman and Li
    1999, doi 10.1137/S1064827595289108).
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
        found = least_squares(
            residuals,
            first.x / scale,
            jacobian,
            bounds=(variables.lower / scale, variables.upper / scale),
            x_scale="jac",
            loss=loss.rho,
            f_scale=loss.scale,
            max_nfev=task.options.most,
        )
        point, converged, ending = task.instruments(found.x * scale), found.status > 0, SPENT
    except KeyboardInterrupt:
        point = min((one for one in trials if one.reached), key=lambda one: task.cost(one, deviations))
        converged, ending = False, INTERRUPTED
    doubts = list(_doubts(task, trials, deviations))
    return Fit(point, task.cost(point, deviations), deviations, converged, ending, len(doubts), sum(doubts))


def _doubts(task: Task, trials: list[Point], deviations: np.ndarray) -> Iterator[bool]:
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


def _refine(task: Task, fit: Fit) -> Fit:
    """The fit with deviations that its own residuals show, of the series for which none are given."""
    given, steps, doubtful = task.given, fit.steps, fit.doubtful
    # A common factor moves no minimum of a sum of squares.
    alone = len(given) == 1 and task.options.loss == "linear"
    for _ in range(0 if np.all(given) else REFITS):
        shown = np.where(given, fit.deviations, _shown_deviations(task, fit.point))
        settled = np.all(np.abs(shown - fit.deviations) <= SETTLED * fit.deviations)
        fit = fit._replace(deviations=shown, cost=task.cost(fit.point, shown))
        if settled or alone or fit.ending == INTERRUPTED:
            break
        fit = _descend(task, fit.point, shown)
        steps, doubtful = steps + fit.steps, doubtful + fit.doubtful
    return fit._replace(steps=steps, doubtful=doubtful)


def _shown_deviations(task: Task, point: Point) -> np.ndarray:
    """The deviation of each series that its residuals show, shape (series,): their root mean square, or with a robust
    loss their median, over the share of the numbers that the fit has not used up.
    """
    measurement, known = task.measurement, task.measurement.known
    left, found = 1 - len(task.variables.names) / np.sum(known), []
    for off, values, there in zip((point.values - measurement.values).T, measurement.values.T, known.T, strict=True):
        size = np.abs(off[there])
        # Of normal noise the median is 0.6745 deviations.
        size = np.sqrt(np.mean(size**2)) if task.options.loss == "linear" else np.median(size) / 0.6745
        found.append(max(size / np.sqrt(left), task.floor(values[there])))
    return np.array(found)
