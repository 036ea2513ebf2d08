"""Figures of a design: errors over time, contributions, trade-off, convergence, paths of pins."""

import textwrap
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.design.answer import Design
from clearance_jax.design.explain import Maintenance, Response, Tradeoff
from clearance_jax.design.standings import TimeHistory
from clearance_jax.report.panels import time_axis
from clearance_jax.report.play_figures import draw_path
from clearance_jax.report.style import legend_below
from clearance_jax.report.wear_figures import draw_lives
from clearance_jax.results.play import middle_path, play

# As wide as a phone shows it: text of 9 points is then 12 pixels high, and of the same size in every figure.
WIDTH, HEIGHT = 3.6, 2.6
STYLED = mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 9, "legend.fontsize": 9})
# Characters of a label that fit along the figure's height and width.
UPRIGHT, LEVEL = 30, 44


def new_figure(height: float = HEIGHT) -> tuple[Figure, Axes]:
    """A figure of the report's width, with one pair of axes."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots()


def _objective(design: Design) -> tuple[float, str]:
    """Factor on the objective, and what it is called."""
    if not design.specification.common:
        return 1.0, f"cost ({design.specification.cost_unit})"
    factor, unit = _scale(next(iter(design.units.values())))
    return -factor, f"clearance, {unit}" if unit == "µm" else f"largest value, {unit}"


def _scale(unit: str) -> tuple[float, str]:
    return (1e6, "µm") if unit == "m" else (1.0, unit)


def _label(text: str, unit: str, width: int) -> str:
    return textwrap.fill(text + (f", {unit}" if unit else ""), width)


@STYLED
def over_time(history: TimeHistory) -> Figure:
    """The signal of a limit over time in every condition, with its bound; times that do not count are shaded."""
    figure, axes = new_figure()
    factor, unit = _scale(history.unit)
    per_second = time_axis(axes, float(history.times[-1]))
    times = per_second * history.times
    for name, values in history.values.items():
        axes.plot(times, factor * values, lw=0.8, label=name or None)
    bound = f"bound on its {history.reduction}" if history.reduction else "bound"
    axes.axhline(factor * history.bound, color="k", ls="--", lw=0.8, label=bound)
    if history.since is not None:
        axes.axvspan(times[0], per_second * history.since, color="0.9", lw=0, zorder=0, label="does not count")
    axes.set_ylabel(_label(history.signal, unit, UPRIGHT))
    figure.legend(loc="outside lower center", ncol=2)
    return figure


@STYLED
def contributions(why: Sequence[Response]) -> Figure:
    """Shares of the clearances in each limit's value, to first order, and the rest."""
    names = [*why[0].contributions, "the rest"]
    figure, axes = new_figure(0.8 + 0.55 * len(why) + 0.18 * len(names))
    colours = [f"C{i}" for i in range(10)]
    for row, response in enumerate(why):
        ends = [0.0, 0.0]  # negative parts to the left, the others to the right
        for i, part in enumerate([*response.contributions.values(), response.rest]):
            share = 100 * response.share(part)
            side = int(share >= 0)
            colour = "0.75" if i == len(names) - 1 else colours[i % 10]
            axes.barh(row, share, 0.5, left=ends[side], color=colour, label=names[i] if row == 0 else None)
            ends[side] += share
        axes.annotate(response.limit, (0, row - 0.3), xytext=(4, 0), textcoords="offset points", va="bottom")
    axes.axvline(100, color="k", ls="--", lw=0.8)
    # Names stand above the bars: beside them they would leave no room on a phone.
    axes.set(yticks=[], xlabel="share of the bound, %", ylim=(len(why) - 0.6, -0.75))
    figure.legend(loc="outside lower center")
    return figure


@STYLED
def trade(tradeoff: Tradeoff, design: Design) -> Figure:
    """The cost, or the clearance, that each bound allows."""
    figure, axes = new_figure()
    factor, unit = _scale(tradeoff.unit)
    times, label = _objective(design)
    axes.plot(factor * tradeoff.bounds, times * tradeoff.objectives, "o-", lw=1)
    axes.plot([factor * tradeoff.asked], [times * design.objective], "k*", ms=12, label="the design")
    axes.set(xlabel=_label(f"bound on {tradeoff.label}", unit, LEVEL), ylabel=label)
    legend_below(axes)
    return figure


@STYLED
def intervals(maintenance: Maintenance, design: Design) -> Figure:
    """After how many cycles a limit is met, against the clearance; or against the share of the designed ones."""
    figure, axes = new_figure()
    places, label = maintenance.shares, "clearances, share of the design"
    if len(design.specification.names) == 1:
        factor, unit = _scale(next(iter(design.units.values())))
        places = factor * maintenance.shares * next(iter(design.clearances.values()))
        label = f"clearance, {unit}" if unit == "µm" else f"{design.specification.names[0]}, {unit}"
    for name, lives in maintenance.lives.items():
        draw_lives(axes, places, lives, maintenance.most, name)
    axes.axhline(maintenance.asked, color="k", ls="--", lw=0.8, label="asked for")
    axes.set(xlabel=label, ylabel="cycles of wear", ylim=(0, None))
    figure.legend(loc="outside lower center", ncol=2)
    return figure


@STYLED
def convergence(design: Design) -> Figure:
    """Cost (or clearance) of each evaluated design; those that violate a limit have another mark."""
    figure, axes = new_figure()
    points, (times, label) = design.program.history, _objective(design)
    values = times * np.array([p.objective for p in points])
    feasible = np.array([p.feasible for p in points])
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    number = np.arange(1, len(points) + 1)
    for chosen, style, what in ((feasible, "o", "holds all limits"), (~feasible, "x", "violates one")):
        if np.any(chosen):
            axes.plot(number[chosen], values[chosen], style, ms=4, label=what)
    axes.set(xlabel="evaluation", ylabel=label)
    if 0 < 10 * values.min() < values.max():
        axes.set_yscale("log")
    figure.legend(loc="outside lower center", ncol=2)
    return figure


@STYLED
def pin_in_sleeve(dataset: xr.Dataset, joint: str) -> Figure:
    """The path of a pin's centre inside the clearance circle, and its contacts. Of a pin that tilts the paths of both
    ends of its axis. Of a pin with axial play also its axial position over time.
    """
    pin, path = play(dataset, joint), middle_path(dataset, joint)
    if pin is None or pin.outline.axial is None:
        figure, axes = new_figure(3.6)
    else:
        figure = Figure(figsize=(WIDTH, 4.9), layout="constrained")
        axes, below = figure.subplots(2, height_ratios=(3, 1))
        _along_the_sleeve(below, path.time, pin.place[:, 2], pin.outline.axial)
    states = {0: ("path", "0.6"), 1: ("in contact", "tab:red")}
    if pin is not None and pin.outline.length is not None:  # an end beyond the circle is in contact
        states = {}
        ends = pin.centres(pin.outline.heights[[0, -1]])
        for k, name in enumerate(("end at −z", "end at +z")):
            axes.plot(*(1e6 * ends[:, k].T), lw=0.8, label=name)
    draw_path(axes, path, states)
    axes.set(xlabel="along the sleeve's x, µm", ylabel="along its y, µm")
    figure.legend(loc="outside lower center", ncol=3, columnspacing=1, handlelength=1.2)
    return figure


def _along_the_sleeve(axes: Axes, times: np.ndarray, places: np.ndarray, clearance: float) -> None:
    axes.plot(time_axis(axes, float(times[-1])) * times, 1e6 * places, lw=0.8)
    for side in (-1, 1):
        axes.axhline(side * 1e6 * clearance, color="k", ls="--", lw=0.8)
    axes.set_ylabel("along z, µm")
