"""`clearance check`: reads and validates a file without computing anything, and says what it is and what it assumes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer import Argument

from clearance_jax.cli import common
from clearance_jax.cli.answer import answer
from clearance_jax.cli.motion import is_robot, undriven
from clearance_jax.units import format_quantity

# What a scene, or a study, may leave out of how it is solved.
ASSUMED = ("rtol", "solver", "start")
SECTIONS = ("sweep", "design", "wear", "calibrate")


def check(
    file: Path = Argument(..., metavar="FILE", help="A scene, a study (TOML with units), or a robot (URDF, MJCF)."),
    base: str | None = common.BASE,
    mimic: str | None = common.MIMIC,
    inertia: str | None = common.INERTIA,
    density: str | None = common.DENSITY,
) -> None:
    """Read and validate a scene, a study or a robot, without computing anything. It says what it is, and what it
    leaves to the defaults. The exit code is 0 for a valid file, 2 for another one.
    """
    common.check_there(file, "file")
    common.set_up()
    kind, lines, assumed = _read(file, {"base": base, "mimic": mimic, "inertia": inertia, "density": density})
    answer.update({"kind": kind, "file": str(file), "assumed": assumed})
    common.say(f"{file}: a valid {kind}")
    for line in lines:
        common.say(f"  {line}")
    for name, value in assumed.items():
        common.say(f"  assumed: {name} = {value}")


def _read(file: Path, robot: dict[str, Any]) -> tuple[str, list[str], dict[str, Any]]:
    """What kind of file it is, lines about it, and what it leaves to the defaults."""
    from clearance_jax.io.files import read_toml
    from clearance_jax.io.scene.scene import implausible
    from clearance_jax.io.study.study import load_study
    from clearance_jax.joints.checks import ImplausibleWarning
    from clearance_jax.solve.settings import Settings

    if not is_robot(file) and "scene" in read_toml(file, "file")[1]:
        with common.aloud(ImplausibleWarning):
            study = load_study(file)
        return "study", [*_asked(study), *_parts(study.mechanism)], {}
    scene = common.read_scene(file, **robot)
    common.warn(implausible(scene.mechanism))
    kind, lines = ("robot" if is_robot(file) else "scene"), list(_parts(scene.mechanism))
    if idle := undriven(scene.mechanism) if is_robot(file) else ():
        lines.append(f"nothing drives {', '.join(idle)}: `simulate` holds them where they stand")
    t1 = scene.solve.get("t1")
    lines.append("no end of the motion: give `--t1`" if t1 is None else f"solved to t1 = {t1:g} s")
    usual = Settings()
    return kind, lines, {name: getattr(usual, name) for name in ASSUMED if name not in scene.solve}


def _asked(study: Any) -> Iterator[str]:
    asked = {name: getattr(study, name) for name in SECTIONS if getattr(study, name) is not None}
    answer.update({"name": study.name, "sections": list(asked)})
    yield f"{study.name}: {', '.join(asked)}"
    if study.design is not None:
        wanted = study.design.problem.specification
        for name, ends in wanted.variables.items():
            least, greatest = (format_quantity(float(end), wanted.units[name]) for end in ends)
            yield f"variable {name}: {least} to {greatest}"
        for limit in wanted.limits:
            yield f"limit: {limit.title}"
    if study.sweep is not None:
        yield f"axes: {', '.join(study.sweep['axes'])}; outputs: {', '.join(study.sweep['outputs'])}"
    if study.calibrate is not None:
        yield f"looks for {', '.join(study.calibrate['parameters'])}"


def _parts(mechanism: Any) -> Iterator[str]:
    """Lines about the parts of a mechanism."""
    parts = {"bodies": mechanism.bodies, "joints": (*mechanism.joints, *mechanism.loops), "points": mechanism.points}
    names = {kind: [part.name for part in several] for kind, several in parts.items()}
    loose = [joint.name for joint in mechanism.clearance_joints()] + [gap.name for gap in mechanism.gaps if gap.is_play]
    answer["mechanism"] = {"name": mechanism.name, "plane": mechanism.is_plane, **names, "with_play": loose}
    yield f"{mechanism.name}, a mechanism {'in the plane' if mechanism.is_plane else 'in space'}"
    for kind, several in names.items():
        yield f"{kind}: {', '.join(several) or 'none'}"
    yield f"with play: {', '.join(loose)}" if loose else "nothing has play"
    yield from (str(note) for note in mechanism.notes)
