"""`clearance run` of a design: a study to clearances, their proof and a report."""

from pathlib import Path
from typing import Any

import typer
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from clearance_jax.cli.common import aloud, console, errors, say, say_written
from clearance_jax.cli.interruption import Interruption
from clearance_jax.cli.pace import Pace, shown_duration
from clearance_jax.errors import ClearanceError


def run_design(
    study: Any, *, report: Path | None, verify: bool, cluster: str | None, record: Path | None, **search: Any
) -> None:
    """The design of a study, its proof and its report. Ctrl-C stops the search and keeps the best design so far."""
    from clearance_jax.ask.place import place_of
    from clearance_jax.design.findings import CUT_SHORT
    from clearance_jax.report.html import write_report
    from clearance_jax.runs.journal import RunWarning

    doubts = aloud(RunWarning)
    with doubts, place_of(cluster) as place, _bar() as bar, Interruption() as asked:  # one cluster for all that follows
        pace, client = Pace(asked.check), place.client
        say(_preparation(study.design.problem.specification.mechanism))
        given = {**search, "record": record, "cluster": client}
        design = _search(study.design, {k: v for k, v in given.items() if v is not None}, bar, pace)
        console.print(f"[bold]{escape(study.name)}[/bold]")
        say(str(design))
        found = _explain(study.design, design, verify, client, report is not None, bar, pace)
    for text in found.notes:
        say(text)
    if found.fits is not None:
        say(str(found.fits))
    if report is not None:
        write_report(found, report, study.name, study.text)
        say_written("report", report)
    if _interruption(design) or CUT_SHORT in found.notes:
        raise typer.Exit(130)
    if not found.good:
        raise typer.Exit(1)


def _bar() -> Progress:
    return Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=errors)


def check_method(method: str | None) -> str | None:
    """A method of the search. **Raises** `ClearanceError` for another word."""
    from clearance_jax.design.methods import METHOD_CHOICES

    if method is not None and method not in METHOD_CHOICES:
        raise ClearanceError(f"`--method` must be {', '.join(METHOD_CHOICES)}, but it is {method!r}.")
    return method


def known_fidelity(fidelity: str | None) -> str | None:
    """A model of the motion. **Raises** `ClearanceError` for another word."""
    from clearance_jax.design.specification import FIDELITY_CHOICES

    if fidelity is not None and fidelity not in FIDELITY_CHOICES:
        raise ClearanceError(f"`--fidelity` must be {', '.join(FIDELITY_CHOICES)}, but it is {fidelity!r}.")
    return fidelity


def _preparation(mechanism: Any) -> str:
    """What is done before the first design is evaluated, and how long it takes, as far as the mechanism tells."""
    from clearance_jax.mechanism.state import layout

    count = len(layout(mechanism).velocities)
    kind, how_long = ("plane", "about ten seconds") if mechanism.is_plane else ("spatial", "about a minute")
    return (
        f"Compiling the program that evaluates designs (a {kind} mechanism with {count} coordinates: this takes "
        f"{how_long}, more on a busy machine; programs that were compiled before are read again)."
    )


def _search(study, given: dict[str, Any], bar: Progress, pace: Pace):
    """The design, with the best so far shown on the way."""
    from clearance_jax.design.specification import AUTO
    from clearance_jax.solve.settings import QUASI_STATIC

    task, points, common = bar.add_task("compiling"), [], study.problem.specification.common
    auto = given.get("fidelity", study.problem.specification.fidelity) == AUTO

    def progress(point):
        points.append(point)
        screened = point.fidelity == QUASI_STATIC and auto
        pace.check() if screened else pace.tick()
        judged = [p for p in points if not auto or p.fidelity != QUASI_STATIC]
        held = [p.objective for p in judged if p.feasible]
        best = "none holds every limit yet" if not held else f"best {-min(held) if common else min(held):.6g}"
        poses = f" and {len(points) - len(judged)} by poses" * auto
        bar.update(task, description=f"{len(judged)} designs{poses}, {best}")

    try:
        return study.problem.solve(progress=progress, **{**study.solve, **given})
    except KeyboardInterrupt:
        say("Interrupted before the first design was evaluated: there is nothing to keep.")
        raise typer.Exit(130) from None


def _interruption(design) -> bool:
    from clearance_jax.design.run import INTERRUPTED

    return design.stop_reason == INTERRUPTED


def _verify(study, design, client: Any, bar: Progress, pace: Pace):
    """The design and its certificate, with how long it will take said before and how far it has come on the way."""
    from clearance_jax.design.verify import expected_evaluations

    count = expected_evaluations(pace.count, design.specification.manufacture.among, **study.verify)
    seconds, done = pace.estimate(count), Pace(pace.check)
    say(f"Verifying by another solver: some {count} evaluations, {shown_duration(seconds)} (Ctrl-C ends it).")

    def progress(_point):
        done.tick()
        bar.update(bar.task_ids[0], description=f"verifying, evaluation {done.count} of some {count}")

    bar.update(bar.task_ids[0], description="verifying, compiling")
    return design.certified(**study.verify, cluster=client, progress=progress)


def _explain(study, design, verify: bool, client: Any, report: bool, bar: Progress, pace: Pace):
    """What can be said of the design: its certificate, and for a report whatever else.

    An interruption keeps what is known by then.
    """
    from clearance_jax.design import findings
    from clearance_jax.design.findings import CUT_SHORT, known_findings

    if _interruption(design):
        return known_findings(design)
    task, certificate = bar.task_ids[0], None

    def progress(name):
        pace.check()
        bar.update(task, description=name)

    try:
        if design.feasible and verify:
            before, (design, certificate) = design, _verify(study, design, client, bar, pace)
            if design.evaluation is not before.evaluation:
                say(str(design))
            say(str(certificate))
    except KeyboardInterrupt:
        found = known_findings(design)
        return found._replace(notes=(*found.notes, CUT_SHORT))
    if not report:
        return known_findings(design, certificate)
    return findings(design, certificate, progress, client)
