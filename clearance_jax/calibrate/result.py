"""The result of a calibration."""

import dataclasses
from typing import NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.calibrate.confidence import LEVEL, Confidence
from clearance_jax.calibrate.fit import FitResult, FitTask
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
    - `correlation`: an array over parameter and parameter; `ellipsoid`: a dataset of the confidence ellipsoid's axes.
    - `residuals`: a dataset over time of the measured values, those of the fitted motion (`NAME_model`), and the
      difference (`NAME_residual`, model minus measurement).
    - `noise`: the deviation of each signal, given or estimated; `chi_square`: the sum of squared residuals over their
      deviations, by the `freedom` left (near 1 by construction where the deviations are estimated from the residuals);
      `missing`: how many numbers were NaN.
    - `notes`: doubts about the fit, in sentences; `others`: minima to which other starts led.
    - `converged`; `motions`: how many were solved with derivatives; `mechanism`: with the fitted numbers.
    """

    mechanism: Mechanism
    values: dict[str, float]
    deviations: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    units: dict[str, str]
    correlation: xr.DataArray
    ellipsoid: xr.Dataset
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

    @property
    def message(self) -> str:
        """The result in words, as it is printed."""
        lines = [f"{name} = {self.row(name)}" for name in self.values]
        count = self.freedom + len(self.values)
        gaps = f", {self.missing} missing" if self.missing else ""
        lines.append(f"{count} numbers compared{gaps}, {self.motions} motions solved, chi-square {self.chi_square:.3g}")
        for other in self.others[:TOLD]:
            at = ", ".join(
                f"{name} = {format_quantity(value, self.units[name], 4)}" for name, value in other.values.items()
            )
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
    fit, names, measurement = fits[0], task.variables.names, task.measurement
    by_name = dict(zip(names, fit.point.x.tolist(), strict=True))
    residuals = task.weigh(fit.point, fit.deviations).residuals
    freedom = residuals.size - len(names)
    return Calibration(
        mechanism,
        by_name,
        dict(zip(names, known.deviations.tolist(), strict=True)),
        {name: (float(low), float(high)) for name, (low, high) in zip(names, known.intervals, strict=True)},
        task.variables.units,
        xr.DataArray(known.correlation, {"parameter": list(names), "other": list(names)}, ("parameter", "other")),
        _ellipsoid(task, known),
        _residuals(task, fit),
        {series.name: float(size) for series, size in zip(measurement.series, fit.deviations, strict=True)},
        float(np.sum(residuals**2) / max(freedom, 1)),
        freedom,
        measurement.missing,
        tuple(name for group in known.unidentified for name in group.names),
        notes,
        tuple(_others(task, fits, known)),
        fit.converged,
        len(task.instruments.points),
    )


def _ellipsoid(task: FitTask, known: Confidence) -> xr.Dataset:
    """The dataset of the confidence ellipsoid: its axes as changes over the sizes of the numbers, and their lengths."""
    return xr.Dataset(
        {
            "axes": (("parameter", "axis"), known.axes, {"long_name": "change over the sizes, along each axis"}),
            "sizes": ("parameter", known.sizes, {"long_name": "half of the bounds' distance, or the number itself"}),
            "half_lengths": (
                "axis",
                known.lengths,
                {"long_name": f"half of each axis, of {100 * LEVEL:.0f} % confidence"},
            ),
        },
        {"parameter": list(task.variables.names)},
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
    size = known.factor * known.deviations
    undetermined = [name in {n for group in known.unidentified for n in group.names} for name in task.variables.names]
    seen, best = [fits[0]], task.cost(fits[0].point, fits[0].deviations)
    for fit in fits[1:]:
        apart = [np.abs(fit.point.x - other.point.x) / np.maximum(size, 1e-3 * np.abs(other.point.x)) for other in seen]
        if fit.converged and all(np.any(np.where(undetermined, 0.0, distances) > 1) for distances in apart):
            seen.append(fit)
            ratio = task.cost(fit.point, fits[0].deviations) / max(best, np.finfo(float).tiny)
            yield Minimum(dict(zip(task.variables.names, fit.point.x.tolist(), strict=True)), float(ratio))
