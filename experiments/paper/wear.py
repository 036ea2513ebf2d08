"""The wear of joint 5 in the paper (Figs. 14 and 15) is reproduced, and its claims T20 to T22 are tested:
`python -m experiments.paper.wear`.

The paper has a clearance of 0.1 mm, a drive of -180 deg/s for 0.5 s in 1000 steps, k = 6e-14 without a unit, and wear
amplified by 10^3. This page takes k in 1/Pa (in mm^2/N the wear would be too small to be seen, amplified or not). The
drive turns at -180 deg/s from the very start. The pin is then at rest in the middle of its sleeve, and the arm is
level. There is no friction. Pressures are those of the paper: Hertz's line contact, with the signs and the root that
are missing in its Eqs. 15 and 16.

Two things are ASSUMED, because the paper does not say them. The contact is 50 mm long. The pressures on the worn
profile are those of an elastic foundation that is as soft as the paper's K (which is much softer than two steel
cylinders). The paper amplifies the wear of one run by 10^3. This page also computes 1000 runs, each on the sleeve that
the runs before have worn.

The following is not known: the start of the motion, the length of the contact, the sampling of the curves (the text has
no number from Figs. 14 and 15), whether the worn sleeve was used in the motion, and the load. The load is assumed to be
300 kg at 176.62 mm, as in [Paper](paper.md). So claims are judged by the shape of the curves, in four readings of
damping and clearance. Depths can be compared in order of magnitude only.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from clearance_jax import wear
from experiments.common import table
from experiments.paper.figures import COLOURS, GREY, panels, saved
from experiments.paper.judges import START, Finding, listed
from experiments.paper.runs import JOINT, Reading
from experiments.paper.wear_runs import (
    LAST,
    LENGTH,
    READINGS,
    RUNS,
    SECTORS,
    aged,
    clearance,
    first,
    lived,
    rig,
    until,
)
from experiments.publish import command, picture, write

MOMENTS = (0.1, 0.3, 1.0)
"""Parts of the run after which Fig. 14 shows the depths."""
UNEVEN, ROUND = 2.0, 0.01
"""Largest over mean depth from which on wear is not uniform; by which part of the clearance a circle may be off."""


# Claims --------------------------------------------------------------------------------------------------------------


class Claim(NamedTuple):
    """What the paper says, what is looked at, how it is judged in one reading, and what is to be said of it."""

    key: str
    says: str
    statistic: str
    judge: Callable[[Reading], Finding]
    honestly: str


def uneven(reading: Reading) -> Finding:
    depth = np.asarray(first(reading).wear.depth[0])
    return Finding(bool(depth.max() >= UNEVEN * depth.mean()), f"{depth.max() / depth.mean():.1f}")


def at_start(reading: Reading) -> Finding:
    whole, early = np.asarray(first(reading).wear.depth[0]).sum(), until(reading, START).sum()
    rates = early / START / whole, (whole - early) / (1 - START) / whole
    return Finding(bool(rates[0] > rates[1]), listed(rates))


def where_force_slides(reading: Reading) -> Finding:
    """Largest in which sector: the depth; and force times slip, of all that lies within a patch of the mean force."""
    seen, one = first(reading).seen, first(reading).wear
    rubbed = np.asarray(seen.weight[:, None] * seen.force * seen.speed)[:, 0]
    geometry = wear.sections_of(rig(reading), JOINT).geometry
    usual = float(wear.HertzLine().half_angle(geometry, jnp.asarray(seen.weight @ seen.force[:, 0] / LAST / LENGTH)))
    angle = np.asarray(one.angle)
    beside = np.asarray(seen.angle[:, 0])[:, None] - angle
    work = rubbed @ (np.cos(beside) > np.cos(usual))
    places = np.degrees([angle[np.argmax(one.depth[0])], angle[np.argmax(work)]])
    apart = abs((places[0] - places[1] + 180) % 360 - 180)
    return Finding(bool(apart <= np.degrees(usual)), f"{listed(places, 'deg')} ({np.degrees(usual):.1f} deg)")


def off_circle(reading: Reading) -> Finding:
    """What is left of the amplified profile less the circle, anywhere, that is nearest to it."""
    depth = RUNS * np.asarray(first(reading).wear.depth[0])
    angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
    circle = np.stack([np.ones(SECTORS), np.cos(angle), np.sin(angle)], axis=1)
    left = np.abs(depth - circle @ np.linalg.lstsq(circle, depth, rcond=None)[0]).max() / clearance(reading)
    return Finding(bool(left > ROUND), f"{left:.3f}")


def grows(reading: Reading) -> Finding:
    far = [one.eccentricity for one in aged(reading)]
    return Finding(bool(np.all(np.diff(far) > 0)), listed(far, "mm", 1e3))


CLAIMS = (
    Claim(
        "T20",
        "wear is not uniform round the sleeve",
        "largest depth over the mean one",
        uneven,
        f"Wear counts as not uniform if the largest depth is at least {UNEVEN:g} times the mean depth. (The factor of "
        "uniform wear is 1.) The weight holds the pin at the bottom of its sleeve, and only the bottom wears. No "
        "collision is needed for this.",
    ),
    Claim(
        "T20b",
        "it is largest where force times slip is",
        "deepest sector, that of most force times slip (patch)",
        where_force_slides,
        "The two numbers are angles of the sleeve. They agree if their difference is less than half the width of a "
        "patch. With a linear law they must agree, so this tests the program more than the claim.",
    ),
    Claim(
        "T20c",
        "initial wear is larger",
        "wear a time, start-up and after it, over the mean",
        at_start,
        "Forces are largest at the start (T2), but the rate of wear is not. Wear is proportional to force times slip, "
        "and a pin that turns evenly has a constant slip (its radius times its angular speed). So wear is proportional "
        "to the impulse of the force. The impulse of an impact is equal to the impulse of the load over the time in "
        "which the pin was free. So impacts add no wear, however hard they are, and there is no wear during the first "
        "fall. Impacts would matter in a law in which wear grows faster than pressure.",
    ),
    Claim(
        "T21",
        "amplified, the worn profile is no circle",
        "off the nearest circle, over the clearance",
        off_circle,
        f"The profile, amplified by {RUNS}, is compared with the nearest circle of any radius and centre. It counts as "
        f"no circle if the largest distance is more than {ROUND:g} of the clearance.",
    ),
    Claim(
        "T22",
        "wear, repeated, makes the clearance grow",
        "mean eccentricity after start-up: 0, 500, 1000 runs",
        grows,
        "The wear of one run, multiplied by 1000, is too deep at one place. The pressure falls while the sleeve wears, "
        "so 1000 runs make a wider and less deep profile (Fig. 15, dotted).",
    ),
)


def verdict(findings: list[Finding]) -> str:
    """How many readings a claim holds in."""
    holding = sum(finding.holds for finding in findings)
    if holding in (0, len(findings)):
        return "holds" if holding else "does not hold"
    return f"holds in {holding} of {len(findings)} readings"


# Figures -------------------------------------------------------------------------------------------------------------


def figure_14(readings: tuple[Reading, ...]) -> Figure:
    """Depths over the sleeve's angle as the run goes on."""
    figure, axes = panels(1, len(readings), 2.6, 4.2 * len(readings), sharey=True)
    angle = 360 * np.arange(SECTORS) / SECTORS
    for axis, reading in zip(axes[0], readings, strict=True):
        for part, colour in zip(MOMENTS, (GREY, *COLOURS), strict=False):
            axis.plot(angle, 1e9 * until(reading, part), color=colour, label=f"after {part * LAST:g} s")
        axis.plot(angle, 1e9 * aged(reading)[0].wear.depth[0], "k:", label="at the end, on a foundation")
        axis.set(title=f"{reading.damping}, {reading.clearance}", xlabel="angle of the sleeve, deg", xlim=(180, 360))
    axes[0, 0].set_ylabel("depth of wear, nm")
    axes[0, 0].legend()
    return figure


def figure_15(readings: tuple[Reading, ...]) -> Figure:
    """The room of the pin's centre: the bore less the pin, worn and amplified; and its radius where it is worn."""
    figure = Figure(figsize=(8.4, 0.4 + 3.2 * len(readings)), layout="constrained")
    angle = 2 * np.pi * np.arange(SECTORS + 1) / SECTORS
    for row, reading in enumerate(readings):
        c, depth = clearance(reading), RUNS * np.asarray(first(reading).wear.depth[0])
        shape = 1e3 * (c + np.append(depth, depth[0]))
        whole = figure.add_subplot(len(readings), 2, 2 * row + 1, projection="polar")
        whole.plot(angle, np.full(angle.size, 1e3 * c), color=GREY, label="round")
        whole.plot(angle, shape, color=COLOURS[0], label="worn, x 1000")
        whole.set_title(f"radial clearance, mm: {reading.damping}, {reading.clearance}")
        whole.set_yticks([1e3 * c])
        whole.legend(loc="center")
        near = figure.add_subplot(len(readings), 2, 2 * row + 2)
        near.plot(np.degrees(angle), np.full(angle.size, 1e3 * c), color=GREY)
        near.plot(np.degrees(angle), shape, color=COLOURS[0], label="one run, x 1000")
        total = lived(reading).depth[-1]
        near.plot(np.degrees(angle[:-1]), 1e3 * (c + total), "k:", label="1000 runs, on a foundation")
        worn = np.degrees(angle[:-1][total > 1e-2 * total.max()])
        near.set(xlim=(worn.min() - 5, worn.max() + 5), xlabel="angle of the sleeve, deg", ylabel="mm")
        near.legend()
    return figure


def verdict_table(found: list[tuple[Claim, dict[Reading, Finding]]], readings: tuple[Reading, ...], out: Path) -> None:
    write(
        "## Verdicts\n\nThe table has one number for each reading, and says whether the claim holds there. The "
        f"start-up is the first {START:.0%} of the run.\n"
    )
    rows = []
    for claim, own in found:
        said = (f"{one.numbers}: {'holds' if one.holds else 'no'}" for one in own.values())
        rows.append((claim.key, claim.says, claim.statistic, *said, f"**{verdict(list(own.values()))}**"))
    readings_said = (f"{r.damping}, {r.clearance}" for r in readings)
    table(("", "the paper says", "looked at", *readings_said, "verdict"), rows, out / "paper_wear.md")
    for claim, own in found:
        write(f"- **{claim.key} {verdict(list(own.values()))}.** {claim.honestly}")
    write("")


def run_table(readings: tuple[Reading, ...], out: Path) -> None:
    """One run in each reading, and 1000 of them."""
    write(
        "## The runs\n\n*Volume by 1000 steps*: the paper's sum over equal steps (its Eq. 12), compared with the "
        "quadrature: the quotient minus one. *Foundation*: the volume on an elastic foundation, divided by k F s "
        "(the volume of a flat patch). *Solved*: the number of runs that were simulated for the 1000 runs.\n"
    )
    rows = []
    for reading in readings:
        one, soft = first(reading), aged(reading)[0].wear
        rows.append(
            (
                f"{reading.damping}, {reading.clearance}",
                f"{1e9 * float(one.wear.deepest):.2f} nm",
                f"{1e9 * float(one.wear.volume):.4e} mm³",
                f"{1e3 * float(one.wear.sliding):.2f} mm",
                f"{np.degrees(float(one.wear.half_angle)):.1f} deg",
                f"{one.stepped / float(one.wear.volume) - 1:+.1e}",
                f"{float(soft.volume / soft.flat_volume):.4f}",
                f"{1e6 * lived(reading).depth[-1].max():.2f} µm",
                f"{lived(reading).evaluations}",
            )
        )
    head = (
        "",
        "deepest",
        "volume",
        "sliding",
        "widest patch",
        "volume by 1000 steps",
        "foundation",
        "deepest after 1000 runs",
        "solved",
    )
    table(head, rows, out / "paper_wear_runs.md")


FIGURES = (
    (
        14,
        figure_14,
        "Dynamic wear over the sleeve's angle as the run goes on; 0 deg is level, 270 deg is below",
    ),
    (15, figure_15, "The rearranged sleeve, wear times 1000: whole, and magnified where it is worn"),
)


def main(quick: bool = False, out: Path = Path("out")) -> list[tuple[Claim, dict[Reading, Finding]]]:
    """Write tables and figures into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    readings = READINGS[:1] if quick else READINGS
    found = [(claim, {reading: claim.judge(reading) for reading in readings}) for claim in CLAIMS]
    verdict_table(found, readings, out)
    run_table(readings, out)
    write("## Figures\n")
    for number, draw, caption in FIGURES:
        shown = readings[:1] if quick else (readings[0], readings[2])
        path = saved(out / f"paper_{number}.png", lambda draw=draw, shown=shown: draw(shown))
        picture(path, f"Fig. {number} of the paper. {caption}")
    return found


if __name__ == "__main__":
    command(main, __doc__, "one reading")
