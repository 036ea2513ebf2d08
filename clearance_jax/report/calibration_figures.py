"""Figures of a calibration: measured and fitted signals, intervals, correlations."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from clearance_jax.calibrate.result import Calibration
from clearance_jax.report.design_figures import HEIGHT, PAGE, WIDTH
from clearance_jax.report.panels import time_axis
from clearance_jax.report.style import BLUE, RED, legend_outside, length_unit, new_figure

# Most letters of a name beside an axis.
SHORT = 22


def _short(name: str) -> str:
    return name if len(name) <= SHORT else f"...{name[3 - SHORT :]}"


def _unit_of(signal: xr.DataArray, largest: float) -> tuple[float, str]:
    unit = str(signal.attrs["units"])
    return length_unit(largest) if unit == "m" else (1.0, unit)


@PAGE
def signal_fit(calibration: Calibration, name: str) -> Figure:
    """A measured and fitted signal over time; below it the residuals, with two deviations of the noise."""
    figure = Figure(figsize=(WIDTH, 1.4 * HEIGHT), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    measured = calibration.residuals[name]
    factor, unit = _unit_of(measured, float(np.nanmax(np.abs(measured.values))))
    times = time_axis(below, float(calibration.residuals["time"][-1])) * calibration.residuals["time"].values
    above.plot(times, factor * measured.values, ".", ms=3, color=BLUE, label="measured")
    above.plot(times, factor * calibration.residuals[f"{name}_model"].values, lw=0.9, color=RED, label="fitted")
    above.set_ylabel(f"{_short(name)}" + (f", {unit}" if unit else ""))
    noise = calibration.noise[name]
    factor, unit = _unit_of(measured, noise)
    below.axhspan(-2 * factor * noise, 2 * factor * noise, color="0.9", lw=0, zorder=0)
    below.plot(times, factor * calibration.residuals[f"{name}_residual"].values, ".", ms=3, color=BLUE)
    below.set_ylabel("residual" + (f", {unit}" if unit else ""))
    legend_outside(figure, 2)
    return figure


@PAGE
def interval_widths(calibration: Calibration) -> Figure:
    """The widths of the 95 % intervals relative to their numbers, cut off at 100 %."""
    names = list(calibration.values)
    figure, axes = new_figure(WIDTH, 1.0 + 0.4 * len(names))
    for row, name in enumerate(names):
        low, high = np.array(calibration.intervals[name])
        size = abs(calibration.values[name]) or 1.0
        half = 100 * (high - low) / 2 / size
        axes.errorbar(0.0, row, xerr=min(half, 100.0), fmt="o", ms=4, capsize=3, color=BLUE)
        known = f"{_short(name)}: " + ("not determined" if name in calibration.undetermined else f"± {half:.2g} %")
        axes.annotate(known, (0, row - 0.18), xytext=(0, 0), textcoords="offset points", ha="center", va="bottom")
    axes.set(yticks=[], xlabel="half of the interval, % of the number", ylim=(len(names) - 0.5, -0.8))
    return figure


@PAGE
def correlations(calibration: Calibration) -> Figure:
    """The correlation of every pair of numbers."""
    names = [str(name) for name in calibration.correlation["parameter"].values]
    figure, axes = new_figure(WIDTH, 1.2 + 0.45 * len(names))
    axes.imshow(calibration.correlation.values, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    for i, line in enumerate(calibration.correlation.values):
        for k, value in enumerate(line):
            axes.text(k, i, f"{value:.2f}", ha="center", va="center", color="w" if abs(value) > 0.6 else "k")
    numbers = [str(i + 1) for i in range(len(names))]
    axes.set_xticks(range(len(names)), numbers)
    axes.set_yticks(range(len(names)), [f"{_short(name)} {n}" for n, name in zip(numbers, names, strict=True)])
    axes.grid(False)
    return figure
