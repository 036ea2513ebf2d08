"""`calibrate`: fit numbers of a mechanism to measured motion or forces, with confidence intervals.

The search for the best fit goes from each start by longer and longer motions, with more starts while the fit is bad.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Unpack

import numpy as np
import xarray as xr
from scipy.stats import qmc

from clearance_jax.calibrate.confidence import Confidence, confidence, profile
from clearance_jax.calibrate.fit import INTERRUPTED, FitResult, FitTask, Variables, descend, residuals_of
from clearance_jax.calibrate.measurement import FitPoint, Instruments, Series, read_measurement
from clearance_jax.calibrate.options import FitOptions, fit_options
from clearance_jax.calibrate.result import Calibration, doubts, result_of
from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.parameters import Leaf, check_bounds, find, parameters, replace
from clearance_jax.solve.settings import SolveOptions, settings_of

# How often the search continues from a better fit at an end of a confidence interval.
ROUNDS = 4
UNSEEN = "at the ends of the intervals no motion was solved to check what the derivatives predict"


def calibrate(
    mechanism: Mechanism,
    dataset: xr.Dataset,
    parameters: Mapping[str, tuple[Any, Any] | None] | Sequence[str],
    *,
    signals: Mapping[str, str | AbstractSignal] | Sequence[str] | None = None,
    deviations: Mapping[str, Any] | None = None,
    priors: Mapping[str, tuple[Any, Any]] | None = None,
    loss: str = "linear",
    starts: int | None = None,
    seed: int = 0,
    most: int = 100,
    t1: Any = None,
    progress: Callable[[FitPoint], Any] | None = None,
    **options: Unpack[SolveOptions],
) -> Calibration:
    """Fit numbers of a mechanism so that its motion is nearest to a measured one, by least squares with exact
    derivatives.

    **Arguments:**

    - `dataset`: variables over a coordinate `time` [s], in SI or in what their attribute `units` says. NaN: not
      measured.
    - `parameters`: dotted names of the numbers that are looked for, as in `cj.parameters(mechanism)`, each with its
      least and its greatest value [SI], or `None`; or the names alone. The name of an array stands for its entries,
      and the name of a module of yours, such as a network, for all its arrays. The search starts at the mechanism's own
      values.
    - `signals`: variable -> what it measures: a quantity of the motion by its name ("piston.position.x"), or a signal
      of `clearance_jax.metrics`. Or the names of variables that are quantities themselves; `None`: all variables over
      `time`.
    - `deviations`: variable -> standard deviation of its noise [SI]; absent ones are estimated from residuals.
    - `priors`: parameter -> (value, standard deviation) that are known beforehand, as if measured; of an array, for
      each of its entries: a regulariser. They make more numbers than data possible.
    - `loss`: "linear", or one that outliers disturb less: "huber", "soft_l1", "cauchy", "arctan".
    - `starts`: how many, the first at the mechanism's own values, the others scattered over the bounds by `seed`;
      `None`: one, and up to seven more while the residuals do not look like noise, until two agree. Each is fitted to
      the first part of the measured time, and from there to longer ones. `most`: motions after which one gives up.
    - `t1`: end of the motion [s] (the last measured instant); `progress`: called with every point that was solved;
      `options`: as `simulate`'s.

    **Raises:** `ClearanceError` for what is unknown, cannot be measured or compared, fewer data than parameters, and
    where no motion reaches its end.
    """
    if "save_at" in options:
        raise ClearanceError("A calibration compares at the measured times: leave `save_at` out.")
    how = fit_options(loss, starts, seed, most)
    variables = _variables(mechanism, parameters, dict(priors or {}), how)
    measurement = read_measurement(mechanism, dataset, signals, deviations, bool(options.get("energy_balance", False)))
    count, wanted = int(np.sum(measurement.known)), int(np.sum(np.isinf(variables.spread)))
    if count < wanted:
        few = f"{count} measured numbers cannot determine {wanted} parameters."
        raise ClearanceError(f"{few} Measure more, or look for fewer.")
    if wanted == count == len(variables.names) and any(series.deviation is None for series in measurement.series):
        raise ClearanceError(
            f"{count} measured numbers for {wanted} parameters leave none to estimate the noise from. Measure more, or "
            "give `deviations`."
        )
    times, t1 = measurement.times, float(measurement.times[-1] if t1 is None else t1)
    settings = settings_of(mechanism, t1, options)
    begin = float(settings.t0)
    if times[0] < begin or times[-1] > t1:
        raise ClearanceError(
            f"The measured times, {times[0]:g} to {times[-1]:g} s, must lie inside the motion, from {begin:g} to "
            f"{t1:g} s. Cut the data, or set `t0` and `t1`."
        )
    instruments = Instruments(mechanism, measurement, variables.by_name, t1, settings, progress)
    task = FitTask(instruments, variables, measurement, how)
    fits = search(task)
    fits[0], known, interrupted = settle(task, fits[0])
    notes = (*doubts(task, fits[0], known), *interrupted)
    fitted = replace(mechanism, variables.by_name(fits[0].point.x))
    return result_of(task, fitted, fits, known, notes)


def settle(task: FitTask, fit: FitResult) -> tuple[FitResult, Confidence, tuple[str, ...]]:
    """The fit, or a better one that was met on the way; its confidence; and notes on what was not compared."""
    known = confidence(task, fit)
    try:
        for _ in range(ROUNDS):
            if fit.ending == INTERRUPTED or any(check.exact for check in residuals_of(task, fit)):
                return fit, known, ()  # stopped, or residuals as small as the solves' errors: nothing to compare
            known, better = profile(task, fit, known)
            if better is None:
                return fit, known, ()
            fit = refine(task, descend(task, better, fit.deviations).after(fit))
            known = confidence(task, fit)
    except KeyboardInterrupt:
        return fit, known, (f"Interrupted: {UNSEEN}.",)
    nearby = "Each look at the ends of the intervals has shown a better fit nearby"
    return fit, known, (f"{nearby}: {UNSEEN}. Try more starts.",)


def _variables(mechanism: Mechanism, given: Any, priors: dict[str, Any], options: FitOptions) -> Variables:
    """The numbers to be fitted, with start values and bounds."""
    known, units, names, wholes = parameters(mechanism), {}, [], []
    given = (given,) if isinstance(given, str) else given
    bounds = _each(known, given if isinstance(given, Mapping) else dict.fromkeys(given, None))
    if not bounds:
        raise ClearanceError("There is no number to look for: `parameters` is empty.")
    priors = _each(known, priors)
    if missing := next((name for name in priors if name not in bounds), None):
        raise unknown_name(f"`priors`: `{missing}` is not looked for.", missing, bounds)
    rows = []
    for name, pair in bounds.items():
        leaf, entry = find(known, name)
        low, high = _bounds(name, leaf, pair)
        expected, spread = _prior(name, priors[name]) if name in priors else (0.0, np.inf)
        values = np.asarray(leaf.value if entry is None else leaf.value[entry], float)
        wholes.append((name, values.shape))
        for place in np.ndindex(values.shape):
            value, number = float(values[place]), ".".join([name, *map(str, place)])
            if not low <= value <= high:
                raise ClearanceError(
                    f"The search starts at the mechanism's own `{number}` = {value:g} {leaf.unit}".rstrip()
                    + f", which is not between its bounds {low:g} and {high:g}. Change one of them."
                )
            names.append(number)
            rows.append((value, low, high, expected, spread))
            units[number] = leaf.unit
        if (options.starts or 1) > 1 and not np.isfinite(high - low):
            raise ClearanceError(f"Several starts are scattered over the bounds, but `{name}` has none. Give them.")
    start, lower, upper, expected, spread = np.array(rows, float).T
    return Variables(tuple(names), start, lower, upper, units, expected, spread, tuple(wholes))


def _each(known: Mapping[str, Leaf], given: Mapping[str, Any]) -> dict[str, Any]:
    """The same by whole parameters, where a name stands for all parameters below it."""
    below = {name: [whole for whole in known if whole.startswith(f"{name}.")] for name in given if name not in known}
    return {whole: pair for name, pair in given.items() for whole in below.get(name) or [name]}


def _prior(name: str, pair: Any) -> tuple[float, float]:
    """An expected value and its standard deviation."""
    try:
        expected, spread = map(float, pair)
    except (TypeError, ValueError):
        raise wrong_value(f"The prior of `{name}`", "a value and its standard deviation", pair) from None
    if not (np.isfinite(expected) and 0 < spread < np.inf):
        raise wrong_value(f"The standard deviation of the prior of `{name}`", "finite and above zero", spread)
    return expected, spread


def _bounds(name: str, leaf: Leaf, pair: Any) -> tuple[float, float]:
    """The given bounds within those of the number itself; these alone if none are given."""
    about = leaf.metadata
    least = [about[key] for key in ("above", "least") if about.get(key) is not None]
    if pair is None:
        return max(least, default=-np.inf), np.inf if about.get("below") is None else about["below"]
    try:
        low, high = map(float, pair)
    except (TypeError, ValueError):
        raise ClearanceError(f"The bounds of `{name}` must be two numbers, but they are {quote(pair)}.") from None
    if not low < high:
        raise ClearanceError(f"The bounds of `{name}` must be a lower and an upper one, not {low:g} and {high:g}.")
    for end in (low, high):
        if np.isfinite(end):
            check_bounds(end, about, f"A bound of `{name}`", leaf.unit)
    return max([low, *least]), high if about.get("below") is None else min(high, about["below"])


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
    """The fit from every start, the best first, refined with estimated deviations. **Raises** `ClearanceError` if no
    motion of a start reaches its end.
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
        pairs = zip(task.variables.names, task.variables.start, strict=True)
        at = ", ".join(f"{name} = {value:.4g}" for name, value in pairs)
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
    best, *others = sorted(fits, key=lambda fit: fit.cost)
    # The search had rough deviations: take those that `refine` would.
    best = best._replace(deviations=_estimated_deviations(task, best))
    agreed = bool(others) and others[0].cost <= SAME * best.cost
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
    low, high = (np.log(end, where=by_log, out=end.copy()) for end in (lower, upper))
    for draw in qmc.LatinHypercube(len(lower), rng=np.random.default_rng(options.seed)).random(count - 1):
        between = low + draw * (high - low)
        yield np.exp(between, where=by_log, out=between.copy())


def grow(task: FitTask, start: np.ndarray, deviations: np.ndarray) -> Iterator[FitResult]:
    """The fit from one start, first to a part of the measured time, then to longer ones; no fit if no motion reaches
    the end.
    """
    best, places = None, [start]
    # The numbers of measured instants to fit, in turn; the last one is all.
    times, known = task.measurement.times, np.cumsum(np.sum(task.measurement.known, axis=1))
    ends = np.searchsorted(times, times[0] + np.array(PARTS) * (times[-1] - times[0]), side="right")
    enough = {int(end) for end in ends if known[end - 1] >= ENOUGH * len(task.variables.names)}
    for count in sorted(enough | {len(times)}):
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


def refine(task: FitTask, fit: FitResult) -> FitResult:
    """Refit with deviations estimated from the residuals, for series without a given deviation."""
    given = task.given
    # A common factor does not move the minimum of a sum of squares that are all of one kind.
    alone = len(given) == 1 and task.options.loss == "linear" and not task.variables.has_prior
    for _ in range(0 if np.all(given) else REFITS):
        deviations = _estimated_deviations(task, fit)
        settled = np.all(np.abs(deviations - fit.deviations) <= SETTLED * fit.deviations)
        fit = fit._replace(deviations=deviations, cost=task.cost(fit.point, deviations))
        if settled or alone or fit.ending == INTERRUPTED:
            break
        fit = descend(task, fit.point, deviations).after(fit)
    return fit


def _estimated_deviations(task: FitTask, fit: FitResult) -> np.ndarray:
    """The deviation of each series (series,): the given one, or that of its residuals (by their median with a robust
    loss).
    """
    measured, known = task.measurement.values, task.measurement.known
    left, deviations = 1 - task.spent(fit.point, fit.deviations) / np.sum(known), []
    for off, values, there in zip((fit.point.values - measured).T, measured.T, known.T, strict=True):
        size = np.abs(off[there])
        # The median of normal noise is 0.6745 deviations.
        size = np.sqrt(np.mean(size**2)) if task.options.loss == "linear" else np.median(size) / 0.6745
        deviations.append(max(size / np.sqrt(left), task.floor(values[there])))
    return np.where(task.given, fit.deviations, deviations)
