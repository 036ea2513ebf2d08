"""The command `clearance`: simulate, info, plot, optimize. Every error is one sentence and exit code 2."""

import os
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from clearance_jax.errors import ClearanceError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    help="Mechanisms and robots with clearance joints.\n\n"
    "[bold]Examples[/bold]\n\n"
    "clearance simulate experiments/scenes/slider_crank.toml -o out.nc --plot out.png\n\n"
    "clearance simulate experiments/scenes/joint5_velocity_1.toml --set joint5.radial_clearance=0.2mm "
    "--set joint5.friction.coefficient=0.3\n\n"
    "clearance info experiments/scenes/four_bar.toml\n\n"
    "clearance plot out.nc -o out.png\n\n"
    "clearance optimize optimize/studies/slider_crank.toml --report out.html",
)
console, errors = Console(), Console(stderr=True)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file (TOML with units).")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Replace one parameter, e.g. joint5.radial_clearance=0.2mm."),
]
Ideal = Annotated[bool, typer.Option("--ideal", help="Take every clearance away.")]


def _mechanism(scene_file: Path, settings: list[str] | None, ideal: bool):
    from clearance_jax.configure import configure

    configure(cache=True)
    from clearance_jax.io.scene import load_scene, parse_setting
    from clearance_jax.mechanism.mechanism import parameters, replace
    from clearance_jax.solve.simulate import check_values

    scene = load_scene(scene_file)
    mechanism = scene.mechanism
    known = parameters(mechanism)
    mechanism = replace(mechanism, dict(parse_setting(text, known, mechanism) for text in settings or []))
    check_values(mechanism)
    return (mechanism.ideal() if ideal else mechanism), scene


FIGURES = (".png", ".pdf", ".svg")


def _writable(path: Path | None, endings: tuple[str, ...] = ()) -> None:
    """Raise before the solve for what could not be written after it."""
    if path is None:
        return
    if not path.parent.is_dir() or path.is_dir():
        raise ClearanceError(f"Cannot write `{path}`: its folder does not exist or it is a folder. Make it first.")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise ClearanceError(f"Cannot write `{path}`: no permission. Choose another path.")
    if endings and path.suffix.lower() not in endings:
        raise ClearanceError(f"Cannot write `{path}`: its name must end in {', '.join(endings)}.")


@app.command()
def simulate(
    scene_file: SceneFile,
    settings: Settings = None,
    t1: Annotated[str | None, typer.Option(help="End time with a unit, e.g. 0.5s (default: the scene's).")] = None,
    rtol: Annotated[float | None, typer.Option(help="Accuracy, e.g. 1e-8 (default: the scene's).")] = None,
    samples: Annotated[int | None, typer.Option(help="Number of output times.", min=2)] = None,
    solver: Annotated[str | None, typer.Option(help="tsit5, or dopri8 for rtol below 1e-8.")] = None,
    ideal: Ideal = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Result file (NetCDF).")] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure of the result (.png, .pdf).")] = None,
) -> None:
    """Simulate a scene and write a dataset and a figure.

    Ctrl-C stops the solve and keeps what was computed.
    """
    mechanism, scene = _mechanism(scene_file, settings, ideal)
    from clearance_jax.results.dataset import to_dataset
    from clearance_jax.results.store import save
    from clearance_jax.solve.simulate import SOLVERS
    from clearance_jax.solve.trace import trace
    from clearance_jax.units import to_si

    _writable(output)
    _writable(plot, FIGURES)
    if output is not None and plot is not None and output.resolve() == plot.resolve():
        raise ClearanceError(f"`-o` and `--plot` name the same file `{output}`. Give two names.")
    options: dict[str, Any] = {"rtol": 1e-8, "samples": 1001, "solver": "tsit5"} | scene.solve
    if solver is not None and solver not in SOLVERS:
        raise ClearanceError(f"`--solver` must be tsit5 or dopri8, but it is {solver!r}.")
    given = {"rtol": rtol, "samples": samples, "solver": solver, "t1": None if t1 is None else to_si(t1, "s", "`--t1`")}
    options |= {k: v for k, v in given.items() if v is not None}
    if "t1" not in options:
        raise ClearanceError(f"{scene_file}: the table `solve` has no `t1`. Add one, or give `--t1 1s`.")
    end = options.pop("t1")
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeElapsedColumn(), console=errors, transient=True) as bar:
        task = bar.add_task("compiling and solving", total=1.0)
        result = trace(mechanism, end, **options, progress=lambda f: bar.update(task, completed=f))
    dataset = to_dataset(
        mechanism, result, scene=scene.text, settings=" ".join(settings or []), solve=repr({"t1": end, **options})
    )
    _report(mechanism, result, dataset)
    if output is not None:
        save(dataset, output)
        console.print(f"dataset  {escape(str(output))}", soft_wrap=True)
    if plot is not None:
        from clearance_jax.report.figures import overview, save_figure

        save_figure(overview(dataset), plot)
        console.print(f"figure   {escape(str(plot))}", soft_wrap=True)
    if result.message:
        raise typer.Exit(130 if result.message == "interrupted" else 1)


def _report(mechanism, result, dataset) -> None:
    solution = result.solution
    console.print(
        f"[bold]{escape(mechanism.name)}[/bold]: {dataset.attrs['result']} at t = {result.time[-1]:.6g} s, "
        f"{int(solution.steps)} steps ({int(solution.rejected)} rejected), "
        f"energy residual {float(solution.energy_residual):.1e}"
    )
    if "peak_force" in dataset:
        count = dataset.sizes["episode"]
        peak = float(dataset["peak_force"].max()) if count else 0.0
        console.print(f"{count} contact episodes, largest force {peak:.6g} N")
    if "point" in dataset.coords:
        import numpy as np

        for point in dataset["point"].values:
            speed = np.hypot(*dataset["velocity"].sel(point=point).values.T).max()
            acceleration = np.hypot(*dataset["acceleration"].sel(point=point).values.T).max()
            console.print(f"{point}: largest speed {speed:.6g} m/s, largest acceleration {acceleration:.6g} m/s^2")


@app.command()
def info(scene_file: SceneFile, settings: Settings = None, ideal: Ideal = False) -> None:
    """What a scene contains: states, terms, cost of one vector-field evaluation, every parameter by its name."""
    mechanism, _ = _mechanism(scene_file, settings, ideal)
    import jax
    import jax.numpy as jnp
    import numpy as np
    from rich.table import Table

    from clearance_jax.dynamics.field import rate
    from clearance_jax.io.scene import unit_of
    from clearance_jax.mechanism.mechanism import layout, parameters

    plan = layout(mechanism)
    console.print(f"[bold]{escape(mechanism.name)}[/bold]")
    console.print(
        f"states: {plan.size} (positions and speeds of {', '.join(plan.names) or 'nothing'}"
        + (f"; {plan.remembered} memory variables" if plan.remembered else "")
        + ")"
    )
    for joint in mechanism.clearance_joints():
        clearance = joint.clearance
        assert clearance is not None
        friction = "no friction" if clearance.friction is None else type(clearance.friction).__name__
        console.print(
            f"clearance joint {joint.name}: {type(clearance.normal).__name__} "
            f"(class {clearance.normal.smoothness}), {friction}"
        )
    console.print(f"ideal loop closures: {', '.join(j.name for j in mechanism.closures()) or 'none'}")
    prepared = mechanism.prepared()
    compiled = jax.jit(rate).lower(jnp.zeros(()), jnp.zeros(plan.size), prepared).compile()
    cost: Any = compiled.cost_analysis()
    console.print(f"one evaluation of the vector field: {int(cost.get('flops', 0))} operations (compiler's count)")
    table = Table("parameter", "value", "unit")
    known = parameters(mechanism)
    for name, leaf in known.items():
        table.add_row(
            name, escape(np.array2string(np.asarray(leaf.value), precision=8)), unit_of(leaf, known, mechanism)
        )
    console.print(table)


@app.command()
def plot(
    result_file: Annotated[Path, typer.Argument(metavar="RESULT", help="A result file written by `simulate -o`.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Figure (default: RESULT with .png).")] = None,
) -> None:
    """Draw the figure of a result file."""
    from clearance_jax.report.figures import overview, save_figure
    from clearance_jax.results.store import load_dataset

    output = result_file.with_suffix(".png") if output is None else output
    _writable(output, FIGURES)
    save_figure(overview(load_dataset(result_file)), output)
    console.print(f"figure   {escape(str(output))}", soft_wrap=True)


@app.command()
def optimize(
    study_file: Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (TOML with units).")],
    report: Annotated[Path | None, typer.Option(help="Report with figures and certificate (.html).")] = None,
    record: Annotated[
        Path | None, typer.Option(help="Keep every evaluated design in this file; go on from it if it exists.")
    ] = None,
    method: Annotated[str | None, typer.Option(help="Solver (default: the study's, or slsqp).")] = None,
    starts: Annotated[int | None, typer.Option(help="Number of starts, the first in the middle.", min=1)] = None,
    verify: Annotated[bool, typer.Option(help="Prove the answer by another solver (takes a while).")] = True,
) -> None:
    """Find the largest, or the cheapest, clearances that keep every limit of a study, and prove them.

    Ctrl-C stops the search and keeps the best design so far.
    """
    from clearance_jax.configure import configure

    configure(cache=True)
    from clearance_jax.design import SOLVERS, Findings, findings
    from clearance_jax.io.study import load_study
    from clearance_jax.report.html import write_report

    _writable(report, (".html", ".htm"))
    _writable(record)
    study = load_study(study_file)
    options = dict(study.solve)
    if method is not None:
        if method not in ("auto", *SOLVERS):
            raise ClearanceError(f"`--method` must be auto, {', '.join(SOLVERS)}, but it is {method!r}.")
        options["method"] = method
    if starts is not None:
        options["starts"] = starts
    common = study.problem.common

    with Progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=errors) as bar:
        task, points = bar.add_task("compiling"), []

        def progress(point):
            points.append(point)
            held = [p.objective for p in points if p.feasible]
            best = "none holds every limit yet" if not held else f"best {-min(held) if common else min(held):.6g}"
            bar.update(task, description=f"{len(points)} designs, {best}")

        design = study.problem.solve(record=record, progress=progress, **options)
        console.print(f"[bold]{escape(study.name)}[/bold]")
        console.print(str(design), highlight=False, markup=False, soft_wrap=True)
        found, searched = Findings(design), design.stopped != "interrupted"
        try:
            if searched and design.feasible and verify:
                bar.update(task, description="verifying by another solver")
                found = Findings(design, design.verify(**study.verify))
                console.print(str(found.certificate), highlight=False, markup=False, soft_wrap=True)
            if searched and report is not None:
                bar.update(task, description="trade-off and standard fits")
                found = findings(design, found.certificate)
        except KeyboardInterrupt:
            found = found._replace(notes=(*found.notes, "Interrupted before every statement was made."))
    for text in found.notes:
        console.print(text, highlight=False, markup=False, soft_wrap=True)
    if found.fits is not None:
        console.print(str(found.fits), highlight=False, markup=False, soft_wrap=True)
    if report is not None:
        write_report(found, report, study.name, study.text)
        console.print(f"report   {escape(str(report))}", soft_wrap=True)
    interrupted = not searched or any(text.startswith("Interrupted") for text in found.notes)
    refuted = found.certificate is not None and not found.certificate.holds
    if interrupted or refuted or not design.feasible:
        raise typer.Exit(130 if interrupted else 1)


def main() -> None:
    """Entry point: turns every `ClearanceError` into one sentence and exit code 2."""
    try:
        app()
    except ClearanceError as error:
        errors.print("error:", style="red", end=" ")
        errors.print(str(error), soft_wrap=True, highlight=False, markup=False)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        errors.print("interrupted")
        raise SystemExit(130) from None
