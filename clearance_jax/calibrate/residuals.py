"""Whether residuals look like noise: as large as it is, and independent from one reading to the next."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm

from clearance_jax.calibrate.fit import FitResult, FitTask

# How improbable residuals must be, were they noise, before that is said.
IMPROBABLE = 1e-3
# Residuals of which it is asked whether they follow each other, at least.
FEWEST = 10
# Readings whose own roughness is asked how large the noise is, at least. It is taken from this quantile of their third
# differences, which outliers and impacts hardly move, and scatters by this over the root of their number.
MANY, QUANTILE, SCATTER = 50, 0.86, 1.35


class ResidualCheck(NamedTuple):
    """What the residuals of one series show.

    - `exact`: they are the solves' own errors; the rest is then of no use.
    - `size`: their mean square over that of noise of the `deviation` that is given, or else of what the readings' own
      roughness shows (NaN where that is not known); between `low` and `high` it is like noise.
    - `follows`: the correlation from one instant to the next, of `count`; `correlated`: more than noise is.
    - `memory`: the mean number of residuals that tell what one independent residual would.
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
        """Whether nothing speaks against it."""
        return self.exact or not (self.correlated or self.size > self.high)


def residuals_of(task: FitTask, fit: FitResult) -> list[ResidualCheck]:
    """What the residuals of each series show, outliers as the loss counts them."""
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
    # Deviations that are estimated are compared with the roughness, which is known less well, and never too small.
    if not given:
        low, high = 0.0, (1 + norm.ppf(1 - IMPROBABLE) * SCATTER / np.sqrt(len(psi))) ** 2
    size = np.mean(psi**2) / (square * (1 - share)) * (fit.deviations[k] / noise) ** 2 if noise > 0 else np.nan
    follows = _correlation(psi, 1)
    correlated = len(psi) >= FEWEST and follows * np.sqrt(len(psi)) > norm.ppf(1 - IMPROBABLE)
    memory = _memory(psi) if correlated else 1.0
    return ResidualCheck(series.name, exact, given, noise, size, low, high, follows, len(psi), bool(correlated), memory)


def _correlation(psi: np.ndarray, lag: int) -> float:
    """Of N independent ones it deviates by 1 / sqrt(N) (Anderson 1942, doi 10.1214/aoms/1177731638)."""
    return float(np.sum(psi[lag:] * psi[:-lag]) / max(np.sum(psi**2), np.finfo(float).tiny))


def _memory(psi: np.ndarray) -> float:
    """1 + 2 sum of the correlations, as long as those of two lags together are positive (Geyer 1992, doi
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
    """The noise that readings show by themselves, by their third differences; NaN where they are few or
    not at equal intervals. It is too large where they do not show the motion between them.
    """
    steps = np.diff(times)
    if len(times) < MANY or np.max(steps) > 1.01 * np.min(steps):
        return np.nan
    rough = np.abs(np.diff(values, 3))
    rough = rough[np.isfinite(rough)]
    # Third differences of independent noise have 20 times its variance.
    size = norm.ppf(0.5 + QUANTILE / 2) * np.sqrt(20)
    return float(np.quantile(rough, QUANTILE) / size) if len(rough) >= MANY else np.nan
