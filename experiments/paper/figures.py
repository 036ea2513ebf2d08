"""The paper's Figs. 6 to 13 as they come out here, in the plane and in space.

Forces and accelerations are on logarithmic axes: that of the first impact is some twenty times all that follows it.
"""

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from experiments.paper.outlook import Compensation
from experiments.paper.runs import (
    EQ7,
    FRICTIONS,
    PLANE,
    SIZES,
    SPACE,
    SPEEDS,
    TABLE1,
    Condition,
    Motion,
    Reading,
    solved,
)
from experiments.paper.statistics import Signal, size, within

STYLE = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 0.8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "axes.titlesize": 8,
    "path.simplify_threshold": 0.3,
}
COLOURS = ("tab:blue", "tab:orange", "tab:green")
OF_WORLD = {PLANE: "tab:blue", SPACE: "tab:orange"}
IDEAL: dict[str, Any] = {"color": "black", "lw": 0.8, "ls": "--"}
GREY = "0.7"
EARLY = 0.06
"""The part of a motion that is enlarged: its first [s]."""
CLOSE = (0.48, 0.49)
"""Where displacements are enlarged [s]."""
PALETTE = 64
"""Colours of a picture: enough for lines, and half the file."""


class Quantity(NamedTuple):
    """What is drawn: how it is got of a motion, its label, and from where on its axis goes if it is logarithmic."""

    of: Callable[[Motion], Signal]
    label: str
    floor: float | None = None

    def draw(self, axis: Axes, motion: Motion, **style: Any) -> None:
        """Over time, from a little before the start: what happens there stands clear of the axis."""
        values = self.of(motion)
        axis.plot(motion.time, values, **style)
        axis.set_xlim(-0.02 * motion.time[-1], motion.time[-1])
        if self.floor is not None:
            highest = max(axis.get_ylim()[1], 1.5 * values.max())
            axis.set_yscale("log")
            axis.set_ylim(self.floor, highest)

    def draw_early(self, axis: Axes, motion: Motion, **style: Any) -> None:
        """Over the first milliseconds."""
        self.draw(axis, motion._replace(time=1e3 * motion.time), **style)
        axis.set_xlim(-0.02e3 * EARLY, 1e3 * EARLY)

    def in_world(self, world: str) -> str:
        return f"{world}:\n{self.label}"


ECCENTRICITY = Quantity(lambda m: 1e3 * m.eccentricity, "distance of\ncentres, mm")
FORCE = Quantity(lambda m: m.force / 1e3, "contact\nforce, kN", 0.5)
SPEED = Quantity(lambda m: 1e3 * m.speed, "end's speed,\nmm/s")
IDEAL_SPEED = Quantity(lambda m: 1e3 * size(m.ideal_velocity), SPEED.label)
FLUCTUATION = Quantity(lambda m: 1e3 * m.fluctuation, "speed less\nideal one, mm/s")
ACCELERATION = Quantity(lambda m: size(m.acceleration), "end's accel-\neration, m/s²", 0.05)
IDEAL_ACCELERATION = Quantity(lambda m: size(m.ideal_acceleration), ACCELERATION.label, 0.05)
SHAKING = Quantity(lambda m: m.shaking, "acceleration less\nideal one, m/s²", 0.05)
DISPLACEMENT = Quantity(lambda m: 1e3 * size(m.position - m.ideal_position[0]), "end's displace-\nment, mm")
IDEAL_DISPLACEMENT = Quantity(lambda m: 1e3 * size(m.ideal_position - m.ideal_position[0]), DISPLACEMENT.label)


def panels(rows: int, columns: int, height: float, width: float, **options: Any) -> tuple[Figure, Any]:
    """A figure of panels, as high as it has rows; room for a legend above."""
    figure = Figure(figsize=(width, 0.4 + height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def legend(figure: Figure, axes: Sequence[Axes]) -> None:
    """One legend above all panels, where it covers nothing: each label once, the ideal robot last."""
    found = {text: line for axis in axes for line, text in zip(*axis.get_legend_handles_labels(), strict=True)}
    texts = sorted(found, key=lambda text: text == WITHOUT)
    figure.legend([found[text] for text in texts], texts, loc="outside upper center", ncols=len(texts))


WITHOUT = "without clearance"


def figure_6(worlds: Sequence[str]) -> Figure:
    """One motion in either damping: the whole of it, and how it begins."""
    quantities = (ECCENTRICITY, FORCE, SPEED, ACCELERATION)
    figure, axes = panels(4, 2 * len(worlds), 1.7, 10, sharey="row", width_ratios=(3, 2) * len(worlds))
    for whole, early, world in zip(axes.T[::2], axes.T[1::2], worlds, strict=True):
        for damping, colour in zip((EQ7, TABLE1), COLOURS, strict=False):
            motion = solved(Reading(world, damping))
            for i, quantity in enumerate(quantities):
                quantity.draw(whole[i], motion, color=colour, label=f"with the damping of {damping}")
                quantity.draw_early(early[i], motion, color=colour)
        for quantity, i in ((IDEAL_SPEED, 2), (IDEAL_ACCELERATION, 3)):
            quantity.draw(whole[i], motion, **IDEAL, label=WITHOUT)
            quantity.draw_early(early[i], motion, **IDEAL)
        whole[0].set_title(f"{world}: the whole motion")
        early[0].set_title(f"{world}: start-up")
        whole[-1].set_xlabel("time, s")
        early[-1].set_xlabel("time, ms")
    for axis, quantity in zip(axes[:, 0], quantities, strict=True):
        axis.set_ylabel(quantity.label)
    legend(figure, axes[:, 0])
    return figure


def figure_7(worlds: Sequence[str]) -> Figure:
    """Clearances of 0.1, 0.2 and 1 mm beside the ideal joint."""
    quantities = (DISPLACEMENT, DISPLACEMENT, SPEED, ACCELERATION, FORCE)
    ideals = (IDEAL_DISPLACEMENT, IDEAL_DISPLACEMENT, IDEAL_SPEED, IDEAL_ACCELERATION)
    figure, axes = panels(5, len(worlds), 1.7, 9)
    for column, world in zip(axes.T, worlds, strict=True):
        motions = [solved(Reading(world), Condition(clearance)) for clearance in SIZES]
        # The smallest last and in front: it moves least.
        for order, (motion, clearance, colour) in enumerate(zip(motions, SIZES, COLOURS, strict=True)):
            for axis, quantity in zip(column, quantities, strict=True):
                quantity.draw(axis, motion, color=colour, label=f"{1e3 * clearance:g} mm", zorder=3 - order / 4)
        for axis, quantity in zip(column, ideals, strict=False):
            quantity.draw(axis, motions[0], **IDEAL, label=WITHOUT, zorder=4)
        near = [DISPLACEMENT.of(m)[within(m.time, *CLOSE)] for m in motions]
        column[1].set(xlim=CLOSE, ylim=(min(x.min() for x in near), max(x.max() for x in near)), title="enlarged")
        column[0].set_title(world)
        column[-1].set_xlabel("time, s")
    for axis, quantity in zip(axes[:, 0], quantities, strict=True):
        axis.set_ylabel(quantity.label)
    legend(figure, [axes[0, 0]])
    return figure


def of_speeds(rows: Sequence[tuple[Sequence[str], Quantity]], ideal: Quantity | None) -> Figure:
    """Under the four drives: in each row a quantity of some worlds, over the ideal robot's where it is the same one."""
    figure, axes = panels(len(rows), 4, 1.7, 10, sharex="col", sharey="row")
    for column, speed, letter in zip(axes.T, SPEEDS, "abcd", strict=True):
        for axis, (worlds, quantity) in zip(column, rows, strict=True):
            for world in worlds:
                motion = solved(Reading(world), Condition(speed=speed))
                quantity.draw(axis, motion, color=OF_WORLD[world], label=world)
            if ideal is not None and ideal.label == quantity.label:
                ideal.draw(axis, motion, **IDEAL, label=WITHOUT)
        column[0].set_title(f"({letter}) {speed}")
        column[-1].set_xlabel("time, s")
    for axis, (worlds, quantity) in zip(axes[:, 0], rows, strict=True):
        axis.set_ylabel(quantity.in_world(worlds[0]) if len(worlds) == 1 else quantity.label)
    legend(figure, axes[:, 0])
    return figure


def figure_8(worlds: Sequence[str]) -> Figure:
    """The end's speed under the four drives, and how far it is from the ideal one."""
    return of_speeds([(worlds, SPEED), *(((world,), FLUCTUATION) for world in worlds)], IDEAL_SPEED)


def figure_9(worlds: Sequence[str]) -> Figure:
    """The end's acceleration under the four drives."""
    return of_speeds([((world,), ACCELERATION) for world in worlds], IDEAL_ACCELERATION)


def figure_10(worlds: Sequence[str]) -> Figure:
    """The contact force under the four drives."""
    return of_speeds([((world,), FORCE) for world in worlds], None)


def of_frictions(quantity: Quantity, worlds: Sequence[str]) -> Figure:
    """A quantity with either friction over the one without."""
    figure, axes = panels(len(worlds), 2, 2.0, 9, sharex=True, sharey=True)
    for row, world in zip(axes, worlds, strict=True):
        without, *others = (solved(Reading(world), Condition(friction=mu)) for mu in FRICTIONS)
        for axis, motion, mu, letter in zip(row, others, FRICTIONS[1:], "ab", strict=True):
            quantity.draw(axis, without, color=GREY, label="without friction")
            quantity.draw(axis, motion, color=OF_WORLD[world], label=f"with friction, {world}")
            axis.set_title(f"({letter}) friction coefficient {mu:g}")
        row[0].set_ylabel(quantity.in_world(world))
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    legend(figure, axes[:, 0])
    return figure


def figure_11(worlds: Sequence[str]) -> Figure:
    """The end's speed less the ideal one, with friction and without."""
    return of_frictions(FLUCTUATION, worlds)


def figure_12(worlds: Sequence[str]) -> Figure:
    """The end's acceleration less the ideal one, with friction and without."""
    return of_frictions(SHAKING, worlds)


def figure_13(worlds: Sequence[str]) -> Figure:
    """The contact force with friction and without."""
    figure, axes = panels(len(worlds), 2, 2.0, 9, sharey=True, width_ratios=(3, 2))
    for (whole, early), world in zip(axes, worlds, strict=True):
        for mu, colour in zip(FRICTIONS, (GREY, *COLOURS), strict=False):
            motion = solved(Reading(world), Condition(friction=mu))
            FORCE.draw(whole, motion, color=colour, label=f"friction coefficient {mu:g}")
            FORCE.draw_early(early, motion, color=colour)
        whole.set(title="the whole motion", ylabel=FORCE.in_world(world))
        early.set_title("start-up")
    whole.set_xlabel("time, s")
    early.set_xlabel("time, ms")
    legend(figure, [whole])
    return figure


FIGURES: dict[int, tuple[Callable[[Sequence[str]], Figure], str]] = {
    6: (figure_6, "Distance of the centres of pin and sleeve, contact force, speed and acceleration of the end"),
    7: (figure_7, "Clearances of 0.1, 0.2 and 1 mm: displacement, speed, acceleration, contact force"),
    8: (figure_8, "Speed of the end under the four drives"),
    9: (figure_9, "Acceleration of the end under the four drives"),
    10: (figure_10, "Contact force under the four drives"),
    11: (figure_11, "Speed of the end, less the ideal one, with friction"),
    12: (figure_12, "Acceleration of the end, less the ideal one, with friction"),
    13: (figure_13, "Contact force with friction"),
}
"""Of every figure of the paper what draws it, and what it shows."""


CORRECTED = ("drives as they were", "corrected once", "corrected twice")


def of_compensation(shown: Sequence[Compensation]) -> Figure:
    """The end's error over time, before and after corrections."""
    columns = min(2, len(shown))
    figure, axes = panels(-(-len(shown) // columns), columns, 2.1, 4.5 * columns, sharex=True, sharey=True)
    for axis, case in zip(axes.ravel(), shown, strict=True):
        for left, text, colour, dash in zip(case.left, CORRECTED, (GREY, *COLOURS), ("-", "-", "--"), strict=False):
            axis.plot(left.time, 1e6 * left.error, dash, color=colour, label=text)
        axis.set_title(f"{case.world}, corrected: {case.drives}")
    axes[0, 0].set_ylim(0, 1.05e6 * max(left.error.max() for case in shown for left in case.left))
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    for axis in axes[:, 0]:
        axis.set_ylabel("error of the end, µm")
    legend(figure, [axes[0, 0]])
    return figure


def drawn(number: int, folder: Path, worlds: Sequence[str] = (PLANE, SPACE)) -> Path:
    """Draw a figure of the paper into a folder."""
    return saved(folder / f"paper_{number}.png", lambda: FIGURES[number][0](worlds))


def saved(path: Path, draw: Callable[[], Figure]) -> Path:
    """Draw, and write a small file."""
    raw = io.BytesIO()
    with mpl.rc_context(STYLE):
        draw().savefig(raw, dpi=110)
    Image.open(raw).convert("RGB").quantize(PALETTE).save(path, optimize=True)
    return path
