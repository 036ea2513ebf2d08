"""`clearance animate`: a film of a result file, with a joint magnified."""

from pathlib import Path
from typing import Annotated, Any

import typer

from clearance_jax.cli.common import check_distinct, check_readable, check_writable, errors, say_written
from clearance_jax.cli.pace import Interruption, ProgressDisplay

Magnified = Annotated[
    str | None,
    typer.Option("--magnify", metavar="JOINT", help="The joint magnified (default: the one that bears most)."),
]


def animate(
    result_file: Annotated[Path, typer.Argument(metavar="RESULT", help="A result file written by `simulate -o`.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Film, .gif or .mp4 (default: RESULT with .gif).")
    ] = None,
    magnify: Magnified = None,
    slowdown: Annotated[
        float | None,
        typer.Option(help="Seconds of film per second of motion (default: a film of ten seconds at most)."),
    ] = None,
    exaggeration: Annotated[
        float | None, typer.Option(help="How many times as large play is drawn (default: so that it is seen).")
    ] = None,
    begin: Annotated[str | None, typer.Option("--from", help="Where it begins, e.g. 10ms.")] = None,
    end: Annotated[str | None, typer.Option("--to", help="Where it ends, e.g. 20ms.")] = None,
) -> None:
    """Film the mechanism of a result file, with a joint magnified.

    An .mp4 needs the program ffmpeg. Ctrl-C leaves no half film.
    """
    from clearance_jax.report.animation import animate as film_of
    from clearance_jax.results.store import load_dataset

    check_readable(result_file)
    output = result_file.with_suffix(".gif") if output is None else output
    check_film(output)
    check_distinct(result=result_file, film=output)
    dataset = load_dataset(result_file)
    span = _span(dataset, begin, end)
    write_film(film_of(dataset, magnify, slowdown=slowdown, exaggeration=exaggeration, span=span), output)


def check_film(path: Path | None) -> None:
    """Raise `ClearanceError`, before the solve, if the film cannot be written."""
    if path is not None:
        from clearance_jax.report.film import check_movie

        check_writable(path)
        check_movie(path)


def write_film(film: Any, path: Path) -> None:
    """Write a film to a file, with a progress display."""
    with ProgressDisplay(errors, parts=True) as shown, Interruption() as asked:
        shown.update(f"drawing {len(film)} frames")

        def progress(done: float) -> None:
            shown.update(part=done)
            asked.check()

        film.save(path, progress)
    say_written("film", path)


def _span(dataset: Any, begin: str | None, end: str | None) -> tuple[float, float] | None:
    if begin is None and end is None:
        return None
    from clearance_jax.units import to_si

    first = float(dataset["time"][0]) if begin is None else to_si(begin, "s", "`--from`")
    last = float(dataset["time"][-1]) if end is None else to_si(end, "s", "`--to`")
    return first, last
