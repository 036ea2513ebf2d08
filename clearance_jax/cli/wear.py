"""`clearance wear`: a wear file to a life: profiles, clearance and criterion over cycles, figures, a film."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

from clearance_jax.cli.animate import check_film, write_film
from clearance_jax.cli.common import (
    DATASETS,
    FIGURES,
    aloud,
    check_distinct,
    check_writable,
    console,
    errors,
    say,
    say_written,
    set_up,
    warn,
)
from clearance_jax.cli.interruption import Interruption
from clearance_jax.cli.pace import shown_duration
from clearance_jax.errors import ClearanceError


def wear(
    wear_file: Annotated[Path, typer.Argument(metavar="STUDY", help="A wear file (TOML with units).")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Result file, NetCDF (default: STUDY with .nc).")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a life that was interrupted.")] = False,
    plot: Annotated[Path | None, typer.Option(help="Figure of the life (.png, .pdf).")] = None,
    movie: Annotated[Path | None, typer.Option(help="Film of the profile over the life (.gif, or .mp4).")] = None,
) -> None:
    """How a sleeve wears over its life, and how long it lasts.

    Ctrl-C, or whatever else ends it, leaves a journal that `--resume` goes on with, to the same answer.
    """
    set_up()
    from clearance_jax.io.plausible import implausible
    from clearance_jax.io.wear_file import load_wear
    from clearance_jax.results.store import save
    from clearance_jax.wear.journal import JournalWarning
    from clearance_jax.wear.sectors import SectorsWarning

    output = wear_file.with_suffix(".nc") if output is None else output
    check_distinct(study=wear_file, output=output, plot=plot, movie=movie)
    check_writable(output, DATASETS)
    check_writable(plot, FIGURES)
    check_film(movie)
    study = load_wear(wear_file)
    warn(implausible(study.model.mechanism))
    journal = study.journal or output.with_suffix(".journal")
    if journal.exists() and not resume:
        raise ClearanceError(
            f"`{journal}` keeps a life that has begun. Go on with it by `--resume`, or delete it, or give another `-o`."
        )
    console.print(f"[bold]{escape(study.name)}[/bold]")
    with _bar() as bar, Interruption() as asked:
        try:
            with aloud(SectorsWarning), aloud(JournalWarning):
                dataset = _lived(study, journal, resume, _Told(bar, asked, study.cycles))
        except (KeyboardInterrupt, ClearanceError):
            if not asked.heard:
                raise
            say(f"Interrupted. What is done is kept: clearance wear {wear_file} -o {output} --resume")
            raise typer.Exit(130) from None
    for line in _words(dataset):
        say(line)
    save(dataset, output)
    say_written("dataset", output)
    if plot is not None:
        from clearance_jax.report.figures import save_figure
        from clearance_jax.report.wear_figures import overview

        save_figure(overview(dataset), plot)
        say_written("figure", plot)
    if movie is not None:
        from clearance_jax.report.wear_figures import animate

        write_film(animate(dataset), movie)


def _lived(study: Any, journal: Path, resume: bool, told: "_Told") -> Any:
    """The life as a dataset."""
    from clearance_jax.wear.folder import described, folder
    from clearance_jax.wear.history import simulate_wear
    from clearance_jax.wear.record import to_dataset

    question = described(study.model, study.until, cycles=study.cycles, **study.options, **study.solve)
    words = {} if study.until is None else {"watched": study.words}
    with folder(journal, question, resume) as blocks:
        how = {**study.options, **study.solve, "until": study.until, "journal": blocks, "progress": told}
        found = simulate_wear(study.model, study.cycles, **how)
        told.say("reading off")
        return to_dataset(found, study.model, name=study.name, **words, **study.texts)


def _bar() -> Progress:
    columns = (BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TextColumn("{task.fields[said]}"))
    return Progress(*columns, console=errors, transient=True)


class _Told:
    """How far a life is, on the screen; Ctrl-C that was lost is raised where it hears of it.

    The time that is left is that of the last block for each cycle: jumps grow, so that at first it is too long.
    """

    def __init__(self, bar: Progress, asked: Interruption, cycles: int):
        self._bar, self._asked, self._cycles = bar, asked, cycles
        self._task = bar.add_task("", total=1.0, said="compiling")
        self._at, self._done = time.monotonic(), 0.0

    def __call__(self, done: float) -> None:
        now = time.monotonic()
        left = (now - self._at) / max(done - self._done, 1e-12) * (1 - done)
        self._at, self._done = now, done
        self._bar.update(self._task, completed=done)
        self.say(f"cycle {round(done * self._cycles)} of {self._cycles}, {shown_duration(left)} left")
        self._asked.check()

    def say(self, text: str) -> None:
        """What is done now."""
        self._bar.update(self._task, said=text)


def _words(dataset: Any) -> list[str]:
    """What was found, in lines."""
    from clearance_jax.units import shown

    told, last = dataset.attrs, dataset.isel(cycle=-1)
    deepest, first = float(last["deepest"]), float(dataset["radial_clearance"][0])
    lived, computed = told["cycles_lived"], told["cycles_computed"]
    lines = [
        f"{lived} cycles lived, {computed} computed: {lived / max(computed, 1):.3g} times less than every one of them",
        f"worn off: {shown(deepest, 'm')} at most, {1e9 * float(last['volume']):.6g} mm^3; radial clearance "
        f"{shown(first, 'm')} at first, {shown(float(last['radial_clearance']), 'm')} in the end",
    ]
    if "watched" in dataset:
        about = dataset["watched"].attrs
        bound = shown(about["bound"], about["units"])
        then = f"reaches {bound} after {told['life']:.6g} cycles" if "life" in told else f"stays below {bound}"
        lines.append(f"{about['long_name']}: {then}")
    return lines
