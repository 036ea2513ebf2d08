"""Figures of play: when a pin bears how, and where its centre goes at every station of its sleeve. Dataset in, Figure
out.
"""

from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report.curves import flights
from clearance_jax.report.panels import time_axis
from clearance_jax.results.bearing import FACE, PLANE, Spans, Stations, kind, outline, spans, stations

# Of contact patterns, faces apart: words and colour. Where a joint has no edges, the first two.
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
# Orbits in a row at most; the least share of the time that is said in a number.
ROW, TOLD = 4, 0.005
SLEEVE = "SleeveClearance"


def play(dataset: xr.Dataset, edges: bool = False) -> Figure:
    """When each clearance joint bears how, and below it the orbits of its pin at every station of its sleeve.

    **Arguments:** `edges`: the orbits at the sleeve's edges only.

    **Raises:** `ClearanceError` for a dataset without clearance joints.
    """
    joints = [str(name) for name in dataset["joint"].values] if "joint" in dataset.coords else []
    if not joints:
        raise ClearanceError("There is nothing to draw: no joint of this result has clearance.")
    plane = [joint for joint in joints if kind(dataset, joint) == PLANE]
    orbits_of = [_stations(dataset, joint, edges) for joint in joints if kind(dataset, joint) == SLEEVE]
    orbits_of += [[orbit for joint in plane for orbit in _stations(dataset, joint)]] if plane else []
    heights = [0.9 + 0.55 * len(joints), *(0.7 + 2.8 * -(-len(group) // ROW) for group in orbits_of)]
    with mpl.rc_context({"axes.grid": True, "grid.alpha": 0.3, "font.size": 9}):
        figure = Figure(figsize=(11, sum(heights)), layout="constrained")
        parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
        timeline(parts[0].subplots(), dataset)
        for part, group in zip(parts[1:], orbits_of, strict=True):
            _drawn(part, group)
        figure.suptitle(f"{dataset.attrs.get('mechanism', '')}: where pins bear")
    return figure


def timeline(axis: Any, dataset: xr.Dataset, joints: list[str] | None = None) -> None:
    """A bar for each clearance joint, coloured by how it bears; below it another one while a face bears."""
    joints = [str(name) for name in dataset["joint"].values] if joints is None else joints
    factor = time_axis(axis, float(dataset["time"][-1]))
    labelled: set[str] = set()
    for row, joint in enumerate(joints):
        found = spans(dataset, joint)
        for words, colour, chosen in _told(dataset, joint, found):
            # One joint's shares of the time stand in the legend; of several they would not be the same.
            share = found.share(chosen)
            label = words if len(joints) > 1 else f"{words} ({share:.0%})" if share >= TOLD else f"{words} (< 1%)"
            _bars(axis, factor, found, chosen, (row - BAR / 2, BAR), colour, label if label not in labelled else None)
            labelled.add(label)
    axis.set(ylim=(len(joints) - 0.4, -0.6), yticks=range(len(joints)), yticklabels=joints)
    axis.set_xlim(factor * float(dataset["time"][0]), factor * float(dataset["time"][-1]))
    axis.grid(axis="y", visible=False)
    axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(PATTERNS) + 1, frameon=False, borderpad=0)


def _told(dataset: xr.Dataset, joint: str, found: Spans) -> list[tuple[str, str, np.ndarray]]:
    """Words, colour and which spans, of every way to bear that there is."""
    radial = found.pattern % FACE
    names = PATTERNS if kind(dataset, joint) == SLEEVE else (PATTERNS[0], TOUCHING)
    told = [(words, colour, radial == code) for code, (words, colour) in enumerate(names)]
    told.append((*FACES, found.pattern >= FACE))
    return [entry for entry in told if np.any(entry[2])]


def _bars(axis: Any, factor: float, found: Spans, chosen, where: tuple[float, float], colour: str, label) -> None:
    low, height = where
    if colour == FACES[1]:
        low, height = low + height, FACE_BAR
    bars = np.stack([found.begin, found.end - found.begin], axis=1)[chosen]
    axis.broken_barh(factor * bars, (low, height), facecolors=colour, lw=0, label=label)


class Orbit(NamedTuple):
    """The path of a pin's centre at one station of its sleeve: what it is called, of which joint, and how far it can
    go [m], (2, points).
    """

    title: str
    joint: str
    outline: np.ndarray
    time: np.ndarray
    places: np.ndarray
    touching: np.ndarray


def orbits(figure: Any, dataset: xr.Dataset, joint: str, edges: bool = False) -> None:
    """The paths of a pin's centre inside the clearance circle at every station of its sleeve, or at its edges only, and
    where along them the pin bears there; on a figure, or part of one.

    **Raises:** `ClearanceError` of a joint that is no pin in a sleeve.
    """
    _drawn(figure, _stations(dataset, joint, edges))


def _stations(dataset: xr.Dataset, joint: str, edges: bool = False) -> list[Orbit]:
    found = stations(dataset, joint)
    last = len(found.heights) - 1
    chosen = sorted({0, last}) if edges else range(last + 1)
    out = []
    for k in chosen:
        place = f"z = {1e3 * found.heights[k]:+.3g} mm{', edge' if k in (0, last) else ''}".replace("-", "−")
        title = f"{place if last else joint}: bears {share(found, k):.0%}"
        room = outline(dataset, joint, k)
        out.append(Orbit(title, joint, room, found.time, found.places[:, k], found.penetration[:, k] > 0))
    return out


def _drawn(figure: Any, found: list[Orbit]) -> None:
    """One beside another; those of one joint on one scale."""
    columns, one = min(ROW, len(found)), len({orbit.joint for orbit in found}) == 1
    rows = -(-len(found) // columns)
    axes = figure.subplots(rows, columns, sharex=one, sharey=one, squeeze=False)
    for orbit, axis in zip(found, axes.flat, strict=False):
        _orbit(axis, orbit)
    for axis in axes.flat[len(found) :]:
        axis.set_axis_off()
    for axis in axes[:, 0]:
        axis.set_ylabel("e_y, µm")
    for axis in axes[-1]:
        axis.set_xlabel("e_x, µm")
    of = f" of {found[0].joint}" if one and len(found) > 1 else ""
    figure.suptitle(f"path of the pin's centre{of} in the sleeve's axes, and how long it bears there", fontsize=10)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)


def _orbit(axis: Any, orbit: Orbit) -> None:
    axis.plot(*1e6 * flights(orbit.time, orbit.places, ~orbit.touching).T, lw=0.6, color="tab:blue", label="apart")
    # A legend's entry even where this station never bears: another one may.
    axis.plot(*1e6 * orbit.places[orbit.touching].T, ".", ms=3, color="tab:red", zorder=2, label="bears here")
    axis.plot(*1e6 * orbit.outline, "k--", lw=0.8, label="clearance circle")
    axis.set_aspect("equal", adjustable="box")
    axis.set_title(orbit.title, fontsize=9)
    for ticks in (axis.xaxis, axis.yaxis):
        ticks.set_major_locator(MaxNLocator(nbins=5))


def share(found: Stations, k: int) -> float:
    """The part of the time in which the pin bears at a station, what is known at an instant holding until the next."""
    lasts = np.diff(found.time)
    return float(np.sum(lasts[found.penetration[:-1, k] > 0]) / np.sum(lasts))
