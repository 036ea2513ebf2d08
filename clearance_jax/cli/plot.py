"""`clearance plot`: the figure of a result file, or the pictures of a sweep."""

from pathlib import Path
from typing import Annotated

import typer

from clearance_jax.cli.common import FIGURES, check_distinct, check_readable, check_writable, say_written
from clearance_jax.cli.pictures import check_folder, draw_sweep
from clearance_jax.errors import ClearanceError


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
    figures.save_figure(draw(dataset), output)
    say_written("figure", output)


def _plot_sweep(store: Path, output: Path | None) -> None:
    from clearance_jax.results.store import open_sweep

    dataset, path = open_sweep(store), store.resolve()
    folder = path.with_name(f"{path.stem}_pictures") if output is None else output
    check_folder(folder)
    check_distinct(store=store, pictures=folder)
    draw_sweep(dataset, folder)
