"""Figures of a sweep of a driven mechanism: bifurcation diagrams, Poincare sections, Lyapunov exponents."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report import sweep_axes as sweep
from clearance_jax.report.style import BLUE, RED, STYLED, legend_below, panel_grid

# A diagram of more points than this is drawn with smaller ones; areas of both [pt^2].
MANY, LARGE, SMALL = 20_000, 4.0, 0.5
# Most sections in a figure; most points that are drawn large; least part of the whole range that a panel shows.
MOST_SECTIONS, FEW, CLOSE = 6, 200, 0.1
# Columns of a picture: with more lanes a line would hide the points.
COLUMNS = 500
# By the sign of the exponent: colours, and words where its uncertainty is known and where it is not.
COLOURS = {-1: BLUE, 0: "0.55", 1: RED}
KNOWN = {-1: "stable: exponent negative", 0: "exponent zero within its uncertainty", 1: "chaotic: exponent positive"}
SIGNS = {-1: "exponent negative", 0: "exponent zero", 1: "exponent positive"}


def section(dataset: xr.Dataset, name: str) -> list[xr.DataArray]:
    """The quantities of a Poincare section (else it **raises**), with name and unit, over lanes and instants."""
    points = sweep.result(dataset, name)
    dims = [str(dim) for dim in points.dims if dim not in sweep.lanes_of(dataset)]
    if len(dims) == 1:
        return [points]
    if len(dims) != 2:
        text = f"`{name}` is no Poincare section: beside those of samples it has {len(dims)} dimensions, not 1 or 2."
        raise ClearanceError(text)
    units = str(points.attrs.get("units", "")).split(", ")
    units = units if len(units) == points.sizes[dims[1]] else units[:1] * points.sizes[dims[1]]
    labels = points[dims[1]].values  # where there are no labels, whole numbers
    return [
        points.isel({dims[1]: k}).rename(str(label)).assign_attrs(units=units[k], long_name=sweep.words(str(label)))
        for k, label in enumerate(labels)
    ]


@STYLED
def bifurcation(
    dataset: xr.Dataset, name: str, axis: str | None = None, exponent: str | None = None, quantity: int = 0
) -> Figure:
    """A bifurcation diagram: the points of a Poincare section over a number that varies, and below them the largest
    Lyapunov exponent. Of other axes of a grid the middle is shown.

    **Arguments:** `dataset`: of a sweep; `name`: of the section; `axis`: name of the number, by default the first that
    varies; `exponent`: name of the exponent, if there is one; `quantity`: which of the section's quantities.
    """
    figure, dataset, axis = _over(dataset, axis, 4.6 if exponent is None else 6.4)
    points = section(dataset, name)[quantity]
    if exponent is None:
        draw_bifurcation(figure.subplots(), dataset, points, axis)
        return figure
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(5, 2))
    draw_bifurcation(above, dataset, points, axis, exponent)
    above.set_xlabel("")
    draw_exponent(below, dataset, exponent, axis)
    return figure


def _over(dataset: xr.Dataset, axis: str | None, height: float) -> tuple[Figure, xr.Dataset, str]:
    """A figure of this height [inch], the lanes along a number (by default the first that varies), and its name."""
    dataset = sweep.tidy(dataset)
    axis = sweep.variables(dataset)[0] if axis is None else axis
    dataset, where = sweep.slice_grid(dataset, axis)
    figure = Figure(figsize=(9, height), layout="constrained")
    if where:
        figure.suptitle(where, fontsize=9)
    return figure, dataset, axis


def draw_bifurcation(
    axes: Axes, dataset: xr.Dataset, points: xr.DataArray, axis: str, exponent: str | None = None
) -> None:
    """The diagram; where the exponent is known, in colours by its sign."""
    across, x = sweep.scaled(dataset, sweep.number(dataset, axis))
    up, y = sweep.scaled(dataset, points)
    size = SMALL if y.size > MANY else LARGE
    kinds = [(np.ones(len(x), bool), "black", None)]
    if exponent is not None:
        rate = sweep.exponent_of(dataset, exponent)
        there = np.unique(rate.sign[np.isfinite(rate.value.values.ravel())])
        words = SIGNS if rate.uncertainty is None else KNOWN
        kinds = [(rate.sign == k, COLOURS[int(k)], words[int(k)]) for k in there]
    for chosen, colour, label in kinds:
        where = np.broadcast_to(x[chosen, None], y[chosen].shape)
        axes.scatter(where, y[chosen], s=size, lw=0, color=colour, label=label, rasterized=True)
    axes.set(xlabel=across.label, ylabel=f"{up.label}\nonce a period", xscale=sweep.scale(x))
    axes.margins(x=0.01)
    if exponent is not None:
        legend_below(axes, markerscale=np.sqrt(30 / size))


def draw_exponent(axes: Axes, dataset: xr.Dataset, name: str, axis: str) -> None:
    """An exponent over a number, in colours by its sign, with its uncertainty where that is known."""
    rate = sweep.exponent_of(dataset, name)
    across, x = sweep.scaled(dataset, sweep.number(dataset, axis))
    up, y = sweep.scaled(dataset, rate.value, "largest Lyapunov\nexponent")
    colours = np.array([COLOURS[int(k)] for k in rate.sign])
    if rate.uncertainty is not None:
        beside = sweep.of_lanes(dataset, rate.uncertainty)
        axes.vlines(x, y - beside, y + beside, color=colours, lw=0.6, alpha=0.5)
    if sweep.lanes_of(dataset) == (axis,) and len(x) <= COLUMNS:  # more would be nothing but line
        axes.plot(x, y, lw=0.5, color="0.3")
    axes.scatter(x, y, s=4 * LARGE if len(x) <= COLUMNS else LARGE, lw=0, color=colours, zorder=3)
    axes.axhline(0, color="black", lw=0.8)
    axes.set(xlabel=across.label, ylabel=up.label, xscale=sweep.scale(x))
    axes.margins(x=0.01)


@STYLED
def exponents(dataset: xr.Dataset, name: str, axis: str | None = None) -> Figure:
    """The largest Lyapunov exponent over a number that varies. Of other axes of a grid the middle is shown. The colour
    says where the motion is chaotic: where the exponent is positive, beyond its uncertainty if that is known.

    **Arguments:** `dataset`: of a sweep; `name`: of the exponent; `axis`: name of the number, by default the first that
    varies.
    """
    figure, dataset, axis = _over(dataset, axis, 3.6)
    draw_exponent(figure.subplots(), dataset, name, axis)
    return figure


@STYLED
def sections(dataset: xr.Dataset, name: str, lanes: list[int] | None = None, exponent: str | None = None) -> Figure:
    """Poincare sections in the plane of their first two quantities, a panel for each of some lanes.

    **Arguments:** `dataset`: of a sweep; `name`: of the section; `lanes`: their indices (by default at most six, evenly
    chosen); `exponent`: name of the Lyapunov exponent, if there is one.

    **Raises:** `ClearanceError` for a section of one quantity.
    """
    dataset = sweep.tidy(dataset)
    parts = section(dataset, name)[:2]
    if len(parts) < 2:
        raise ClearanceError(f"The section `{name}` is of one quantity: in a plane it takes two.")
    chosen = sweep.spread_places(dataset[sweep.CODE].size, MOST_SECTIONS) if lanes is None else lanes
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = Figure(figsize=(3.3 * columns, 2.8 * rows + 0.3), layout="constrained")
    panels = panel_grid(figure, len(chosen), columns).ravel()
    rate = None if exponent is None else sweep.exponent_of(dataset, exponent)
    (across, x), (up, y) = (sweep.scaled(dataset, part) for part in parts)
    for panel, lane in zip(panels, chosen, strict=False):
        colour = "black" if rate is None else COLOURS[int(rate.sign[lane])]
        panel.scatter(x[lane], y[lane], s=LARGE if len(x[lane]) > FEW else 4 * LARGE, lw=0, color=colour)
        _widen(panel, x, y)
        panel.set_title(_tell(dataset, lane, rate), fontsize=9)
    figure.supxlabel(across.label, fontsize=9)
    figure.supylabel(up.label, fontsize=9)
    return figure


def _widen(panel: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Show at least a part of the range of all lanes, so that the points of a periodic motion coincide."""
    for values, limits, put in ((x, panel.get_xlim(), panel.set_xlim), (y, panel.get_ylim(), panel.set_ylim)):
        least, middle = CLOSE * float(np.ptp(values[np.isfinite(values)])), 0.5 * sum(limits)
        if limits[1] - limits[0] < least:
            put(middle - 0.5 * least, middle + 0.5 * least)
    panel.ticklabel_format(useOffset=False)
    for ticks in (panel.xaxis, panel.yaxis):
        ticks.set_major_locator(MaxNLocator(nbins=5))


def _tell(dataset: xr.Dataset, lane: int, rate: sweep.Exponent | None) -> str:
    told = []
    for name in sweep.variables(dataset):
        axis, values = sweep.scaled(dataset, sweep.number(dataset, name))
        told.append(f"{axis.name} {values[lane]:.4g} {axis.unit}".strip())
    if rate is not None:
        beside = "" if rate.uncertainty is None else f" ± {rate.uncertainty.values.ravel()[lane]:.2g}"
        told.append(f"exponent {rate.value.values.ravel()[lane]:+.3g}{beside} 1/s")
    return "\n".join(told)
