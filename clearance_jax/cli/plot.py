"""`clearance plot` and `clearance animate`: figures of a result file, pictures of a sweep, films of a motion."""

import os
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from clearance_jax.cli.common import (
    FIGURES,
    check_distinct,
    check_readable,
    check_writable,
    errors,
    say_written,
    warn,
    write_figure,
)
from clearance_jax.cli.pace import Interruption, ProgressDisplay
from clearance_jax.errors import ClearanceError

# Characters of a figure's name that a file name must not have.
UNFIT = re.compile(r"[^\w.+-]+")
Magnified = Annotated[
    str | None,
    typer.Option("--magnify", metavar="JOINT", help="The joint magnified (default: the one that bears most)."),
]


def check_folder(folder: Path | None) -> None:
    """Raise `ClearanceError`, before the solves, if pictures cannot be written to a folder."""
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise ClearanceError(f"Cannot write pictures to `{folder}`: it is a file. Name a folder.")
    there = folder if folder.exists() else folder.parent
    if not there.is_dir():
        raise ClearanceError(f"Cannot make the folder `{folder}`: `{there}` does not exist. Make that first.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ClearanceError(f"Cannot write pictures to `{folder}`: no permission. Choose another folder.")


def draw_sweep(dataset: Any, folder: Path) -> None:
    """Draw every figure that fits a sweep, with sensitivity indices if its samples allow them. If nothing can be drawn,
    print a warning.
    """
    from clearance_jax.report.figures import save_figure
    from clearance_jax.report.sweep_axes import results
    from clearance_jax.report.sweep_figures import figures
    from clearance_jax.results.sobol import is_sobol, middle_derivatives, sobol_indices

    try:
        with errors.status("drawing"):
            named = [name for name in results(dataset) if is_sobol(dataset[name])]
            indices = {name: sobol_indices(dataset, name) for name in named}
            slopes = ((name, middle_derivatives(dataset, name)) for name in named)
            drawn = figures(dataset, indices, {name: slope for name, slope in slopes if slope is not None})
            folder.mkdir(exist_ok=True)
            for name, figure in drawn.items():
                save_figure(figure, folder / f"{UNFIT.sub('_', name)}.png")
    except ClearanceError as error:
        warn(str(error))
        return
    say_written("pictures", folder)


def plot(
    result_file: Annotated[
        Path,
        typer.Argument(metavar="RESULT", help="A result file of `simulate -o` or `wear`, or a store of `sweep`."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", help="Figure (default: RESULT with .png); of a sweep a folder (default: RESULT_pictures)."
        ),
    ] = None,
    play: Annotated[bool, typer.Option("--play", help="When pins bear how, and their orbits, instead.")] = False,
) -> None:
    """Draw the figure of a result file: its motion, where its pins bear, or a life of wear; or all pictures that fit a
    sweep, also one that is still running.
    """
    if result_file.is_dir():
        if play:
            raise ClearanceError(f"`{result_file}` is a sweep: no motion is in it. Plot it without `--play`.")
        _plot_sweep(result_file, output)
        return
    from clearance_jax.report import figures, wear_figures
    from clearance_jax.results.store import load_dataset

    check_readable(result_file)
    output = result_file.with_suffix(".png") if output is None else output
    check_writable(output, FIGURES)
    check_distinct(result=result_file, figure=output)
    dataset = load_dataset(result_file)
    draw = figures.play if play else (wear_figures if wear_figures.is_life(dataset) else figures).overview
    write_figure(draw(dataset), output)


def _plot_sweep(store: Path, output: Path | None) -> None:
    from clearance_jax.results.store import open_sweep

    dataset, path = open_sweep(store), store.resolve()
    folder = path.with_name(f"{path.stem}_pictures") if output is None else output
    check_folder(folder)
    check_distinct(store=store, pictures=folder)
    draw_sweep(dataset, folder)


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
    from clearance_jax.report.film import animate as film_of
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
