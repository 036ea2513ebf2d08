"""`clearance plot`, `animate` and `view`: figures, films and pages of a result file, pictures of a sweep."""

import os
import re
from pathlib import Path
from typing import Any

from typer import Argument, Option

from clearance_jax.cli import common
from clearance_jax.cli.pace import Interruption, ProgressDisplay
from clearance_jax.errors import ClearanceError
from clearance_jax.report.figures import kind_of, save_figure
from clearance_jax.units import to_si

# Characters of a figure's name that a file name must not have.
UNFIT = re.compile(r"[^\w.+-]+")


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
    """Draw all figures that fit a sweep, with sensitivity indices if its samples allow; else print a warning."""
    from clearance_jax.report.sweep_axes import results
    from clearance_jax.report.sweep_figures import figures
    from clearance_jax.results.sobol import is_sobol, middle_derivatives, sobol_indices

    try:
        with common.errors.status("drawing"):
            named = [name for name in results(dataset) if is_sobol(dataset[name])]
            indices = {name: sobol_indices(dataset, name) for name in named}
            slopes = ((name, middle_derivatives(dataset, name)) for name in named)
            drawn = figures(dataset, indices, {name: slope for name, slope in slopes if slope is not None})
            folder.mkdir(exist_ok=True)
            for name, figure in drawn.items():
                save_figure(figure, folder / f"{UNFIT.sub('_', name)}.png")
    except ClearanceError as error:
        common.warn(str(error))
        return
    common.say_written("pictures", folder)


def plot(
    result_file: Path = Argument(
        ..., metavar="RESULT", help="A motion of `simulate -o`, a life that wears or a store of a sweep of `run -o`."
    ),
    output: Path | None = common.output(
        "Figure (default: RESULT with .png); of a sweep a folder (default: RESULT_pictures)."
    ),
    plot_kind: str | None = common.KIND,
    narrow: bool = common.NARROW,
    play: bool = Option(False, "--play", help="The same as `--plot-kind play`."),
) -> None:
    """Draw a figure of a result file: a motion (by default its overview) or a life of wear; or all pictures that fit
    a sweep, also one that is still running.
    """
    common.check_there(result_file, "result file")
    from clearance_jax.report import wear_figures
    from clearance_jax.results.store import load_dataset, open_sweep

    if play and plot_kind not in (None, "play"):
        raise ClearanceError("`--play` is `--plot-kind play`. Give one of the two.")
    plot_kind = "play" if play else plot_kind
    kind = kind_of(plot_kind or "overview")
    if result_file.is_dir():
        if plot_kind is not None:
            raise ClearanceError(f"`{result_file}` is a sweep: no motion is in it. Plot it without `--plot-kind`.")
        dataset, path = open_sweep(result_file), result_file.resolve()
        folder = path.with_name(f"{path.stem}_pictures") if output is None else output
        check_folder(folder)
        common.check_distinct(store=result_file, pictures=folder)
        return draw_sweep(dataset, folder)
    output = result_file.with_suffix(".png") if output is None else output
    common.check_writable(output, common.FIGURES)
    common.check_distinct(result=result_file, figure=output)
    dataset = load_dataset(result_file)
    draw = wear_figures.overview if plot_kind is None and wear_figures.is_life(dataset) else kind.draw
    return common.write_figure(draw(dataset, narrow), output)


def animate(
    result_file: Path = Argument(..., metavar="RESULT", help="A result file written by `simulate -o`."),
    output: Path | None = common.output("Film, .gif or .mp4 (default: RESULT with .gif)."),
    magnify: str | None = common.MAGNIFIED,
    slowdown: float | None = Option(
        None, help="Seconds of film per second of motion (default: a film of ten seconds at most)."
    ),
    exaggeration: float | None = Option(
        None, help="How many times as large play is drawn (default: so that it is seen)."
    ),
    begin: str | None = Option(None, "--from", help="Where it begins, e.g. 10ms."),
    end: str | None = Option(None, "--to", help="Where it ends, e.g. 20ms."),
) -> None:
    """Film the mechanism of a result file, with a joint magnified.

    An .mp4 needs the program ffmpeg. Ctrl-C leaves no half film.
    """
    common.check_there(result_file, "result file")
    from clearance_jax.report.film import animate as film_of
    from clearance_jax.results.store import load_dataset

    output = result_file.with_suffix(".gif") if output is None else output
    check_film(output)
    common.check_distinct(result=result_file, film=output)
    dataset = load_dataset(result_file)
    first, last = (float(dataset["time"][k]) if "time" in dataset else 0.0 for k in (0, -1))
    first = first if begin is None else to_si(begin, "s", "`--from`")
    last = last if end is None else to_si(end, "s", "`--to`")
    span = None if begin is None and end is None else (first, last)
    write_film(film_of(dataset, magnify, slowdown=slowdown, exaggeration=exaggeration, span=span), output)


def view(
    result_file: Path = Argument(..., metavar="RESULT", help="A result file written by `simulate -o`."),
    output: Path | None = common.output("The page (default: RESULT with .html)."),
    urdf: Path | None = Option(None, help="The robot's URDF file, to show its meshes."),
    title: str | None = Option(None, help="Title of the page (default: the mechanism's name)."),
    samples: int | None = Option(None, help="Most samples that the page keeps (default: what fits in 2 MB)."),
) -> None:
    """Write a page that shows the motion of a result file in three dimensions. A browser opens it, without network."""
    common.check_there(result_file, "result file")
    from clearance_jax.results.store import load_dataset
    from clearance_jax.viewer.page import view as page_of

    output = result_file.with_suffix(".html") if output is None else output
    common.check_writable(output, (".html", ".htm"))
    common.check_distinct(result=result_file, page=output)
    page = page_of(load_dataset(result_file), urdf=urdf, title=title, samples=samples)
    page.save(output)
    common.say(str(page))
    common.say_written("page", output)


def check_film(path: Path | None) -> None:
    """Raise `ClearanceError`, before the solve, if the film cannot be written."""
    if path is not None:
        from clearance_jax.report.film import check_movie

        common.check_writable(path)
        check_movie(path)


def write_film(film: Any, path: Path) -> None:
    """Write a film to a file, with a progress display."""
    with ProgressDisplay(common.errors, parts=True) as shown, Interruption() as asked:
        shown.update(f"drawing {len(film)} frames")

        def progress(done: float) -> None:
            shown.update(part=done)
            asked.check()

        film.save(path, progress)
    common.say_written("film", path)


def figure_for(path: Path | None, name: str | None) -> Any:
    """The kind of figure of a name (default: overview). **Raises** `ClearanceError` for a name without a figure."""
    if path is None and name is not None:
        raise ClearanceError("`--plot-kind` is about a figure, but there is none. Add `--plot FILE`.")
    return kind_of(name or "overview")
