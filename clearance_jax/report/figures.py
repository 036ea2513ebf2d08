"""Figures from a dataset: the four panels of the motion, and the pin's path in the sleeve. Dataset in, Figure out."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report.curves import envelope, flights
from clearance_jax.results.first_fall import seconds

# Ticks of a time axis at most; columns of a picture in which a curve is no longer told from its envelope.
TICKS, COLUMNS = 6, 500
# Of the height of a curve, with the room for a legend above it.
LEGEND_ROOM = 1.15
# A motion that is over by then is told in ms [s].
SHORT = 0.2
STATES = (("free", "tab:blue"), ("contact", "tab:green"), ("impact", "tab:red"))


def time_axis(axis: Axes, last: float) -> float:
    """A time axis to `last` [s], in ms or s, with few ticks; what seconds are to be multiplied by."""
    factor, unit = (1e3, "ms") if last < SHORT else (1.0, "s")
    axis.xaxis.set_major_locator(MaxNLocator(nbins=TICKS - 1, steps=[1, 2, 2.5, 5, 10]))
    axis.set_xlabel(f"time, {unit}")
    return factor


def overview(dataset: xr.Dataset) -> Figure:
    """Eccentricity, contact force, speed and acceleration of the first named point, and the pin's path."""
    joints = list(dataset["joint"].values) if "joint" in dataset.coords else []
    if "time" not in dataset.coords or not (joints or "point" in dataset.coords):
        raise ClearanceError(
            "There is nothing to draw: this is no result of `clearance simulate`, or it names no point."
        )
    with mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 9}):
        figure = Figure(figsize=(13, 7.5) if joints else (9, 7), layout="constrained")
        parts: Any = figure.subfigures(1, 2, width_ratios=(2, 1)) if joints else (figure, None)
        left, right = parts
        axes = left.subplots(2, 2) if joints else left.subplots(2, 1)[:, None]
        if joints:
            _eccentricity(axes[0, 0], dataset)
            _force(axes[0, 1], dataset)
            rows: Any = axes[1]
            assert right is not None
            for axis, joint in zip(np.atleast_1d(right.subplots(len(joints), 1)), joints, strict=True):
                pin_path(axis, dataset, joint)
        else:
            rows = axes[:, 0]
        if "point" in dataset.coords:
            _point(rows[0], dataset, "velocity", "speed, m/s")
            _point(rows[1], dataset, "acceleration", "acceleration, m/s²")
        figure.suptitle(f"{dataset.attrs.get('mechanism', '')}   ({dataset.attrs.get('result', '')})")
    return figure


def _curve(axis, time: np.ndarray, values: np.ndarray, label: str) -> Any:
    """A curve, or where it has far more points than the picture has columns its envelope; its colour."""
    if len(time) <= 2 * COLUMNS:
        return axis.plot(time, values, lw=0.8, label=label)[0].get_color()
    middles, least, greatest = envelope(time, values, COLUMNS)
    colour = axis.plot(middles, greatest, lw=0.8, label=label)[0].get_color()
    axis.plot(middles, least, lw=0.8, color=colour)
    axis.fill_between(middles, least, greatest, color=colour, alpha=0.3, lw=0)
    return colour


def _of_joint(dataset: xr.Dataset, joint: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values in a joint: at the step ends where these are known, which no oscillation escapes."""
    step = f"step_{name.removeprefix('contact_')}"
    time, known = ("step_time", step) if step in dataset else ("time", name)
    return dataset[time].values, dataset[known].sel(joint=joint).values


def _eccentricity(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    for joint in dataset["joint"].values:
        time, places = _of_joint(dataset, joint, "eccentricity")
        colour = _curve(axis, factor * time, np.hypot(*places.T) * 1e3, str(joint))
        clearance = dataset.attrs.get(f"parameter.{joint}.radial_clearance")
        if clearance is not None:
            axis.axhline(float(clearance) * 1e3, color=colour, ls="--", lw=0.8, alpha=0.7)
    axis.set(ylabel="eccentricity, mm", title="(a) pin from sleeve centre (dashed: clearance)")
    if dataset.sizes["joint"] > 1:
        axis.legend()


def _force(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    for index, joint in enumerate(dataset["joint"].values):
        time, force = _of_joint(dataset, joint, "contact_force")
        colour = _curve(axis, factor * time, force, str(joint))
        if "peak_force" in dataset:
            own = dataset["episode_joint"].values == index
            axis.plot(
                dataset["peak_time"].values[own] * factor,
                dataset["peak_force"].values[own],
                "v",
                ms=4,
                color=colour,
                mfc="none",
                label="refined peaks" if index == 0 else None,
            )
    axis.set(ylabel="normal force, N", title="(b) contact force", ylim=(0, None))
    _fit_peaks(axis, dataset)
    # Above all that is drawn: peaks stand wherever a legend might.
    axis.set_ylim(0, LEGEND_ROOM * axis.get_ylim()[1])
    axis.legend(loc="upper center", ncols=3)


def _fit_peaks(axis, dataset: xr.Dataset) -> None:
    """Where one short peak towers over the motion, keep the motion readable and state the peak in words."""
    if "peak_force" not in dataset or dataset.sizes["episode"] == 0:
        return
    largest = int(dataset["peak_force"].values.argmax())
    peak, sampled = float(dataset["peak_force"][largest]), float(np.percentile(dataset["contact_force"], 99.9))
    if peak > 4 * sampled > 0:
        axis.set_ylim(0, 1.6 * sampled)
        axis.text(
            0.5,
            0.85,
            f"largest peak {peak:.4g} N at {seconds(float(dataset['peak_time'][largest]))} (above the axis)",
            transform=axis.transAxes,
            ha="center",
            va="top",
            fontsize=8,
        )


def _point(axis, dataset: xr.Dataset, name: str, ylabel: str) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    points = [str(point) for point in dataset["point"].values]
    for point in points:
        size = np.hypot(*dataset[name].sel(point=point).values.T)
        _curve(axis, factor * dataset["time"].values, size, point)
    axis.set(ylabel=ylabel, title=f"{'(c)' if name == 'velocity' else '(d)'} {name} of {', '.join(points)}")
    if len(points) > 1:
        axis.legend()


def pin_path(axis, dataset: xr.Dataset, joint: str) -> None:
    """The pin centre's path inside the clearance circle, coloured by contact state."""
    here = dataset.sel(joint=joint)
    time, places, states = _path(here)
    x, y = places.T * 1e6
    for code, (name, colour) in enumerate(STATES):
        chosen = states == code
        if np.any(chosen):
            share = np.mean(here["contact_state"].values == code)
            label = f"{name} ({share:.0%})" if share >= 0.005 else f"{name} (< 1%)"
            if name == "free":
                axis.plot(*flights(time, places, chosen).T * 1e6, lw=0.6, color=colour, label=label, zorder=1)
            else:
                axis.plot(x[chosen], y[chosen], ".", ms=3, color=colour, label=label, zorder=2 + code)
    clearance = dataset.attrs.get(f"parameter.{joint}.radial_clearance")
    if clearance is not None:
        angle = np.linspace(0, 2 * np.pi, 361)
        radius = float(clearance) * 1e6
        axis.plot(radius * np.cos(angle), radius * np.sin(angle), "k--", lw=0.8, label="clearance circle")
    axis.set_aspect("equal", adjustable="box")
    axis.set(xlabel="e_x, µm", ylabel="e_y, µm", title=f"pin centre in the sleeve of {joint}")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2, fontsize=8)


def _path(here: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, places and contact states of one joint: at the samples, and at the step ends where these are known (an
    impact may be shorter than the time between samples, a flight's step longer).
    """
    names = [("time", "eccentricity", "contact_state")]
    if "step_state" in here:
        names.append(("step_time", "step_eccentricity", "step_state"))
    columns = zip(*names, strict=True)
    time, places, states = (np.concatenate([here[name].values for name in column]) for column in columns)
    time, order = np.unique(time, return_index=True)
    return time, places[order], states[order]


def save_figure(figure: Figure, path) -> None:
    """Write a figure. **Raises** `ClearanceError` where the path is not writable or its ending unknown."""
    path = Path(path)
    partial = path.with_name(f".partial.{path.name}")
    try:
        figure.savefig(partial, dpi=130)
        partial.replace(path)
    except (OSError, ValueError) as error:
        partial.unlink(missing_ok=True)
        raise ClearanceError(
            f"Cannot write the figure `{path}`: {error}. Choose another path ending in .png or .pdf."
        ) from error
