"""Figures of a motion from a dataset: panels of variables, contact patterns over time, and paths of pins in sleeves."""

from collections.abc import Mapping
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report.panels import Panel, curve, flights, of_points, panels, time_axis
from clearance_jax.report.style import STYLED, legend_below, panel_grid
from clearance_jax.results import play as pins
from clearance_jax.results.first_fall import seconds
from clearance_jax.results.places import names_of

ECCENTRICITY = "pin from sleeve centre (dashed: clearance)"
STATES = (("free", "tab:blue"), ("contact", "tab:green"), ("impact", "tab:red"))
# Words and colours of contact patterns, faces apart. A joint without edges has only the first and `TOUCHING`.
PATTERNS = ("apart", "0.88"), ("at one edge", "tab:orange"), ("along a line", "tab:green")
PATTERNS += (("at two opposite edges", "tab:red"),)
TOUCHING = ("in contact", "tab:red")
FACES = ("on a face", "tab:purple")
# Heights, as parts of a joint's row: the bar of its pattern, and the bar of its faces below.
BAR, FACE_BAR = 0.55, 0.16
# Most orbits in a row; the least share of the time that is shown as a number.
ROW, TOLD = 4, 0.005
# Most joints whose paths are shown: those with the largest forces.
MOST = 6
BEARING = {0: ("apart", "tab:blue"), 1: ("bears here", "tab:red")}


@STYLED
def overview(dataset: xr.Dataset) -> Figure:
    """Of a mechanism with clearances eccentricity, contact force, speed and acceleration of the named points, and the
    pins' paths (of many joints, of those that bear most); of another one its coordinates, points, drives or reactions.

    **Raises:** `ClearanceError` for a dataset that is no motion, or shows nothing.
    """
    joints = names_of(dataset, "joint")
    of_contacts = [Panel(ECCENTRICITY, _eccentricity), Panel("contact force", _force)]
    shown = [*of_contacts, *of_points(dataset)] if joints else panels(dataset)
    if "time" not in dataset.coords or not shown:
        why = "this is no result of `clearance simulate`, or nothing in it moves"
        raise ClearanceError(f"There is nothing to draw: {why}.")
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
    axes = panel_grid(figure, len(joints), across).flat
    if len(joints) == 1:
        pin_path(axes[0], dataset, joints[0])
        return
    named = {}
    for axis, joint in zip(axes, joints, strict=False):
        _draw_states(axis, dataset, joint, shares=False)
        axis.set_title(joint, fontsize=9)
        axis.tick_params(labelsize=7)
        named |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    figure.suptitle("pin centres in their sleeves: e_y over e_x, µm", fontsize=10)
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=4, frameon=False, fontsize=8)


def _eccentricity(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    for joint in bearing_most(dataset):
        time, places = pins.at_steps(dataset, joint, "eccentricity")
        places = places[:, :2]  # across the sleeve
        colour = curve(axis, factor * time, np.hypot(*places.T) * 1e3, str(joint))
        outline = pins.outline_of(dataset, joint)
        if outline is not None and outline.height is None and not np.any(outline.depth):
            axis.axhline(outline.clearance * 1e3, color=colour, ls="--", lw=0.8, alpha=0.7)
    axis.set(ylabel="eccentricity, mm")


def _force(axis, dataset: xr.Dataset) -> None:
    factor = time_axis(axis, float(dataset["time"][-1]))
    joints = names_of(dataset, "joint")
    for place, joint in enumerate(bearing_most(dataset)):
        time, force = pins.at_steps(dataset, joint, "contact_force")
        colour = curve(axis, factor * time, force, str(joint))
        if "peak_force" in dataset:
            episodes = dataset["episode_joint"].values == joints.index(joint)
            times, peaks = (dataset[name].values[episodes] for name in ("peak_time", "peak_force"))
            label = "refined peaks" if place == 0 else None
            axis.plot(factor * times, peaks, "v", ms=4, color=colour, mfc="none", label=label)
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
        text = f"largest peak {peak:.4g} N at {seconds(float(dataset['peak_time'][largest]))} (above the axis)"
        style = {"ha": "center", "va": "top", "fontsize": 8, "transform": axis.transAxes}
        axis.text(0.5, 0.85, text, bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 1.5}, **style)


def pin_path(axis, dataset: xr.Dataset, joint: str) -> None:
    """The pin centre's path inside the clearance circle, coloured by contact state."""
    _draw_states(axis, dataset, joint, shares=True)
    axis.set(xlabel="e_x, µm", ylabel="e_y, µm", title=f"pin centre in the sleeve of {joint}")
    legend_below(axis, 2, fontsize=8)


def _draw_states(axis, dataset: xr.Dataset, joint: str, shares: bool) -> None:
    """Draw a pin's path; `shares`: label the states with their fractions of the time."""
    path = pins.middle_path(dataset, joint)
    states = {code: state for code, state in enumerate(STATES) if np.any(path.state == code)}
    if shares:
        states = {code: (with_share(name, path.share(code)), colour) for code, (name, colour) in states.items()}
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
        fix = "Choose another path ending in .png or .pdf."
        raise ClearanceError(f"Cannot write the figure `{path}`: {error}. {fix}") from error


@STYLED
def play(dataset: xr.Dataset, edges: bool = False) -> Figure:
    """The contact patterns of clearance joints over time, and below them the orbits of pins at every station of their
    sleeves (of the joints with the largest forces).

    **Arguments:** `edges`: the orbits at the sleeve's edges only.

    **Raises:** `ClearanceError` for a dataset without clearance joints.
    """
    joints = names_of(dataset, "joint")
    if not joints:
        raise ClearanceError("There is nothing to draw: no joint of this result has clearance.")
    most = bearing_most(dataset)
    drawn = [pins.station_paths(dataset, joint) for joint in most if pins.is_pin(pins.outline_of(dataset, joint))]
    drawn = [[paths[0], paths[-1]] if edges and len(paths) > 1 else paths for paths in drawn]
    orbits_of = [paths for paths in drawn if len(paths) > 1]
    single = [paths[0] for paths in drawn if len(paths) == 1]
    orbits_of += [single] if single else []
    heights = [0.9 + 0.55 * len(joints), *(0.7 + 2.8 * -(-len(group) // ROW) for group in orbits_of)]
    figure = Figure(figsize=(11, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    timeline(parts[0].subplots(), dataset)
    for part, group in zip(parts[1:], orbits_of, strict=True):
        _draw_orbits(part, group)
    title = f"{dataset.attrs.get('mechanism', '')}: where pins bear"
    if len(joints) > MOST:
        title += f"\npaths of the {MOST} of {len(joints)} that bear most"
    figure.suptitle(title)
    return figure


def bearing_most(dataset: xr.Dataset) -> list[str]:
    """The joints that a figure shows: those with the largest forces, in their own order."""
    joints = names_of(dataset, "joint")
    forces = dataset["step_force" if "step_force" in dataset else "contact_force"].values
    most = np.argsort(-np.max(forces, axis=0), kind="stable")[:MOST]
    return [joints[k] for k in sorted(most)]


def timeline(axis: Any, dataset: xr.Dataset, joints: list[str] | None = None) -> None:
    """Draw a bar for each clearance joint, coloured by its contact pattern; below it another one while a face bears."""
    joints = names_of(dataset, "joint") if joints is None else joints
    factor = time_axis(axis, float(dataset["time"][-1]))
    labelled: set[str] = set()
    for row, joint in enumerate(joints):
        bearing, outline = pins.spans(dataset, joint), pins.outline_of(dataset, joint)
        names = PATTERNS if outline is not None and outline.edges else (PATTERNS[0], TOUCHING)
        told = [(words, colour, bearing.pattern % pins.FACE == code) for code, (words, colour) in enumerate(names)]
        for words, colour, chosen in (*told, (*FACES, bearing.pattern >= pins.FACE)):
            if not np.any(chosen):
                continue
            # One joint's shares of the time stand in the legend; of several they would not be the same.
            label = words if len(joints) > 1 else with_share(words, bearing.share(chosen))
            where = (row + BAR / 2, FACE_BAR) if words == FACES[0] else (row - BAR / 2, BAR)
            bars = factor * np.stack([bearing.begin, bearing.end - bearing.begin], axis=1)[chosen]
            axis.broken_barh(bars, where, facecolors=colour, lw=0, label=None if label in labelled else label)
            labelled.add(label)
    axis.set(ylim=(len(joints) - 0.4, -0.6), yticks=range(len(joints)), yticklabels=joints)
    axis.set_xlim(factor * float(dataset["time"][0]), factor * float(dataset["time"][-1]))
    axis.grid(axis="y", visible=False)
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(PATTERNS) + 1, frameon=False, borderpad=0)


def with_share(words: str, share: float) -> str:
    """Words, and the fraction of the time."""
    return f"{words} ({share:.0%})" if share >= TOLD else f"{words} (< 1%)"


def _draw_orbits(figure: Any, paths: list[pins.PinPath]) -> None:
    """Draw paths beside each other; those of one joint have one scale."""
    columns, same_joint = min(ROW, len(paths)), len({path.joint for path in paths}) == 1
    axes = panel_grid(figure, len(paths), columns, sharex=same_joint, sharey=same_joint)
    for path, axis in zip(paths, axes.flat, strict=False):
        draw_path(axis, path, BEARING)
        named = path.joint
        if same_joint and len(paths) > 1:
            edge = ", edge" if path.height in (paths[0].height, paths[-1].height) else ""
            named = f"z = {1e3 * path.height:+.3g} mm{edge}".replace("-", "−")
        axis.set_title(f"{named}: bears {path.share(1):.0%}", fontsize=9)
    for axis in axes[:, 0]:
        axis.set_ylabel("e_y, µm")
    for axis in axes[-1]:
        axis.set_xlabel("e_x, µm")
    of = f" of {paths[0].joint}" if same_joint and len(paths) > 1 else ""
    figure.suptitle(f"path of the pin's centre{of} in the sleeve's axes, and how long it bears there", fontsize=10)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def draw_path(axis: Any, path: pins.PinPath, states: Mapping[int, tuple[str, str]]) -> None:
    """A pin's path: flights as curves, contacts as dots, the limit of travel; `states`: label and colour by state."""
    for code, (label, colour) in states.items():
        chosen = path.state == code
        if code == 0:
            axis.plot(*1e6 * flights(path.time, path.places, chosen).T, lw=0.6, color=colour, label=label, zorder=1)
        else:
            axis.plot(*1e6 * path.places[chosen].T, ".", ms=3, color=colour, label=label, zorder=2 + code)
    if path.travel is not None:
        axis.plot(*1e6 * path.travel, "k--", lw=0.8, label="clearance")
    axis.set_aspect("equal", adjustable="box")
    for ticks in (axis.xaxis, axis.yaxis):
        ticks.set_major_locator(MaxNLocator(nbins=5))
