"""Reads URDF files as mechanisms of robots."""

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, naming, quote, suggest
from clearance_jax.io.urdf.bodies import Assembly, Rigid, check_bodies, merge
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.robot import NOWHERE, FramePose, Joint, Robot, Triple, is_identity, rpy_of, triple
from clearance_jax.mechanism.actuators import AbstractActuator, JointFriction, JointSpring
from clearance_jax.mechanism.body import GROUND, Body, Limits, Motion, Point
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import ORIGIN, Gravity, Inertia, Orientation, Position, as_axis
from clearance_jax.mechanism.tree.compounds import Ball, Free, Planar
from clearance_jax.mechanism.tree.tree import AbstractJoint, Prismatic, Revolute

BASES = ("fixed", "free")
MIMICS = ("refuse", "independent")
EARTH = (0.0, 0.0, -9.81)


def load_urdf(
    path: str | Path,
    *,
    base: str = "fixed",
    gravity: Any = EARTH,
    end_effector: str | Sequence[str] | None = None,
    mimic: str = "refuse",
) -> Mechanism:
    """The mechanism of a robot's URDF file.

    Links that are fixed to one another become one body, with the name of the first of them. Joints keep their names and
    limits (`Motion.limits`, which do not bound the motion), and their springs, damping and friction as actuators (for a
    planar or floating joint along each of its motions, in N s/m along and N m s/rad about). The rotors of motors become
    `Motion.rotor_inertia`. A coordinate starts at zero, or in the middle of its limits if zero is outside of them.

    **Arguments:**

    - `path`: of the file.
    - `base`: "fixed": the root link is the ground. "free": it moves freely, by a joint `floating_base`.
    - `gravity` [m/s^2], three numbers: along the axes of the root link as it is at the start.
    - `end_effector`: a link, or several, whose frames become points of the mechanism, under the name of the link (if a
      body has this name, `NAME_frame`). By default every link at the end of a limb.
    - `mimic`: "refuse": a file with joints that follow another one is refused. "independent": each of them moves by
      itself.

    **Raises:** `ClearanceError` naming the file, the line, the element and the fix, for whatever is wrong or missing.

    **Warns:** `NotReadWarning` of what in the file may be physics and was not read. The mechanism's `notes` say it too.
    """
    mechanism = read_robot(path, base=base, gravity=gravity, end_effector=end_effector, mimic=mimic)[1]
    warn_of_notes(path, mechanism)
    return mechanism


class NotReadWarning(UserWarning):
    """A file holds what may be physics, and what was not read."""


def warn_of_notes(path: str | Path, mechanism: Mechanism) -> None:
    """Warn of what was not read in a mechanism's file."""
    if mechanism.notes:
        warnings.warn(f"{path}: {'; '.join(mechanism.notes)}", NotReadWarning, stacklevel=3)


def read_robot(
    path: str | Path, base: str = "fixed", gravity: Any = EARTH, end_effector: Any = None, mimic: str = "refuse"
) -> tuple[str, Mechanism]:
    """As `load_urdf`, with the file's text."""
    _check_word("base", base, BASES)
    _check_word("mimic", mimic, MIMICS)
    field = _gravity(gravity)
    text, robot = read_urdf(path)
    with naming(f"`{path}`"), jax.ensure_compile_time_eval():
        # Numbers stay numbers where a robot is loaded inside a jitted function.
        if mimic == "refuse":
            _check_no_mimic(robot)
        return text, _mechanism(robot, base == "free", field, _frames_asked(robot, end_effector))


def _check_word(name: str, value: Any, allowed: Sequence[str]) -> None:
    if not isinstance(value, str) or value not in allowed:
        word = value if isinstance(value, str) else ""
        raise ClearanceError(
            f"`{name}` must be one of the allowed words, but it is {quote(value)}. {suggest(word, allowed)}"
        )


def _gravity(value: Any) -> Gravity:
    try:
        numbers = [float(component) for component in value]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not np.all(np.isfinite(numbers)):
        raise ClearanceError(f"`gravity` must be three finite numbers in m/s^2, but it is {quote(value)}.")
    return Gravity(*(None if component == 0 else component for component in numbers))


def _check_no_mimic(robot: Robot) -> None:
    for joint in robot.joints:
        if joint.mimic is not None:
            raise ClearanceError(
                f"line {joint.line}: joint `{joint.name}` follows `{joint.mimic.joint}` (<mimic>), and such joints are "
                "not made yet. Load the robot with `mimic='independent'`, so that each moves by itself, or fix the "
                "joint."
            )


def _frames_asked(robot: Robot, end_effector: Any) -> list[str] | None:
    """The links whose frames become points; `None`: not given."""
    if end_effector is None:
        return None
    asked = [end_effector] if isinstance(end_effector, str) else end_effector
    known = {link.name for link in robot.links}
    for name in asked:
        if not isinstance(name, str) or name not in known:
            word = name if isinstance(name, str) else ""
            raise ClearanceError(
                f"`end_effector` must name links, but there is no link {quote(name)}. {suggest(word, known)}"
            )
    return list(dict.fromkeys(asked))


def _mechanism(robot: Robot, free: bool, gravity: Gravity, asked: list[str] | None) -> Mechanism:
    whole = merge(robot)
    joints = (_free_joint(whole), *whole.joints) if free else whole.joints
    _check_base(whole, free)
    moving = {joint.child: whole.bodies[joint.child] for joint in joints}
    check_bodies(joints, moving)
    names = UniqueNames()
    bodies = {GROUND: GROUND, **names.of(moving, "link")}
    if not free:
        bodies[whole.root] = GROUND
    named = names.of((joint.name for joint in joints), "joint")
    links = _ends(robot, whole, free) if asked is None else asked
    points = names.of(links, "frame")
    return Mechanism(
        tuple(_body(body, bodies[name]) for name, body in moving.items()),
        tuple(joint_of(joint, named[joint.name], bodies[joint.parent], bodies[joint.child]) for joint in joints),
        points=tuple(_point(whole, link, points[link], bodies) for link in links),
        gravity=gravity,
        name=robot.name,
        notes=(f"not read: {', '.join(robot.unread)}",) if robot.unread else (),
    )


def _check_base(whole: Assembly, free: bool) -> None:
    root = whole.bodies[whole.root]
    if not (free or whole.joints):
        raise ClearanceError("nothing of the robot moves: every joint is fixed. Load it with `base='free'`.")
    if free and not root.mass > 0:
        raise ClearanceError(
            f"line {root.line}: the root link `{root.name}` has no mass, so it cannot be a free base. Give it an "
            "<inertial>, or load the robot with `base='fixed'` (a link of it may hang on a floating joint)."
        )


def _free_joint(whole: Assembly) -> Joint:
    """The joint of a free base."""
    line = whole.bodies[whole.root].line
    name = "floating_base"
    while any(joint.name == name for joint in whole.joints):
        name += "_"
    return Joint(name, "floating", GROUND, whole.root, NOWHERE, NOWHERE, (0.0, 0.0, 1.0), None, None, 0.0, 0.0, line)


def _body(body: Rigid, name: str) -> Body:
    if body.mass == 0:
        return Body(name)
    (xx, xy, xz), (_, yy, yz), (*_, zz) = body.inertia.tolist()
    products = (None if product == 0 else product for product in (xy, xz, yz))
    return Body(name, body.mass, Inertia(xx, yy, zz, *products), position_of(triple(body.center)))


def _ends(robot: Robot, whole: Assembly, free: bool) -> list[str]:
    """The links at the ends of limbs: neither the link nor its body carries a joint, and the body moves."""
    carrying = {joint.parent for joint in robot.joints}
    inner = {joint.parent for joint in whole.joints} | (set() if free else {whole.root})
    return [
        link.name for link in robot.links if link.name not in carrying and whole.frames[link.name].body not in inner
    ]


def _point(whole: Assembly, link: str, name: str, bodies: dict[str, str]) -> Point:
    body, pose = whole.frames[link]
    return Point(name, bodies[body], *place_of(pose))


def joint_of(joint: Joint, name: str, parent: str, child: str) -> AbstractJoint:
    """The joint of a mechanism between two bodies, with the names that it and they have there."""
    ends = {"name": name, "parent": parent, "child": child}
    ends |= {"at_parent": position_of(joint.xyz), "orientation": orientation_of(joint.rpy)}
    if joint.kind == "floating":
        damping = joint.damping if joint.damping > 0 else None
        slides = {f"slide_{letter}": Motion(actuators=_losses(joint)) for letter in "xyz"}
        return Free(**ends, **slides, motion=Ball(damping=damping))
    if joint.kind == "planar":
        motions = {name: Motion(actuators=_losses(joint)) for name in ("slide_x", "slide_y", "turn")}
        return Planar(**ends, **motions, axis=as_axis(joint.axis))
    kind = Prismatic if joint.kind == "prismatic" else Revolute
    return kind(**ends, axis=as_axis(joint.axis), motion=_motion(joint))


def _motion(joint: Joint) -> Motion:
    rotor = joint.rotor if joint.rotor > 0 else None
    start = _start(joint.limits or Limits())
    return Motion(position=start, actuators=_losses(joint), limits=joint.limits, rotor_inertia=rotor)


def _losses(joint: Joint) -> tuple[AbstractActuator, ...]:
    """Actuators for its spring, damping and friction, along each coordinate of the joint."""
    spring = JointSpring(joint.stiffness, joint.damping, joint.rest)
    damper = (spring,) if joint.damping > 0 or joint.stiffness > 0 else ()
    return (*damper, JointFriction(joint.friction)) if joint.friction > 0 else damper


def _start(limits: Limits) -> float:
    """The initial coordinate: 0 if it is within the limits, else their middle, or the only one."""
    lower = -float("inf") if limits.lower is None else limits.lower
    upper = float("inf") if limits.upper is None else limits.upper
    if lower <= 0.0 <= upper:
        return 0.0
    ends = [end for end in (limits.lower, limits.upper) if end is not None]
    return sum(ends) / len(ends)


def place_of(pose: FramePose) -> tuple[Position, Orientation | None]:
    """Position and orientation of a frame."""
    rpy = NOWHERE if is_identity(pose.rotation) else triple(rpy_of(pose.rotation))
    return position_of(triple(pose.position)), orientation_of(rpy)


def position_of(xyz: Triple) -> Position:
    """A position [m]; zero components become `None`."""
    return ORIGIN if xyz == NOWHERE else Position(*_present(xyz))


def orientation_of(rpy: Triple) -> Orientation | None:
    """An orientation [rad]; zero angles become `None`, as does a zero rotation."""
    return None if rpy == NOWHERE else Orientation(*_present(rpy))


def _present(numbers: Triple) -> list[float | None]:
    return [None if number == 0 else number for number in numbers]


class UniqueNames:
    """Gives every part a unique name: that in the file if possible. (Links and joints may share names there.)

    `.` and `=` become `_`. If two parts have the same name, the kind of the later one is appended to its name.
    """

    def __init__(self):
        self.taken = {GROUND, "gravity", "drive", "target"}

    def of(self, written: Iterable[str], what: str) -> dict[str, str]:
        """Unique names by the names in the file; `what`: the kind of these parts in one word."""
        return {name: self._unique(name, what) for name in written}

    def _unique(self, name: str, what: str) -> str:
        wanted = name.replace(".", "_").replace("=", "_")
        unique, count = wanted, 1
        while unique in self.taken:
            unique = f"{wanted}_{what}" if count == 1 else f"{wanted}_{what}_{count}"
            count += 1
        self.taken.add(unique)
        return unique
