"""Figures of a sweep: heat maps, curves with bands, response surfaces, parallel coordinates, sensitivity indices."""

import itertools
import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report import sweep_axes as sweep
from clearance_jax.report.recurrence_figures import bifurcation, exponents, section, sections
from clearance_jax.report.style import BLUE, ORANGE, STYLED, legend_below, legend_outside, look, new_figure, panel_grid
from clearance_jax.results.sobol import Indices

COLOURS, FAILED = "viridis", "0.8"
# Most panels of a heat map, curves of different colours, bins of a scattered axis, lines of parallel coordinates.
PANELS, CURVES, BINS, LINES = 6, 6, 24, 2000
# Of a figure with one panel [inch]: on 390 pixels its text is 10 pixels high.
WIDTH = 4.8
# Bands: lower and upper quantile, opacity; the opacity where there are several curves.
BANDS, FAINT = ((0.05, 0.95, 0.18), (0.25, 0.75, 0.35)), 0.12


def figures(
    dataset: xr.Dataset, indices: Mapping[str, Indices] | None = None, local: Mapping[str, Mapping] | None = None
) -> dict[str, Figure]:
    """All figures that fit a sweep, by name.

    For each result that is one number a lane: a heat map and a response surface over the first two axes, or a curve
    over the only one, bands over every number that scatters, and parallel coordinates. For Poincare sections and
    Lyapunov exponents: bifurcation diagrams, sections and exponents.

    **Arguments:** `dataset`: of a sweep; `indices`: sensitivity indices of results, by their names; `local`: their
    derivatives by every number.

    **Raises:** `ClearanceError` for a dataset that is no sweep, or in which no sample has a result.
    """
    recurrences = (dataset.filter_by_attrs(metric=kind) for kind in ("PoincareSection", "LyapunovExponent"))
    kinds = sweep.results(dataset), *([str(name) for name in seen.data_vars] for seen in recurrences)
    dataset = sweep.tidy(dataset[[sweep.CODE, *itertools.chain(*kinds)]].load())  # a store is read once
    numbers = [name for name in sweep.variables(dataset) if dataset[name].size > 1]
    axes = [name for name in sweep.lanes_of(dataset) if name in numbers]
    plain, points, rates = ([name for name in names if np.isfinite(dataset[name].values).any()] for names in kinds)
    if not numbers or not (plain or points or rates):
        raise ClearanceError("There is nothing to draw: nothing varies in this sweep, or no sample has a result.")
    plain, out = [name for name in plain if name not in rates], {}
    for name in plain:
        if len(axes) >= 2:
            out[f"{name}: heat map"] = heat_map(dataset, name)
            out[f"{name}: response surface"] = response_surface(dataset, name)
        out |= {f"{name} over {axis}": curves(dataset, name, axis) for axis in numbers}
    if plain and len(numbers) >= 2:
        out["parallel coordinates"] = parallel_coordinates(dataset, plain[-1])
    exponent = rates[0] if rates else None
    for name in points:
        for axis in numbers:
            out[f"{name}: bifurcations over {axis}"] = bifurcation(dataset, name, axis, exponent)
        if len(section(dataset, name)) > 1:
            out[f"{name}: Poincare sections"] = sections(dataset, name, exponent=exponent)
    for name in rates:
        out |= {f"{name} over {axis}": exponents(dataset, name, axis) for axis in numbers}
    for name, sobol in (indices or {}).items():
        out[f"{name}: sensitivity indices"] = sensitivities(sobol, (local or {}).get(name), sweep.words(name))
    return out


def _grid(dataset: xr.Dataset, name: str, x: str | None, y: str | None) -> tuple[str, str, xr.DataArray]:
    axes = [dim for dim in sweep.lanes_of(dataset) if dim in sweep.variables(dataset) and dataset.sizes[dim] > 1]
    if len(axes) < 2:
        raise ClearanceError(f"This sweep has {len(axes)} axes: a picture of `{name}` over two takes a grid of two.")
    x = axes[0] if x is None else x
    y = next(dim for dim in axes if dim != x) if y is None else y
    for axis in (x, y):
        if axis not in axes:
            raise ClearanceError(f"`{axis}` is no axis of this grid. Its axes: {', '.join(axes)}.")
    return x, y, sweep.result(dataset, name)


@STYLED
def heat_map(dataset: xr.Dataset, name: str, x: str | None = None, y: str | None = None) -> Figure:
    """A result over two axes of a grid, as colours. A third axis makes panels; of further axes the middle is shown.
    Lanes that failed, or have not been run yet, are grey.

    **Arguments:** `dataset`: of a sweep; `name`: of the result; `x`, `y`: names of the axes, by default the first two.
    """
    dataset = sweep.tidy(dataset)
    x, y, values = _grid(dataset, name, x, y)
    others = [dim for dim in sweep.lanes_of(dataset) if dim not in (x, y)]
    middle = {dim: dataset.sizes[dim] // 2 for dim in others[1:]}
    shown = sweep.spread_places(dataset.sizes[others[0]], PANELS) if others else []
    places = [{others[0]: k} | middle for k in shown] or [{}]
    columns = 2 if len(places) == 4 else min(3, len(places))
    rows = -(-len(places) // columns)
    size = (WIDTH, 3.9) if len(places) == 1 else (3.4 * columns + 0.8, 2.9 * rows + 0.2)
    figure = Figure(figsize=size, layout="constrained")
    panels = panel_grid(figure, len(places), columns, sharex=True, sharey=True)
    across, up, of = sweep.axis_scale(dataset, x), sweep.axis_scale(dataset, y), sweep.display(values)
    norm = Normalize(*(of.factor * f(values.values) for f in (np.nanmin, np.nanmax)))
    for panel, place in zip(panels.ravel(), places, strict=False):
        cells = of.factor * values.isel(place).transpose(y, x).values
        panel.grid(visible=False)
        edges = across.factor * dataset[x].values, up.factor * dataset[y].values
        panel.pcolormesh(*edges, cells, norm=norm, cmap=COLOURS, shading="nearest", rasterized=True)
        panel.set(facecolor=FAILED, xscale=sweep.scale(edges[0]), yscale=sweep.scale(edges[1]))
        panel.set_title(textwrap.fill(sweep.place_words(dataset, place), 38), fontsize=9)
    for panel in panels[-1]:
        panel.set_xlabel(across.label)
    for panel in panels[:, 0]:
        panel.set_ylabel(up.label)
    figure.colorbar(ScalarMappable(norm, COLOURS), ax=panels, label=of.label)
    counts = zip(sweep.endings(dataset), ("failed", "not run yet"), strict=True)
    missing = " and ".join(f"{count} {what}" for count, what in counts if count)
    told = [f"of {values.size} samples {missing} (grey)"] if missing else []
    if others and len(shown) < dataset.sizes[others[0]]:
        told.append(f"{len(shown)} of {dataset.sizes[others[0]]} values of {sweep.title_of(dataset, others[0])}")
    if told:
        figure.suptitle("\n".join(told), fontsize=9)
    return figure


@STYLED
def response_surface(dataset: xr.Dataset, name: str, x: str | None = None, y: str | None = None) -> Figure:
    """A result as a surface over two axes of a grid, with its level lines below. Of other axes the middle is shown.

    **Arguments:** `dataset`: of a sweep; `name`: of the result; `x`, `y`: names of the axes, by default the first two.
    """
    dataset = sweep.tidy(dataset)
    x, y, values = _grid(dataset, name, x, y)
    place = {dim: dataset.sizes[dim] // 2 for dim in sweep.lanes_of(dataset) if dim not in (x, y)}
    across, up, of = sweep.axis_scale(dataset, x), sweep.axis_scale(dataset, y), sweep.display(values)
    height = of.factor * values.isel(place).transpose(y, x).values
    where = np.meshgrid(across.factor * dataset[x].values, up.factor * dataset[y].values)
    figure = Figure(figsize=(WIDTH + 0.6, 4.6), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    drawn = axes.plot_surface(*where, height, cmap=COLOURS, lw=0.2, edgecolor="0.3", rstride=1, cstride=1, alpha=0.95)
    low, high = np.nanmin(height), np.nanmax(height)
    floor = low - 0.25 * (high - low if high > low else 1.0)
    if min(height.shape) > 1 and high > low:
        axes.contour(*where, np.ma.masked_invalid(height), levels=8, zdir="z", offset=floor, cmap=COLOURS)
    axes.set_zlim(floor, None)
    axes.set_xlabel(across.label, labelpad=8)
    axes.set_ylabel(up.label, labelpad=8)
    # Below the surface there is nothing to be read off.
    axes.set_zticks([tick for tick in MaxNLocator(nbins=6).tick_values(low, high) if low <= tick <= high])
    axes.view_init(elev=26, azim=-128)
    axes.set_box_aspect(None, zoom=0.85)  # or labels would leave the page
    figure.colorbar(drawn, ax=axes, shrink=0.7, pad=0.02, label=of.label)
    axes.set_title(textwrap.fill(sweep.place_words(dataset, place), 60), fontsize=9)
    return figure


@STYLED
def curves(dataset: xr.Dataset, name: str, x: str | None = None, by: str | None = None) -> Figure:
    """A result over one number: its median, and bands between its quantiles over all else that varies. If another axis
    of the grid has few values, there is a curve for each of them.

    **Arguments:** `dataset`: of a sweep; `name`: of the result; `x`: name of the number, by default the first that
    varies; `by`: name of an axis whose values have a curve each.
    """
    dataset = sweep.tidy(dataset)
    x = sweep.variables(dataset)[0] if x is None else x
    figure, axes = new_figure(WIDTH, 3.9)
    draw_curves(axes, dataset, name, x, by)
    return figure


def draw_curves(axes: Any, dataset: xr.Dataset, name: str, x: str, by: str | None = None) -> None:
    """Draw `curves` on given axes."""
    if by is None:
        few = [dim for dim in sweep.lanes_of(dataset) if dim != x and 1 < dataset.sizes[dim] <= CURVES]
        by = few[0] if x in sweep.lanes_of(dataset) and few else None
    across, of = sweep.axis_scale(dataset, x), sweep.display(sweep.result(dataset, name))
    places = [None] if by is None else sweep.spread_places(dataset.sizes[by], CURVES)
    for i, k in enumerate(places):
        part = dataset if k is None else dataset.isel({by: [k]})
        label = None if by is None or k is None else sweep.value_words(dataset, by, k)
        _band(axes, part, name, x, across, of, look(i), label, alone=len(places) == 1)
    scale = sweep.scale(dataset[x].values) if x in sweep.lanes_of(dataset) else "linear"
    axes.set(xlabel=across.label, ylabel=of.label, xscale=scale)
    axes.margins(x=0.01)
    if axes.get_legend_handles_labels()[0]:
        legend_below(axes, title=None if by is None else sweep.title_of(dataset, by))


def _band(
    axes: Any, part: xr.Dataset, name: str, x: str, across: Any, of: Any, how: dict[str, Any], label: Any, alone: bool
) -> None:
    """Draw the medians as a curve, with quantile bands where a place has several results."""
    where, values = sweep.of_lanes(part, sweep.number(part, x)), sweep.of_lanes(part, sweep.result(part, name))
    places, groups = _groups(where, values, on_axis=x in part.dims)
    middles = np.array([np.median(group) if group.size else np.nan for group in groups])
    spread = max(group.size for group in groups) > 1
    if spread:
        # Bands of several curves lie over one another: of these the inner ones.
        for low, high, dark in BANDS if alone else BANDS[1:]:
            edges = [np.quantile(group, [low, high]) if group.size else [np.nan] * 2 for group in groups]
            told = f"{low:.0%} to {high:.0%} of the samples" if alone else None
            below, above = of.factor * np.array(edges).T
            filled = {"alpha": dark if alone else FAINT, "lw": 0, "label": told}
            axes.fill_between(across.factor * places, below, above, color=how["color"], **filled)
    told = "median" if spread and label is None else label
    how = how | {"lw": 1.2, "ms": 4, "markevery": max(1, len(places) // 12), "label": told}
    axes.plot(across.factor * places, of.factor * middles, **how)


def _groups(where: np.ndarray, values: np.ndarray, on_axis: bool) -> tuple[np.ndarray, list[np.ndarray]]:
    """Places along a number, and the finite results at each: values of an axis, or bins of equally many results."""
    if on_axis:
        places = np.unique(where)
        return places, [values[(where == place) & np.isfinite(values)] for place in places]
    order = np.argsort(where, kind="stable")
    order = order[np.isfinite(values[order])]
    bins = np.array_split(order, max(1, min(BINS, len(order) // 10)))
    return np.array([np.mean(where[members]) for members in bins]), [values[members] for members in bins]


@STYLED
def parallel_coordinates(dataset: xr.Dataset, colour: str, names: list[str] | None = None) -> Figure:
    """Every lane as a line through its numbers and results. Each of these has an axis of its own.

    **Arguments:** `dataset`: of a sweep; `colour`: the number or result that colours the lines; `names`: what has an
    axis, in this order, by default all that varies, and all results of one number a lane.
    """
    dataset = sweep.tidy(dataset)
    names = [*sweep.variables(dataset), *sweep.results(dataset)] if names is None else names
    how, columns = {}, {}
    for name in {*names, colour}:
        how[name], columns[name] = sweep.scaled(dataset, dataset[name])
    whole = np.flatnonzero(np.all([np.isfinite(values) for values in columns.values()], axis=0))
    if not whole.size:
        raise ClearanceError("There is nothing to draw: no sample has all of these results.")
    # The highest values are drawn last, on top. Of many lanes some are drawn, evenly chosen in that order.
    order = whole[np.argsort(columns[colour][whole], kind="stable")]
    order = order[sweep.spread_places(len(order), LINES)]
    figure, axes = new_figure(1.2 + 1.7 * len(names), 4.2)
    heights = []
    for i, name in enumerate(names):
        low, high = columns[name][whole].min(), columns[name][whole].max()
        heights.append((columns[name][order] - low) / (high - low if high > low else 1.0))
        axes.axvline(i, color="0.2", lw=0.8)
        for height, value, side in ((-0.02, low, "top"), (1.02, high, "bottom")):
            axes.text(i, height, f"{value:.4g}", ha="center", va=side)
    lines = np.stack([np.broadcast_to(np.arange(len(names)), (len(order), len(names))), np.stack(heights, 1)], axis=-1)
    drawn = LineCollection(list(lines), cmap=COLOURS, lw=0.7, alpha=max(0.15, min(0.8, 60 / len(order))))
    drawn.set_array(columns[colour][order])
    axes.add_collection(drawn)
    shown = [how[name] for name in names]
    labels = [axis.name.replace(" ", "\n", 1) + f",\n{axis.unit}" * bool(axis.unit) for axis in shown]
    axes.set(xlim=(-0.3, len(names) - 0.7), ylim=(-0.1, 1.1), yticks=[], xticks=range(len(names)), xticklabels=labels)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    norm = Normalize(columns[colour][order].min(), columns[colour][order].max())
    figure.colorbar(ScalarMappable(norm, COLOURS), ax=axes, label=how[colour].label)
    return figure


@STYLED
def sensitivities(found: Indices, derivatives: Mapping[str, Any] | None = None, of: str = "") -> Figure:
    """The sensitivity indices of a result as bars, with their confidence intervals, beside what local derivatives say.

    **Arguments:** `found`: what `sobol_indices` gives; `derivatives`: by every number that was varied, in SI units;
    `of`: what the result is called.
    """
    bars: list[tuple] = [("first order", found.first, found.first_interval, BLUE)]
    bars += [("total", found.total, found.total_interval, ORANGE)]
    if derivatives is not None:
        bars.append(("by local derivatives", found.linear(derivatives), None, "0.6"))
    count, height = len(found.names), 0.8 / len(bars)
    figure, axes = new_figure(WIDTH, 1.5 + 0.22 * len(bars) * count)
    for i, (label, values, interval, colour) in enumerate(bars):
        where = np.arange(count) + (i - (len(bars) - 1) / 2) * height
        axes.barh(where, values, 0.9 * height, color=colour, label=label)
        if interval is not None:
            axes.hlines(where, interval[0], interval[1], color="black", lw=0.9)
    axes.axvline(0, color="black", lw=0.8)
    axes.set(yticks=range(count), yticklabels=[sweep.words(name) for name in found.names], ylim=(count - 0.5, -0.5))
    axes.set_xlabel(f"part of the variance{f' of {of}' if of else ''}")
    axes.grid(axis="y", visible=False)
    legend_outside(figure, len(bars))
    return figure


__all__ = ["bifurcation", "curves", "exponents", "figures", "heat_map", "parallel_coordinates", "response_surface"]
__all__ += ["sections", "sensitivities"]
