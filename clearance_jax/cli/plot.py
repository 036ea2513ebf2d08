"""`clearance plot`: the figure of a result file."""

from pathlib import Path
from typing import Annotated

import typer

from clearance_jax.cli.common import FIGURES, check_distinct, check_readable, check_writable, say_written


def plot(
    result_file: Annotated[Path, typer.Argument(metavar="RESULT", help="A result file written by `simulate -o`.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Figure (default: RESULT with .png).")] = None,
) -> None:
    """Draw the figure of a result file."""
    from clearance_jax.report.figures import overview, save_figure
    from clearance_jax.results.store import load_dataset

    check_readable(result_file)
    output = result_file.with_suffix(".png") if output is None else output
    check_writable(output, FIGURES)
    check_distinct(result=result_file, figure=output)
    save_figure(overview(load_dataset(result_file)), output)
    say_written("figure", output)
