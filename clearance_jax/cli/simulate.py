"""`clearance simulate`: simulate a scene; write a dataset, a figure, a film."""

import warnings
from pathlib import Path
from typing import Any

from rich.markup import escape
from typer import Exit, Option

from clearance_jax.cli import common
from clearance_jax.cli.answer import answer, largest, quantity
from clearance_jax.cli.motion import check_covered, driven_by, end_of, say_held, usual_end
from clearance_jax.cli.pace import Interruption, ProgressDisplay
from clearance_jax.cli.plot import check_film, figure_for, write_film
from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value

# More steps than in Python's `simulate`: here the user sees the progress and can stop the solve.
DEFAULTS = {"rtol": 1e-8, "samples": 1001, "solver": "auto", "max_steps": 10_000_000}


def simulate(
    scene_file: Path = common.SCENE,
    settings: list[str] | None = common.SETTINGS,
    t1: str | None = Option(None, help="End time with a unit, e.g. 0.5s (default: the scene's, or the trajectory's)."),
    rtol: float | None = Option(None, help="Accuracy, e.g. 1e-8 (default: the scene's)."),
    samples: int | None = Option(None, help="Number of output times.", min=2),
    solver: str | None = common.choice("Solver, auto by rtol", "auto", "tsit5", "dopri8"),
    start: str | None = common.choice("Where pins start, settled at their walls", "centre", "settled"),
    fidelity: str | None = common.choice("Model of the motion, quasi-static by poses", "dynamics", "quasi-static"),
    trajectory: Path | None = Option(None, help="Drives the joints that a CSV file of times and values names."),
    clearance: list[str] | None = common.CLEARANCES,
    ideal: bool = common.IDEAL,
    base: str | None = common.BASE,
    mimic: str | None = common.MIMIC,
    inertia: str | None = common.INERTIA,
    density: str | None = common.DENSITY,
    output: Path | None = common.output("Result file (NetCDF)."),
    plot: Path | None = Option(None, help="Figure of the result (.png, .pdf)."),
    plot_kind: str | None = common.KIND,
    movie: Path | None = Option(None, help="Film of the motion (.gif, or .mp4 with ffmpeg)."),
    magnify: str | None = common.MAGNIFIED,
) -> None:
    """Simulate a scene, or a robot (URDF, MJCF), and write a dataset, a figure, a film.

    Joints of a robot that nothing drives are held where they stand. Ctrl-C stops the solve and keeps what was computed.
    """
    scene = common.read_scene(scene_file, base=base, mimic=mimic, inertia=inertia, density=density)
    driven, lead, idle = driven_by(scene, scene_file, trajectory)
    mechanism = common.change(driven, settings, ideal, clearance)
    from clearance_jax.solve.simulate import EnergyWarning

    _check_files(scene_file, trajectory, output, plot, movie)
    draw = figure_for(plot, plot_kind)
    _check_magnified(mechanism, magnify, movie)
    given = {"t1": t1, "rtol": rtol, "samples": samples, "solver": solver, "start": start, "fidelity": fidelity}
    given = usual_end(lead, idle) | scene.solve | {name: value for name, value in given.items() if value is not None}
    options = _options(scene_file, given)
    check_covered(lead, options)
    end = options.pop("t1")
    say_held(idle, lead is None, end if lead is None and t1 is None else None, driven)
    with ProgressDisplay(common.errors, parts=True) as shown, warnings.catch_warnings():
        warnings.simplefilter("ignore", EnergyWarning)  # printed below, after the result
        shown.update("compiling and solving")
        solve = {"save_at" if name == "samples" else name: value for name, value in options.items()}
        with Interruption("keeping what was computed") as asked:

            def progress(done: float) -> None:
                shown.update(part=done)
                asked.check()

            result, solution = _solved(mechanism, end, solve, progress)
            if not asked.heard:
                asked.until = ""  # an interruption from here on keeps nothing
            shown.update("observing", 0.0)
            told = {"scene": scene.text, "settings": " ".join([*(settings or []), *(clearance or [])])}
            told |= {"trajectory": "" if lead is None else str(lead.path), "solve": repr({"t1": end, **options})}
            dataset = _observed(mechanism, (result, solution), solve, shown, told)
    _keep(dataset, output)
    _report(mechanism, result, solution, dataset)
    _warn(mechanism, solution, dataset)
    _answer(mechanism, result, solution, dataset, end, options)
    _write(dataset, output, plot, draw, movie, magnify)
    if result.message:
        raise Exit(130 if result.message == "interrupted" else 1)


def _check_files(
    scene: Path, trajectory: Path | None, output: Path | None, plot: Path | None, movie: Path | None
) -> None:
    common.check_distinct(scene=scene, trajectory=trajectory, output=output, plot=plot, movie=movie)
    common.check_writable(output, common.DATASETS)
    common.check_writable(plot, common.FIGURES)


def _observed(mechanism: Any, solved: tuple, solve: dict[str, Any], shown: ProgressDisplay, told: dict) -> Any:
    from clearance_jax.results.dataset import to_dataset
    from clearance_jax.results.episodes import ContactWarning

    result, solution = solved
    ideal = None if result.message else _ideal_motion(mechanism, solution, solve)
    with common.aloud(ContactWarning):
        return to_dataset(mechanism, result, ideal=ideal, progress=lambda part: shown.update(part=part), **told)


def _keep(dataset: Any, output: Path | None) -> None:
    """Save the dataset before the first line of text: who reads that may close the pipe."""
    if output is not None:
        from clearance_jax.results.store import save

        save(dataset, output)


def _write(
    dataset: Any, output: Path | None, plot: Path | None, draw: Any, movie: Path | None, magnify: str | None
) -> None:
    if output is not None:
        common.say_written("dataset", output)
    if plot is not None:
        common.write_figure(draw(dataset), plot)
    if movie is not None:
        from clearance_jax.report.film import animate

        write_film(animate(dataset, magnify), movie)


def _solved(mechanism: Any, end: float, solve: dict[str, Any], progress: Any) -> tuple[Any, Any]:
    """A `Trace` of the dynamics and its solution, or twice a `Solution` of quasi-static poses."""
    from clearance_jax.solve.drivers.trace import trace
    from clearance_jax.solve.settings import QUASI_STATIC
    from clearance_jax.solve.simulate import simulate as solution_of

    if solve.get("fidelity") == QUASI_STATIC:
        solution = solution_of(mechanism, end, **solve, throw=False)
        return solution, solution
    result = trace(mechanism, end, **solve, progress=progress)
    return result, result.solution


def _ideal_motion(mechanism: Any, solution: Any, solve: dict[str, Any]) -> Any:
    """The motion of the ideal mechanism at the samples, where no drive prescribes it; else `None`."""
    from clearance_jax.metrics.ideal import freedom
    from clearance_jax.solve.simulate import simulate as solution_of

    ideal = mechanism.intended()
    try:
        if not mechanism.has_play or freedom(ideal) == 0:
            return None
    except ClearanceError:  # over-constrained without its play; the dataset says so
        return None
    known = {name: solve[name] for name in ("rtol", "solver", "fidelity", "t0", "max_steps") if name in solve}
    time = solution.time
    moved = solution_of(ideal, float(time[-1]), **known | {"save_at": time, "energy_balance": False}, throw=False)
    return moved if bool(moved.succeeded) else None


def _check_magnified(mechanism: Any, joint: str | None, movie: Path | None) -> None:
    """Raise `ClearanceError`, before the solve, for a film that cannot be written, or a joint it cannot magnify."""
    check_film(movie)
    if joint is None:
        return
    if movie is None:
        raise ClearanceError("`--magnify` is about a film, but there is none. Add `--movie FILE`.")
    gaps = [gap for gap in mechanism.gaps if gap.is_play or gap.is_between_stops]
    known = [each.name for each in (*mechanism.clearance_joints(), *gaps)]
    if joint not in known:
        raise unknown_name(f"`--magnify`: there is no clearance joint {quote(joint)}.", joint, known, "--magnify")


def _options(scene_file: Path, given: dict[str, Any]) -> dict[str, Any]:
    """The checked options of the solve: those `given`, over the defaults."""
    from clearance_jax.solve.settings import OF_MOTIONS, SOLVER_WORDS, STARTS

    for name, words in (("solver", SOLVER_WORDS), ("start", STARTS), ("fidelity", OF_MOTIONS)):
        if given.get(name) not in (None, *words):
            raise wrong_value(f"`--{name}`", " or ".join(words), given[name], shown=repr(given[name]))
    return DEFAULTS | given | {"t1": end_of(scene_file, given.get("t1"))}


def _warn(mechanism: Any, solution: Any, dataset: Any) -> None:
    from clearance_jax.solve.law_validity import invalid, sunk
    from clearance_jax.solve.simulate import doubt

    common.warn(doubt(solution))
    common.warn(invalid(solution))
    if "penetration" in dataset:
        deepest = dataset["penetration"].max("time")
        common.warn(sunk(mechanism, dict(zip(dataset["joint"].values.tolist(), deepest.values.tolist(), strict=True))))


def _report(mechanism, result, solution, dataset) -> None:
    from clearance_jax.results.first_fall import loads, peak_words
    from clearance_jax.solve.solution import attempts

    headline = f"[bold]{escape(mechanism.name)}[/bold]: {dataset.attrs['result']} at t = {result.time[-1]:.6g} s"
    if solution.validity is not None:
        headline += f"\nquasi-static: {escape(str(solution.validity))}"
        common.console.print(headline, soft_wrap=True, highlight=False)
    else:
        headline += f", {attempts(solution)}"
        common.console.print(f"{headline}, energy residual {float(solution.energy_residual):.1e}")
    if result.rests:
        common.console.print(f"start: {escape(result.rests)}", soft_wrap=True, highlight=False)
    if "peak_force" in dataset:
        forces = loads(dataset) or "the surfaces never meet"
        common.console.print(f"{dataset.sizes['episode']} contact episodes, {forces}", soft_wrap=True)
    if "point" in dataset.coords:
        for point in dataset["point"].values:
            for name in ("speed", "acceleration"):
                common.console.print(f"{point}: largest {name} {peak_words(dataset, name, point)}", soft_wrap=True)


def _answer(mechanism: Any, result: Any, solution: Any, dataset: Any, end: float, options: dict[str, Any]) -> None:
    """What `--json` prints: how the solve ended, the largest contact force, and the largest values of the samples."""
    from clearance_jax.results.first_fall import loads
    from clearance_jax.solve.settings import with_solver

    reached, counts = float(result.time[-1]), ("accepted_steps", "rejected_steps", "cut_steps")
    answer.update({"mechanism": mechanism.name, "result": dataset.attrs["result"], "result_code": int(solution.code)})
    answer.update({"t1": quantity(end, "s"), "end_time": quantity(reached, "s")})
    answer["options"] = with_solver(mechanism, options)
    answer.update({name: dataset.attrs[name] for name in (*counts, "energy_residual")})
    forces = loads(dataset) if "peak_force" in dataset else None
    peaks = {} if forces is None else {"largest_force": forces.largest, "after_first_falls": forces.after}
    for name, peak in peaks.items():
        if peak is not None:
            answer[name] = {**quantity(peak.force, "N"), "time": quantity(peak.time, "s"), "joint": str(peak.joint)}
    answer["largest"] = largest(dataset)
