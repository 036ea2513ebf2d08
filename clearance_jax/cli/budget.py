"""`clearance info --budget`: the error budget of a point as a table and a figure, and advice."""

from pathlib import Path
from typing import Any

from clearance_jax.cli.common import FIGURES, change, check_distinct, check_writable, errors, say, say_written
from clearance_jax.cli.motion import check_covered, driven_by, end_of, usual_end
from clearance_jax.cli.posture import is_robot, say_held
from clearance_jax.errors import ClearanceError, suggest


def say_budget(
    scene: Any,
    scene_file: Path,
    settings: list[str] | None,
    clearance: list[str] | None,
    *,
    trajectory: Path | None,
    t1: str | None,
    point: str | None,
    plot: Path | None,
) -> None:
    """Print the error budget of a point of a scene or a robot, and draw it if `plot` is given."""
    check_distinct(scene=scene_file, trajectory=trajectory, plot=plot)
    check_writable(plot, FIGURES)
    if point is not None and is_robot(scene_file):
        scene = scene._replace(mechanism=_with_point(scene.mechanism, scene_file, point))
    driven, lead, idle = driven_by(scene, scene_file, trajectory)
    mechanism = change(driven, settings, False, clearance)
    name = _point(mechanism, point)
    options = usual_end(lead, idle) | scene.solve
    end = float(end_of(scene_file, options.get("t1") if t1 is None else t1))
    check_covered(lead, {**options, "t1": end})
    say_held(idle, lead is None, end if lead is None and t1 is None else None, driven)
    from clearance_jax.design.budget import error_budget
    from clearance_jax.design.specification import KNOWN

    with errors.status("compiling and solving (of an arm this takes about a minute)"):
        budget = error_budget(mechanism, name, end, **{n: options[n] for n in KNOWN if n in options})
    say(str(budget))
    if plot is not None:
        from clearance_jax.report.design_figures import budget_figure
        from clearance_jax.report.figures import save_figure

        save_figure(budget_figure(budget), plot)
        say_written("figure", plot)


def _with_point(mechanism: Any, robot: Path, link: str) -> Any:
    """The robot with a point at the frame of the named link."""
    from clearance_jax.io.urdf.mechanism import load_urdf

    return mechanism if link in [point.name for point in mechanism.points] else load_urdf(robot, end_effector=link)


def _point(mechanism: Any, asked: str | None) -> str:
    """The name of the point of a budget: the one that is asked for, or the only one."""
    names = [point.name for point in mechanism.points]
    if asked is not None and asked not in names:
        raise ClearanceError(f"`--point`: there is no point `{asked}`. {suggest(asked, names)}")
    if asked is None and len(names) != 1:
        raise ClearanceError(
            f"A budget is about one point, but the mechanism has {len(names)} ({', '.join(names)}). Say which one by "
            "`--point NAME`."
            if names
            else "A budget is about the error of a point, but the mechanism has none. Give the scene a `point`."
        )
    return names[0] if asked is None else asked
