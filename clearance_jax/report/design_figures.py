"""Figures of a design: errors over time, contributions, what a bound costs, how the solver came there."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.design.answer import Design
from clearance_jax.design.explain import Response, Tradeoff
from clearance_jax.design.time_histories import TimeHistory

STYLE = {"axes.grid": True, "grid.alpha": 0.3, "font.size": 10, "legend.fontsize": 9}
# Small enough to be read on a phone.
WIDTH, HEIGHT = 4.6, 3.0


def _axes() -> tuple[Figure, Axes]:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
        return figure, figure.subplots()


def _objective(design: Design) -> tuple[float, str]:
    """Factor on the objective, and what it is called."""
    if not design.specification.common:
        return 1.0, "cost"
    factor, unit = _scaled(next(iter(design.units.values())))
    return -factor, f"clearance, {unit}" if unit == "µm" else f"largest value, {unit}"


def _scaled(unit: str) -> tuple[float, str]:
    return (1e6, "µm") if unit == "m" else (1.0, unit)


def over_time(history: TimeHistory) -> Figure:
    """The signal of a limit over time in every condition, with its bound."""
    figure, axes = _axes()
    factor, unit = _scaled(history.unit)
    for name, values in history.values.items():
        axes.plot(history.times, factor * values, lw=0.8, label=name or None)
    bound = "bound" if history.metric == "Peak" else f"bound on its {history.metric}"
    axes.axhline(factor * history.bound, color="k", ls="--", lw=0.8, label=bound)
    axes.set(xlabel="time, s", ylabel=f"{history.limit}, {unit}")
    axes.legend()
    return figure


def contributions(why: Sequence[Response]) -> Figure:
    """Which clearance has how much of each limit's value, to first order, and what is left."""
    figure, axes = _axes()
    figure.set_figheight(1.1 + 0.5 * len(why) + 0.12 * len(why[0].contributions))
    names = [*why[0].contributions, "the rest"]
    colours = [f"C{i}" for i in range(10)]
    for row, response in enumerate(why):
        ends = [0.0, 0.0]  # negative parts to the left, the others to the right
        for i, part in enumerate([*response.contributions.values(), response.rest]):
            share = 100 * part / response.bound
            side = int(share >= 0)
            colour = "0.75" if i == len(names) - 1 else colours[i % 10]
            axes.barh(row, share, left=ends[side], color=colour, label=names[i] if row == 0 else None)
            ends[side] += share
    axes.axvline(100, color="k", ls="--", lw=0.8)
    axes.set(yticks=range(len(why)), yticklabels=[r.limit for r in why], xlabel="share of the bound, %")
    axes.invert_yaxis()
    figure.legend(loc="outside lower center", ncol=2)
    return figure


def trade(found: Tradeoff, design: Design) -> Figure:
    """What each bound costs, or how large a clearance it allows."""
    figure, axes = _axes()
    factor, unit = _scaled(found.unit)
    times, label = _objective(design)
    axes.plot(factor * found.bounds, times * found.objectives, "o-", lw=1)
    asked = {limit.title: limit.bound for limit in design.specification.limits}.get(found.limit, 1.0)
    axes.plot([factor * asked], [times * design.objective], "k*", ms=12, label="the design")
    axes.set(xlabel=f"bound on {found.limit}" + (f", {unit}" if unit else ""), ylabel=label)
    axes.legend()
    return figure


def convergence(design: Design) -> Figure:
    """Cost (or clearance) of each evaluated design, those that hold all limits apart from the others."""
    figure, axes = _axes()
    points, (times, label) = design.program.history, _objective(design)
    values = times * np.array([p.objective for p in points])
    held = np.array([p.feasible for p in points])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    number = np.arange(1, len(points) + 1)
    for chosen, style, what in ((held, "o", "holds all limits"), (~held, "x", "violates one")):
        if np.any(chosen):
            axes.plot(number[chosen], values[chosen], style, ms=4, label=what)
    axes.set(xlabel="evaluation", ylabel=label)
    if 0 < 10 * values.min() < values.max():
        axes.set_yscale("log")
    axes.legend()
    return figure
