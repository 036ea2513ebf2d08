"""The page of the reproduction: verdicts, printed numbers, figures, choices, outlook, each as the run finds them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.common import table
from experiments.paper import figures, text
from experiments.paper.choices import CHOICES, SEEN, Effect, effects, rested
from experiments.paper.claims import READINGS, Verdict, verdicts
from experiments.paper.judges import START
from experiments.paper.outlook import (
    HORIZON,
    MOVED,
    START_UP,
    WRONG,
    Compensation,
    Influence,
    compensations,
    influences,
)
from experiments.paper.runs import EQ7, LATE, PLANE, RADIAL, RTOL, SIZES, SPACE, Condition, Motion, Reading, solved
from experiments.paper.statistics import centre_frequency, mean, peak, size
from experiments.publish import picture, write

PRINTED = {"speed": 0.8322885, "acceleration": 10.21889}
"""The two numbers of its curves that the paper prints: largest speed [m/s], largest acceleration [m/s^2]."""
TIGHTER = 0.1
GRAVITY = 9.81


class Found(NamedTuple):
    """All that a run finds."""

    verdicts: list[Verdict]
    effects: list[Effect]
    compensations: list[Compensation]
    influences: list[Influence]


def verdict_tables(found: list[Verdict], out: Path) -> None:
    """The verdicts with the numbers of the literal reading, and yes or no of every reading."""
    words = [v.words for v in found]
    write(
        text.VERDICTS.format(
            statements=len(found),
            everywhere=words.count("holds"),
            somewhere=sum(word.startswith("holds ") for word in words),
            nowhere=words.count("does not hold"),
            start=100 * START,
        )
    )
    literal = [r for r in found[0].findings if (r.damping, r.clearance) == (EQ7, RADIAL)]
    rows = [
        (v.claim.key, v.claim.says, v.claim.statistic, *(v.findings[r].numbers for r in literal), f"**{v.words}**")
        for v in found
    ]
    table(("", "the paper says", "looked at", *(r.world for r in literal), "verdict"), rows, out / "paper_verdicts.md")
    write(text.READINGS)
    readings = list(found[0].findings)
    rows = [(v.claim.key, *("yes" if v.findings[r].holds else "no" for r in readings)) for v in found]
    table(("", *(", ".join(r[:3]) for r in readings)), rows, out / "paper_readings.md")


def swinging() -> None:
    """What the pin does in its sleeve between the jumps of the drive."""
    motions = [solved(Reading(), Condition(clearance)) for clearance in SIZES]
    lengths = [1e3 * mean(m.time, m.eccentricity) for m in motions]
    write(
        text.SWINGING.format(
            lengths=" / ".join(f"{length:.3f}" for length in lengths),
            known=" / ".join(f"{np.sqrt(GRAVITY / (1e-3 * length)) / (2 * np.pi):.1f}" for length in lengths),
            found=" / ".join(f"{centre_frequency(m.time, m.fluctuation):.1f}" for m in motions),
        )
    )


def robustness(found: list[Verdict]) -> None:
    """Whether findings depend on the tolerance, or on when Velocity_4 ends."""
    total = sum(len(v.findings) for v in found)
    for change, words in (
        ({"rtol": TIGHTER * RTOL}, f"With rtol {TIGHTER * RTOL:g} instead of {RTOL:g}"),
        ({"last": LATE}, "With Velocity_4 ending at 9 s"),
    ):
        others = verdicts([r._replace(**change) for r in found[0].findings])
        changed = [
            f"{v.claim.key} ({', '.join(r[:3])})"
            for v, other in zip(found, others, strict=True)
            for r in v.findings
            if v.findings[r].holds != other.findings[r._replace(**change)].holds
        ]
        write(
            f"{words}, {len(changed)} of these {total} findings differ{': ' if changed else ''}{'; '.join(changed)}.\n"
        )


def printed_numbers(worlds: Sequence[str], readings: Sequence[Reading], out: Path) -> None:
    """The two numbers that the paper prints, beside ours."""
    cases = [(", ".join(r[:3]), solved(r)) for r in readings if r.world in worlds]
    cases += [(f"{world}, {EQ7}, {RADIAL}, the pin lies in the sleeve at the start", rested(world)) for world in worlds]
    rows = [(name, *beside(motion)) for name, motion in cases]
    write(text.PRINTED)
    head = ("reading", "speed, mm/s", "over 832.2885 mm/s", "acceleration, mm/s²", "over 10218.89 mm/s²")
    table(head, rows, out / "paper_printed.md")
    ratios = {name: peak(size(m.acceleration)) / PRINTED["acceleration"] for name, m in cases}
    nearest = min(ratios, key=lambda name: abs(np.log(ratios[name])))
    write(text.NEAREST.format(nearest=nearest))


def beside(motion: Motion) -> tuple[str, ...]:
    """Largest speed and acceleration of a motion, each over the printed one."""
    speed, acceleration = peak(motion.speed), peak(size(motion.acceleration))
    return (
        f"{1e3 * speed:.4f}",
        f"{speed / PRINTED['speed']:.4f}",
        f"{1e3 * acceleration:.0f}",
        f"{acceleration / PRINTED['acceleration']:.2f}",
    )


def draw(numbers: Sequence[int], worlds: Sequence[str], out: Path) -> None:
    write(text.FIGURES)
    for number in numbers:
        picture(figures.drawn(number, out, worlds), f"Fig. {number} of the paper. {figures.FIGURES[number][1]}")


def choice_tables(found: dict[str, list[Effect]], out: Path) -> None:
    """Which choices matter, and what each does to what is seen."""
    write(text.CHOICES)
    for world, ranked in found.items():
        rows = [(e.choice.name, "its own" if e.choice.own else "unknown", f"{e.size:.2f}", *ratios(e)) for e in ranked]
        table((f"choice, {world}", "in the paper", "moves by", *SEEN), rows, out / f"paper_choices_{world}.md")
        most, least = ranked[0], ranked[-1]
        both = next(e for e in ranked if e.choice.own and e is not most)
        write(
            text.RANKED.format(
                world="the plane" if world == PLANE else world,
                **{"most": most.choice.name, "by": most.size},
                **{"next": both.choice.name, "next_by": both.size},
                **{"least": least.choice.name, "least_by": least.size},
            )
        )


def ratios(effect: Effect) -> list[str]:
    return [f"{ratio:.2f}" for ratio in effect.ratios.values()]


def outlook_tables(corrected: list[Compensation], led: list[Influence], out: Path) -> None:
    """Error compensation, and the influence of the trajectory."""
    write(text.COMPENSATION.format(since=1e3 * START_UP, wrong=100 * WRONG))
    rows = [
        (c.world, c.drives, "right" if c.known else "wrong", *(left(c, i) for i in range(len(c.left))))
        for c in corrected
    ]
    table(("", "drives", "model", "error before", "after one", "after two"), rows, out / "paper_compensation.md")
    shown = [c for c in corrected if c.known]
    picture(
        figures.saved(out / "paper_compensation.png", lambda: figures.of_compensation(shown)),
        "Error of the end before and after correction, by the drives that are corrected",
    )
    write(text.TRAJECTORY.format(horizon=HORIZON, moved=1e3 * MOVED))
    rows = [
        (
            i.asked,
            f"{i.value:.6g} {i.unit}",
            *(f"{slope:.4g}" for slope in i.derivatives),
            f"{i.error:.1e}",
            *(f"{value:.6g}" for value in (i.predicted, i.found)),
        )
        for i in led
    ]
    head = ("", "value", "by the first, per s", "by the second", "by the third", "error", "predicted", "found")
    table(head, rows, out / "paper_trajectory.md")


def left(compensation: Compensation, done: int) -> str:
    """An error after some corrections, and how much of it they took away."""
    now, gone = compensation.left[done], compensation.gone[done]
    words = f"{1e6 * now.rms:.0f} µm ({1e6 * now.reachable:.0f})"
    return words if done == 0 else f"{words}: {100 * gone[0]:.0f} % gone ({100 * gone[1]:.0f} %)"


def main(quick: bool = False, out: Path = Path("out")) -> Found:
    """Write tables and figures into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    worlds = (PLANE,) if quick else (PLANE, SPACE)
    readings = [r for r in READINGS if r.world in worlds and not (quick and r.clearance != RADIAL)]
    found = verdicts(readings)
    verdict_tables(found, out)
    swinging()
    if not quick:
        robustness(found)
    printed_numbers(worlds, readings, out)
    draw((6, 13) if quick else tuple(figures.FIGURES), worlds, out)
    moved = {world: effects(world, CHOICES[:3] if quick else CHOICES) for world in worlds}
    choice_tables(moved, out)
    corrected, led = compensations(quick), influences(quick)
    outlook_tables(corrected, led, out)
    return Found(found, [e for ranked in moved.values() for e in ranked], corrected, led)
