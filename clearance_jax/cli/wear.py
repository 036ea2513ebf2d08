"""`clearance run` of a wear simulation: profiles, clearance and criterion over cycles; figures, a film."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from rich.markup import escape

from clearance_jax.cli.answer import answer, console, errors, quantity
from clearance_jax.cli.common import aloud, note, say, write_dataset, write_figure
from clearance_jax.cli.pace import Interruption, ProgressDisplay, shown_duration
from clearance_jax.cli.plot import write_film
from clearance_jax.errors import ClearanceError
from clearance_jax.units import format_quantity


def run_wear(study: Any, file: Path, output: Path, *, resume: bool, plot: Path | None, movie: Path | None) -> None:
    """Run the wear simulation of a study. Ctrl-C, or another end, leaves a journal that it can be resumed from."""
    from clearance_jax.runs.journal import RunWarning
    from clearance_jax.wear.history import lived_so_far, simulate_wear
    from clearance_jax.wear.worn import SectorsWarning

    journal = study.wear.journal or output.with_suffix(".journal")
    if journal.exists() and not resume:
        raise ClearanceError(
            f"`{journal}` keeps a life that has begun. Go on with it by `--resume`, or delete it, or give another `-o`."
        )
    console.print(f"[bold]{escape(study.name)}[/bold]")
    with ProgressDisplay(errors, parts=True) as shown, Interruption() as asked:
        try:
            with aloud(SectorsWarning), aloud(RunWarning):
                given, progress = study.wear, _progress(shown, asked, study.wear.cycles)
                how = {**given.options, "until": given.until, "journal": journal, "progress": progress, **given.solve}
                history = simulate_wear(given.model, given.cycles, **how)
                shown.update("reading off")
                dataset = _dataset(study, history)
        except (KeyboardInterrupt, ClearanceError):
            if not asked.heard:
                raise
            history = lived_so_far(study.wear.model, journal, study.wear.until)
            if history is not None:
                result = f"interrupted after {int(history.cycles[-1])} cycles"
                write_dataset(_dataset(study, history, result=result), output)
            note(f"Interrupted. What is done is kept: clearance run {file} -o {output} --resume")
            raise typer.Exit(130) from None
    for line in _words(dataset):
        say(line)
    write_dataset(dataset, output)
    if plot is not None:
        from clearance_jax.report.wear_figures import overview

        write_figure(overview(dataset), plot)
    if movie is not None:
        from clearance_jax.report.wear_figures import animate

        write_film(animate(dataset), movie)


def _dataset(study: Any, history: Any, **attributes: Any) -> Any:
    from clearance_jax.wear.record import to_dataset

    given = study.wear
    words = {} if given.until is None else {"watched": given.words}
    texts = {"scene": study.scene_text, "study": study.text}
    return to_dataset(history, given.model, name=study.name, **words, **texts, **attributes)


def _progress(shown: ProgressDisplay, asked: Interruption, cycles: int) -> Callable[[float], None]:
    """A function of the fraction done, which shows the progress and raises a lost Ctrl-C. It estimates the remaining
    time from the last block. That is too long at first, since later blocks have more cycles.
    """
    shown.phase("compiling")
    last = time.monotonic(), 0.0

    def progress(done: float) -> None:
        nonlocal last
        (before, part), last = last, (time.monotonic(), done)
        left = (last[0] - before) / max(done - part, 1e-12) * (1 - done)
        shown.update(f"cycle {round(done * cycles)} of {cycles}, {shown_duration(left)} left", done)
        asked.check()

    return progress


def _words(dataset: Any) -> list[str]:
    told, last = dataset.attrs, dataset.isel(cycle=-1)
    deepest, first = float(last["deepest"]), float(dataset["radial_clearance"][0])
    lived, computed = told["cycles_lived"], told["cycles_computed"]
    clearance = quantity(last["radial_clearance"], "m")
    answer["wear"] = {"cycles_lived": lived, "deepest": quantity(deepest, "m"), "radial_clearance": clearance}
    answer["wear"] |= {"life": told.get("life")} if "watched" in dataset else {}
    lines = [
        f"{lived} cycles lived, {computed} computed: {lived / max(computed, 1):.3g} times less than every one of them",
        f"worn off: {format_quantity(deepest, 'm')} at most, {1e9 * float(last['volume']):.6g} mm^3; radial clearance "
        f"{format_quantity(first, 'm')} at first, {format_quantity(float(last['radial_clearance']), 'm')} in the end",
    ]
    if "watched" in dataset:
        about = dataset["watched"].attrs
        bound = format_quantity(about["bound"], about["units"])
        then = f"reaches {bound} after {told['life']:.6g} cycles" if "life" in told else f"stays below {bound}"
        lines.append(f"{about['long_name']}: {then}")
    return lines
