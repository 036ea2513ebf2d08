"""Defaults for a robot from a URDF file, which has no drives and no end time: joints are held in their posture."""

from typing import Any

from clearance_jax.cli.common import say

# Default duration of a held posture [s]: long enough for pins to come to rest at their walls.
HELD = 0.1


def is_robot(scene_file: Any) -> bool:
    """Whether a file is a robot (URDF), not a scene."""
    return scene_file.suffix.lower() == ".urdf"


def with_posture(mechanism: Any, names: Any) -> Any:
    """The mechanism with constant drives that hold the named coordinates at their positions."""
    from clearance_jax.mechanism.drives import Constant
    from clearance_jax.mechanism.variants import drivable

    known = drivable(mechanism.joints)
    return mechanism.with_drives({name: Constant(known[name].motion.position) for name in names})


def undriven(mechanism: Any) -> tuple[str, ...]:
    """The revolute and prismatic coordinates without drive and controller, which would fall."""
    from clearance_jax.mechanism.tree import Prismatic, Revolute

    return tuple(name for joint, name in _idle(mechanism) if type(joint) in (Revolute, Prismatic))


def _idle(mechanism: Any, fixed: tuple[str, ...] = ()) -> list[tuple[Any, str]]:
    """Every joint with the name of a coordinate that is neither driven nor controlled nor `fixed`."""
    moved = {*fixed, *(reference.name for controller in mechanism.controllers for reference in controller.references)}
    return [
        (joint, coordinate.name)
        for joint in mechanism.joints
        for coordinate in joint.own_coordinates()
        if coordinate.play is None and coordinate.motion.is_free and coordinate.name not in moved
    ]


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
    say(
        f"{which}: {what} is held where it stands{until}{moving}. Drive joints by `--trajectory FILE` (a CSV table of "
        "times and joint values), or by a scene with a table `[robot]`."
    )
