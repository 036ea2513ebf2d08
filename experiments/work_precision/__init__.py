"""Time against error: `python -m experiments.work_precision` writes out/work_precision*.md and a picture.

Ten scenes are solved by every solver here, with and without event location, and by other tools in the same run. All
tools start from the same state and give the states at the same times. Errors are relative: those of positions and
states are the largest over the samples, divided by the largest magnitude of the component; that of the force is of the
largest contact force at the samples; that of the derivative is of the last states by one clearance, divided by the
largest magnitude of its component until then. Times are the shortest wall times of several solves in one process,
without compilation; `ms with derivative` is the time of a solve that gives the derivative too. The library runs without
its energy balance here, because the other tools do not compute one.

The slider-cranks with one clearance and joint 5 are written by hand in numba too. There scipy and SUNDIALS have numba's
right-hand side (`+ numba`), and the references share no code with the library. In all other scenes the other tools are
handed the library's compiled field, called through numpy, and the reference is the library's own (dopri8 at rtol
1e-12). diffrax has the library's field in every scene, and a first step of a millionth of the motion, because its own
choice finds none where a pin starts in the middle. Motions are so short that the reference is certain: impacts amplify
errors, and a minute of such a scene is chaos. `gave up`: a tool stopped before the end, or took more than 8 s. After a
solve of more than 3 s no tighter tolerance was tried.
"""

import time
import traceback
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from experiments.common import compact, output, table
from experiments.publish import picture, say, write
from experiments.work_precision import findings, ideal_arm, one_solve, ours, peers, scenes
from experiments.work_precision.pictures import draw
from experiments.work_precision.points import BOUNDS, SLOPE_BOUND, Point, cheapest, of

PLANE_RTOLS = tuple(10.0**-k for k in range(4, 12))
SPACE_RTOLS = tuple(10.0**-k for k in range(4, 11))
PEER_RTOLS = (1e-4, 1e-6, 1e-8, 1e-10)
QUICK_RTOLS, QUICK_TOOLS = (1e-5, 1e-8), ("tsit5", "tsit5, no events")
UNMEASURED = (
    "CasADi in scenes other than the slider-cranks with one clearance: it needs the equations in its own expressions.",
    "Exudyn in other scenes, and with its own clearance objects, whose force law is another one. In the slider-cranks "
    "it has the same law as a user function, and gives the end of a solve only.",
    "Derivatives by tools that give none (differences of solves are in `experiments.reference.sensitivity_baselines`).",
    "In space: dopri8 without events, derivatives by dopri8 and by diffrax, and implicit solvers of diffrax.",
    "Time to compile, batches, and GPUs, which have pages of their own; computers other than this one.",
)


class Found(NamedTuple):
    """The runs on all scenes, and the single solves of slider-cranks."""

    points: list[Point]
    one: list[Point]


def main(quick: bool = False) -> Found:
    suffix = "_quick" if quick else ""
    cases, points, lost = gather(quick)
    write("## Scenes and references")
    references(cases, suffix)
    write(
        "## Least times\n\nThe least times [ms] with which errors of positions stay below a bound, at that and every "
        "tighter tolerance tried."
    )
    summary(points, suffix)
    write("## Findings\n\n" + "\n\n".join(findings.sentences(points, cases)))
    write(
        '## What `solver="auto"` chooses\n\nThe time of dopri8 over that of tsit5, for the error of positions that '
        'tsit5 has at the rtol of the column; `*`: "auto" takes dopri8; `-`: not reached.'
    )
    table(*findings.choices(points, cases), output(f"work_precision_auto{suffix}.md"))
    say(findings.cost_of_choice(points, cases))
    write("## One solve beside hand-written C\n\n" + (one_solve.__doc__ or "").partition("\n\n")[2])
    one = [
        p for case in cases if case.scene.of == scenes.CRANKS and case.stored for p in one_solve.measure(case, quick)
    ]
    one_solve.tabulate(one, suffix)
    if not quick:
        write("## Steps of an ideal arm")
        ideal_arm.main(suffix)
    write("## What was not measured\n\n" + "\n".join(f"- {line}" for line in [*lost, *unmeasured()]))
    path = compact(draw(points), output(f"work_precision{suffix}.png"))
    write("## All runs")
    picture(path, "Error of the worst position against time, for all scenes and tools")
    everything(points, suffix)
    return Found(points, one)


def gather(quick: bool) -> tuple[list[scenes.Case], list[Point], list[str]]:
    """The scenes, all runs on them, and in words the scenes that failed: the others are worth a page without them."""
    cases, points, lost, began = [], [], [], time.perf_counter()
    for scene in scenes.ALL[:1] if quick else scenes.ALL:
        try:
            case = scenes.Case(scene)
            found = measured(case, quick)
        except Exception as error:
            if quick:
                raise
            traceback.print_exc()
            lost.append(f"{scene.name}: it failed ({type(error).__name__}: {str(error).partition(chr(10))[0][:200]}).")
            continue
        cases.append(case)
        points += found
        print(f"{scene.name}: {len(found)} runs, {time.perf_counter() - began:.0f} s until now", flush=True)
    return cases, points, lost


def measured(case: scenes.Case, quick: bool) -> list[Point]:
    """All tools on a scene, after its reference."""
    programs = ours.Programs(case)
    dear = "tsit5" if case.scene.of == scenes.SPACE else "dopri8"
    case.set_truth(programs.value("dopri8"), programs.value("tsit5"), programs.slope(dear))
    if quick:
        return ours.measure(programs, QUICK_RTOLS, QUICK_TOOLS) + peers.measure(case, QUICK_RTOLS, True)
    rtols = SPACE_RTOLS if case.scene.of == scenes.SPACE else PLANE_RTOLS
    return ours.measure(programs, rtols) + peers.measure(case, PEER_RTOLS)


def references(cases: Sequence[scenes.Case], suffix: str) -> None:
    """The scenes, and how far their references can be trusted."""
    rows = [
        (
            case.scene.name,
            len(case.y0),
            f"{1e3 * case.times[-1]:g}",
            len(case.times),
            "stored" if case.stored else "own",
            f"{case.trust:.0e}",
            case.scene.clearance,
            "stored" if case.scene.twin == "slider_crank" else "own",
            f"{case.slope_trust:.0e}",
        )
        for case in cases
    ]
    head = ("scene", "states", "until, ms", "samples", "reference", "two solvers differ by")
    table(
        (*head, "derivative by", "its reference", "two solves differ by"),
        rows,
        output(f"work_precision_scenes{suffix}.md"),
    )


def summary(points: Sequence[Point], suffix: str) -> None:
    """By scene and tool the least time to each bound."""
    pairs = dict.fromkeys((p.scene, p.tool) for p in points)
    rows = []
    for scene, tool in pairs:
        mine = of(points, scene, tool)
        least = [ms(cheapest(mine, bound)) for bound in BOUNDS]
        slope = ms(cheapest(mine, SLOPE_BOUND, "slope", "slope_seconds"), "slope_seconds")
        given = any(np.isfinite(p.slope) for p in mine)
        rows.append((scene, tool, *least, slope if given else ""))
    head = ("scene", "tool", *(f"{bound:.0e}" for bound in BOUNDS), f"derivative within {SLOPE_BOUND:.0e}")
    table(head, rows, output(f"work_precision_summary{suffix}.md"))


def ms(point: Point | None, spent: str = "seconds") -> str:
    return "none" if point is None else f"{1e3 * getattr(point, spent):.2f}"


def unmeasured() -> list[str]:
    """What the page does not say."""
    absent = [f"{name}: not installed, not measured." for name in peers.PACKAGES if not peers.installed(name)]
    return [*absent, *UNMEASURED]


def everything(points: Sequence[Point], suffix: str) -> None:
    """Every run as a row."""
    rows = []
    for p in points:
        if not np.isfinite(p.seconds):
            rows.append((p.scene, p.tool, f"{p.rtol:.0e}", "gave up", *[""] * 6))
            continue
        errors = ["" if np.isnan(x) else f"{x:.1e}" for x in (p.position, p.state, p.force, p.slope)]
        count = p.evaluations if p.evaluations >= 0 else ""
        slope_ms = "" if np.isnan(p.slope_seconds) else f"{1e3 * p.slope_seconds:.2f}"
        rows.append((p.scene, p.tool, f"{p.rtol:.0e}", *errors, count, f"{1e3 * p.seconds:.2f}", slope_ms))
    head = ("scene", "tool", "rtol", "error of worst position", "of worst state", "of peak force", "of derivative")
    table((*head, "evaluations", "ms", "ms with derivative"), rows, output(f"work_precision{suffix}.md"))
