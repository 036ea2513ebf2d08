"""A robot by itself: a URDF file says nothing of how its joints are driven, nor until when it is to be simulated."""

from typing import Any

from clearance_jax.cli.common import say

# For so long a posture is held [s]: pins fall to their walls and come to rest there.
HELD = 0.1


def is_robot(scene_file: Any) -> bool:
    """Whether a file is a robot by itself, and no scene."""
    return scene_file.suffix.lower() == ".urdf"


def with_posture(mechanism: Any, names: Any) -> Any:
    """The mechanism with constant drives of those coordinates, which hold them where they stand."""
    from clearance_jax.mechanism.driving import drivable
    from clearance_jax.mechanism.profiles import Constant

    known = drivable(mechanism.joints)
    return mechanism.with_drives({name: Constant(known[name].motion.position) for name in names})


def undriven(mechanism: Any) -> tuple[str, ...]:
    """The joints of one coordinate that neither a drive nor a controller moves: they would fall."""
    from clearance_jax.mechanism.tree import Prismatic, Revolute

    commanded = {reference.name for controller in mechanism.controllers for reference in controller.references}
    return tuple(
        coordinate.name
        for joint in mechanism.joints
        if type(joint) in (Revolute, Prismatic)
        for coordinate in joint.own_coordinates()
        if coordinate.play is None and coordinate.motion.is_free and coordinate.name not in commanded
    )


def say_held(names: tuple[str, ...], every: bool, seconds: float | None, mechanism: Any) -> None:
    """Print that joints are held, for how long where nobody said that, what is not, and how they are driven instead."""
    if not names:
        return
    loose = _loose(mechanism, names)
    which = "No joint of this robot is driven" if every else f"Nothing drives {', '.join(names)}"
    what = "what is not driven" if loose or not every else "each"
    moving = f". {', '.join(loose)} cannot be held: what hangs on it moves freely, and falls" if loose else ""
    until = "" if seconds is None else f", for {seconds:g} s (`--t1` for another time)"
    say(
        f"{which}: {what} is held where it stands{until}{moving}. Drive joints by `--trajectory FILE` (a CSV table of "
        "times and joint values), or by a scene with a table `[robot]`."
    )


def _loose(mechanism: Any, fixed: tuple[str, ...]) -> tuple[str, ...]:
    """The joints of a robot of which no drive or controller moves some coordinate, and that are not held: floating and
    planar ones.
    """
    commanded = {reference.name for controller in mechanism.controllers for reference in controller.references}
    return tuple(
        joint.name
        for joint in mechanism.joints
        if any(
            coordinate.play is None and coordinate.motion.is_free and coordinate.name not in {*commanded, *fixed}
            for coordinate in joint.own_coordinates()
        )
    )
