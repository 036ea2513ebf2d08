"""`clearance run`: a sweep, a design, a wear simulation or a calibration, as a study file asks."""

from pathlib import Path
from typing import Annotated, Any

import typer

from clearance_jax.cli.animate import check_film
from clearance_jax.cli.calibrate import run_calibrate
from clearance_jax.cli.common import DATASETS, FIGURES, aloud, check_distinct, check_writable, set_up
from clearance_jax.cli.design import check_choices, run_design
from clearance_jax.cli.pictures import check_folder
from clearance_jax.cli.sweep import check_sweep, run_sweep
from clearance_jax.cli.wear import run_wear
from clearance_jax.errors import ClearanceError

# The sections of a study that an option is for.
FOR = {
    "--output": ("sweep", "wear", "calibrate"),
    "--resume": ("sweep", "wear"),
    "--plot": ("sweep", "wear"),
    "--movie": ("wear",),
    "--cores": ("sweep",),
    "--cluster": ("sweep", "design"),
    "--report": ("design", "calibrate"),
    "--record": ("design",),
    "--method": ("design",),
    "--fidelity": ("design",),
    "--starts": ("design", "calibrate"),
    "--no-verify": ("design",),
    "--tradeoff": ("design",),
}


def run(
    study_file: Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (TOML with units).")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Store of a sweep, or dataset of a life (default: STUDY with .zarr, or .nc), or of residuals.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a sweep, whose axes may have grown, or with a life.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Folder for the pictures of a sweep; figure of a life (.png, .pdf).")
    ] = None,
    movie: Annotated[Path | None, typer.Option(help="Film of a life (.gif, or .mp4).")] = None,
    report: Annotated[
        Path | None, typer.Option(help="Report of a design, with certificate, or of a calibration (.html).")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="Keep every evaluated design in this file; go on from it if it exists.")
    ] = None,
    method: Annotated[str | None, typer.Option(help="Solver of a design (default: the study's, or slsqp).")] = None,
    fidelity: Annotated[
        str | None,
        typer.Option(help="Model of the motion of a design: dynamics, quasi-static, auto (default: the study's)."),
    ] = None,
    starts: Annotated[int | None, typer.Option(help="Number of starts, the first in the middle.", min=1)] = None,
    verify: Annotated[bool, typer.Option(help="Prove a design by another solver (takes a while).")] = True,
    tradeoff: Annotated[
        bool,
        typer.Option("--tradeoff", help="Say what other bounds of a design's limit would mean (a search for each)."),
    ] = False,
    cores: Annotated[int | None, typer.Option(help="How many cores a sweep takes (default: all).", min=1)] = None,
    cluster: Annotated[
        str | None,
        typer.Option(help='Solve by the dask scheduler at this address, tcp://node1:8786 ("local": processes here).'),
    ] = None,
) -> None:
    """Do what a study asks: a sweep, a design, the life of a joint that wears, a calibration.

    Ctrl-C keeps what is done: the best design so far; a store or a journal that `--resume` goes on with.
    """
    given = {
        "--output": output,
        "--resume": resume or None,
        "--plot": plot,
        "--movie": movie,
        "--cores": cores,
        "--cluster": cluster,
        "--report": report,
        "--record": record,
        "--method": method,
        "--fidelity": fidelity,
        "--starts": starts,
        "--no-verify": None if verify else True,
        "--tradeoff": tradeoff or None,
    }
    check_choices(method, fidelity)
    check_writable(report, (".html", ".htm"))
    check_writable(record)
    check_film(movie)
    check_distinct(study=study_file, output=output, plot=plot, movie=movie, report=report, record=record)
    set_up()
    study = _load(study_file)
    asked = _sections(study)
    _check_options(given, asked)
    if "sweep" in asked:
        store = study_file.with_suffix(".zarr") if output is None else output
        check_sweep(store, cluster)
        check_folder(plot)
        run_sweep(study, study_file, store, resume=resume, cores=cores, cluster=cluster, plot=plot)
    if "wear" in asked:
        dataset = study_file.with_suffix(".nc") if output is None else output
        check_writable(dataset, DATASETS)
        check_writable(plot, FIGURES)
        run_wear(study, study_file, dataset, resume=resume, plot=plot, movie=movie)
    if "calibrate" in asked:
        check_writable(output, DATASETS)
        run_calibrate(study, output=output, report=report, starts=starts)
    if "design" in asked:
        how = {"method": method, "fidelity": fidelity, "starts": starts}
        run_design(study, report=report, verify=verify, tradeoff=tradeoff, cluster=cluster, record=record, **how)


def _load(path: Path) -> Any:
    from clearance_jax.io.study.study import load_study
    from clearance_jax.joints.checks import ImplausibleWarning

    with aloud(ImplausibleWarning):
        return load_study(path)


def _sections(study: Any) -> list[str]:
    """The names of the sections of a study that ask for a computation."""
    lives = study.wear is not None and study.wear.cycles is not None
    asks = {"sweep": study.sweep is not None, "design": study.design is not None, "wear": lives}
    asks["calibrate"] = study.calibrate is not None
    return [section for section, is_asked in asks.items() if is_asked]


def _check_options(given: dict[str, Any], asked: list[str]) -> None:
    """Raise `ClearanceError` for options that no section of the study takes, or that two sections would take."""
    for option, value in given.items():
        sections = [section for section in asked if section in FOR[option]]
        if value is None:
            continue
        if not sections:
            wanted = " or ".join(f"`{section}`" for section in FOR[option])
            raise ClearanceError(f"`{option}` has no effect: the study has no section {wanted}. Leave it out.")
        if len(sections) > 1 and option in ("--output", "--plot", "--report", "--starts"):
            raise ClearanceError(f"`{option}` is for one result, but the study asks for {' and '.join(sections)}.")
