"""Figures of a design and its mechanism: errors, contributions, trade-off, convergence, pins; of an error budget."""

import itertools
import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.design.answer import Design
from clearance_jax.design.judge.budget import WAVES, ErrorBudget
from clearance_jax.design.judge.explain import Maintenance, Response, Tradeoff
from clearance_jax.design.judge.observed import TimeHistory
from clearance_jax.report import style
from clearance_jax.report.panels import instant, time_axis
from clearance_jax.report.play_figures import draw_path, timeline
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import STYLED, legend_below, legend_outside, length_unit, look, new_figure, round_down
from clearance_jax.report.wear_figures import draw_lives
from clearance_jax.results.places import Outline, bounds, places
from clearance_jax.results.play import middle_path, play

# As wide as a phone shows it: text of 9 points is then 12 pixels high, and of the same size in every figure.
WIDTH, HEIGHT = 3.6, 2.6
PAGE = mpl.rc_context(style.STYLE | {"legend.fontsize": 9})
# Characters of a label that fit along the figure's height and width.
UPRIGHT, LEVEL = 30, 44
# The height of a line of a legend [inch].
ENTRY = 0.2
# Of the picture of a mechanism: its least and greatest height [inch].
LOW, HIGH = 1.5, 4.2
# Relative to the mechanism's size: distance below which places share a label, and margin for labels.
SAME, ROOM = 0.02, 0.2
# Labels [point]: height of a line, width of a character, distance from the labelled place.
LINE, CHARACTER, OFF = 11.0, 5.6, 9.0
# Sides on which a label may stand, the best first; half the size of a joint's mark [point]; points spread over a label.
SIDES = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1)])
MARK, SPREAD = 8.0, np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 5)), -1).reshape(-1, 2)
# Of an error budget: the size of the mark of the largest share [point]. Areas of marks are proportional to shares.
LARGEST = 34.0
# Words and colours of the models of an error budget.
MODELS = {"dynamics": ("dynamics", style.RED), "quasi_static": ("quasi-static", "k")}
MODELS |= {"play": ("play alone", style.BLUE), "elasticity": ("elasticity alone", style.ORANGE)}
MODELS |= {WAVES: ("transmission error alone", style.GREEN)}


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


@PAGE
def over_time(history: TimeHistory) -> Figure:
    """The signal of a limit over time in every condition, with its bound; times that do not count are shaded."""
    factor, unit = _scale(history.unit)
    last, counts = float(history.times[-1]), history.times >= (-np.inf if history.since is None else history.since)
    nearest, labels = [], []
    for name, values in history.values.items():
        k = int(np.nanargmin(np.where(counts, np.abs(history.bound - values), np.inf)))
        nearest.append(k)
        labels.append(f"{name or 'the design'}: {factor * values[k]:.4g} {unit} at {instant(history.times[k], last)}")
    # For further lines of the legend the axes give no height away: their label needs it.
    lines = sum(style.fit(text, WIDTH - 0.9).count("\n") + 1 for text in labels)
    figure, axes = new_figure(WIDTH, HEIGHT + ENTRY * (lines + (history.since is not None)))
    per_second = time_axis(axes, last)
    times = per_second * history.times
    for k, values in enumerate(history.values.values()):
        # The mark is where the signal is nearest to its bound.
        how = {"lw": 0.8, "ms": 5, "mfc": "white", "markevery": [nearest[k]]} | look(k)
        axes.plot(times, factor * values, label=labels[k], **how)
    bound = f"bound on its {history.reduction}" if history.reduction else "bound"
    axes.axhline(factor * history.bound, color="k", ls="--", lw=0.8, label=bound)
    if history.since is not None:
        axes.axvspan(times[0], per_second * history.since, color="0.9", lw=0, zorder=0, label="does not count")
    axes.set_ylabel(_label(history.signal, unit, UPRIGHT))
    legend_outside(figure, 2)
    return figure


@PAGE
def contributions(why: Sequence[Response]) -> Figure:
    """Shares of the clearances in each limit's value, to first order, and the rest."""
    names = [*why[0].contributions, "the rest"]
    titles = [style.fit(response.limit, WIDTH - 0.4) for response in why]
    row_height = 0.55 + ENTRY * max(text.count("\n") for text in titles)
    figure, axes = new_figure(WIDTH, 0.8 + row_height * len(why) + 0.18 * len(names))
    for row, response in enumerate(why):
        ends = [0.0, 0.0]  # negative parts to the left, the others to the right
        for i, part in enumerate([*response.contributions.values(), response.rest]):
            share = 100 * response.share(part)
            side = int(share >= 0)
            colour = "0.75" if i == len(names) - 1 else style.COLOURS[i % len(style.COLOURS)]
            axes.barh(row, share, 0.5, left=ends[side], color=colour, label=names[i] if row == 0 else None)
            ends[side] += share
        axes.annotate(titles[row], (0, row - 0.3), xytext=(4, 0), textcoords="offset points", va="bottom")
    axes.axvline(100, color="k", ls="--", lw=0.8)
    # Names stand above the bars: beside them they would leave no room on a phone.
    axes.set(yticks=[], xlabel="share of the bound, %", ylim=(len(why) - 0.6, -0.75))
    legend_outside(figure, 1)
    return figure


@PAGE
def trade(tradeoff: Tradeoff, design: Design) -> Figure:
    """The cost, or the clearance, that each bound allows."""
    figure, axes = new_figure(WIDTH, HEIGHT)
    factor, unit = _scale(tradeoff.unit)
    times, label = _objective(design)
    axes.plot(factor * tradeoff.bounds, times * tradeoff.objectives, "o-", lw=1)
    axes.plot([factor * tradeoff.asked], [times * design.objective], "k*", ms=12, label="the design")
    axes.set(xlabel=_label(f"bound on {tradeoff.label}", unit, LEVEL), ylabel=label)
    legend_outside(figure, 1)
    return figure


@PAGE
def intervals(maintenance: Maintenance, design: Design) -> Figure:
    """After how many cycles a limit is met, against the clearance; or against the share of the designed ones."""
    # A condition has up to three lines of the legend.
    figure, axes = new_figure(WIDTH, HEIGHT + 3 * ENTRY * (len(maintenance.lives) - 1))
    places, label = maintenance.shares, "clearances, share of the design"
    if len(design.specification.names) == 1:
        factor, unit = _scale(next(iter(design.units.values())))
        places = factor * maintenance.shares * next(iter(design.clearances.values()))
        label = f"clearance, {unit}" if unit == "µm" else f"{design.specification.names[0]}, {unit}"
    for name, lives in maintenance.lives.items():
        draw_lives(axes, places, lives, maintenance.most, name)
    axes.axhline(maintenance.asked, color="k", ls="--", lw=0.8, label="asked for")
    axes.set(xlabel=label, ylabel="cycles of wear", ylim=(0, None))
    legend_outside(figure, 2)
    return figure


@PAGE
def convergence(design: Design) -> Figure:
    """Cost (or clearance) of each evaluated design; those that violate a limit have another mark."""
    figure, axes = new_figure(WIDTH, HEIGHT)
    points, (times, label) = design.program.history, _objective(design)
    values = times * np.array([p.objective for p in points])
    feasible = np.array([p.feasible for p in points])
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    number = np.arange(1, len(points) + 1)
    for chosen, mark, what in ((feasible, "o", "holds all limits"), (~feasible, "x", "violates one")):
        if np.any(chosen):
            axes.plot(number[chosen], values[chosen], mark, ms=4, label=what)
    axes.set(xlabel="evaluation", ylabel=label)
    axes.axhline(times * design.objective, color="k", ls="--", lw=0.8, label="the design")
    if 0 < 10 * values.min() < values.max():
        axes.set_yscale("log")
    legend_outside(figure, 2)
    return figure


@PAGE
def pin_in_sleeve(dataset: xr.Dataset, joint: str) -> Figure:
    """The path of a pin's centre inside the clearance circle, and its contacts. Of a pin that tilts the paths of both
    ends of its axis. Of a pin with axial play also its axial position over time.
    """
    pin, path = play(dataset, joint), middle_path(dataset, joint)
    if pin is None or pin.outline.axial is None:
        figure, axes = new_figure(WIDTH, 3.6)
    else:
        figure = Figure(figsize=(WIDTH, 4.9), layout="constrained")
        axes, below = figure.subplots(2, height_ratios=(3, 1))
        below.plot(time_axis(below, float(path.time[-1])) * path.time, 1e6 * pin.place[:, 2], lw=0.8)
        for side in (-1, 1):
            below.axhline(side * 1e6 * pin.outline.axial, color="k", ls="--", lw=0.8)
        below.set_ylabel("along z, µm")
    states = {0: ("path", "0.6", ""), 1: ("in contact", style.RED, "o")}
    if pin is not None and pin.outline.length is not None:  # an end beyond the circle is in contact
        states = {}
        ends = pin.centres(pin.outline.heights[[0, -1]])
        for k, (name, dashes) in enumerate((("end at −z", "-"), ("end at +z", "--"))):
            axes.plot(*(1e6 * ends[:, k].T), dashes, lw=0.8, label=name)
    draw_path(axes, path, states)
    axes.set(xlabel="along the sleeve's x, µm", ylabel="along its y, µm")
    legend_outside(figure, 3)
    return figure


@PAGE
def bearing(dataset: xr.Dataset, joints: list[str]) -> Figure:
    """When pins of these joints bear and when they are apart."""
    figure, axes = new_figure(WIDTH, 1.2 + 0.3 * len(joints))
    timeline(axes, dataset, joints)
    return figure


@PAGE
def mechanism(outline: Outline) -> Figure:
    """The mechanism at one instant."""
    low, high = bounds(outline.visible)
    size = float(max(high - low))
    width, height = high - low + 2 * ROOM * size
    figure, axes = new_figure(WIDTH, float(np.clip(WIDTH * height / width, LOW, HIGH)))
    # The whole page is the axes': names are placed in points, which no layout may move afterwards.
    figure.set_layout_engine("none")
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    Skeleton(axes, outline.places, whole=True).show(outline.sample)
    # One scale both ways: what is left of the page lies around the mechanism.
    page = float(max(width / WIDTH, height / figure.get_figheight())) * figure.get_size_inches()
    left, bottom = 0.5 * (low + high - page)
    axes.set(xlim=(left, left + page[0]), ylim=(bottom, bottom + page[1]))
    _write_names(figure, axes, outline, SAME * size)
    # A bar of a round length below the mechanism.
    length = round_down(0.4 * size)
    text = f"{1e3 * length:g} mm" if length < 1 else f"{length:g} m"
    left, bottom = left + 0.03 * size, bottom + 0.05 * size
    axes.plot([left, left + length], [bottom, bottom], color="k", lw=2, solid_capstyle="butt")
    axes.annotate(text, (left + length, bottom), (5, 0), textcoords="offset points", va="center")
    return figure


def _write_names(figure: Figure, axes: Axes, outline: Outline, same: float) -> None:
    """Write names beside their places, those of one place together, where they hide least."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    places = outline.places.at[outline.sample]
    for name, mark in {**outline.places.joints, **outline.places.points}.items():
        near = next((names for at, names in groups if np.hypot(*(at - places[mark])) < same), None)
        if near is None:
            groups.append((places[mark], [name]))
        else:
            near.append(name)
    figure.draw_without_rendering()  # from here on the axes know where they are
    scale, page, along = 72 / figure.dpi, 72 * figure.get_size_inches(), np.linspace(0, 1, 25)[:, None]
    at = [scale * axes.transData.transform(where) for where, _ in groups]
    # Points of the page that names would hide: of joints, bodies, other names.
    taken = [middle + MARK * SPREAD for middle in at]
    for marks in outline.places.bodies.values():
        taken += [a + along * (b - a) for a, b in itertools.pairwise(scale * axes.transData.transform(places[marks]))]
    for middle, (where, names) in zip(at, groups, strict=True):
        half = np.array([CHARACTER * max(map(len, names)), LINE * len(names)]) / 2
        sides = [np.clip(middle + side * (OFF + half), half, page - half) for side in SIDES]
        hidden = [np.sum(np.all(np.abs(np.concatenate(taken) - side) < half, axis=1)) for side in sides]
        best = sides[int(np.argmin(hidden))]
        taken.append(best + half * SPREAD)
        axes.annotate(
            "\n".join(names), where, best - middle, textcoords="offset points", ha="center", va="center", zorder=5,
            linespacing=1.1, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )  # fmt: skip


@STYLED
def budget_figure(budget: ErrorBudget) -> Figure:
    """Three panels: the mechanism when its quasi-static error is largest, with marks by the joints' shares; the shares
    with their parts by play and by elasticity; the errors of each model over time.
    """
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(1.1, 1.0, 1.1))
    dataset = budget.dataset.drop_dims("axis").rename(page_axis="axis")
    placed = places(dataset)
    left = figure.add_subplot(grid[0], **({"projection": "3d"} if placed.at.shape[-1] == 3 else {}))
    _robot(left, budget, placed)
    _joint_shares(figure.add_subplot(grid[1]), budget)
    _over_time(figure.add_subplot(grid[2]), budget)
    figure.suptitle(f"What the error of `{budget.point}` is made of")
    return figure


def _robot(axis: Any, budget: ErrorBudget, placed: Any) -> None:
    k, shares = int(budget.dataset.quasi_static.values.argmax()), budget.shares
    Skeleton(axis, placed, whole=True).show(k)
    largest = max(abs(share) for share in shares.values())
    for name, joint in budget.drawn_at.items():
        size = LARGEST * np.sqrt(abs(shares[name]) / largest) if largest > 0 else 0.0
        place = placed.at[k, placed.joints[joint]][None].T
        axis.plot(*place, marker="o", ms=size, mfc=style.RED, mec="none", alpha=0.35, zorder=6)
    axis.set_title(f"shares at {budget.peak_time:.3g} s (areas)", fontsize=10)


def _joint_shares(axis: Any, budget: ErrorBudget) -> None:
    shares, play, waves = budget.shares, budget.play_shares, budget.transmission_shares
    names = sorted(shares, key=lambda name: abs(shares[name]))
    factor, unit = length_unit(max(abs(share) for share in shares.values()))
    rows = np.arange(len(names))
    total, rigid, wave = (factor * np.array([part[name] for name in names]) for part in (shares, play, waves))
    parts, begin = {"play": rigid, "elasticity": total - rigid - wave, WAVES: wave}, np.zeros(len(names))
    for what, part in parts.items():
        if what in budget.peaks:
            axis.barh(rows, part, 0.55, left=begin, color=MODELS[what][1], label=what.replace("_", " "))
            begin = begin + part
    axis.set_yticks(rows, names)
    axis.set(xlabel=f"share of the peak, {unit}")
    axis.set_title("by joint", fontsize=10)
    legend_below(axis, 2)


def _over_time(axis: Any, budget: ErrorBudget) -> None:
    times = budget.dataset.time.values
    per_second = time_axis(axis, float(times[-1]))
    factor, unit = length_unit(max(peak for peak in budget.peaks.values() if np.isfinite(peak)))
    for name, (label, colour) in MODELS.items():
        if name in budget.dataset and np.isfinite(values := budget.dataset[name].values).all():
            axis.plot(per_second * times, factor * values, color=colour, lw=1.2, label=label)
    axis.set(ylabel=f"error of {budget.point}, {unit}")
    axis.set_title("over time", fontsize=10)
    legend_below(axis, 2)
