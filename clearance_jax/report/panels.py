"""Panels of a motion from a dataset. Curves of very many points are drawn as envelopes, paths of few as splines."""

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from string import ascii_lowercase
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.interpolate import CubicSpline

from clearance_jax.report.style import NARROW, ZOOM, fit, keep_labels, legend_below, length_unit, look
from clearance_jax.results.places import bounds, names_of

# Ticks of a time axis at most; columns of a picture, in which a curve is no longer told from its extremes.
TICKS, COLUMNS = 6, 500
# Markers on a curve.
MARKS = 7
# Motions that end before this are shown in ms [s].
SHORT = 0.2
# More curves than this are not told apart by a legend.
MOST_NAMED = 10
# Relative to the size of what is shown: the margin, and half the least extent of an axis.
ROOM, LEAST = 0.12, 0.3
# The height of a panel in space over that of another one, where panels lie below each other.
SPACE = 1.3
# Points drawn per interval of a flight. Places nearer in time than this part of the flight count as one.
FINE, NEAR = 12, 1e-3


class Panel(NamedTuple):
    """A panel: its title, a function that draws a dataset on axes, and the axes' projection."""

    title: str
    draw: Callable[[Any, xr.Dataset], None]
    projection: str | None = None


def _unit_of_time(last: float) -> tuple[float, str]:
    return (1e3, "ms") if last < SHORT else (1.0, "s")


def instant(time: float, last: float) -> str:
    """A time [s] in words, in the unit of axes to `last` [s]."""
    factor, unit = _unit_of_time(last)
    return f"{factor * time:.4g} {unit}"


def time_axis(axis: Axes, last: float) -> float:
    """Format a time axis to `last` [s] in ms or s, with few ticks; returns the factor from seconds."""
    factor, unit = _unit_of_time(last)
    axis.xaxis.set_major_locator(MaxNLocator(nbins=TICKS - 1, steps=[1, 2, 2.5, 5, 10]))
    axis.set_xlabel(f"time, {unit}")
    return factor


def curve(axis, time: np.ndarray, values: np.ndarray, label: str, k: int = 0) -> Any:
    """Draw the `k`-th curve, with some markers, by its extremes if it has far more points than the picture has columns;
    returns its colour.
    """
    how = look(k) | {"lw": 0.8, "ms": 4, "mfc": "white"} | ({} if label else {"marker": ""})
    if len(time) > 2 * COLUMNS:
        chosen = extremes(time, values, COLUMNS)
        time, values = time[chosen], values[chosen]
    every = max(len(time) // MARKS, 1)
    axis.plot(time, values, label=label, markevery=(every * (2 * k + 1) // 14 % every, every), **how)
    return how["color"]


def page(shown: list[Panel], dataset: xr.Dataset, title: str, narrow: bool) -> Figure:
    """A figure of panels with letters, in two to four columns, or below each other if it is `narrow`."""
    columns = 1 if narrow else min(len(shown), 2) if len(shown) <= 4 else 3 if len(shown) <= 6 else 4
    rows = math.ceil(len(shown) / columns)
    heights = [SPACE if narrow and panel.projection else 1.0 for panel in shown[::columns]]
    size = (NARROW, 2.6 * sum(heights) + 0.4) if narrow else (4.5 * columns, 3.5 * rows)
    figure = Figure(figsize=size, layout="constrained")
    places = figure.add_gridspec(rows, columns, height_ratios=heights)
    for i, panel in enumerate(shown):
        axis = figure.add_subplot(places[i // columns, i % columns], projection=panel.projection)
        panel.draw(axis, dataset)
        axis.set_title(f"({ascii_lowercase[i]}) {panel.title}" if len(shown) > 1 else panel.title)
    figure.suptitle(fit(title, size[0], 11.0))
    keep_labels(figure)
    return figure


def heading(dataset: xr.Dataset) -> str:
    """The title of a figure of a motion: its mechanism, and how the motion ended if it did not reach its end."""
    ended = str(dataset.attrs.get("result", "successful"))
    return str(dataset.attrs.get("mechanism", "")) + ("" if ended == "successful" else f" ({ended})")


def panels(dataset: xr.Dataset) -> list[Panel]:
    """Of a motion: its coordinates, each kind for itself; speed and acceleration of the named points; where drives or
    couplings have backlash, or joints stops, the points' errors, and places and efforts in the gaps; efforts of drives
    and actuators, or where there are none reactions in the joints; the points' paths.
    """
    motions = _of_each_unit(dataset, "q", "coordinate", {"rad": "turns", "m": "slides"})
    motions += of_points(dataset) + of_gaps(dataset)
    efforts = _of_each_unit(dataset, "drive_force", "drive", {"N m": "torques of drives", "N": "forces of drives"})
    titles = {"N m": "torques of actuators", "N": "forces of actuators"}
    efforts += _of_each_unit(dataset, "actuator_effort", "actuated", titles)
    if not efforts and "joint_reaction" in dataset:
        names = names_of(dataset, "any_joint")
        efforts = [Panel("reactions in joints", partial(_curves, "joint_reaction", "any_joint", names, "force, N"))]
    if "position" not in dataset:
        return motions + efforts
    projection = "3d" if dataset.sizes["axis"] == 3 else None
    return [*motions, *efforts, Panel(f"path of {_list(dataset)}", _path, projection)]


def of_points(dataset: xr.Dataset) -> list[Panel]:
    """Speed and acceleration of the named points."""
    if "velocity" not in dataset:
        return []
    names, listed = names_of(dataset, "point"), _list(dataset)
    return [
        Panel(f"{name} of {listed}", partial(_curves, name, "point", names, label))
        for name, label in (("velocity", "speed, m/s"), ("acceleration", "acceleration, m/s²"))
    ]


def of_gaps(dataset: xr.Dataset) -> list[Panel]:
    """Errors of the points, places in gaps of backlash and between stops, efforts of flanks, effort over wind-up."""
    if "gap_position" not in dataset:
        return []
    out = []
    if "position_error" in dataset:
        out.append(Panel(f"error of {_list(dataset)}", _errors))
    units, names = dataset["gap_unit"].values, dataset["gap"].values
    for unit, effort in (("rad", "N m"), ("m", "N")):
        some = [str(name) for name in names[units == unit]]
        loose = [name for name in some if f"gap.{name}" in dataset.attrs]
        stopped = [name for name in some if f"stops.{name}" in dataset.attrs]
        if loose:
            out.append(Panel("place in the gap", partial(gap_places, loose, unit)))
        if stopped:
            out.append(Panel("place between the stops", partial(gap_places, stopped, unit)))
        if some:
            out.append(Panel("effort of flanks", partial(_curves, "gap_effort", "gap", some, f"effort, {effort}")))
        if loose:
            out.append(Panel("effort over place", partial(_wind_up, loose, unit, f"effort, {effort}")))
    return out


def _errors(axis: Any, dataset: xr.Dataset) -> None:
    factor, unit = length_unit(float(dataset["position_error"].max()))
    scaled = dataset.assign(position_error=factor * dataset["position_error"])
    _curves("position_error", "point", names_of(dataset, "point"), f"error, {unit}", axis, scaled)


def _fine(dataset: xr.Dataset, names: list[str], unit: str) -> tuple[float, str]:
    """The factor on places in gaps, and their unit in words."""
    largest = float(np.abs(dataset["gap_position"].sel(gap=names)).max())
    return (length_unit(largest) if unit == "m" else (1e3, "mrad")) if largest < 0.1 else (1.0, unit)


def half_gap(dataset: xr.Dataset, name: str) -> float:
    """Half the width of a gap of backlash or between stops; NaN if it has none."""
    return float(dataset.attrs.get(f"gap.{name}", dataset.attrs.get(f"stops.{name}", np.nan)))


def gap_places(names: list[str], unit: str, axis: Any, dataset: xr.Dataset) -> None:
    """Draw places in gaps or between stops over time, and the ends dashed."""
    factor, word = _fine(dataset, names, unit)
    shown = dataset.assign(gap_position=factor * dataset["gap_position"])
    _curves("gap_position", "gap", names, f"place, {word}", axis, shown)
    for k, name in enumerate(names):
        for side in (-1, 1):
            end = side * factor * half_gap(dataset, name)
            axis.axhline(end, color=look(k)["color"], ls="--", lw=0.8, alpha=0.7)


def _wind_up(names: list[str], unit: str, label: str, axis: Any, dataset: xr.Dataset) -> None:
    """Draw efforts of flanks over the places in their gaps."""
    factor, word = _fine(dataset, names, unit)
    for k, name in enumerate(names):
        here = dataset.sel(gap=name)
        axis.plot(factor * here["gap_position"], here["gap_effort"], **look(k) | {"ls": "none", "ms": 2.5}, label=name)
    axis.set(xlabel=f"place in the gap, {word}", ylabel=label)
    if 1 < len(names) <= MOST_NAMED:
        legend_below(axis, fontsize=8)


def _list(dataset: xr.Dataset) -> str:
    names = names_of(dataset, "point")
    return names[0] if len(names) == 1 else f"{len(names)} points"  # a legend names them


def _of_each_unit(dataset: xr.Dataset, variable: str, dim: str, titles: dict[str, str]) -> list[Panel]:
    if variable not in dataset:
        return []
    units, names = dataset[f"{dim}_unit"].values, dataset[dim].values
    members = {unit: [str(name) for name in names[units == unit]] for unit in titles}
    return [Panel(titles[u], partial(_curves, variable, dim, some, u)) for u, some in members.items() if some]


def _curves(variable: str, dim: str, names: list[str], label: str, axis: Any, dataset: xr.Dataset) -> None:
    """Draw a variable over time, of vectors the lengths, with a legend for several names."""
    factor = time_axis(axis, float(dataset["time"][-1]))
    for k, name in enumerate(names):
        values = dataset[variable].sel({dim: name}).values
        values = np.linalg.norm(values, axis=-1) if values.ndim > 1 else values
        curve(axis, factor * dataset["time"].values, values, name, k)
    axis.set_ylabel(label)
    if 1 < len(names) <= MOST_NAMED:
        legend_below(axis, fontsize=8)


def _path(axis: Any, dataset: xr.Dataset) -> None:
    for k, name in enumerate(dataset["point"].values):
        places = dataset["position"].sel(point=name).values.T
        axis.plot(*places, lw=0.8, ms=4, markevery=[0], label=str(name), **look(k))
    same_scale(axis, dataset["position"].values)
    if 1 < dataset.sizes["point"] <= MOST_NAMED:
        legend_below(axis, fontsize=8)


def same_scale(axis: Any, places: np.ndarray) -> np.ndarray:
    """Give axes one scale around places (..., 2 or 3) [m]; returns their lowest corner."""
    low, high = bounds(places)
    # A mechanism that stands still has axes too, so large that their numbers need no power of ten.
    size = max(float(np.max(high - low)), 0.02 * float(np.max(np.abs([low, high]))), 1e-9)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low) + ROOM * size, LEAST * size)
    for name, centre, reach in zip("xyz", middle, half, strict=False):
        getattr(axis, f"set_{name}lim")(centre - reach, centre + reach)
        getattr(axis, f"set_{name}label")(f"{name}, m", labelpad=13 if len(half) == 3 else None)
        getattr(axis, f"{name}axis").set_major_locator(
            MaxNLocator(nbins=3 if len(half) == 3 or reach < 0.7 * half.max() else 5)
        )
    if len(half) == 3:
        axis.set_box_aspect(tuple(half), zoom=ZOOM)
    else:
        axis.set_aspect("equal", adjustable="box")
    return middle - half


def extremes(time: np.ndarray, values: np.ndarray, columns: int) -> np.ndarray:
    """Places of a curve's first and last point, and of the least and the greatest value in each of so many equal
    columns of time. A line through these looks as the line through all points does, in a picture of such columns.
    """
    edges = np.linspace(time[0], time[-1], columns + 1)
    column = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, columns - 1)
    order = np.lexsort((values, column))
    first = np.flatnonzero(np.diff(column[order], prepend=-1))
    least, greatest = order[first], order[np.append(first[1:], len(time)) - 1]
    return np.unique(np.concatenate([[0, len(time) - 1], least, greatest]))


def flights(time: np.ndarray, places: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Every free flight as a smooth path from contact to contact, (points, 2), with a row of NaN after each; of times
    (n,), places (n, 2), and whether each is free (n,).
    """
    edge = np.diff(np.concatenate([[0], free.astype(int), [0]]))
    paths = [np.zeros((0, 2))]
    for begin, end in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True):
        # With the last place in contact before it, and the first one after it.
        part = slice(max(begin - 1, 0), min(end + 1, len(time)))
        paths += [smooth(time[part], places[part]), np.full((1, 2), np.nan)]
    return np.concatenate(paths)


def smooth(time: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A smooth path through places (n, 2) of a flight: a spline, for without contact it has no corner."""
    apart = NEAR * (time[-1] - time[0])
    kept = [0]
    for i in range(1, len(time)):
        if time[i] - time[kept[-1]] > apart:
            kept.append(i)
    kept[-1] = len(time) - 1 if len(kept) > 1 else kept[-1]
    if len(kept) < 3:
        return places[kept]
    t = time[kept]
    fine = np.concatenate([np.linspace(a, b, FINE, endpoint=False) for a, b in pairwise(t)])
    return CubicSpline(t, places[kept])(np.append(fine, t[-1]))
