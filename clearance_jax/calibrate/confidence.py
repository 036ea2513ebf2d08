"""How well the data determine the numbers: covariance, intervals, and what they cannot tell apart.

With residuals r in units of their deviations, J their derivatives by n parameters and psi the derivative of the loss,
the covariance is (J^T J)^-1 sum(psi^2) / (N - n) / mean(psi')^2 (Huber 1973, doi 10.1214/aos/1176342503): for least
squares the reduced chi-square times (J^T J)^-1. Residuals that follow each other count as fewer: the covariance is
larger by how many of them tell what one independent residual would.
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
# Two numbers belong to one undetermined combination from this entry of its projector on, and to none below it.
JOINED = 0.05


class Unidentified(NamedTuple):
    """Numbers of which the data determine fewer combinations than there are: `names`; the changes of these,
    `directions` of shape (free, names), along which nothing can be told.
    """

    names: tuple[str, ...]
    directions: np.ndarray


class Confidence(NamedTuple):
    """How well n numbers are known, in the order of the parameters.

    - `covariance` (n, n), `deviations` (n,), `intervals` (n, 2) that hold the true value with the probability `LEVEL`,
      `correlation` (n, n); huge where the data say nothing.
    - `axes` (n, n): of the ellipsoid whose extent along each number is its interval, each axis as a column, as changes
      over the numbers' `sizes` (n,), with which intervals are compared; `lengths` (n,): half of each, the shortest
      first.
    - `factor`: from a deviation to half of an interval; `inflation`: by what the noise enlarges the covariance;
      `memory`: the part of it by which residuals follow each other.
    - `bent`: the numbers whose interval is that of the motion itself, because it is not what the derivatives predict.
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
    """By what the noise enlarges the covariance, and how many deviations an interval reaches.

    Deviations that are given are believed, unless the residuals are larger than they allow.
    """
    given = bool(np.all(task.given))
    residuals = task.weigh(fit.point, fit.deviations).residuals
    psi, slope = task.loss.influence(residuals)
    shown = np.sum(psi**2) / max(freedom, 1) / max(np.mean(slope), np.finfo(float).eps) ** 2
    if given:
        # Robust losses take more variance than least squares, even where all is normal.
        return max(1.0, float(shown)) * memory, float(norm.ppf(0.5 + LEVEL / 2))
    return float(shown) * memory, float(t.ppf(0.5 + LEVEL / 2, max(freedom / memory, 1.0)))


def _unidentified(
    names: tuple[str, ...], rows: np.ndarray, lengths: np.ndarray, size: np.ndarray
) -> Iterator[Unidentified]:
    """Combinations whose interval is larger than the numbers themselves, or than their bounds allow."""
    free = rows[[k for k, row in enumerate(rows) if lengths[k] * np.max(np.abs(row)) > 1]]
    if not free.size:
        return
    # Directions of equal length are determined up to a rotation only: their common projector is.
    projector = free.T @ free
    _, member = connected_components(np.abs(projector) > JOINED, directed=False)
    for label in np.unique(member):
        group = np.flatnonzero(member == label)
        values, vectors = np.linalg.eigh(projector[np.ix_(group, group)])
        if np.any(values > 0.5):
            yield Unidentified(tuple(names[i] for i in group), vectors[:, values > 0.5].T * size[group])
