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

SHORT = 0.2  # a motion that is over by then is told in ms [s]
STATES = (("free", "tab:blue"), ("contact", "tab:green"), ("impact", "tab:red"))


def time_axis(ax: Axes, t: np.ndarray) -> np.ndarray:
    """Label an axis over times [s], in ms or s, with at most six ticks; returns the times in that unit."""
    factor, unit = (1e3, "ms") if t[-1] < SHORT else (1.0, "s")
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10]))
    ax.set_xlabel(f"time, {unit}")
    return factor * np.asarray(t)


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


def _seconds(dataset: xr.Dataset) -> tuple[np.ndarray, str]:
    t = dataset["time"].values
    return (t * 1e3, "time, ms") if t[-1] < 0.2 else (t, "time, s")


def _eccentricity(axis, dataset: xr.Dataset) -> None:
    t, label = _seconds(dataset)
    for joint in dataset["joint"].values:
        e = np.hypot(*dataset["eccentricity"].sel(joint=joint).values.T) * 1e3
        (line,) = axis.plot(t, e, lw=0.8, label=f"{joint}")
        clearance = dataset.attrs.get(f"parameter.{joint}.radial_clearance")
        if clearance is not None:
            axis.axhline(float(clearance) * 1e3, color=line.get_color(), ls="--", lw=0.8, alpha=0.7)
    axis.set(xlabel=label, ylabel="eccentricity, mm", title="(a) pin from sleeve centre (dashed: clearance)")
    if dataset.sizes["joint"] > 1:
        axis.legend()


def _force(axis, dataset: xr.Dataset) -> None:
    t, label = _seconds(dataset)
    factor = 1e3 if t[-1] > dataset["time"].values[-1] * 10 else 1.0
    for index, joint in enumerate(dataset["joint"].values):
        force = dataset["contact_force"].sel(joint=joint).values
        (line,) = axis.plot(t, force, lw=0.8, label=f"{joint}")
        if "peak_force" in dataset:
            own = dataset["episode_joint"].values == index
            axis.plot(
                dataset["peak_time"].values[own] * factor,
                dataset["peak_force"].values[own],
                "v",
                ms=4,
                color=line.get_color(),
                mfc="none",
                label="refined peaks" if index == 0 else None,
            )
    axis.set(xlabel=label, ylabel="normal force, N", title="(b) contact force", ylim=(0, None))
    _fit_peaks(axis, dataset)
    axis.legend()


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
            0.97,
            f"largest peak {peak:.4g} N at {float(dataset['peak_time'][largest]):.4g} s (above the axis)",
            transform=axis.transAxes,
            ha="center",
            va="top",
            fontsize=8,
        )


def _point(axis, dataset: xr.Dataset, name: str, ylabel: str) -> None:
    t, label = _seconds(dataset)
    point = ""
    for point in dataset["point"].values:
        axis.plot(t, np.hypot(*dataset[name].sel(point=point).values.T), lw=0.8, label=f"{point}")
    axis.set(xlabel=label, ylabel=ylabel, title=f"{'(c)' if name == 'velocity' else '(d)'} {name} of {point}")


def pin_path(axis, dataset: xr.Dataset, joint: str) -> None:
    """The pin centre's path inside the clearance circle, coloured by contact state."""
    here = dataset.sel(joint=joint)
    # Step ends show an impact that is shorter than the time between samples; the shares are those of time.
    places, states = (
        ("step_eccentricity", "step_state") if "step_state" in dataset else ("eccentricity", "contact_state")
    )
    x, y = here[places].values.T * 1e6
    axis.plot(x, y, lw=0.4, color="0.75", zorder=1)
    for code, (name, colour) in enumerate(STATES):
        chosen = here[states].values == code
        if np.any(chosen):
            share = np.mean(here["contact_state"].values == code)
            label = f"{name} ({share:.0%})" if share >= 0.005 else f"{name} (< 1%)"
            axis.plot(x[chosen], y[chosen], ".", ms=3, color=colour, label=label, zorder=2 + code)
    clearance = dataset.attrs.get(f"parameter.{joint}.radial_clearance")
    if clearance is not None:
        angle = np.linspace(0, 2 * np.pi, 361)
        radius = float(clearance) * 1e6
        axis.plot(radius * np.cos(angle), radius * np.sin(angle), "k--", lw=0.8, label="clearance circle")
    axis.set_aspect("equal", adjustable="box")
    axis.set(xlabel="e_x, µm", ylabel="e_y, µm", title=f"pin centre in the sleeve of {joint}")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2, fontsize=8)


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
