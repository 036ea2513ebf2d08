"""How well the data determine the fitted numbers: covariance, intervals, undetermined combinations.

With residuals r in units of their deviations, J their derivatives by n parameters and psi the derivative of the loss,
the covariance is (J^T J)^-1 sum(psi^2) / (N - n) / mean(psi')^2 (Huber 1973, doi 10.1214/aos/1176342503): for least
squares the reduced chi-square times (J^T J)^-1. If residuals are correlated in time, the covariance is multiplied by
the number of residuals that are worth one independent residual.

Where intervals are wider than those that the derivatives predict, they come from the profile likelihood: the end of an
interval is where it has fallen by as much as it would for a linear motion at the end of the interval that the
derivatives predict (Venzon and Moolgavkar 1988, doi 10.2307/2347496).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.stats import norm, t

from clearance_jax.calibrate.fit import FitResult, FitTask, residuals_of
from clearance_jax.calibrate.measurement import FitPoint

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
    - `sizes` (n,) of the numbers (`Variables.sizes`).
    - `factor`: half of an interval over the deviation; `inflation`: factor of the noise on the covariance; `memory`:
      the part of it from correlated residuals.
    - `bent`: names whose intervals come from the motion itself, as the derivatives do not predict it.
    - `unidentified`: what the data cannot determine.
    """

    covariance: np.ndarray
    deviations: np.ndarray
    intervals: np.ndarray
    correlation: np.ndarray
    sizes: np.ndarray
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
    return Confidence(covariance, deviations, intervals, correlation, size, factor, inflation, memory, unknown)


def _noise(task: FitTask, fit: FitResult, freedom: int, memory: float) -> tuple[float, float]:
    """The factor of the noise on the covariance, and half of an interval over the deviation."""
    psi, slope = task.loss.influence(task.weigh(fit.point, fit.deviations).residuals)
    shown = np.sum(psi**2) / max(freedom, 1) / max(np.mean(slope), np.finfo(float).eps) ** 2
    if np.all(task.given):
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


# Ratio of the rise of the cost to its prediction at the end of an interval: within the first factor the prediction is
# used, beyond the second a doubt is reported.
STRAIGHT, BENT = 1.25, 2.0
# The factor of each further trial, how far trials go at least (a rippled cost may fall again), how many there are at
# most, and how often the last step is halved.
FARTHER, WIDEST, TRIALS, HALVINGS = 1.5, 3.0, 12, 2
# The search for another minimum: places in predicted half intervals, and along how many of the least known numbers.
FAR, LOOKED = (3.0, 9.0, 27.0), 2
# The other numbers are corrected if that is predicted to gain this part of the rise, at most so often at one place.
WORTH, CORRECTIONS = 0.1, 4
# Singular values below this part of the largest one belong to undetermined directions.
UNTOLD = 1e-6
# A point is a better minimum if its cost is below that of the fit by this part of the wanted rise.
BETTER = 0.02


def profile(task: FitTask, fit: FitResult, known: Confidence) -> tuple[Confidence, FitPoint | None]:
    """Search for the ends of the intervals of the determined numbers, if the derivatives do not predict the motion: the
    confidence with these, and a better point than the fit if one was met.
    """
    walk, intervals, bent = _Walk(task, fit, known), known.intervals.copy(), []
    undetermined = {name for group in known.unidentified for name in group.names}
    determined = [k for k in task.variables.alone().tolist() if task.variables.names[k] not in undetermined]
    vague = sorted(determined, key=lambda k: known.deviations[k] / known.sizes[k])[-LOOKED:]
    for far, numbers in ((True, vague), (False, determined)):
        for k in numbers:
            for side, sign in enumerate((-1.0, 1.0)):
                end, straight = walk.look(k, sign, far)
                if walk.better:
                    return known, walk.lowest
                intervals[k, side] = sign * max(sign * intervals[k, side], sign * end)
                bent += [] if straight else [task.variables.names[k]]
    intervals = np.clip(intervals, task.variables.lower[:, None], task.variables.upper[:, None])
    return known._replace(intervals=intervals, bent=tuple(dict.fromkeys(bent))), None


class _Walk:
    """Evaluations along one number, with the others at their best fit."""

    def __init__(self, task: FitTask, fit: FitResult, known: Confidence):
        self.task, self.fit, self.known = task, fit, known
        self.cost = task.cost(fit.point, fit.deviations)
        self.here = task.weigh(fit.point, fit.deviations)
        self.lowest, self.lowest_rise, self.better = fit.point, 0.0, False

    def look(self, k: int, sign: float, far: bool) -> tuple[float, bool]:
        """The end of the interval of number `k` to one side, and whether it is as predicted.

        Places lie along `way`, the predicted half interval, at parts of it up to the bound (`most`). `wanted` is the
        rise of the cost at its end for a linear motion. With `far` the places are those of `FAR`, to look for another
        minimum.
        """
        task, known, x = self.task, self.known, self.fit.point.x
        way = sign * known.factor * known.deviations[k] * self.others_follow(k)
        wanted = task.loss.cost(self.here.residuals + self.here.jacobian @ way) - self.cost
        bound = task.variables.upper[k] if sign > 0 else task.variables.lower[k]
        most = (bound - x[k]) / way[k]
        if most <= 0 or not wanted > 0:
            return x[k], True
        rises: dict[float, float] = {}
        for part in (part for part in FAR if part < most) if far else _parts(most, wanted, rises):
            rises[part] = self.rise(k, x + part * way, wanted)
            if rises[part] < -BETTER * wanted:
                self.better = True
                break
            if not far and len(rises) == 1 and 1 / STRAIGHT <= rises[part] / (wanted * part**2) <= STRAIGHT:
                break
        within = [part for part, rise in rises.items() if rise <= wanted]
        end, first = max([min(1.0, most), *within]), next(iter(rises.items()), (1.0, wanted))
        straight = 1 / BENT <= first[1] / (wanted * first[0] ** 2) <= BENT
        return float(x[k] + end * way[k]), bool(not within if far else straight and end <= BENT)

    def others_follow(self, k: int) -> np.ndarray:
        """The change of all numbers per unit of number `k`, the others at their best fit (along what is determined)."""
        sizes, way = self.known.sizes, np.ones(len(self.known.sizes))
        others = np.arange(len(sizes)) != k
        scaled = self.here.jacobian[:, others] * sizes[others]
        way[others] = -sizes[others] * np.linalg.lstsq(scaled, self.here.jacobian[:, k], rcond=UNTOLD)[0]
        return way

    def rise(self, k: int, place: np.ndarray, wanted: float) -> float:
        """The rise of the cost over that of the fit with number `k` fixed, the others corrected while that helps."""
        task, variables, others = self.task, self.task.variables, np.arange(len(place)) != k
        rise, point = self.seen(np.clip(place, variables.lower, variables.upper))
        scale = self.known.deviations[others]
        for _ in range(CORRECTIONS if len(place) > 1 and point.reached else 0):
            at = task.weigh(point, self.fit.deviations)
            # Residuals are weighted by the loss.
            psi, slope = task.loss.influence(at.residuals)
            root, step = np.sqrt(np.maximum(slope, 0.1)), np.zeros(len(place))
            step[others] = -scale * np.linalg.lstsq(root[:, None] * at.jacobian[:, others] * scale, psi / root)[0]
            gain = task.loss.cost(at.residuals) - task.loss.cost(at.residuals + at.jacobian @ step)
            if gain < WORTH * max(rise, wanted):
                break
            now, point = self.seen(np.clip(point.x + step, variables.lower, variables.upper))
            if now >= rise:
                break
            rise = now
        return rise

    def seen(self, place: np.ndarray) -> tuple[float, FitPoint]:
        """The rise of the cost at a place, and its point; the lowest of all is kept."""
        point = self.task.instruments(place)
        rise = self.task.cost(point, self.fit.deviations) - self.cost if point.reached else np.inf
        if rise < self.lowest_rise:
            self.lowest, self.lowest_rise = point, rise
        return rise, point


def _parts(most: float, wanted: float, rises: dict[float, float]) -> Iterator[float]:
    """The places to evaluate, in predicted half intervals: outwards until the cost has risen, then by bisection."""
    part = min(1.0, most)
    yield part
    while part < most and (part < WIDEST or (rises[part] <= wanted and len(rises) < TRIALS)):
        part = min(most, FARTHER * part)
        yield part
    within = [part for part, rise in rises.items() if rise <= wanted]
    beyond = [part for part in rises if within and part > max(within)]
    if beyond:
        low, high = max(within), min(beyond)
        for _ in range(HALVINGS):
            part = (low + high) / 2
            yield part
            low, high = (part, high) if rises[part] <= wanted else (low, part)
