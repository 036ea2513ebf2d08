"""`clearance info`: the contents of a scene, the cost of one evaluation of its vector field, an error budget."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table
from typer import Option

from clearance_jax.cli import common
from clearance_jax.cli.answer import answer, quantity
from clearance_jax.cli.motion import check_covered, driven_by, end_of, is_robot, say_held, usual_end
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.units import format_quantity

# Numbers of one parameter that are listed, at most.
LISTED = 12
# Modes that are listed, at most.
MODES = 6


def info(
    scene_file: Path = common.SCENE,
    settings: list[str] | None = common.SETTINGS,
    clearance: list[str] | None = common.CLEARANCES,
    ideal: bool = common.IDEAL,
    base: str | None = common.BASE,
    mimic: str | None = common.MIMIC,
    inertia: str | None = common.INERTIA,
    density: str | None = common.DENSITY,
    budget: bool = Option(
        False, "--budget", help="Instead: what the error of a point is made of, and what would help."
    ),
    point: str | None = Option(None, help="The point of the budget (default: the only one)."),
    trajectory: Path | None = Option(
        None, help="For the budget: drives the joints that a CSV file of times and values names."
    ),
    t1: str | None = Option(
        None, help="End time of the budget, e.g. 0.5s (default: the scene's, or the trajectory's)."
    ),
    plot: Path | None = Option(None, help="Figure of the budget (.png, .pdf)."),
) -> None:
    """What a scene contains: states, terms, cost of one vector-field evaluation, every parameter by its name.

    With `--budget`, what the error of a point is made of: play, elasticity and dynamics, joint by joint.
    """
    of_robot = {"base": base, "mimic": mimic, "inertia": inertia, "density": density}
    scene = common.read_scene(scene_file, **of_robot)
    of_budget = {"point": point, "trajectory": trajectory, "t1": t1, "plot": plot}
    if budget:
        if ideal:
            raise ClearanceError("`--budget` is about play, which `--ideal` takes away. Leave one of them out.")
        if point is not None and is_robot(scene_file):
            scene = _with_point(scene, scene_file, point, of_robot)
        return say_budget(scene, scene_file, settings, clearance, **of_budget)
    for option, value in of_budget.items():
        if value is not None:
            raise ClearanceError(f"`--{option}` is about the error budget. Add `--budget`, or leave it out.")
    mechanism = common.change(scene.mechanism, settings, ideal, clearance)
    _print_terms(mechanism)
    for line in _modes_words(mechanism):
        common.console.print(line, highlight=False)
    loops = ", the body of each loop once" if mechanism.form.is_table else ""
    operations = _operations(mechanism)
    answer.update({"mechanism": mechanism.name, "operations": operations, "parameters": _values(mechanism)})
    counted = f"{operations} operations (compiler's count{loops})"
    common.console.print(f"one evaluation of the vector field: {counted}")
    for table in (_limits(mechanism), _parameters(mechanism)):
        if table.row_count:
            common.console.print(table)
    return None


def _print_terms(mechanism) -> None:
    from clearance_jax.mechanism.state import layout

    plan = layout(mechanism)
    common.console.print(f"[bold]{escape(mechanism.name)}[/bold]")
    for note in mechanism.notes:
        common.console.print(escape(note), highlight=False, soft_wrap=True)
    memory = f"; {plan.remembered} memory variables" if plan.remembered else ""
    moving = ", ".join(plan.positions) or "nothing"
    answer["states"] = plan.size
    common.console.print(f"states: {plan.size} (positions and speeds of {moving}{memory})")
    for joint in mechanism.clearance_joints():
        clearance = joint.clearance
        friction = "no friction" if clearance.friction is None else type(clearance.friction).__name__
        common.console.print(
            f"clearance joint {joint.name}: {type(clearance.normal).__name__} "
            f"(class {clearance.normal.smoothness}), {friction}{_made_words(clearance)}{_worn_words(clearance)}"
        )
    for coupling in mechanism.couplings:
        terms = " + ".join(f"{float(ratio):g} {leader}" for leader, ratio in coupling.terms)
        added = f" + {float(coupling.offset):g}" if float(coupling.offset) else ""
        common.console.print(f"coupling {coupling.name}: {coupling.follower} = {terms}{added}", highlight=False)
    for gap in mechanism.gaps:
        common.console.print(f"{gap.name}: {_gap_words(gap)}", highlight=False)
    for line in _acting_words(mechanism):
        common.console.print(line, highlight=False)
    common.console.print(f"equations of motion: {mechanism.form}", highlight=False)
    common.console.print(f"ideal loop closures: {', '.join(j.name for j in mechanism.closures()) or 'none'}")
    if mechanism.closures():
        from clearance_jax.dynamics.closures import mobility

        common.console.print(f"free to move: {mobility(mechanism)}")


def _gap_words(gap) -> str:
    """What a gap of a coordinate is, and its law."""
    if gap.what == "friction":
        return f"friction, {type(gap.clearance.friction).__name__}"
    half, offset, sides = float(gap.size), float(gap.offset or 0.0), gap.clearance.sides
    size = _angle if gap.turns else lambda width: format_quantity(width, "m")
    ends = {"both": (offset - half, offset + half)}.get(sides, (offset,))
    lossy = "" if gap.loss is None else f"efficiency {float(gap.loss.efficiency):g}, "
    if gap.what == "elasticity":
        wave = "" if gap.wave is None else f"transmission error of at most {size(float(gap.wave.error))}, "
        return f"{wave}{lossy}{type(gap.clearance.normal).__name__}"
    words = f"backlash {size(2 * half)}" if gap.is_play else f"stops at {' and '.join(map(size, ends))}"
    law = gap.clearance.normal
    return f"{words}, {lossy}{type(law).__name__} (class {law.smoothness})"


def _angle(width: float) -> str:
    """An angle in words: a small one in minutes of arc too."""
    from clearance_jax.joints.gears import ARC_MINUTE

    minutes = width / ARC_MINUTE
    return f"{width:.4g} rad" + (f" ({minutes:.3g} arcmin)" if 0 < minutes < 600 else "")


def _made_words(clearance) -> str:
    """The range of a clearance as made, if it comes from a fit or a bearing."""
    tolerance = getattr(clearance, "tolerance", None)
    if tolerance is None:
        return ""
    least, greatest = (float(bound) for bound in (tolerance.least, tolerance.greatest))
    tight = "; the tightest of them have no play" if least < 0 else ""
    return f", radial clearance as made {format_quantity(least, 'm')} to {format_quantity(greatest, 'm')}{tight}"


def _worn_words(clearance) -> str:
    import numpy as np

    depth = getattr(clearance, "depth", None)
    if depth is None:
        return ""
    deepest, mean = (format_quantity(float(value), "m") for value in (np.max(depth), np.mean(depth)))
    return f", worn off by {deepest} at most, {mean} in the mean over {np.size(depth)} sectors"


def _acting_words(mechanism) -> Iterator[str]:
    from clearance_jax.mechanism.state import effort_sources

    for source in effort_sources(mechanism):
        sampled = "" if source.period is None else f", sampled every {source.period:g} s"
        yield f"{type(source.part).__name__} on {', '.join(source.coordinates)}{sampled}"
    for wrench in mechanism.wrenches:
        yield f"load {wrench.name} on {wrench.body}"
    for body in mechanism.bodies:
        if not body.is_always_there:
            times = {"picked up": body.picked_up, "put down": body.put_down}
            words = (f"{word} at {float(time):g} s" for word, time in times.items() if time is not None)
            yield f"payload {body.name}, {', '.join(words)}"


def _modes_words(mechanism) -> Iterator[str]:
    """Lines about the modes of the play about the settled pose at t = 0, the lowest frequency first."""
    from clearance_jax.analysis.modes import WEAKLY_DAMPED, seated_modes

    if not mechanism.clearance_joints():
        return
    try:
        modes = seated_modes(mechanism)
    except ClearanceError as error:
        yield f"modes of the play about its settled pose: none, for it cannot be settled ({escape(str(error))})"
        return
    sizes = ({"frequency": quantity(mode.frequency, "Hz"), "damping_ratio": float(mode.ratio)} for mode in modes)
    answer["modes"] = list(sizes)
    listed = ", ".join(f"{mode.frequency:.4g} Hz (damping ratio {mode.ratio:.2g})" for mode in modes[:MODES])
    more = f", and {len(modes) - MODES} faster ones" if len(modes) > MODES else ""
    yield f"modes of the play about its settled pose: {listed}{more}"
    weak = sum(mode.ratio < WEAKLY_DAMPED for mode in modes[:MODES])
    if weak:
        yield (
            f"warning: {weak} of these with a damping ratio below {100 * WEAKLY_DAMPED:g} % (they ring for long, or "
            "grow where it is negative), which no real joint does. Give the joints an `element` (a damper, a preloaded "
            "bearing), friction, or a normal law with more damping."
        )


def _limits(mechanism) -> Table:
    table = Table("coordinate", "least", "greatest", "fastest", "strongest")
    for coordinate in mechanism.coordinates():
        limits = coordinate.motion.limits
        if limits is None:
            continue
        unit, effort = ("rad", "N m") if coordinate.slides is None else ("m", "N")
        units = (unit, unit, f"{unit}/s", effort)
        shown = ["" if value is None else f"{value:.6g} {u}" for value, u in zip(limits, units, strict=True)]
        table.add_row(escape(coordinate.name), *shown)
    return table


def _operations(mechanism) -> int:
    """The number of operations of one evaluation of the vector field, as the compiler counts them."""
    import jax
    import jax.numpy as jnp

    from clearance_jax._compile.once import compute_once
    from clearance_jax.dynamics.field import slope
    from clearance_jax.mechanism.state import layout

    state = jnp.zeros(layout(mechanism).size)
    program = jax.jit(compute_once(slope))
    cost: Any = program.lower(jnp.zeros(()), state, mechanism.prepare()).compile().cost_analysis()
    return int(cost.get("flops", 0))


def _values(mechanism) -> dict[str, Any]:
    from clearance_jax.parameters import parameters

    return {name: {"value": leaf.value, "unit": leaf.unit} for name, leaf in parameters(mechanism).items()}


def _parameters(mechanism) -> Table:
    import numpy as np

    from clearance_jax.parameters import parameters

    table = Table("parameter", "value", "unit")
    for name, leaf in parameters(mechanism).items():
        value = np.asarray(leaf.value)
        shown = f"{value:.9g}" if value.ndim == 0 else f"[{', '.join(f'{x:.9g}' for x in value.ravel())}]"
        if value.size > LISTED:
            shown = f"{value.size} numbers from {value.min():.9g} to {value.max():.9g}"
        table.add_row(name, escape(shown), leaf.unit)
    return table


def say_budget(
    scene: Any, scene_file: Path, settings: Any, clearance: Any, *, trajectory: Any, t1: Any, point: Any, plot: Any
) -> None:
    """Print the error budget of a point of a scene or a robot, and draw it if `plot` is given."""
    common.check_distinct(scene=scene_file, trajectory=trajectory, plot=plot)
    common.check_writable(plot, common.FIGURES)
    driven, lead, idle = driven_by(scene, scene_file, trajectory)
    mechanism = common.change(driven, settings, False, clearance)
    name = _point(mechanism, point)
    options = usual_end(lead, idle) | scene.solve
    end = float(end_of(scene_file, options.get("t1") if t1 is None else t1))
    check_covered(lead, {**options, "t1": end})
    say_held(idle, lead is None, end if lead is None and t1 is None else None, driven)
    from clearance_jax.design.asked.specification import KNOWN
    from clearance_jax.design.judge.budget import error_budget

    with common.errors.status("compiling and solving (of an arm this takes about a minute)"):
        budget = error_budget(mechanism, name, end, **{n: options[n] for n in KNOWN if n in options})
    for kind in ("peaks", "shares"):
        answer[kind] = {part: quantity(value, "m") for part, value in getattr(budget, kind).items()}
    common.say(str(budget))
    if plot is not None:
        from clearance_jax.report.design_figures import budget_figure

        common.write_figure(budget_figure(budget), plot)


def _with_point(scene: Any, robot: Path, link: str, options: dict[str, Any]) -> Any:
    names = [point.name for point in scene.mechanism.points]
    return scene if link in names else common.read_scene(robot, **options, end_effector=link)


def _point(mechanism: Any, asked: str | None) -> str:
    """The name of the point of a budget: the one that is asked for, or the only one."""
    names = [point.name for point in mechanism.points]
    if asked is not None and asked not in names:
        raise unknown_name(f"`--point`: there is no point `{asked}`.", asked, names, "--point")
    if asked is None and len(names) != 1:
        about = "one point" if names else "the error of a point"
        count = f"{len(names)} ({', '.join(names)})" if names else "none"
        fix = "Say which one by `--point NAME`." if names else "Give the scene a `point`."
        raise ClearanceError(f"A budget is about {about}, but the mechanism has {count}. {fix}")
    return names[0] if asked is None else asked
