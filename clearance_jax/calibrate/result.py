"""The result of a calibration, and doubts about it, in sentences."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.calibrate.confidence import Confidence, Unidentified
from clearance_jax.calibrate.fit import FitResult, FitTask, ResidualCheck, residuals_of
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.units import format_quantity

# The largest number of other minima in the message.
TOLD = 3


class Minimum(NamedTuple):
    """A minimum that another start led to: `values` of the numbers, and the `ratio` of its cost to that of the best."""

    values: dict[str, float]
    ratio: float


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """The fitted numbers of a mechanism and how well they are known. It prints itself.

    - `values`, `deviations` (standard), `intervals` (of 95 %) by name [SI]; `units`; those that are `undetermined`.
    - `correlation`: an array over parameter and parameter.
    - `residuals`: a dataset over time of the measured values, those of the fitted motion (`NAME_model`), and the
      difference (`NAME_residual`, model minus measurement).
    - `noise`: the deviation of each signal, given or estimated; `chi_square`: the sum of squared residuals over their
      deviations, by the `freedom` left (near 1 by construction where the deviations are estimated from the residuals);
      `missing`: how many numbers were NaN.
    - `notes`: doubts about the fit, in sentences; `others`: minima to which other starts led.
    - `converged`; `motions`: how many were solved with derivatives; `mechanism`: with the fitted numbers.
    - `arrays`: those among the parameters, by name; `covariance`: an array over all numbers (`NAME.i` of an array),
      while all of the above is of the other numbers; `expected`: of how many numbers something was known beforehand.
    """

    mechanism: Mechanism
    values: dict[str, float]
    deviations: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    units: dict[str, str]
    correlation: xr.DataArray
    residuals: xr.Dataset
    noise: dict[str, float]
    chi_square: float
    freedom: int
    missing: int
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    others: tuple[Minimum, ...]
    converged: bool
    motions: int
    arrays: dict[str, np.ndarray]
    covariance: xr.DataArray
    expected: int

    @property
    def compared(self) -> int:
        """The number of measured numbers."""
        return self.freedom - self.expected + len(self.values) + sum(array.size for array in self.arrays.values())

    @property
    def message(self) -> str:
        """The result in words, as it is printed."""
        lines = [f"{name} = {self.row(name)}" for name in self.values]
        lines += [f"{name}: {array.size} numbers" for name, array in self.arrays.items()]
        gaps = f", {self.missing} missing" if self.missing else ""
        compared = f"{self.compared} numbers compared{gaps}"
        lines.append(f"{compared}, {self.motions} motions solved, chi-square {self.chi_square:.3g}")
        for other in self.others[:TOLD]:
            at = ", ".join(f"{n} = {format_quantity(value, self.units[n], 4)}" for n, value in other.values.items())
            lines.append(f"Another minimum, of {other.ratio:.3g} times the cost: {at}.")
        if len(self.others) > TOLD:
            lines.append(f"{len(self.others) - TOLD} more minima cost more.")
        return "\n".join([*lines, *self.notes])

    def row(self, name: str) -> str:
        """A number with its interval."""
        unit, (low, high) = self.units[name], self.intervals[name]
        value = format_quantity(self.values[name], unit, 5)
        if name in self.undetermined:
            return f"{value} (not determined)"
        return f"{value} (95 %: {format_quantity(low, unit, 5)} to {format_quantity(high, unit, 5)})"

    def __repr__(self) -> str:
        return self.message


def result_of(
    task: FitTask, mechanism: Mechanism, fits: list[FitResult], known: Confidence, notes: tuple[str, ...]
) -> Calibration:
    """The `Calibration`, from the `mechanism` with the fitted numbers and the `fits`, the best first."""
    fit, variables, measurement, alone = fits[0], task.variables, task.measurement, task.variables.alone()
    names = [variables.names[k] for k in alone]
    correlation = known.correlation[np.ix_(alone, alone)]
    residuals = task.weigh(fit.point, fit.deviations).residuals
    freedom = residuals.size - len(variables.names)
    every = list(variables.names)
    return Calibration(
        mechanism,
        dict(zip(names, fit.point.x[alone].tolist(), strict=True)),
        dict(zip(names, known.deviations[alone].tolist(), strict=True)),
        {name: (float(low), float(high)) for name, (low, high) in zip(names, known.intervals[alone], strict=True)},
        variables.units,
        xr.DataArray(correlation, {"parameter": names, "other": names}, ("parameter", "other")),
        _residuals(task, fit),
        {series.name: float(size) for series, size in zip(measurement.series, fit.deviations, strict=True)},
        float(np.sum(residuals**2) / max(freedom, 1)),
        freedom,
        int(np.sum(~measurement.known)),
        tuple(name for group in known.unidentified for name in group.names),
        notes,
        tuple(_others(task, fits, known)),
        fit.converged,
        len(task.instruments.points),
        {name: array for name, array in variables.by_name(fit.point.x).items() if array.ndim},
        xr.DataArray(known.covariance, {"parameter": every, "other": every}, ("parameter", "other")),
        int(np.sum(np.isfinite(variables.spread))),
    )


def _residuals(task: FitTask, fit: FitResult) -> xr.Dataset:
    variables = {}
    for series, model in zip(task.measurement.series, fit.point.values.T, strict=True):
        about = {"units": series.unit}
        variables[series.name] = ("time", series.values, about)
        variables[f"{series.name}_model"] = ("time", model, about)
        variables[f"{series.name}_residual"] = ("time", model - series.values, about)
    return xr.Dataset(variables, {"time": ("time", task.measurement.times, {"units": "s"})})


def _others(task: FitTask, fits: list[FitResult], known: Confidence):
    """The minima that are outside of each other's intervals, without the best."""
    size, vague = known.factor * known.deviations, {name for group in known.unidentified for name in group.names}
    undetermined = [name in vague for name in task.variables.names]
    seen, best = [fits[0].point.x], task.cost(fits[0].point, fits[0].deviations)
    for fit in fits[1:]:
        x = fit.point.x
        apart = [np.abs(x - other) / np.maximum(size, 1e-3 * np.abs(other)) for other in seen]
        if fit.converged and all(np.any(np.where(undetermined, 0.0, distances) > 1) for distances in apart):
            seen.append(x)
            ratio = task.cost(fit.point, fits[0].deviations) / max(best, np.finfo(float).tiny)
            alone = {task.variables.names[k]: float(x[k]) for k in task.variables.alone()}
            yield Minimum(alone, float(ratio))


# Share of steps that gained much less than predicted from which on this is told, and the least number of steps.
MISLED, MANY = 0.5, 4
# A number lies at a bound if it is nearer than this part of its size.
AT_BOUND = 1e-6
# The example of a change along an undetermined direction, over the numbers' sizes.
EXAMPLE = 0.1


def doubts(task: FitTask, fit: FitResult, known: Confidence) -> Iterator[str]:
    """The doubts that a user must know before using the numbers."""
    if not fit.converged:
        yield f"The search has not converged: {fit.ending}. The numbers are those of the best motion so far."
    yield from (_undetermined(group, task.variables.units) for group in known.unidentified)
    yield from _at_bounds(task, fit)
    every = residuals_of(task, fit)
    exact = [check.name for check in every if check.exact]
    if exact:
        yield (
            f"The residuals of {listed(exact)} are no larger than the errors of the solves: the intervals are a rough "
            "guess. Choose a smaller `rtol`."
        )
    yield from _sizes([check for check in every if check.given or not check.exact])
    for check in every:
        if check.correlated and not check.exact:
            yield (
                f"The residuals of `{check.name}` follow each other (their correlation from one instant to the next is "
                f"{check.follows:.2f}, that of independent noise is 0 ± {1 / np.sqrt(check.count):.2f}): the model "
                "lacks an effect, or the noise is not independent. The intervals are made wider by the factor "
                f"{np.sqrt(known.memory):.2g}, but if the model is wrong the truth may lie outside of them."
            )
    if fit.steps >= MANY and fit.doubtful > MISLED * fit.steps:
        yield (
            f"{fit.doubtful} of {fit.steps} steps of the search brought less than a quarter of the improvement that "
            "the derivatives predicted: the derivatives may be misleading, as in chaotic motion. Measure a shorter "
            "time, or try more starts."
        )
    if known.bent:
        yield (
            f"At the ends of the intervals, mainly of {listed(known.bent)}, the motion is not the one that the "
            "derivatives predict. These intervals are those of the motion itself; the deviations and correlations are "
            "a rough guess."
        )


def listed(names: Sequence[str]) -> str:
    """Names as a list in a sentence."""
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _undetermined(group: Unidentified, units: Mapping[str, str]) -> str:
    if len(group.names) == 1:
        return (
            f"The data do not determine {listed(group.names)}: its interval is larger than the number itself, or than "
            "its bounds. Fix it, or measure something that depends on it."
        )
    if len(group.directions) == len(group.names):
        none = f"The data do not determine {listed(group.names)}, nor any combination of them"
        return f"{none}. Fix them, or measure more."
    how = ""
    if len(group.directions) == 1:
        parts = zip(group.names, group.directions[0], strict=True)
        changes = ", ".join(f"{name} by {format_quantity(EXAMPLE * part, units[name], 3)}" for name, part in parts)
        how = f" (change {changes}: the readings stay the same within the noise)"
    known = len(group.names) - len(group.directions)
    combinations = "one combination" if known == 1 else f"{known} combinations"
    return (
        f"The data cannot tell {listed(group.names)} apart: only {combinations} of them can be determined{how}. Fix "
        "one of them, or measure something else."
    )


def _at_bounds(task: FitTask, fit: FitResult) -> Iterator[str]:
    variables, x = task.variables, fit.point.x
    near = np.minimum(x - variables.lower, variables.upper - x) <= AT_BOUND * variables.sizes(x)
    names = [name for name, there in zip(variables.names, near, strict=True) if there]
    if names:
        verb, its = ("lies at a bound", "its interval") if len(names) == 1 else ("lie at bounds", "their intervals")
        yield f"{listed(names)} {verb}: a better value may lie beyond, and {its} cannot be trusted. Widen the bounds."


def _sizes(every: Sequence[ResidualCheck]) -> Iterator[str]:
    """Sentences about residuals that are larger or smaller than the noise."""
    for check in every:
        its, root, square = f"The residuals of `{check.name}` are", np.sqrt(check.size), f"{check.size:.3g}"
        noise, why = f"its noise (reduced chi-square {square})", "the noise is larger than the given deviation"
        if check.size < check.low:
            why = "the noise is smaller than the given deviation. The intervals are too wide."
            yield f"{its} only {root:.2g} times as large as {noise}: {why}"
        if not check.given:
            noise = "the noise that the readings themselves show, from one instant to the next"
            why = "the noise is not independent"
        if check.size > check.high:
            wrong = "the model is wrong, there are outliers, or"
            yield f"{its} {root:.3g} times as large as {noise}: {wrong} {why}."
