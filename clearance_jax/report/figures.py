"""Figures of a motion from a dataset: panels of variables, and paths of pins in their sleeves."""

from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from clearance_jax.errors import ClearanceError
from clearance_jax.report.panels import Panel, curve, of_points, panels, time_axis
from clearance_jax.report.play_figures import MOST, bearing_most, draw_path, with_share
from clearance_jax.report.style import STYLED, legend_below
from clearance_jax.results.bearing import at_steps
from clearance_jax.results.first_fall import seconds
from clearance_jax.results.outlines import outline_of
from clearance_jax.results.play import middle_path

ECCENTRICITY = "pin from sleeve centre (dashed: clearance)"
STATES = (("free", "tab:blue"), ("contact", "tab:green"), ("impact", "tab:red"))


@STYLED
def overview(dataset: xr.Dataset) -> Figure:
    """Of a mechanism with clearances eccentricity, contact force, speed and acceleration of the named points, and the
    pins' paths (of many joints, of those that bear most); of another one its coordinates, points, drives or reactions.

    **Raises:** `ClearanceError` for a dataset that is no motion, or shows nothing.
    """
    joints = list(dataset["joint"].values) if "joint" in dataset.coords else []
    shown = (
        [Panel(ECCENTRICITY, _eccentricity), Panel("contact force", _force), *of_points(dataset)]
        if joints
        else panels(dataset)
    )
    if "time" not in dataset.coords or not shown:
        raise ClearanceError(
            "There is nothing to draw: this is no result of `clearance simulate`, or nothing in it moves."
        )
    columns = 2 if len(shown) <= 4 else 3 if len(shown) <= 6 else 4
    rows, across = -(-len(shown) // columns), 1 if len(joints) <= 2 else 2
    size = (11 + 2.2 * across, 7.5) if joints else (4.5 * columns, 3.5 * rows)
    figure = Figure(figsize=size, layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(2, 0.6 + 0.4 * across)) if joints else (figure, None)
    left, right = parts
    for i, (panel, letter) in enumerate(zip(shown, ascii_lowercase, strict=False)):
        axis = left.add_subplot(rows, columns, i + 1, projection=panel.projection)
        panel.draw(axis, dataset)
        axis.set_title(f"({letter}) {panel.title}")
    if joints:
        _pin_paths(right, dataset, bearing_most(dataset), across)
    title = f"{dataset.attrs.get('mechanism', '')}   ({dataset.attrs.get('result', '')})"
    if len(joints) > MOST:
        title += f"\nof {len(joints)} joints with play the {MOST} that bear most"
    figure.suptitle(title)
    return figure


def _pin_paths(figure: Any, dataset: xr.Dataset, joints: list[str], across: int) -> None:
    """The paths of pins, in a grid with one legend."""
    axes = figure.subplots(-(-len(joints) // across), across, squeeze=False).flat
    if len(joints) == 1:
        pin_path(axes[0], dataset, joints[0])
        return
    named = {}
    for axis, joint in zip(axes, joints, strict=False):
        _draw_states(axis, dataset, joint, shares=False)
        axis.set_title(joint, fontsize=9)
        axis.tick_params(labelsize=7)
        named |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    for axis in list(axes)[len(joints) :]:
        axis.set_axis_off()
    figure.suptitle("pin centres in their sleeves: e_y over e_x, µm", fontsize=10)
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)


def _eccentricity(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    for joint in bearing_most(dataset):
        time, places = at_steps(dataset, joint, "eccentricity")
        places = places[:, :2]  # across the sleeve
        colour = curve(axis, factor * time, np.hypot(*places.T) * 1e3, str(joint))
        outline = outline_of(dataset, joint)
        if outline is not None and outline.height is None and not np.any(outline.depth):
            axis.axhline(outline.clearance * 1e3, color=colour, ls="--", lw=0.8, alpha=0.7)
    axis.set(ylabel="eccentricity, mm")


def _force(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    joints = [str(name) for name in dataset["joint"].values]
    for place, joint in enumerate(bearing_most(dataset)):
        time, force = at_steps(dataset, joint, "contact_force")
        colour = curve(axis, factor * time, force, str(joint))
        if "peak_force" in dataset:
            episodes = dataset["episode_joint"].values == joints.index(joint)
            axis.plot(
                dataset["peak_time"].values[episodes] * factor,
                dataset["peak_force"].values[episodes],
                "v",
                ms=4,
                color=colour,
                mfc="none",
                label="refined peaks" if place == 0 else None,
            )
    axis.set(ylabel="normal force, N", ylim=(0, None))
    _fit_peaks(axis, dataset)
    legend_below(axis, fontsize=8)


def _fit_peaks(axis, dataset: xr.Dataset) -> None:
    """If one short peak is far above the motion, limit the axis to the motion and state the peak in words."""
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
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.5},
        )


def pin_path(axis, dataset: xr.Dataset, joint: str) -> None:
    """The pin centre's path inside the clearance circle, coloured by contact state."""
    _draw_states(axis, dataset, joint, shares=True)
    axis.set(xlabel="e_x, µm", ylabel="e_y, µm", title=f"pin centre in the sleeve of {joint}")
    legend_below(axis, 2, fontsize=8)


def _draw_states(axis, dataset: xr.Dataset, joint: str, shares: bool) -> None:
    """Draw a pin's path; `shares`: label the states with their fractions of the time."""
    path = middle_path(dataset, joint)
    states = {
        code: (with_share(name, path.share(code)) if shares else name, colour)
        for code, (name, colour) in enumerate(STATES)
        if np.any(path.state == code)
    }
    draw_path(axis, path, states)


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
