"""`clearance view`: a motion as one HTML file."""

from pathlib import Path

from typer import Argument, Option

from clearance_jax.cli import common


def view(
    result_file: Path = Argument(..., metavar="RESULT", help="A result file written by `simulate -o`."),
    output: Path | None = Option(None, "-o", "--output", help="The page (default: RESULT with .html)."),
    urdf: Path | None = Option(None, help="The robot's URDF file, to show its meshes."),
    title: str | None = Option(None, help="Title of the page (default: the mechanism's name)."),
    samples: int | None = Option(None, help="Most samples that the page keeps (default: what fits in 2 MB)."),
) -> None:
    """Write a page that shows the motion of a result file in three dimensions. A browser opens it, without network."""
    from clearance_jax.results.store import load_dataset
    from clearance_jax.viewer.page import view as page_of

    common.check_readable(result_file)
    output = result_file.with_suffix(".html") if output is None else output
    common.check_writable(output, (".html", ".htm"))
    common.check_distinct(result=result_file, page=output)
    page = page_of(load_dataset(result_file), urdf=urdf, title=title, samples=samples)
    page.save(output)
    common.say(str(page))
    common.say_written("page", output)
