"""Figures of play: contact patterns over time, paths of pins in their sleeves."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from clearance_jax.errors import ClearanceError
from clearance_jax.report import style
from clearance_jax.report.panels import flights, heading, time_axis
from clearance_jax.report.style import NARROW, STYLED, fit, legend_below, panel_grid
from clearance_jax.results import play as pins
from clearance_jax.results.places import names_of

# Words, colour and marker of the states of a path.
STATES = (("free", style.SKY, ""), ("contact", style.GREEN, "o"), ("impact", style.RED, "^"))
BEARING = {0: ("apart", style.SKY, ""), 1: ("bears here", style.RED, "o")}
# Words, colours and heights (as parts of a joint's row) of the bars of contact patterns, faces apart. A joint without
# edges has only the first and `TOUCHING`. Heights are for those who do not see the colours.
PATTERNS = ("apart", "0.8", 0.12), ("at one edge", style.ORANGE, 0.3), ("along a line", style.GREEN, 0.45)
TALL = 0.6
PATTERNS += (("at two opposite edges", style.RED, TALL),)
TOUCHING = ("in contact", style.BLUE, TALL)
FACES = ("on a face", style.PURPLE, 0.16)
# Words, colours, side and height (from, to) of the bars of gaps: the flank above is that at the positive end.
FLANKS = (("on the flank at the positive end", style.RED, 1, 0.06, TALL / 2), ("apart", "0.8", 0, -0.06, 0.06))
FLANKS += (("on the flank at the negative end", style.BLUE, -1, -TALL / 2, -0.06),)
# Most orbits in a row, on a narrow screen; the least share of the time that is shown as a number.
ROW, FEW, TOLD = 4, 2, 0.005
# Most joints whose paths are shown: those with the largest forces.
MOST = 6


@STYLED
def draw_play(dataset: xr.Dataset, narrow: bool = False, edges: bool = False) -> Figure:
    """The figure `play`."""
    joints, gaps = names_of(dataset, "joint"), names_of(dataset, "gap")
    if not (joints or gaps):
        raise ClearanceError("There is nothing to draw: no joint of this result has clearance, and no drive backlash.")
    most = bearing_most(dataset)
    drawn = [pins.station_paths(dataset, joint) for joint in most if pins.is_pin(pins.outline_of(dataset, joint))]
    drawn = [[paths[0], paths[-1]] if edges and len(paths) > 1 else paths for paths in drawn]
    orbits_of = [paths for paths in drawn if len(paths) > 1]
    single = [paths[0] for paths in drawn if len(paths) == 1]
    orbits_of += [single] if single else []
    row, tall = (FEW, 2.3) if narrow else (ROW, 2.8)
    heights = [(1.4 if narrow else 0.9) + 0.55 * len(group) for group in (joints, gaps) if group]
    heights += [(1.3 if narrow else 0.8) + tall * -(-len(group) // row) for group in orbits_of]
    figure = Figure(figsize=(NARROW if narrow else 11, sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    bars = [draw for draw, group in ((timeline, joints), (_flanks, gaps)) if group]
    for part, draw in zip(parts, bars, strict=False):
        draw(part.subplots(), dataset)
    for part, group in zip(parts[len(bars) :], orbits_of, strict=True):
        _draw_orbits(part, group, row)
    bear = ("where pins and flanks bear" if gaps else "where pins bear") if joints else "which flanks bear"
    title = f"{heading(dataset)}: {bear}"
    if len(joints) > MOST:
        title += f"\npaths of the {MOST} of {len(joints)} that bear most"
    figure.suptitle(fit(title, figure.get_figwidth(), 11.0))
    return figure


def bearing_most(dataset: xr.Dataset) -> list[str]:
    """The joints that a figure shows: those with the largest forces, in their own order."""
    joints = names_of(dataset, "joint")
    return _largest(joints, [pins.at_steps(dataset, joint, "contact_force")[1] for joint in joints])


def pressed_most(dataset: xr.Dataset, unit: str) -> list[str]:
    """The gaps of angles ("rad") or slides ("m") that a figure shows: those with the largest efforts."""
    gaps = [gap for gap in names_of(dataset, "gap") if str(dataset["gap_unit"].sel(gap=gap).values) == unit]
    return _largest(gaps, [pins.at_steps(dataset, gap, "gap_effort")[1] for gap in gaps])


def _largest(names: list[str], values: Sequence[np.ndarray]) -> list[str]:
    most = np.argsort([-np.max(np.abs(each)) for each in values], kind="stable")[:MOST]
    return [names[k] for k in sorted(most)]


def timeline(axis: Any, dataset: xr.Dataset, joints: list[str] | None = None) -> None:
    """Draw a bar for each clearance joint, with colour and height by its contact pattern; below it another one while a
    face bears.
    """
    joints = names_of(dataset, "joint") if joints is None else joints
    factor = time_axis(axis, float(dataset["time"][-1]))
    labelled: set[str] = set()
    for row, joint in enumerate(joints):
        bearing, outline = pins.spans(dataset, joint), pins.outline_of(dataset, joint)
        names = PATTERNS if outline is not None and outline.edges else (PATTERNS[0], TOUCHING)
        told = [(*look, bearing.pattern % pins.FACE == code) for code, look in enumerate(names)]
        for words, colour, height, chosen in (*told, (*FACES, bearing.pattern >= pins.FACE)):
            if not np.any(chosen):
                continue
            # One joint's shares of the time stand in the legend; of several they would not be the same.
            label = words if len(joints) > 1 else with_share(words, bearing.share(chosen))
            bars = factor * np.stack([bearing.begin, bearing.end - bearing.begin], axis=1)[chosen]
            low = row + TALL / 2 - (0.0 if words == FACES[0] else float(height))
            known = None if label in labelled else label
            axis.broken_barh(bars, (low, height), facecolors=colour, lw=0, label=known)
            labelled.add(label)
    axis.set(ylim=(len(joints) - 0.4, -0.6), yticks=range(len(joints)), yticklabels=joints)
    axis.set_xlim(factor * float(dataset["time"][0]), factor * float(dataset["time"][-1]))
    axis.grid(axis="y", visible=False)
    legend_below(axis, len(PATTERNS) + 1)


def _flanks(axis: Any, dataset: xr.Dataset) -> None:
    """Draw a bar for each gap of a drive, coupling or stop, with colour and place by the flank that bears."""
    gaps = names_of(dataset, "gap")
    factor = time_axis(axis, float(dataset["time"][-1]))
    for row, gap in enumerate(gaps):
        time, state = pins.at_steps(dataset, gap, "gap_state")
        _, place = pins.at_steps(dataset, gap, "gap_position")
        # Every touch and separation is a step end, so a state holds from one to the next.
        bears = np.where(state > 0, np.sign(place), 0)[:-1]
        bars = factor * np.stack([time[:-1], np.diff(time)], axis=1)
        for words, colour, side, low, high in FLANKS:
            label = (
                words
                if len(gaps) > 1
                else with_share(words, float(np.sum(bars[bears == side, 1]) / np.sum(bars[:, 1])))
            )
            axis.broken_barh(
                bars[bears == side],
                (row - high, high - low),
                facecolors=colour,
                lw=0,
                label=label if row == 0 else None,
            )
    axis.set(ylim=(len(gaps) - 0.4, -0.6), yticks=range(len(gaps)), yticklabels=gaps)
    axis.set_xlim(factor * float(dataset["time"][0]), factor * float(dataset["time"][-1]))
    axis.grid(axis="y", visible=False)
    legend_below(axis, len(FLANKS))


def with_share(words: str, share: float) -> str:
    """Words, and the fraction of the time."""
    return f"{words} ({share:.0%})" if share >= TOLD else f"{words} (< 1%)"


def _draw_orbits(figure: Any, paths: list[pins.PinPath], row: int) -> None:
    """Draw paths beside each other; those of one joint have one scale."""
    gap = "\n" if row == FEW else " "
    columns, same_joint = min(row, len(paths)), len({path.joint for path in paths}) == 1
    axes = panel_grid(figure, len(paths), columns, sharex=same_joint, sharey=same_joint)
    for path, axis in zip(paths, axes.flat, strict=False):
        draw_path(axis, path, BEARING)
        named = path.joint
        if same_joint and len(paths) > 1:
            edge = ", edge" if path.height in (paths[0].height, paths[-1].height) else ""
            named = f"z = {1e3 * path.height:+.3g} mm{edge}".replace("-", "−")
        axis.set_title(f"{named}:{gap}bears {path.share(1):.0%}", fontsize=9)
    for axis in axes[:, 0]:
        axis.set_ylabel("e_y, µm")
    for axis in axes.flat[max(len(paths) - columns, 0) : len(paths)]:
        axis.set_xlabel("e_x, µm")
    of = f" of {paths[0].joint}" if same_joint and len(paths) > 1 else ""
    figure.suptitle(f"path of the pin's centre{of} in the sleeve's axes,{gap}and how long it bears there", fontsize=10)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_states(axis: Any, dataset: xr.Dataset, joint: str, shares: bool) -> None:
    """Draw a pin's path; `shares`: label the states with their fractions of the time."""
    path = pins.middle_path(dataset, joint)
    states = {code: state for code, state in enumerate(STATES) if np.any(path.state == code)}
    if shares:
        states = {code: (with_share(name, path.share(code)), *how) for code, (name, *how) in states.items()}
    draw_path(axis, path, states)


def draw_path(axis: Any, path: pins.PinPath, states: Mapping[int, tuple[str, str, str]]) -> None:
    """A pin's path: flights as curves, contacts as marks, the limit of travel; `states`: label, colour and marker by
    state.
    """
    for code, (label, colour, marker) in states.items():
        chosen = path.state == code
        if code == 0:
            axis.plot(*1e6 * flights(path.time, path.places, chosen).T, lw=0.6, color=colour, label=label, zorder=1)
        else:
            how: Any = {"ls": "", "ms": 2.5, "mew": 0, "color": colour, "label": label, "zorder": 2 + code}
            axis.plot(*1e6 * path.places[chosen].T, marker=marker, **how)
    if path.travel is not None:
        axis.plot(*1e6 * path.travel, "k--", lw=0.8, label="clearance")
    axis.set_aspect("equal", adjustable="box")
    axis.yaxis.set_major_locator(MaxNLocator(nbins=5))
    axis.xaxis.set_major_locator(MaxNLocator(nbins=4))
