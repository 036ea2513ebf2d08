"""The search for the best fit: from each start by longer and longer motions, with more starts while the fit is bad."""

from collections.abc import Iterator

import numpy as np
from scipy.stats import qmc

from clearance_jax.calibrate.fit import INTERRUPTED, FitResult, FitTask, Variables, descend, residuals_of
from clearance_jax.calibrate.measurement import FitPoint, Series
from clearance_jax.calibrate.options import FitOptions
from clearance_jax.errors import ClearanceError

# Ratio of bounds above which the starts of a positive number are scattered in its logarithm.
WIDE = 10.0
# The largest number of refits with deviations from residuals, and their relative change that ends these.
REFITS, SETTLED = 8, 0.01
# Parts of the measured time that are fitted before all of it: the longer a motion, the narrower its minimum.
PARTS = (0.125, 0.25, 0.5)
# Measurements that a part must have for each unknown, and the tolerance of the search in a part.
ENOUGH, COARSE = 4, 1e-3
# The largest number of automatic starts, and the ratio of costs below which two minima are the same.
MOST_AUTOMATIC, SAME = 8, 1.01


def search(task: FitTask) -> list[FitResult]:
    """The fit from every start, the best first, refined with estimated deviations.

    **Raises:** `ClearanceError` if no motion of a start reaches its end.
    """
    spread = np.array([_first_deviation(task, series) for series in task.measurement.series])
    fits: list[FitResult] = []
    try:
        for start in starts_of(task.variables, task.options):
            fits += grow(task, start, spread)
            if fits and (fits[-1].ending == INTERRUPTED or _enough(task, fits)):
                break
    except KeyboardInterrupt:
        if not fits:
            raise
        fits = [fit._replace(converged=False, ending=INTERRUPTED) for fit in fits]
    if not fits:
        variables = task.variables
        at = ", ".join(f"{name} = {value:.4g}" for name, value in zip(variables.names, variables.start, strict=True))
        why = next((point.why for point in task.instruments.points if point.why), "")
        raise ClearanceError(
            f"No motion from which the search could start reaches its end ({at}): "
            f"{why or 'a reading or a derivative is not finite'}. Change the mechanism's numbers, or the bounds."
        )
    fits.sort(key=lambda fit: fit.cost)
    return [refine(task, fits[0]), *fits[1:]]


def _enough(task: FitTask, fits: list[FitResult]) -> bool:
    """Whether automatic starts can end: the best fit's residuals look like noise, or two starts agree on it."""
    if task.options.starts is not None:
        return False
    costs = sorted(fit.cost for fit in fits)
    agreed = len(costs) > 1 and costs[1] <= SAME * costs[0]
    best = min(fits, key=lambda fit: fit.cost)
    best = best._replace(deviations=np.where(task.given, best.deviations, _shown_deviations(task, best.point)))
    return agreed or all(check.like_noise for check in residuals_of(task, best))


def _first_deviation(task: FitTask, series: Series) -> float:
    """The deviation of a series for the first fit: the given one, the spread of the signal, or its size."""
    values = series.values[np.isfinite(series.values)]
    spread = float(np.std(values))
    return series.deviation or (spread if spread > task.floor(values) else float(np.max(np.abs(values))) or 1.0)


def starts_of(variables: Variables, options: FitOptions) -> Iterator[np.ndarray]:
    """The start points: the mechanism's own numbers, then points scattered over the bounds."""
    yield np.clip(variables.start, variables.lower, variables.upper)
    lower, upper = variables.lower, variables.upper
    count = options.starts or (MOST_AUTOMATIC if np.all(np.isfinite(upper - lower)) else 1)
    if count == 1:
        return
    by_log = (lower > 0) & (upper > WIDE * lower)
    low, high = np.where(by_log, np.log(lower, where=by_log, out=lower.copy()), lower), upper.copy()
    high[by_log] = np.log(upper[by_log])
    for draw in qmc.LatinHypercube(len(lower), rng=np.random.default_rng(options.seed)).random(count - 1):
        between = low + draw * (high - low)
        yield np.where(by_log, np.exp(np.where(by_log, between, 0.0)), between)


def grow(task: FitTask, start: np.ndarray, deviations: np.ndarray) -> Iterator[FitResult]:
    """The fit from one start, first to a part of the measured time and then to longer ones; none if its motion does not
    reach its end.
    """
    best, places = None, [start]
    for count in _counts(task):
        part = task.until(count)
        try:
            tried = [point for point in map(part.instruments, places) if point.reached]
            if not tried:
                continue
            first = min(tried, key=lambda point: part.cost(point, deviations))
            best = descend(part, first, deviations, 1e-8 if part is task else COARSE).after(best)
        except KeyboardInterrupt:
            if best is None:
                raise
            best = best._replace(ending=INTERRUPTED, converged=False)
        if best.ending == INTERRUPTED:
            break
        # The fit of a part may be misleading: the start may be nearer to the fit of a longer one.
        places = [best.point.x, start]
    if best is not None:
        point = task.instruments(best.point.x)
        yield from (best._replace(point=point, cost=task.cost(point, deviations)),) if point.reached else ()


def _counts(task: FitTask) -> list[int]:
    """The numbers of measured instants to fit, in turn; the last one is all."""
    times, known = task.measurement.times, np.cumsum(np.sum(task.measurement.known, axis=1))
    ends = np.searchsorted(times, times[0] + np.array(PARTS) * (times[-1] - times[0]), side="right")
    enough = {int(end) for end in ends if known[end - 1] >= ENOUGH * len(task.variables.names)}
    return sorted(enough | {len(times)})


def refine(task: FitTask, fit: FitResult) -> FitResult:
    """Refit with deviations estimated from the residuals, for series without a given deviation."""
    given = task.given
    # A common factor does not move the minimum of a sum of squares.
    alone = len(given) == 1 and task.options.loss == "linear"
    for _ in range(0 if np.all(given) else REFITS):
        shown = np.where(given, fit.deviations, _shown_deviations(task, fit.point))
        settled = np.all(np.abs(shown - fit.deviations) <= SETTLED * fit.deviations)
        fit = fit._replace(deviations=shown, cost=task.cost(fit.point, shown))
        if settled or alone or fit.ending == INTERRUPTED:
            break
        fit = descend(task, fit.point, shown).after(fit)
    return fit


def _shown_deviations(task: FitTask, point: FitPoint) -> np.ndarray:
    """The deviation of each series from its residuals, shape (series,): their root mean square, or from their median
    with a robust loss, corrected for the fitted degrees of freedom.
    """
    measurement, known = task.measurement, task.measurement.known
    left, deviations = 1 - len(task.variables.names) / np.sum(known), []
    for off, values, there in zip((point.values - measurement.values).T, measurement.values.T, known.T, strict=True):
        size = np.abs(off[there])
        # Of normal noise the median is 0.6745 deviations.
        size = np.sqrt(np.mean(size**2)) if task.options.loss == "linear" else np.median(size) / 0.6745
        deviations.append(max(size / np.sqrt(left), task.floor(values[there])))
    return np.array(deviations)
