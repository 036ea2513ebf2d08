"""Tests of whether residuals look like noise: of its size, and independent in time."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm

from clearance_jax.calibrate.fit import FitResult, FitTask

# Residuals are unlike noise if noise would give such ones with less than this probability.
IMPROBABLE = 1e-3
# Least number of residuals for a test of correlation.
FEWEST = 10
# Least number of readings for an estimate of their noise from their roughness. It uses this quantile of their third
# differences, which outliers and impacts hardly move; its relative scatter is SCATTER over the root of their number.
MANY, QUANTILE, SCATTER = 50, 0.86, 1.35


class ResidualCheck(NamedTuple):
    """The tests of the residuals of one series.

    - `exact`: they are the solves' own errors, so that the other tests mean nothing.
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
    return [_shown(task, fit, k, off[there, k]) for k, there in enumerate(task.measurement.known.T)]


def _shown(task: FitTask, fit: FitResult, k: int, residuals: np.ndarray) -> ResidualCheck:
    series, psi = task.measurement.series[k], task.loss.influence(residuals)[0]
    values, given = series.values[np.isfinite(series.values)], series.deviation is not None
    exact = bool(np.sqrt(np.mean((residuals * fit.deviations[k]) ** 2)) <= task.floor(values))
    share = len(task.variables.names) / np.sum(task.measurement.known)
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
        pair = (1.0 if lag == 0 else _correlation(psi, lag)) + _correlation(psi, lag + 1)
        if pair <= 0:
            break
        total += 2 * pair
    return float(np.clip(total, 1.0, len(psi)))


def _roughness(times: np.ndarray, values: np.ndarray) -> float:
    """The standard deviation of the noise of readings, from their third differences; NaN if they are few or not
    equidistant. It is too large if readings are too sparse for the motion.
    """
    steps = np.diff(times)
    if len(times) < MANY or np.max(steps) > 1.01 * np.min(steps):
        return np.nan
    rough = np.abs(np.diff(values, 3))
    rough = rough[np.isfinite(rough)]
    # Third differences of independent noise have 20 times its variance.
    size = norm.ppf(0.5 + QUANTILE / 2) * np.sqrt(20)
    return float(np.quantile(rough, QUANTILE) / size) if len(rough) >= MANY else np.nan
