"""The fit: least squares over the unknown numbers, from a start to a minimum, and whether residuals look like noise.

Residuals look like noise if their size is that of the noise, and if they do not depend on each other in time.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2, norm

from clearance_jax.calibrate.measurement import FitPoint, Instruments, Measurement
from clearance_jax.calibrate.options import LOSSES, FitOptions, Loss

# A trial step is doubtful if it gains less than this part of the decrease that the derivatives predict.
DOUBTFUL = 0.25
# Steps with a smaller predicted decrease, over the cost, are not judged.
WORTH = 1e-6
# Why a search has not converged.
INTERRUPTED, SPENT = "it was interrupted", "it had as many trial points as it may"


class Variables(NamedTuple):
    """The numbers that are fitted: `names`, `start` values and bounds, all (parameters,); `units` by name.

    What is known of them beforehand: `expected` values, each with its standard deviation `spread`, infinite where
    nothing is. `arrays`: names and shapes of the parameters, if some are arrays, of which these are the entries.
    """

    names: tuple[str, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    units: dict[str, str]
    expected: Any = 0.0
    spread: Any = np.inf
    arrays: tuple[tuple[str, tuple[int, ...]], ...] = ()

    def by_name(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """The parameters as numbers and arrays."""
        parts = np.split(x, np.cumsum(self._counts)[:-1])
        return {name: part.reshape(shape) for (name, shape), part in zip(self._wholes, parts, strict=True)}

    def alone(self) -> np.ndarray:
        """The places of the numbers that are no entries of an array."""
        return np.flatnonzero(np.repeat([shape == () for _, shape in self._wholes], self._counts))

    @property
    def _wholes(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        return self.arrays or tuple((name, ()) for name in self.names)

    @property
    def _counts(self) -> list[int]:
        return [int(np.prod(shape)) for _, shape in self._wholes]

    @property
    def has_prior(self) -> bool:
        """Whether anything is known of any number beforehand."""
        return bool(np.any(np.isfinite(self.spread)))

    def prior(self, x: np.ndarray) -> "Weighted":
        """How far numbers are from what is expected, in units of the spreads, as residuals."""
        spread = np.broadcast_to(self.spread, x.shape)
        known = np.isfinite(spread)
        return Weighted(((x - self.expected) / spread)[known], np.diag(1 / spread)[known])

    @property
    def scale(self) -> np.ndarray:
        """The scale of each number for the search: its spread, start value, or the distance of its bounds."""
        width = self.upper - self.lower
        size = np.where(self.start != 0, np.abs(self.start), np.where(np.isfinite(width), width, 1.0))
        return np.where(np.isfinite(self.spread), self.spread, size)

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """The size of each number, with which its interval is compared: half of the distance of its bounds; its value
        `x` if that is smaller and the bounds exclude zero; two spreads of what is known beforehand.
        """
        half, magnitude = (self.upper - self.lower) / 2, np.where(x != 0, np.abs(x), 1.0)
        one_sign = (self.lower > 0) | (self.upper < 0)
        size = np.where(one_sign, np.minimum(half, magnitude), np.where(np.isfinite(half), half, magnitude))
        return np.where(np.isfinite(self.spread), np.minimum(half, 2 * self.spread), size)


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
        """The residuals (model minus measurement) of the known values, over their deviations, and those of priors."""
        known, prior = self.measurement.known, self.variables.prior(point.x)
        off = (point.values - self.measurement.values) / deviations
        slopes = (point.slopes / deviations[:, None])[known]
        return Weighted(np.append(off[known], prior.residuals), np.concatenate([slopes, prior.jacobian]))

    def spent(self, point: FitPoint, deviations: np.ndarray) -> float:
        """How many numbers the data determine: all, less the shares that are known beforehand (their leverage)."""
        if not self.variables.has_prior:
            return float(len(self.variables.names))
        of_each = np.sum(np.linalg.qr(self.weigh(point, deviations).jacobian)[0] ** 2, axis=1)
        return float(np.sum(of_each[: np.sum(self.measurement.known)]))

    def cost(self, point: FitPoint, deviations: np.ndarray) -> float:
        """The cost of a point, which the fit minimises."""
        return self.loss.cost(self.weigh(point, deviations).residuals)


class Weighted(NamedTuple):
    """Residuals over their deviations, shape (known,), and their derivatives by the numbers (known, parameters)."""

    residuals: np.ndarray
    jacobian: np.ndarray


class FitResult(NamedTuple):
    """The result of a search from one start: the `point`, its `cost`, the `deviations` (series,) that residuals are
    divided by, whether it `converged` and the `ending` in words if not; how many `steps` were tried, and how many were
    `doubtful`, as they gained much less than the derivatives had predicted.
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

    bounds = variables.lower / scale, variables.upper / scale
    how: Any = {"loss": loss.rho, "f_scale": loss.scale, "max_nfev": task.options.most, "ftol": least}
    how |= {"bounds": bounds, "x_scale": "jac"}
    # A motion that does not reach its end has NaN residuals, which count as a step that was too long.
    try:
        try:
            solution = least_squares(residuals, first.x / scale, jacobian, **how)
        except np.linalg.LinAlgError:
            # LAPACK fails for some Jacobians of many numbers of which data say nothing.
            solution = least_squares(residuals, first.x / scale, jacobian, tr_solver="lsmr", **how)
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


# Residuals are unlike noise if noise would give such ones with less than this probability.
IMPROBABLE = 1e-3
# Least number of residuals for a test of correlation.
FEWEST = 10
# Least number of readings for an estimate of their noise from their roughness. It uses this quantile of their third
# differences, which outliers and impacts hardly move; its relative scatter is SCATTER over the root of their number.
MANY, QUANTILE, SCATTER = 50, 0.86, 1.35


class ResidualCheck(NamedTuple):
    """The tests of the residuals of one series.

    - `exact`: they are no larger than the errors of the solves, so that the other tests mean nothing.
    - `size`: their mean square over that of noise with the given `deviation`, or with that of the readings' roughness
      (NaN: not known); noise has a size between `low` and `high`.
    - `follows`: the correlation of `count` residuals from one instant to the next; `correlated`: more than noise.
    - `memory`: the number of residuals that are worth one independent residual.
    """

    name: str
    exact: bool
    given: bool
    deviation: float
    size: float
    low: float
    high: float
    follows: float
    count: int
    correlated: bool
    memory: float

    @property
    def like_noise(self) -> bool:
        """Whether the residuals look like noise."""
        return self.exact or not (self.correlated or self.size > self.high)


def residuals_of(task: FitTask, fit: FitResult) -> list[ResidualCheck]:
    """The tests of the residuals of each series; outliers are weighted by the loss."""
    off = (fit.point.values - task.measurement.values) / fit.deviations
    return [_check(task, fit, k, off[there, k]) for k, there in enumerate(task.measurement.known.T)]


def _check(task: FitTask, fit: FitResult, k: int, residuals: np.ndarray) -> ResidualCheck:
    series, psi = task.measurement.series[k], task.loss.influence(residuals)[0]
    values, given = series.values[np.isfinite(series.values)], series.deviation is not None
    exact = bool(np.sqrt(np.mean((residuals * fit.deviations[k]) ** 2)) <= task.floor(values))
    share = task.spent(fit.point, fit.deviations) / np.sum(task.measurement.known)
    square, freedom_each = task.loss.normal_squares()
    freedom = freedom_each * len(psi) * (1 - share)
    low, high = chi2.ppf([IMPROBABLE / 2, 1 - IMPROBABLE / 2], freedom) / freedom
    noise = series.deviation or _roughness(task.measurement.times, series.values)
    # Estimated deviations are compared with the roughness, which is less exact and has no lower limit.
    if not given:
        low, high = 0.0, (1 + norm.ppf(1 - IMPROBABLE) * SCATTER / np.sqrt(len(psi))) ** 2
    size = np.mean(psi**2) / (square * (1 - share)) * (fit.deviations[k] / noise) ** 2 if noise > 0 else np.nan
    follows = _correlation(psi, 1)
    correlated = len(psi) >= FEWEST and follows * np.sqrt(len(psi)) > norm.ppf(1 - IMPROBABLE)
    memory = _memory(psi) if correlated else 1.0
    return ResidualCheck(series.name, exact, given, noise, size, low, high, follows, len(psi), bool(correlated), memory)


def _correlation(psi: np.ndarray, lag: int) -> float:
    """The correlation at a lag. For N independent residuals its standard deviation is 1 / sqrt(N) (Anderson 1942, doi
    10.1214/aoms/1177731638).
    """
    return float(np.sum(psi[lag:] * psi[:-lag]) / max(np.sum(psi**2), np.finfo(float).tiny))


def _memory(psi: np.ndarray) -> float:
    """1 + 2 sum of the correlations over lags, up to where the sum of a pair of lags is not positive (Geyer 1992, doi
    10.1214/ss/1177011137).
    """
    total = -1.0
    for lag in range(0, len(psi) - 1, 2):
        pair = (_correlation(psi, lag) if lag else 1.0) + _correlation(psi, lag + 1)
        if pair <= 0:
            break
        total += 2 * pair
    return float(np.clip(total, 1.0, len(psi)))


def _roughness(times: np.ndarray, values: np.ndarray) -> float:
    """The deviation of the noise of readings, from their third differences; NaN if few or not equidistant."""
    steps = np.diff(times)
    if len(times) < MANY or np.max(steps) > 1.01 * np.min(steps):
        return np.nan
    rough = np.abs(np.diff(values, 3))
    rough = rough[np.isfinite(rough)]
    # Third differences of independent noise have 20 times its variance.
    size = norm.ppf(0.5 + QUANTILE / 2) * np.sqrt(20)
    return float(np.quantile(rough, QUANTILE) / size) if len(rough) >= MANY else np.nan
