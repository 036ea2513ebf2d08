"""`clearance run` of a design: find clearances, verify them, write a report."""

from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from clearance_jax.cli.answer import answer, console, errors, quantity
from clearance_jax.cli.common import aloud, note, say, say_written
from clearance_jax.cli.pace import Interruption, Pace, ProgressDisplay, shown_duration
from clearance_jax.errors import wrong_value

# Free coordinates of a plane mechanism above which compiling takes minutes.
MANY = 16


def run_design(
    study: Any,
    *,
    report: Path | None,
    verify: bool,
    tradeoff: bool,
    cluster: str | None,
    record: Path | None,
    **search: Any,
) -> None:
    """Run the design of a study, verify it and report it. Ctrl-C keeps the best design so far."""
    from clearance_jax.ask.answers import place_of
    from clearance_jax.design.judge.findings import CUT_SHORT, known_findings
    from clearance_jax.design.search.run import INTERRUPTED
    from clearance_jax.design.search.yields import YieldWarning
    from clearance_jax.report.html import write_report
    from clearance_jax.runs.journal import RunWarning

    doubts, shown = aloud(RunWarning, YieldWarning), ProgressDisplay(errors)
    # One cluster for all that follows.
    with doubts, place_of(cluster) as client, shown, Interruption() as asked:
        pace, specification = Pace(asked.check), study.design.problem.specification
        note(_preparation(specification.mechanism))
        if specification.manufacture.is_sampled:
            note(f"Parts: {specification.manufacture}.")
        given = {**search, "record": record, "cluster": client}
        design = _search(study.design, {k: v for k, v in given.items() if v is not None}, shown, pace)
        console.print(f"[bold]{escape(study.name)}[/bold]")
        say(str(design))
        trade = {} if tradeoff and study.design.tradeoff is None else study.design.tradeoff
        if design.stop_reason == INTERRUPTED:
            findings = known_findings(design)
        else:
            findings = _explain(study.design, design, verify, client, report is not None, trade, shown, pace)
    best = findings.design
    values = {name: quantity(value, best.units[name]) for name, value in best.clearances.items()}
    answer["design"] = {"feasible": best.feasible, "confirmed": findings.good, "stopped": best.stop_reason}
    answer["design"] |= {"objective": best.objective, "variables": values, "because": best.deciders}
    for text in (*findings.notes, findings.fits, findings.tradeoff):
        if text is not None:
            say(str(text))
    if report is not None:
        write_report(findings, report, study.name, study.text)
        say_written("report", report)
    if design.stop_reason == INTERRUPTED or CUT_SHORT in findings.notes:
        raise typer.Exit(130)
    if not findings.good:
        raise typer.Exit(1)


def check_choices(method: str | None, fidelity: str | None) -> None:
    """Raise `ClearanceError` for the name of a search method or a model of the motion that does not exist."""
    from clearance_jax.design.asked.specification import FIDELITY_CHOICES
    from clearance_jax.design.search.methods import METHOD_CHOICES

    for option, word, choices in (("method", method, METHOD_CHOICES), ("fidelity", fidelity, FIDELITY_CHOICES)):
        if word is not None and word not in choices:
            raise wrong_value(f"`--{option}`", ", ".join(choices), word, shown=repr(word))


def _preparation(mechanism: Any) -> str:
    """The sentence about compiling, with a rough duration by the size of the mechanism."""
    from clearance_jax.mechanism.state import layout

    count = len(layout(mechanism).velocities)
    kind, how_long = ("plane", "about ten seconds") if mechanism.is_plane else ("spatial", "about a minute")
    if mechanism.is_plane and count > MANY:
        how_long = "minutes"
    return (
        f"Compiling the program that evaluates designs (a {kind} mechanism with {count} coordinates: this takes "
        f"{how_long}, more on a busy machine; programs that were compiled before are read again)."
    )


def _search(study, given: dict[str, Any], shown: ProgressDisplay, pace: Pace):
    from clearance_jax.design.asked.specification import AUTO
    from clearance_jax.solve.settings import QUASI_STATIC

    points, options = [], {**study.solve, **given}
    # One common clearance is as large as possible, unless classes have costs.
    common = study.problem.specification.common and options.get("classes") is None
    shown.phase("search: compiling")
    auto = given.get("fidelity", study.problem.specification.fidelity) == AUTO

    def progress(point):
        points.append(point)
        screened = point.fidelity == QUASI_STATIC and auto
        pace.check() if screened else pace.tick()
        judged = [p for p in points if not auto or p.fidelity != QUASI_STATIC]
        objectives = [p.objective for p in judged if p.feasible]
        least = min(objectives, default=0.0)
        best = f"best {-least if common else least:.6g}" if objectives else "none holds every limit yet"
        poses = f" and {len(points) - len(judged)} by poses" * auto
        shown.update(f"search: {len(judged)} designs{poses}, {best}")

    try:
        return study.problem.solve(progress=progress, **options)
    except KeyboardInterrupt:
        note("Interrupted before the first design was evaluated: there is nothing to keep.")
        raise typer.Exit(130) from None


def _verify(study, design, client: Any, shown: ProgressDisplay, pace: Pace):
    """The design and its certificate; prints the expected duration and shows the progress."""
    from clearance_jax.design.judge.verify import expected_evaluations

    count = expected_evaluations(pace.count, design.specification.manufacture.among, **study.verify)
    seconds, done = pace.estimate(count), Pace(pace.check)
    note(f"Verifying by another solver: some {count} evaluations, {shown_duration(seconds)} (Ctrl-C ends it).")

    def progress(_point):
        done.tick()
        shown.update(f"judge: evaluation {done.count} of some {count}")

    shown.phase("judge: compiling")
    return design.certified(**study.verify, cluster=client, progress=progress)


def _explain(
    study, design, verify: bool, client: Any, report: bool, trade: dict | None, shown: ProgressDisplay, pace: Pace
):
    """The certificate, a trade-off if asked for, for a report all findings; an interruption keeps those so far."""
    from clearance_jax.design import findings
    from clearance_jax.design.judge.findings import CUT_SHORT, known_findings, with_tradeoff

    certificate, phases = None, set()

    def progress(name):
        pace.check()
        # "trade-off, bound 3 of 7 (1.1 times), 12 designs" is one phase with all that goes before.
        phase = name.split(" (")[0]
        (shown.update if phase in phases else shown.phase)(name)
        phases.add(phase)

    try:
        if design.feasible and verify:
            before, (design, certificate) = design, _verify(study, design, client, shown, pace)
            if design.evaluation is not before.evaluation:
                say(str(design))
            say(str(certificate))
    except KeyboardInterrupt:
        partial = known_findings(design)
        return partial._replace(notes=(*partial.notes, CUT_SHORT))
    if not report:
        return with_tradeoff(known_findings(design, certificate), progress, client, trade)
    return findings(design, certificate, progress, client, trade)
