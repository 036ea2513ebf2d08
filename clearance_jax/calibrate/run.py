"""`calibrate`: fit numbers of a mechanism to measured motion or forces, with confidence intervals."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Unpack

import numpy as np
import xarray as xr

from clearance_jax.calibrate.confidence import Confidence, confidence, profile
from clearance_jax.calibrate.fit import INTERRUPTED, FitResult, FitTask, Variables, descend, residuals_of
from clearance_jax.calibrate.measurement import FitPoint, Instruments, Measurement, read_measurement
from clearance_jax.calibrate.options import FitOptions, fit_options
from clearance_jax.calibrate.result import Calibration, doubts, result_of
from clearance_jax.calibrate.search import refine, search
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.parameters import Leaf, check_bounds, find, parameters, replace
from clearance_jax.solve.settings import Settings, SolveOptions, settings_of

# How often the search continues from a better fit that was met at the ends of the intervals.
ROUNDS = 4
UNSEEN = "the motion at the ends of the intervals was not compared with what the derivatives predict"


def calibrate(
    mechanism: Mechanism,
    dataset: xr.Dataset,
    parameters: Mapping[str, tuple[Any, Any]] | Sequence[str],
    *,
    signals: Mapping[str, str | AbstractSignal] | Sequence[str] | None = None,
    deviations: Mapping[str, Any] | None = None,
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
      least and its greatest value [SI]; or the names alone. The search starts at the mechanism's own values.
    - `signals`: of each variable what it measures: a quantity of the motion by its name ("piston.position.x"), or a
      signal of `clearance_jax.metrics`. Or names of variables that are quantities themselves; `None`: all over `time`
      are.
    - `deviations`: of each variable the standard deviation of its noise [SI]; what is absent is estimated from
      residuals.
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
    variables = _variables(mechanism, parameters, how)
    measurement = read_measurement(mechanism, dataset, signals, deviations, bool(options.get("energy_balance", False)))
    _check_count(measurement, variables)
    settings, t1 = _span(mechanism, measurement.times, t1, options)
    instruments = Instruments(mechanism, measurement, variables.names, t1, settings, progress)
    task = FitTask(instruments, variables, measurement, how)
    fits = search(task)
    fits[0], known, interrupted = settle(task, fits[0])
    notes = (*doubts(task, fits[0], known), *interrupted)
    fitted = replace(mechanism, dict(zip(variables.names, fits[0].point.x, strict=True)))
    return result_of(task, fitted, fits, known, notes)


def settle(task: FitTask, fit: FitResult) -> tuple[FitResult, Confidence, tuple[str, ...]]:
    """The fit, or a better one that was met on the way; its confidence; and notes on what was not compared."""
    known = confidence(task, fit)
    try:
        for _ in range(ROUNDS):
            if fit.ending == INTERRUPTED or any(check.exact for check in residuals_of(task, fit)):
                return fit, known, ()
            profiled = profile(task, fit, known)
            if profiled.better is None:
                return fit, profiled.known, ()
            fit = refine(task, descend(task, profiled.better, fit.deviations).after(fit))
            known = confidence(task, fit)
    except KeyboardInterrupt:
        return fit, known, (f"Interrupted: {UNSEEN}.",)
    message = f"Each look at the ends of the intervals has shown a better fit nearby: {UNSEEN}. Try more starts."
    return fit, known, (message,)


def _variables(mechanism: Mechanism, given: Any, options: FitOptions) -> Variables:
    """The numbers to be fitted, with start values and bounds."""
    known = parameters(mechanism)
    given = (given,) if isinstance(given, str) else given
    bounds = given if isinstance(given, Mapping) else dict.fromkeys(given, None)
    if not bounds:
        raise ClearanceError("There is no number to look for: `parameters` is empty.")
    ends, start, units = [], [], {}
    for name, pair in bounds.items():
        leaf, entry = find(known, name)
        if entry is None and np.ndim(leaf.value):
            raise ClearanceError(f"`parameters` wants numbers, but `{name}` is an array. Name its entries, `{name}.0`.")
        low, high = _bounds(name, leaf, pair)
        value = float(np.asarray(leaf.value if entry is None else leaf.value[entry]))
        if not low <= value <= high:
            raise ClearanceError(
                f"The search starts at the mechanism's own `{name}` = {value:g} {leaf.unit}".rstrip()
                + f", which is not between its bounds {low:g} and {high:g}. Change one of them."
            )
        if (options.starts or 1) > 1 and not np.isfinite(high - low):
            raise ClearanceError(f"Several starts are scattered over the bounds, but `{name}` has none. Give them.")
        ends.append((low, high))
        start.append(value)
        units[name] = leaf.unit
    lower, upper = np.array(ends, float).T
    return Variables(tuple(bounds), np.array(start), lower, upper, units)


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


def _check_count(measurement: Measurement, variables: Variables) -> None:
    count, wanted = int(np.sum(measurement.known)), len(variables.names)
    if count < wanted:
        raise ClearanceError(
            f"{count} measured numbers cannot determine {wanted} parameters. Measure more, or look for fewer."
        )
    if count == wanted and any(series.deviation is None for series in measurement.series):
        raise ClearanceError(
            f"{count} measured numbers for {wanted} parameters leave none to estimate the noise from. Measure more, or "
            "give `deviations`."
        )


def _span(mechanism: Mechanism, times: np.ndarray, t1: Any, options: Any) -> tuple[Settings, float]:
    """The settings of the solves, and the end of the motion [s]."""
    end = float(times[-1] if t1 is None else t1)
    settings = settings_of(mechanism, end, options)
    begin = float(settings.t0)
    if times[0] < begin or times[-1] > end:
        raise ClearanceError(
            f"The measured times, {times[0]:g} to {times[-1]:g} s, must lie inside the motion, from "
            f"{begin:g} to {end:g} s. Cut the data, or set `t0` and `t1`."
        )
    return settings, end
