"""`clearance run` of a calibration: fit numbers, print their confidence, write a report and a dataset of residuals."""

from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from clearance_jax.cli.common import console, errors, say, say_written
from clearance_jax.cli.interruption import Interruption
from clearance_jax.cli.pace import ProgressDisplay


def run_calibrate(study: Any, *, output: Path | None, report: Path | None, starts: int | None) -> None:
    """Run the calibration of a study. Ctrl-C stops the search and keeps the best motion so far."""
    from clearance_jax.calibrate.run import calibrate
    from clearance_jax.report.html import calibration_report
    from clearance_jax.results.store import save

    given = study.calibrate | ({} if starts is None else {"starts": starts})
    with ProgressDisplay(errors) as shown, Interruption() as asked:
        shown.phase("compiling")
        points = []

        def progress(point: Any) -> None:
            points.append(point)
            shown.update(f"{len(points)} motions" + ("" if point.reached else ", the last one failed"))
            asked.check()

        try:
            calibration = calibrate(**given, progress=progress)
        except KeyboardInterrupt:
            say("Interrupted before the first motion was compared: there is nothing to keep.")
            raise typer.Exit(130) from None
    console.print(f"[bold]{escape(study.name)}[/bold]")
    say(calibration.message)
    if output is not None:
        save(calibration.residuals, output)
        say_written("dataset", output)
    if report is not None:
        calibration_report(calibration, report, study.name, study.text)
        say_written("report", report)
    if asked.heard:
        raise typer.Exit(130)
    if not calibration.converged:
        raise typer.Exit(1)
