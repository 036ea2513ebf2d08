"""Figures of play from a dataset: contact patterns over time, and paths of pin centres at the stations of sleeves."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report.curves import flights
from clearance_jax.report.panels import time_axis
from clearance_jax.report.style import STYLED
from clearance_jax.results.bearing import FACE, BearingSpans, spans
from clearance_jax.results.outlines import outline_of
from clearance_jax.results.play import PinPath, is_pin, station_paths

# Words and colours of contact patterns, faces apart. A joint without edges has only the first and `TOUCHING`.
PATTERNS = (
    ("apart", "0.88"),
    ("at one edge", "tab:orange"),
    ("along a line", "tab:green"),
    ("at two opposite edges", "tab:red"),
)
TOUCHING = ("in contact", "tab:red")
FACES = ("on a face", "tab:purple")
# Of the height of a joint's row: its bar, and the one of its faces below.
BAR, FACE_BAR = 0.55, 0.16
# Most orbits in a row; the least share of the time that is shown as a number.
ROW, TOLD = 4, 0.005
# Most joints whose paths are shown: those with the largest forces.
MOST = 6
BEARING = {0: ("apart", "tab:blue"), 1: ("bears here", "tab:red")}


@STYLED
def play(dataset: xr.Dataset, edges: bool = False) -> Figure:
    """The contact patterns of clearance joints over time, and below them the orbits of pins at every station of their
    sleeves (of the joints with the largest forces).

    **Arguments:** `edges`: the orbits at the sleeve's edges only.

    **Raises:** `ClearanceError` for a dataset without clearance joints.
    """
    joints = [str(name) for name in dataset["joint"].values] if "joint" in dataset.coords else []
    if not joints:
        raise ClearanceError("There is nothing to draw: no joint of this result has clearance.")
    most = bearing_most(dataset)
    drawn = [_paths(dataset, joint, edges) for joint in most if is_pin(outline_of(dataset, joint))]
    orbits_of = [paths for paths in drawn if len(paths) > 1]
    single = [paths[0] for paths in drawn if len(paths) == 1]
    orbits_of += [single] if single else []
    heights = [0.9 + 0.55 * len(joints), *(0.7 + 2.8 * -(-len(group) // ROW) for group in orbits_of)]
    figure = Figure(figsize=(11, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    timeline(parts[0].subplots(), dataset)
    for part, group in zip(parts[1:], orbits_of, strict=True):
        _draw(part, group)
    title = f"{dataset.attrs.get('mechanism', '')}: where pins bear"
    if len(joints) > MOST:
        title += f"\npaths of the {MOST} of {len(joints)} that bear most"
    figure.suptitle(title)
    return figure


def bearing_most(dataset: xr.Dataset) -> list[str]:
    """The joints that a figure shows: those with the largest forces, in their own order."""
    joints = [str(name) for name in dataset["joint"].values]
    forces = dataset["step_force" if "step_force" in dataset else "contact_force"].values
    most = np.argsort(-np.max(forces, axis=0), kind="stable")[:MOST]
    return [joints[k] for k in sorted(most)]


def timeline(axis: Any, dataset: xr.Dataset, joints: list[str] | None = None) -> None:
    """Draw a bar for each clearance joint, coloured by its contact pattern; below it another one while a face bears."""
    joints = [str(name) for name in dataset["joint"].values] if joints is None else joints
    factor = time_axis(axis, float(dataset["time"][-1]))
    labelled: set[str] = set()
    for row, joint in enumerate(joints):
        bearing = spans(dataset, joint)
        for words, colour, chosen in _tell(dataset, joint, bearing):
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


def _tell(dataset: xr.Dataset, joint: str, bearing: BearingSpans) -> list[tuple[str, str, np.ndarray]]:
    """Words, colour and spans of every contact pattern that occurs."""
    radial = bearing.pattern % FACE
    outline = outline_of(dataset, joint)
    names = PATTERNS if outline is not None and outline.edges else (PATTERNS[0], TOUCHING)
    told = [(words, colour, radial == code) for code, (words, colour) in enumerate(names)]
    told.append((*FACES, bearing.pattern >= FACE))
    return [entry for entry in told if np.any(entry[2])]


def with_share(words: str, share: float) -> str:
    """Words, and the fraction of the time."""
    return f"{words} ({share:.0%})" if share >= TOLD else f"{words} (< 1%)"


def _paths(dataset: xr.Dataset, joint: str, edges: bool) -> list[PinPath]:
    paths = station_paths(dataset, joint)
    return [paths[0], paths[-1]] if edges and len(paths) > 1 else paths


def _draw(figure: Any, paths: list[PinPath]) -> None:
    """Draw paths beside each other; those of one joint have one scale."""
    columns, same_joint = min(ROW, len(paths)), len({path.joint for path in paths}) == 1
    rows = -(-len(paths) // columns)
    axes = figure.subplots(rows, columns, sharex=same_joint, sharey=same_joint, squeeze=False)
    for path, axis in zip(paths, axes.flat, strict=False):
        draw_path(axis, path, BEARING)
        named = path.joint
        if same_joint and len(paths) > 1:
            edge = ", edge" if path.height in (paths[0].height, paths[-1].height) else ""
            named = f"z = {1e3 * path.height:+.3g} mm{edge}".replace("-", "−")
        axis.set_title(f"{named}: bears {path.share(1):.0%}", fontsize=9)
    for axis in axes.flat[len(paths) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("e_y, µm")
    for axis in axes[-1]:
        axis.set_xlabel("e_x, µm")
    of = f" of {paths[0].joint}" if same_joint and len(paths) > 1 else ""
    figure.suptitle(f"path of the pin's centre{of} in the sleeve's axes, and how long it bears there", fontsize=10)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def draw_path(axis: Any, path: PinPath, states: Mapping[int, tuple[str, str]]) -> None:
    """Draw the path of a pin's centre: flights as curves, contacts as dots, and the limit of its travel; `states`:
    label and colour by contact state.
    """
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
