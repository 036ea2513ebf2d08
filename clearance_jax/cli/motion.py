"""The drives of a scene or a robot: its own, those of a trajectory, or none, which holds its posture."""

from pathlib import Path
from typing import Any

from clearance_jax.cli.common import note
from clearance_jax.errors import ClearanceError
from clearance_jax.units import to_si

# Default duration of a held posture [s]: long enough for pins to come to rest at their walls.
HELD = 0.1


def is_robot(scene_file: Any) -> bool:
    """Whether a file is a robot (URDF, MJCF), not a scene."""
    return scene_file.suffix.lower() in (".urdf", ".xacro", ".xml")


def undriven(mechanism: Any) -> tuple[str, ...]:
    """The revolute and prismatic coordinates without drive and controller, which would fall."""
    from clearance_jax.mechanism.tree.tree import Prismatic, Revolute

    return tuple(name for joint, name in _idle(mechanism) if type(joint) in (Revolute, Prismatic))


def _idle(mechanism: Any, fixed: tuple[str, ...] = ()) -> list[tuple[Any, str]]:
    """Every joint with the name of a coordinate that is neither driven nor controlled nor `fixed`, and follows none."""
    moved = {*fixed, *(reference.name for controller in mechanism.controllers for reference in controller.references)}
    moved |= {coupling.follower for coupling in mechanism.firm_couplings}
    every = [(joint, coordinate) for joint in mechanism.joints for coordinate in joint.own_coordinates()]
    free = [(joint, c.name) for joint, c in every if c.play is None and c.motion.is_free]
    return [(joint, name) for joint, name in free if name not in moved]


def say_held(names: tuple[str, ...], every: bool, seconds: float | None, mechanism: Any) -> None:
    """Print which joints are held, for how long, which cannot be held, and how to drive them instead."""
    if not names:
        return
    # Floating and planar joints have coordinates that are not held.
    loose = dict.fromkeys(joint.name for joint, _ in _idle(mechanism, names))
    which = "No joint of this robot is driven" if every else f"Nothing drives {', '.join(names)}"
    what = "what is not driven" if loose or not every else "each"
    moving = f". {', '.join(loose)} cannot be held: what hangs on it moves freely, and falls" if loose else ""
    until = "" if seconds is None else f", for {seconds:g} s (`--t1` for another time)"
    note(
        f"{which}: {what} is held where it stands{until}{moving}. Drive joints by `--trajectory FILE` (a CSV table of "
        "times and joint values), or by a scene with a table `[robot]`."
    )


def driven_by(scene: Any, scene_file: Path, trajectory: Path | None) -> tuple[Any, Any, tuple[str, ...]]:
    """The driven mechanism, its trajectory (`None`: none), and a robot's coordinates that nothing drives: held."""
    from clearance_jax.io.trajectory import Trajectory, read_trajectory
    from clearance_jax.mechanism.motion.drives import Constant
    from clearance_jax.mechanism.variants import drivable

    lead, driven = scene.trajectory, scene.mechanism
    if trajectory is not None:
        lead = Trajectory(trajectory, read_trajectory(trajectory, driven))
    if lead is not None:
        driven = driven.with_drives(lead.drives)
    idle = undriven(driven) if is_robot(scene_file) else ()
    if idle:
        known = drivable(driven.joints)
        driven = driven.with_drives({name: Constant(known[name].motion.position) for name in idle})
    return driven, lead, idle


def usual_end(lead: Any, idle: tuple[str, ...]) -> dict[str, float]:
    """The default end of a motion [s], as `{"t1": ...}`; empty if there is none."""
    return {"t1": lead.span[1]} if lead is not None else {"t1": HELD} if idle else {}


def end_of(scene_file: Path, t1: Any) -> Any:
    """The end of a motion [s], from a number or a text with a unit. **Raises** `ClearanceError` if it is `None`."""
    if t1 is None:
        raise ClearanceError(f"{scene_file}: the table `solve` has no `t1`. Add one, or give `--t1 1s`.")
    return to_si(t1, "s", "`--t1`") if isinstance(t1, str) else t1


def check_covered(lead: Any, options: dict[str, Any]) -> None:
    """Raise `ClearanceError` if the motion begins before the trajectory or ends after it (beyond round-off)."""
    if lead is None:
        return
    (first, last), t0, t1 = lead.span, options.get("t0", 0.0), options["t1"]
    hair, outside = 1e-9 * (last - first), ""
    if t0 < first - hair:
        outside = f"t0 is {t0:.9g} s, but the trajectory `{lead.path}` begins at {first:.9g} s"
    elif t1 > last + hair:
        outside = f"t1 is {t1:.9g} s, but the trajectory `{lead.path}` ends at {last:.9g} s"
    if outside:
        raise ClearanceError(f"{outside}. Change the one or the other.")
