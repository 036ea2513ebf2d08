"""How well the data determine the fitted numbers: covariance, intervals, undetermined combinations.

With residuals r in units of their deviations, J their derivatives by n parameters and psi the derivative of the loss,
the covariance is (J^T J)^-1 sum(psi^2) / (N - n) / mean(psi')^2 (Huber 1973, doi 10.1214/aos/1176342503): for least
squares the reduced chi-square times (J^T J)^-1. If residuals are correlated in time, the covariance is multiplied by
the number of residuals that are worth one independent residual.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.stats import norm, t

from clearance_jax.calibrate.fit import FitResult, FitTask
from clearance_jax.calibrate.residuals import residuals_of

LEVEL = 0.95
# Singular values below this part of the largest one are round-off and errors of the solves.
LEAST = 1e-12
# Two numbers belong to one undetermined combination if their entry of the projector is above this.
JOINED = 0.05


class Unidentified(NamedTuple):
    """Numbers that the data do not determine, alone or apart: their `names`, and the `directions` (free, names) along
    which they can change without effect.
    """

    names: tuple[str, ...]
    directions: np.ndarray


class Confidence(NamedTuple):
    """How well n numbers are known, in the order of the parameters.

    - `covariance` (n, n), `deviations` (n,), `intervals` (n, 2) of the probability `LEVEL`, `correlation` (n, n); huge
      values where the data say nothing.
    - `axes` (n, n): axes of the confidence ellipsoid as columns, whose extent along each number is its interval, as
      changes over the `sizes` (n,) of the numbers; `lengths` (n,): half of each axis, the shortest first.
    - `factor`: half of an interval over the deviation; `inflation`: factor of the noise on the covariance; `memory`:
      the part of it from correlated residuals.
    - `bent`: names whose intervals come from the motion itself, as the derivatives do not predict it.
    - `unidentified`: what the data cannot determine.
    """

    covariance: np.ndarray
    deviations: np.ndarray
    intervals: np.ndarray
    correlation: np.ndarray
    axes: np.ndarray
    sizes: np.ndarray
    lengths: np.ndarray
    factor: float
    inflation: float
    memory: float
    unidentified: tuple[Unidentified, ...]
    bent: tuple[str, ...] = ()


def confidence(task: FitTask, fit: FitResult) -> Confidence:
    """How well the fitted numbers are known."""
    weighted, variables, x = task.weigh(fit.point, fit.deviations), task.variables, fit.point.x
    count, n = weighted.jacobian.shape
    size = variables.sizes(x)
    memory = float(np.sqrt(np.mean([check.memory**2 for check in residuals_of(task, fit)])))
    inflation, factor = _noise(task, fit, count - n, memory)
    _, singular, rows = np.linalg.svd(weighted.jacobian * size, full_matrices=False)
    singular = np.maximum(singular, LEAST * max(singular[0], np.finfo(float).tiny))
    lengths = factor * np.sqrt(inflation) / singular
    covariance = (rows.T * (inflation / singular**2)) @ rows * np.outer(size, size)
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    half = factor * deviations
    intervals = np.clip(np.stack([x - half, x + half], axis=1), variables.lower[:, None], variables.upper[:, None])
    unknown = tuple(_unidentified(variables.names, rows, lengths, size))
    return Confidence(
        covariance, deviations, intervals, correlation, rows.T, size, lengths, factor, inflation, memory, unknown
    )


def _noise(task: FitTask, fit: FitResult, freedom: int, memory: float) -> tuple[float, float]:
    """The factor of the noise on the covariance, and half of an interval over the deviation.

    Given deviations are used, unless the residuals are larger than these allow.
    """
    given = bool(np.all(task.given))
    residuals = task.weigh(fit.point, fit.deviations).residuals
    psi, slope = task.loss.influence(residuals)
    shown = np.sum(psi**2) / max(freedom, 1) / max(np.mean(slope), np.finfo(float).eps) ** 2
    if given:
        # Robust losses have more variance than least squares, also for normal noise.
        return max(1.0, float(shown)) * memory, float(norm.ppf(0.5 + LEVEL / 2))
    return float(shown) * memory, float(t.ppf(0.5 + LEVEL / 2, max(freedom / memory, 1.0)))


def _unidentified(
    names: tuple[str, ...], rows: np.ndarray, lengths: np.ndarray, size: np.ndarray
) -> Iterator[Unidentified]:
    """Combinations whose interval is larger than the sizes of the numbers (`Variables.sizes`)."""
    free = rows[[k for k, row in enumerate(rows) if lengths[k] * np.max(np.abs(row)) > 1]]
    if not free.size:
        return
    # Directions of equal length are determined only up to a rotation, but their projector is unique.
    projector = free.T @ free
    _, member = connected_components(np.abs(projector) > JOINED, directed=False)
    for label in np.unique(member):
        group = np.flatnonzero(member == label)
        values, vectors = np.linalg.eigh(projector[np.ix_(group, group)])
        if np.any(values > 0.5):
            yield Unidentified(tuple(names[i] for i in group), vectors[:, values > 0.5].T * size[group])
