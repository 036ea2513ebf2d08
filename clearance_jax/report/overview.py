"""The default figure of a motion: mechanism, error, contact forces with the first fall set apart, orbits of pins."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from clearance_jax.errors import ClearanceError
from clearance_jax.report.panels import curve, heading, instant, page, panels, same_scale, time_axis
from clearance_jax.report.play_figures import MOST, bearing_most, draw_states, timeline
from clearance_jax.report.skeleton import Skeleton
from clearance_jax.report.style import NARROW, STYLED, fit, force_unit, legend_below, length_unit, look, panel_grid
from clearance_jax.results import play as pins
from clearance_jax.results.first_fall import falls_over
from clearance_jax.results.places import Places, names_of, outline, places

# Widths of the two columns, and heights: mechanism, a row of orbits, the first fall, a panel over time, and in the
# timeline a joint's bar [inch].
WIDTHS, MECHANISM, ORBIT, FALL, ROW, BAR = (4.6, 7.0), 3.2, 2.0, 2.0, 2.0, 0.3
# Distance of a legend below a panel that has no numbers there, and height of a line in a legend [inch].
NEAR, LINE = 0.08, 0.17
# Between the left edge of a column and its axes [inch].
MARGIN = 0.9
# Most names in the mechanism; places nearer than this part of its size share a name.
FEW, SAME = 5, 0.1
# If first falls take more of the motion than this, they are not set apart.
LONG = 0.8


class MotionShown(NamedTuple):
    """A dataset, its joints that are shown, when their first falls are over [s] (minus infinity: not set apart), and
    whether the figure is narrow.
    """

    dataset: xr.Dataset
    joints: list[str]
    over: float
    narrow: bool

    @property
    def falls(self) -> bool:
        """Whether first falls are set apart."""
        return bool(np.isfinite(self.over))

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of the orbits."""
        columns = 1 if len(self.joints) == 1 else 2 if len(self.joints) <= 4 else 3
        return -(-len(self.joints) // columns), columns

    @property
    def last(self) -> float:
        """When the motion ends [s]."""
        return float(self.dataset["time"][-1])

    def title(self, axis: Any, text: str, column: int) -> None:
        """Write the title of a panel in a column."""
        width = NARROW if self.narrow else WIDTHS[column]
        axis.set_title(fit(text, width - MARGIN), loc="left", fontsize=9)

    def forces(self, joint: str, falling: bool) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and contact forces [N], within the steps too, after the first falls or in them (`falling`)."""
        time, force = pins.at_steps(self.dataset, joint, "contact_force")
        if "peak_force" in self.dataset:
            there = self.dataset["episode_joint"].values == names_of(self.dataset, "joint").index(joint)
            time = np.append(time, self.dataset["peak_time"].values[there])
            force = np.append(force, self.dataset["peak_force"].values[there])
            order = np.argsort(time, kind="stable")
            time, force = time[order], force[order]
        chosen = (time <= self.over) == falling
        return time[chosen], force[chosen]


@STYLED
def draw_motion(dataset: xr.Dataset, narrow: bool = False) -> Figure:
    """The figure `motion`."""
    shown = panels(dataset) if "time" in dataset.coords else []
    if not shown:
        why = "this is no result of `clearance simulate`, or nothing in it moves"
        raise ClearanceError(f"There is nothing to draw: {why}.")
    return page(shown, dataset, heading(dataset), narrow)


@STYLED
def draw_overview(dataset: xr.Dataset, narrow: bool = False) -> Figure:
    """The figure `overview`."""
    every = names_of(dataset, "joint")
    if not every or "time" not in dataset.coords:
        return draw_motion(dataset, narrow)
    time, over = dataset["time"].values, falls_over(dataset)
    shown = MotionShown(dataset, bearing_most(dataset), over, narrow)
    if over > time[0] + LONG * (time[-1] - time[0]):
        shown = shown._replace(over=-np.inf)
    first: dict[Callable, float] = {_mechanism: MECHANISM} if "mark_position" in dataset else {}
    rest: dict[Callable, float] = {_orbits: 0.5 + ORBIT * (1.4 if len(shown.joints) == 1 else shown.grid[0])}
    rest |= {_fall: FALL + LINE * len(shown.joints)} if shown.falls else {}
    tall = 0.9 + sum(_rows(shown).values())
    columns = [first | {_over_time: tall} | rest] if narrow else [first | rest, {_over_time: tall}]
    widths = (NARROW,) if narrow else WIDTHS
    height = max(sum(column.values()) for column in columns)
    figure = Figure(figsize=(sum(widths), height + 0.5), layout="constrained")
    where, letters = figure.subfigures(1, len(columns), width_ratios=widths, squeeze=False)[0], iter("abcdefgh")
    for part, column in zip(where, columns, strict=True):
        places = part.subfigures(len(column), 1, height_ratios=list(column.values()), squeeze=False)[:, 0]
        for place, draw in zip(places, column, strict=True):
            draw(place, shown, letters)
    title = heading(dataset)
    if len(every) > MOST:
        title += f"\nof {len(every)} joints with play the {MOST} that bear most"
    if "ideal" in dataset.attrs and "position_error" not in dataset:
        title += f"\nerror not shown: {dataset.attrs['ideal']}"
    figure.suptitle(fit(title, sum(widths), 11.0))
    return figure


def _mechanism(figure: Any, shown: MotionShown, letters: Iterator[str]) -> None:
    """The mechanism at one instant; joints with play and points in their colours, with the points' paths."""
    still, placed = outline(shown.dataset), places(shown.dataset)
    i, in_space = still.sample, placed.at.shape[-1] == 3
    axis = figure.add_subplot(projection="3d" if in_space else None)
    Skeleton(axis, placed, whole=True).show(i)
    for k, name in enumerate(placed.points):
        path = placed.at[:, placed.points[name]]
        axis.plot(*path.T, lw=1.2, ms=6, markevery=[i], zorder=5.5, **look(-1 - k))
    for k, joint in enumerate(shown.joints):
        axis.plot(*placed.at[[i], placed.joints[joint]].T, ms=8, mew=1.8, mfc="white", zorder=6, **look(k))
    _name(axis, placed, i, [*placed.points.items(), *((joint, placed.joints[joint]) for joint in shown.joints)])
    if not in_space:
        same_scale(axis, still.visible)
    shown.title(axis, f"({next(letters)}) mechanism at {instant(still.time, shown.last)}, paths of its points", 0)


def _name(axis: Any, placed: Places, i: int, marks: list[tuple[str, int]]) -> None:
    """Write names beside marks, those of one place together; nothing if they are too many."""
    groups: list[tuple[np.ndarray, list[str]]] = []
    for name, mark in marks if len(marks) <= FEW else ():
        at = placed.at[i, mark]
        near = next((names for other, names in groups if np.linalg.norm(at - other) < SAME * placed.size), None)
        if near is None:
            groups.append((at, [name]))
        else:
            near.append(name)
    for at, names in groups:
        axis.text(*at, f"\n   {', '.join(dict.fromkeys(names))}", va="top", fontsize=8, zorder=7)


def _orbits(figure: Any, shown: MotionShown, letters: Iterator[str]) -> None:
    count = len(shown.joints)
    axes = panel_grid(figure, count, shown.grid[1])
    named = {}
    for axis, joint in zip(axes.flat, shown.joints, strict=False):
        draw_states(axis, shown.dataset, joint, shares=count == 1)
        axis.set_title(joint, fontsize=9)
        axis.tick_params(labelsize=8)
        named |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    figure.suptitle(f"({next(letters)}) pin centres in their sleeves, e_y over e_x, µm", fontsize=9)
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=2 if count == 1 else 4, fontsize=8)


def _fall(figure: Any, shown: MotionShown, letters: Iterator[str]) -> None:
    axis = figure.subplots()
    _forces(axis, shown, falling=True)
    shown.title(axis, f"({next(letters)}) contact force in the first fall, an artefact of the start", 0)
    legend_below(axis, 1 if shown.narrow else 2, fontsize=8)


def _forces(axis: Any, shown: MotionShown, falling: bool) -> None:
    """Contact forces in the first falls or after them, with the largest of each joint in words."""
    series = {joint: shown.forces(joint, falling) for joint in shown.joints}
    factor, unit = force_unit(max((float(force.max()) for _, force in series.values() if force.size), default=0.0))
    last = shown.over if falling else shown.last
    per_second = time_axis(axis, last)
    for k, (joint, (time, force)) in enumerate(series.items()):
        if force.size:
            top = int(np.argmax(force))
            told = f"{joint}: at most {factor * force[top]:.4g} {unit} at {instant(time[top], last)}"
            curve(axis, per_second * time, factor * force, told, k)
    axis.set(ylabel=f"normal force, {unit}", ylim=(0, None))


def _rows(shown: MotionShown) -> dict[Callable, float]:
    """The panels over time, and their heights [inch]."""
    lines = LINE * len(shown.joints) / (1 if shown.narrow else 2)
    rows: dict[Callable, float] = {_error: ROW} if "position_error" in shown.dataset else {}
    return rows | {_force: ROW + lines, _eccentricity: ROW - 0.3, _bearing: 0.6 + BAR * len(shown.joints)}


def _over_time(figure: Any, shown: MotionShown, letters: Iterator[str]) -> None:
    """Panels below each other over one axis of time, on which the first falls are grey."""
    rows = _rows(shown)
    axes = figure.subplots(len(rows), 1, sharex=True, height_ratios=list(rows.values()))
    factor = time_axis(axes[-1], shown.last)
    for axis, draw in zip(axes, rows, strict=True):
        shown.title(axis, f"({next(letters)}) {draw(axis, shown)}", 1)
        if axis is not axes[-1]:
            axis.set_xlabel("")
            if shown.falls:
                begin = factor * float(shown.dataset["time"][0])
                axis.axvspan(begin, factor * shown.over, color="0.88", lw=0, zorder=0)
    axes[-1].set_xlim(*factor * shown.dataset["time"].values[[0, -1]])


def _error(axis: Any, shown: MotionShown) -> str:
    errors = shown.dataset["position_error"]
    time, largest = shown.dataset["time"].values, errors.max("time")
    factor, unit = length_unit(float(largest.max()))
    per_second = time_axis(axis, float(time[-1]))
    for k, name in enumerate(names_of(shown.dataset, "point")):
        values = errors.sel(point=name).values
        top = int(np.nanargmax(values))
        told = f"{name}: at most {factor * values[top]:.4g} {unit} at {instant(time[top], shown.last)}"
        if time[top] <= shown.over:
            told += f", after the fall {factor * np.nanmax(values[time > shown.over]):.4g} {unit}"
        curve(axis, per_second * time, factor * values, told, -1 - k)
    axis.set(ylabel=f"error, {unit}", ylim=(0, None))
    legend_below(axis, 1 if shown.narrow else 2, below=NEAR, fontsize=8)
    return "distance of points from their places on the ideal mechanism"


def _force(axis: Any, shown: MotionShown) -> str:
    _forces(axis, shown, falling=False)
    legend_below(axis, 1 if shown.narrow else 2, below=NEAR, fontsize=8)
    if not shown.falls:
        return "contact force"
    return f"contact force after the first fall (grey: fall, until {instant(shown.over, shown.last)})"


def _eccentricity(axis: Any, shown: MotionShown) -> str:
    per_second = time_axis(axis, shown.last)
    for k, joint in enumerate(shown.joints):
        time, places = pins.at_steps(shown.dataset, joint, "eccentricity")
        colour = curve(axis, per_second * time, 1e6 * np.hypot(*places[:, :2].T), joint, k)  # across the sleeve
        form = pins.outline_of(shown.dataset, joint)
        if form is not None and form.height is None and not np.any(form.depth):
            axis.axhline(1e6 * form.clearance, color=colour, ls="--", lw=0.8, alpha=0.7)
    axis.set(ylabel="eccentricity, µm", ylim=(0, None))
    return "distance of the pin's centre from the sleeve's (dashed: clearance)"


def _bearing(axis: Any, shown: MotionShown) -> str:
    """The timeline, beside it how often each joint was touched after the first falls."""
    timeline(axis, shown.dataset, shown.joints)
    if "episode_start" not in shown.dataset:
        return "when pins bear"
    later = shown.dataset["episode_start"].values > shown.over
    owner = shown.dataset["episode_joint"].values[later]
    for row, joint in enumerate(shown.joints):
        count = int(np.sum(owner == names_of(shown.dataset, "joint").index(joint)))
        axis.text(1.01, row, f"{count}", transform=axis.get_yaxis_transform(), va="center")
    return f"when pins bear; right: number of touches{' after the first fall' * shown.falls}"
