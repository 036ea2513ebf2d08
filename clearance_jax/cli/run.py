"""`clearance run`: what a study file asks; a sweep and a calibration here, a design and wear in their own modules."""

from pathlib import Path
from typing import Any

from rich.markup import escape
from typer import Argument, Exit, Option

from clearance_jax._basis.extras import require
from clearance_jax.cli import common
from clearance_jax.cli.answer import answer, quantity
from clearance_jax.cli.design import check_choices, run_design
from clearance_jax.cli.pace import Interruption, ProgressDisplay
from clearance_jax.cli.plot import check_film, check_folder, draw_sweep
from clearance_jax.cli.wear import run_wear
from clearance_jax.errors import ClearanceError

# The sections of a study that an option is for.
FOR = {"output": ("sweep", "wear", "calibrate"), "resume": ("sweep", "wear"), "plot": ("sweep", "wear")}
FOR |= {"movie": ("wear",), "cores": ("sweep",), "cluster": ("sweep", "design"), "report": ("design", "calibrate")}
FOR |= {"record": ("design",), "method": ("design",), "fidelity": ("design",), "starts": ("design", "calibrate")}
FOR |= {"verify": ("design",), "tradeoff": ("design",)}
# File endings that a store, which is a folder, must not have.
OF_FILES = (".csv", ".txt", ".json", ".nc", ".h5", ".hdf5", ".parquet", ".xlsx", ".png", ".pdf")


def run(
    study_file: Path = Argument(..., metavar="STUDY", help="A study file (TOML with units)."),
    output: Path | None = common.output(
        "Store of a sweep, or dataset of a life (default: STUDY with .zarr, or .nc), or of residuals."
    ),
    resume: bool = Option(False, "--resume", help="Go on with a sweep, whose axes may have grown, or with a life."),
    plot: Path | None = Option(None, help="Folder for the pictures of a sweep; figure of a life (.png, .pdf)."),
    movie: Path | None = Option(None, help="Film of a life (.gif, or .mp4)."),
    report: Path | None = Option(None, help="Report of a design, with certificate, or of a calibration (.html)."),
    record: Path | None = Option(None, help="Keep every evaluated design in this file; go on from it if it exists."),
    method: str | None = Option(None, help="Search method of a design (default: the study's, or slsqp)."),
    fidelity: str | None = common.choice("Model of the motion of a design", "dynamics", "quasi-static", "auto"),
    starts: int | None = Option(None, help="Number of starts, the first in the middle.", min=1),
    verify: bool = Option(True, help="Prove a design by another solver (takes a while)."),
    tradeoff: bool = Option(
        False, "--tradeoff", help="Say what other bounds of a design's limit would mean (a search for each)."
    ),
    cores: int | None = Option(None, help="How many cores a sweep takes (default: all).", min=1),
    cluster: str | None = Option(
        None, help='Solve by the dask scheduler at this address, tcp://node1:8786 ("local": processes here).'
    ),
) -> None:
    """Do what a study asks: a sweep, a design, the life of a joint that wears, a calibration.

    Ctrl-C keeps what is done: the best design so far; a store or a journal that `--resume` goes on with.
    """
    given = dict(locals())  # every option by its name
    common.check_there(study_file, "study file")
    check_choices(method, fidelity)
    common.check_writable(report, (".html", ".htm"))
    common.check_writable(record)
    check_film(movie)
    common.check_distinct(study=study_file, output=output, plot=plot, movie=movie, report=report, record=record)
    common.set_up()
    from clearance_jax.io.study.study import load_study
    from clearance_jax.joints.checks import ImplausibleWarning

    with common.aloud(ImplausibleWarning):
        study = load_study(study_file)
    asked = [name for name in ("sweep", "design", "wear", "calibrate") if getattr(study, name) is not None]
    if study.wear is not None and study.wear.cycles is None:
        asked.remove("wear")
    _check_options(given, asked)
    if "sweep" in asked:
        store = study_file.with_suffix(".zarr") if output is None else output
        check_sweep(store, cluster)
        check_folder(plot)
        run_sweep(study, study_file, store, resume=resume, cores=cores, cluster=cluster, plot=plot)
    if "wear" in asked:
        dataset = study_file.with_suffix(".nc") if output is None else output
        common.check_writable(dataset, common.DATASETS)
        common.check_writable(plot, common.FIGURES)
        run_wear(study, study_file, dataset, resume=resume, plot=plot, movie=movie)
    if "calibrate" in asked:
        common.check_writable(output, common.DATASETS)
        run_calibrate(study, output=output, report=report, starts=starts)
    if "design" in asked:
        how = {"method": method, "fidelity": fidelity, "starts": starts}
        run_design(study, report=report, verify=verify, tradeoff=tradeoff, cluster=cluster, record=record, **how)


def _check_options(given: dict[str, Any], asked: list[str]) -> None:
    """Raise `ClearanceError` for options that no section of the study takes, or that two sections would take."""
    for name, takers in FOR.items():
        sections, option = [section for section in asked if section in takers], f"--{name}"
        if given[name] in (None, name == "verify"):
            continue
        if not sections:
            option = "--no-verify" if name == "verify" else option
            wanted = " or ".join(f"`{section}`" for section in takers)
            raise ClearanceError(f"`{option}` has no effect: the study has no section {wanted}. Leave it out.")
        if len(sections) > 1 and name in ("output", "plot", "report", "starts"):
            raise ClearanceError(f"`{option}` is for one result, but the study asks for {' and '.join(sections)}.")


def check_sweep(output: Path, cluster: str | None) -> None:
    """Raise `ClearanceError`, before the solves, for a missing package or a store that is named like a file."""
    require("The store of a sweep", "sweep", "zarr")
    if cluster is not None:
        require("A sweep on a cluster", "sweep", "dask", "distributed", "cloudpickle")
    if output.suffix.lower() in OF_FILES:
        raise ClearanceError(f"Cannot write a store to `{output}`: it is a folder. Give it a name that ends in .zarr.")


def run_sweep(
    study: Any, file: Path, output: Path, *, resume: bool, cores: int | None, cluster: str | None, plot: Path | None
) -> None:
    """Run the sweep of a study into a zarr store. Ctrl-C, or another end, leaves a store that can be resumed."""
    from clearance_jax.runs.journal import RunWarning
    from clearance_jax.sweep.run import sweep as swept

    common.console.print(f"[bold]{escape(study.name)}[/bold]")
    with common.aloud(RunWarning), ProgressDisplay(common.errors, parts=True) as shown, Interruption() as asked:
        shown.phase("compiling")

        def progress(now: Any) -> None:
            shown.update(str(now), now.done / now.lanes)
            asked.check()

        try:
            how = {"resume": resume, "cores": cores, "cluster": cluster, "plan": lambda plan: common.note(str(plan))}
            dataset = swept(**study.sweep, store=output, **how, progress=progress)
        except KeyboardInterrupt:
            common.note(f"Interrupted. What is done is kept: clearance run {file} -o {output} --resume")
            raise Exit(130) from None
    answer["sweep"] = {"samples": dataset.attrs["lanes"], "failed": dataset.attrs["failed"]}
    why = f": {dataset.attrs['failures']}" if dataset.attrs["failed"] else ""
    common.say(f"{dataset.attrs['lanes']} samples, {dataset.attrs['failed']} failed{why}")
    common.say_written("store", output)
    if plot is not None:
        draw_sweep(dataset, plot)


def run_calibrate(study: Any, *, output: Path | None, report: Path | None, starts: int | None) -> None:
    """Run the calibration of a study. Ctrl-C stops the search and keeps the best motion so far."""
    from clearance_jax.calibrate.run import calibrate
    from clearance_jax.report.html import calibration_report

    given = study.calibrate | ({} if starts is None else {"starts": starts})
    with ProgressDisplay(common.errors) as shown, Interruption() as asked:
        shown.phase("compiling")
        points = []

        def progress(point: Any) -> None:
            points.append(point)
            shown.update(f"{len(points)} motions" + ("" if point.reached else ", the last one failed"))
            asked.check()

        try:
            calibration = calibrate(**given, progress=progress)
        except KeyboardInterrupt:
            common.note("Interrupted before the first motion was compared: there is nothing to keep.")
            raise Exit(130) from None
    sizes = {name: quantity(value, calibration.units[name]) for name, value in calibration.values.items()}
    for name, (least, greatest) in calibration.intervals.items():
        sizes[name]["interval"] = [least, greatest]
    answer["calibration"] = {"converged": calibration.converged, "values": sizes}
    common.console.print(f"[bold]{escape(study.name)}[/bold]")
    common.say(calibration.message)
    if output is not None:
        common.write_dataset(calibration.residuals, output)
    if report is not None:
        calibration_report(calibration, report, study.name, study.text)
        common.say_written("report", report)
    if asked.heard:
        raise Exit(130)
    if not calibration.converged:
        raise Exit(1)
