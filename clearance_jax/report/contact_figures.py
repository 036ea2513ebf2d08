"""Figures of contacts: polar load diagrams, spectra, contact episodes."""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from scipy.signal import welch

from clearance_jax.errors import ClearanceError
from clearance_jax.report.panels import heading, time_axis
from clearance_jax.report.play_figures import bearing_most, pressed_most
from clearance_jax.report.style import NARROW, RED, STYLED, fit, force_unit, legend_below, length_unit, look
from clearance_jax.results import play as pins
from clearance_jax.results.first_fall import falls_over, seconds
from clearance_jax.results.places import names_of

# Sectors of a rose; width of a polar diagram, height of another panel [inch].
SECTORS, POLAR, PANEL = 36, 2.9, 2.4
# Of a spectrum: least and most even samples, windows in the time (they overlap by half), and how far below its largest
# value it is shown.
LEAST, GREATEST, WINDOWS, DEPTH = 64, 2**18, 8, 1e-10
# Ratios of the ends of a logarithmic axis: below the first one it has even numbers, above the other powers of ten only.
FEW, MANY = 5.0, 3e3


@STYLED
def draw_polar_load(dataset: xr.Dataset, narrow: bool = False) -> Figure:
    """The figure `polar_load`."""
    joints = bearing_most(dataset) if names_of(dataset, "joint") else []
    joints = [joint for joint in joints if pins.is_pin(pins.outline_of(dataset, joint))]
    if not joints:
        why = "There is nothing to draw: no joint of this result is a pin in a sleeve with clearance"
        gaps = names_of(dataset, "gap")
        more = f", and the gap of `{gaps[0]}` has no directions: see the figures play and episodes" if gaps else ""
        raise ClearanceError(f"{why}{more}.").about(gaps[0] if gaps else None)
    over, beside = falls_over(dataset), 1 if narrow or len(joints) == 1 else 2
    rows = -(-len(joints) // beside)
    wide = NARROW if narrow else 2 * POLAR * beside
    figure = Figure(figsize=(wide, (0.5 * NARROW + 0.5 if narrow else POLAR + 0.3) * rows + 0.7), layout="constrained")
    for place, joint in enumerate(joints):
        forces, rose = (figure.add_subplot(rows, 2 * beside, 2 * place + k, projection="polar") for k in (1, 2))
        _loads(forces, rose, dataset, joint, over)
    text = f"{heading(dataset)}: loads of pins{_after(over)}\ndirection: from the sleeve's centre to the contact"
    figure.suptitle(fit(text, wide, 11.0))
    return figure


def _after(over: float) -> str:
    return f" after the first fall (until {seconds(over)})" if np.isfinite(over) else ""


def _loads(forces: Any, rose: Any, dataset: xr.Dataset, joint: str, over: float) -> None:
    """Forces over their directions, and the share of the time in each direction."""
    time, force, angle = pins.loads_by_direction(dataset, joint)
    lasts = np.diff(time, append=time[-1]) * (time > over)
    chosen = (time > over) & (force > 0)
    factor, unit = force_unit(float(force[chosen].max(initial=0.0)))
    forces.plot(angle[chosen], factor * force[chosen], ".", ms=3, mew=0, alpha=0.6)
    forces.set_title(f"{joint}: force, {unit}", fontsize=9)
    sector = np.floor(angle[chosen] / (2 * np.pi) * SECTORS).astype(int) % SECTORS
    share = 100 * np.bincount(sector, lasts[chosen], SECTORS) / max(float(np.sum(lasts)), np.finfo(float).tiny)
    width = 2 * np.pi / SECTORS
    rose.bar((np.arange(SECTORS) + 0.5) * width, share, width, color=RED, ec="white", lw=0.4)
    rose.set_title(f"{joint}: % of time per {360 // SECTORS}°,\nbears {np.sum(share):.3g} % in all", fontsize=9)
    for axis in (forces, rose):
        axis.set_xticks(np.arange(0, 2 * np.pi, np.pi / 2))
        axis.tick_params(labelsize=8)
        axis.set_rlabel_position(135)
        axis.yaxis.set_major_locator(MaxNLocator(nbins=4, prune="lower"))


class EvenSeries(NamedTuple):
    """Values over even times, `per_second` of them, with a name, by its number among those of its kind."""

    name: str
    number: int
    values: np.ndarray
    per_second: float


@STYLED
def draw_spectrum(dataset: xr.Dataset, narrow: bool = False, modes: tuple[float, ...] = ()) -> Figure:
    """The figure `spectrum`."""
    kinds, over = _kinds(dataset), falls_over(dataset)
    if not kinds:
        raise ClearanceError("There is nothing to draw: no joint of this result has clearance, and no drive backlash.")
    parts, units = {}, {"error": "length"}
    for kind in kinds:
        title = {"joints": "force", "angles": "torque of flanks", "slides": "force of flanks"}[kind.what]
        name, units[title] = ("contact_force" if kind.what == "joints" else "gap_effort"), kind.effort
        series = ((k, each, *pins.at_steps(dataset, each, name)) for k, each in enumerate(kind.names))
        rows = [_even(k, each, time, values, over) for k, each, time, values in series]
        if moving := [row for row in rows if np.any(row.values)]:
            parts[title] = moving
    if "position_error" in dataset:
        columns = (dataset["position_error"].sel(point=name).values for name in names_of(dataset, "point"))
        time, named = dataset["time"].values, zip(names_of(dataset, "point"), columns, strict=True)
        parts = {"error": [_even(-1 - k, name, time, values, over) for k, (name, values) in enumerate(named)]} | parts
    if not parts:
        raise ClearanceError("There is nothing to draw: nothing touches in this result, so no force has a spectrum.")
    figure = Figure(figsize=(NARROW if narrow else 7, (PANEL + 0.6) * len(parts) + 0.5), layout="constrained")
    axes = figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (kind, rows) in zip(axes, parts.items(), strict=True):
        resolution = _densities(axis, units[kind], rows)
        for frequency in modes:
            label = "seated modes" if frequency == modes[0] else None
            axis.axvline(frequency, color="0.4", lw=0.9, ls=":", label=label)
        axis.set_title(f"{kind}, resolution {resolution:.3g} Hz", loc="left", fontsize=9)
        legend_below(axis, 3, fontsize=8)
    axes[-1].set_xlabel("frequency, Hz")
    figure.suptitle(fit(f"{heading(dataset)}: spectra{_after(over)}", figure.get_figwidth(), 11.0))
    return figure


def _even(number: int, name: str, time: np.ndarray, values: np.ndarray, over: float) -> EvenSeries:
    """A series after the first falls at even times, as dense as nine of ten of its own steps, by interpolation."""
    time, values = time[time > over], values[time > over]
    if len(time) < LEAST:
        text = f"A spectrum needs {LEAST} samples at least after the first fall, but there are {len(time)}."
        raise ClearanceError(f"{text} Simulate for longer, or save more times.").about("time", len(time))
    steps = np.diff(time)
    count = int(np.clip((time[-1] - time[0]) / np.quantile(steps[steps > 0], 0.1), LEAST, GREATEST))
    even = np.linspace(time[0], time[-1], count)
    return EvenSeries(name, number, np.interp(even, time, values), (count - 1) / (time[-1] - time[0]))


def _densities(axis: Any, of: str, rows: list[EvenSeries]) -> float:
    """Draw power spectral densities of a "length", or of efforts in a unit; returns their resolution [Hz]."""
    largest = max(float(np.abs(row.values).max()) for row in rows)
    factor, unit = length_unit(largest) if of == "length" else _effort_unit(largest, of)
    unit = f"({unit})" if " " in unit else unit
    resolution, top = 0.0, 0.0
    for row in rows:
        window = max(len(row.values) * 2 // (WINDOWS + 1), LEAST // 2)
        frequency, density = welch(factor * row.values, row.per_second, nperseg=window)
        how: Any = look(row.number) | {"lw": 0.9, "ms": 4, "mfc": "white", "markevery": 0.2, "label": row.name}
        axis.loglog(frequency[1:], density[1:], **how)
        resolution, top = max(resolution, float(frequency[1])), max(top, float(density[1:].max()))
    axis.set_ylabel(f"density, {unit}²/Hz")
    axis.set_ylim(bottom=max(DEPTH * top, np.finfo(float).tiny))
    return resolution


class ContactKind(NamedTuple):
    """Contacts of one kind: `what` they are, their `names`, the beginning of their variables' names, and the units of
    speeds and efforts.
    """

    what: str
    names: list[str]
    begin: str
    speed: str
    effort: str


def _kinds(dataset: xr.Dataset) -> list[ContactKind]:
    """The contacts of a motion: those of joints, of gaps of angles and of slides."""
    every = [ContactKind("joints", bearing_most(dataset), "", "m/s", "N")] if names_of(dataset, "joint") else []
    every += [
        ContactKind("angles", pressed_most(dataset, "rad"), "gap_", "rad/s", "N m"),
        ContactKind("slides", pressed_most(dataset, "m"), "gap_", "m/s", "N"),
    ]
    return [kind for kind in every if kind.names]


def _effort_unit(largest: float, unit: str) -> tuple[float, str]:
    factor, shown = force_unit(largest)
    return factor, shown.replace("N", unit)


@STYLED
def draw_episodes(dataset: xr.Dataset, narrow: bool = False) -> Figure:
    """The figure `episodes`."""
    kinds = [kind for kind in _kinds(dataset) if dataset.sizes.get(f"{kind.begin}episode")]
    if not kinds:
        raise ClearanceError("There is nothing to draw: this result has no contact episodes.")
    over, columns = falls_over(dataset), 1 if narrow else len(kinds)
    rows = 3 * len(kinds) // columns
    size = (NARROW if narrow else max(8, 5.5 * columns), rows * PANEL * 0.8 + rows / 3)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).T.reshape(len(kinds), 3)
    for row, kind in zip(axes, kinds, strict=True):
        _episodes(row, dataset, kind, over)
        if kinds[0].what != "joints" or len(kinds) > 1:
            row[0].set_title(kind.what if kind.what == "joints" else f"flanks of {kind.what}", loc="left", fontsize=9)
    hollow = f"\nhollow: in the first fall, until {seconds(over)}" if np.isfinite(over) else ""
    figure.suptitle(fit(f"{heading(dataset)}: contact episodes{hollow}", figure.get_figwidth(), 11.0))
    return figure


def _episodes(axes: Any, dataset: xr.Dataset, kind: ContactKind, over: float) -> None:
    """Draw impact speed, largest force and restitution of the episodes of one kind of contacts."""
    begin, dim = kind.begin, "gap" if kind.begin else "joint"
    start, of = dataset[f"{begin}episode_start"].values, dataset[f"{begin}episode_{dim}"].values
    every = [names_of(dataset, dim).index(name) for name in kind.names]
    mine = np.isin(of, every)
    factor, unit = _effort_unit(float(dataset[f"{begin}peak_force"].values[mine].max(initial=0.0)), kind.effort)
    shown = {"impact_speed": (1.0, f"impact speed, {kind.speed}")}
    shown |= {"peak_force": (factor, f"largest {'effort' if begin else 'force'}, {unit}")}
    shown |= {"restitution": (1.0, "restitution")}
    for axis, (name, (times, label)) in zip(axes, shown.items(), strict=True):
        per_second = time_axis(axis, float(dataset["time"][-1]))
        for k, (contact, index) in enumerate(zip(kind.names, every, strict=True)):
            for falling, face in ((False, look(k)["color"]), (True, "none")):
                some = (of == index) & ((not begin and (start <= over)) == falling)
                told = None if falling else f"{contact}: {np.sum(some)} episodes"
                how: Any = look(k) | {"ls": "", "ms": 4, "mfc": face, "label": told}
                axis.plot(per_second * start[some], times * dataset[begin + name].values[some], **how)
        axis.set_ylabel(label)
        if name != "restitution":
            axis.set_yscale("log")
            low, high = axis.get_ylim()
            # Else a short axis would have one number, and a long one none.
            short, long = high < FEW * low, high > MANY * low
            axis.yaxis.set_major_locator(MaxNLocator(4) if short else LogLocator(subs=(1,) if long else (1, 2, 5)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter(NullFormatter())
        if axis is not axes[-1]:
            axis.set_xlabel("")
    axes[-1].set(ylim=(0, 1.05))
    axes[-1].tick_params(labelbottom=True)
    legend_below(axes[-1], 3, fontsize=8)
