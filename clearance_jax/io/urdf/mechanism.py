"""Reads URDF files as mechanisms of robots."""

import functools
import itertools
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, naming, quote, unknown_name, wrong_value
from clearance_jax.io.keys.kinds import Word
from clearance_jax.io.urdf.bodies import ROUNDED, SMALLEST, Assembly, check_bodies, merge
from clearance_jax.io.urdf.file import read_urdf
from clearance_jax.io.urdf.inertia import WATER, Weighing
from clearance_jax.io.urdf.robot import NOWHERE, FramePose, Joint, Link, Robot, Triple, is_identity, rpy_of, triple
from clearance_jax.io.urdf.text import told
from clearance_jax.mechanism.actuators import AbstractActuator, JointFriction, JointSpring
from clearance_jax.mechanism.body import GROUND, Body, Limits, Motion, Point
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.drives import Constant
from clearance_jax.mechanism.placement import ORIGIN, Gravity, Inertia, Orientation, Position, as_axis
from clearance_jax.mechanism.tree.compounds import Ball, Free, Planar
from clearance_jax.mechanism.tree.tree import AbstractJoint, Prismatic, Revolute

BASES = ("fixed", "free")
MIMICS = ("follow", "independent")
INERTIAS = ("refuse", "balance", "from-geometry")
# How a message writes an option of the robot: where Python, a scene or a command gave it.
IN_PYTHON, IN_SCENE, IN_COMMAND = "`{}='{}'`", '`robot.{} = "{}"`', "`--{} {}`"
EARTH = (0.0, 0.0, -9.81)


def load_urdf(
    path: str | Path,
    *,
    base: str = "fixed",
    gravity: Any = EARTH,
    end_effector: str | Sequence[str] | None = None,
    mimic: str = "follow",
    inertia: str = "refuse",
    density: float | None = None,
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
    - `mimic`: "follow": a joint with `<mimic>` follows the other one, by a coupling `NAME_mimic`. "independent": it
      moves by itself.
    - `inertia`: what becomes of links whose inertia no body has, and of bodies without mass. "refuse": the file is
      refused (a body without mass only if a joint moves nothing else). "balance": each moment of inertia of such a link
      becomes their mean. "from-geometry": a link with mass takes the inertia of its shapes, scaled to its mass; a body
      without mass takes mass and inertia of the shapes of its links. Shapes are those for collisions, else for the eye;
      each is solid, and where two overlap both count. Meshes need the extra `meshes`.
    - `density` [kg/m^3]: of the shapes of a body without mass, by default 1000.

    **Raises:** `ClearanceError` naming the file, the line, the element and the fix, for whatever is wrong or missing.

    **Warns:** `NotReadWarning` of what in the file may be physics and was not read, and of what was assumed. The
    mechanism's `notes` say it too.
    """
    options = {"base": base, "gravity": gravity, "end_effector": end_effector, "mimic": mimic}
    mechanism = read_robot(path, **options, inertia=inertia, density=density)[1]
    warn_of_notes(path, mechanism)
    return mechanism


class NotReadWarning(UserWarning):
    """A robot's file holds what may be physics and was not read, or what was read by an assumption."""


def warn_of_notes(path: str | Path, mechanism: Mechanism) -> None:
    """Warn of what was not read in a mechanism's file, and of what was assumed."""
    if mechanism.notes:
        warnings.warn(f"{path}: {'; '.join(mechanism.notes)}", NotReadWarning, stacklevel=3)


def read_robot(
    path: str | Path,
    base: str = "fixed",
    gravity: Any = EARTH,
    end_effector: Any = None,
    mimic: str = "follow",
    inertia: str = "refuse",
    density: float | None = None,
    written: str = IN_PYTHON,
) -> tuple[str, Mechanism]:
    """As `load_urdf`, with the file's text; `written`: how messages write an option."""
    for name, word, allowed in (("base", base, BASES), ("mimic", mimic, MIMICS), ("inertia", inertia, INERTIAS)):
        Word("", "", allowed=allowed).read(word, f"`{name}`", {})
    if density is not None and (inertia != "from-geometry" or not 0 < density < np.inf):
        needs = f"goes with {written.format('inertia', 'from-geometry')}, and is a number above 0"
        raise ClearanceError(f"`density` {needs}. Correct it, or leave it out.").about("density", density)
    field = _gravity(gravity)
    text, robot = read_urdf(path, Weighing(inertia, WATER if density is None else density, base == "free"))
    with naming(f"`{path}`"), jax.ensure_compile_time_eval():
        # Numbers stay numbers where a robot is loaded inside a jitted function.
        if mimic == "independent":
            robot = robot._replace(joints=tuple(joint._replace(mimic=None) for joint in robot.joints))
        return text, _mechanism(robot, base == "free", field, _frames_asked(robot, end_effector), written)


def _gravity(value: Any) -> Gravity:
    try:
        numbers = [float(component) for component in value]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) != 3 or not np.all(np.isfinite(numbers)):
        raise wrong_value("`gravity`", "three finite numbers in m/s^2", value)
    return Gravity(*present_of(numbers))


def _frames_asked(robot: Robot, end_effector: Any) -> list[str] | None:
    """The links whose frames become points; `None`: not given."""
    if end_effector is None:
        return None
    asked = [end_effector] if isinstance(end_effector, str) else end_effector
    known = {link.name for link in robot.links}
    for name in asked:
        if not isinstance(name, str) or name not in known:
            word = name if isinstance(name, str) else ""
            text = f"`end_effector` must name links, but there is no link {quote(name)}."
            raise unknown_name(text, word, known, "end_effector")
    return list(dict.fromkeys(asked))


def _mechanism(robot: Robot, free: bool, gravity: Gravity, asked: list[str] | None, written: str) -> Mechanism:
    whole = merge(robot)
    joints, root = whole.joints, whole.bodies[whole.root]
    if not (free or joints):
        fly = written.format("base", "free")
        raise ClearanceError(f"nothing of the robot moves: every joint is fixed. Load it with {fly}.")
    if free and not root.mass > 0:
        raise ClearanceError(
            f"line {root.line}: the root link `{root.name}` has no mass, so it cannot be a free base. Give it an "
            f"<inertial>, or shapes and load the robot with {written.format('inertia', 'from-geometry')}, or with "
            f"{written.format('base', 'fixed')} (a link of it may hang on a floating joint)."
        )
    if free:
        name = "floating_base"
        while any(joint.name == name for joint in joints):
            name += "_"
        place = (NOWHERE, NOWHERE, (0.0, 0.0, 1.0))
        joints = (Joint(name, "floating", GROUND, whole.root, *place, None, None, 0.0, 0.0, root.line), *joints)
    moving = {joint.child: whole.bodies[joint.child] for joint in joints}
    assumed = (*robot.assumed, *check_bodies(joints, moving, functools.partial(written.format, "inertia")))
    taken = {GROUND, "gravity", "drive", "target"}
    bodies = {GROUND: GROUND, **unique_names(moving, "link", taken)}
    if not free:
        bodies[whole.root] = GROUND
    named = unique_names((joint.name for joint in joints), "joint", taken)
    points = unique_names(ends_of(robot, whole, free) if asked is None else asked, "frame", taken)
    frames = {name: whole.frames[link] for link, name in points.items()}
    mimics = {joint.name: joint.mimic for joint in joints if joint.mimic is not None}
    followers = {name: mimic for name, mimic in mimics.items() if mimic.multiplier}
    still = {named[name]: Constant(mimic.offset) for name, mimic in mimics.items() if not mimic.multiplier}
    couplings = unique_names((f"{named[name]}_mimic" for name in followers), "coupling", taken)
    mechanism = Mechanism(
        tuple(body_of(body, bodies[name]) for name, body in moving.items()),
        tuple(joint_of(joint, named[joint.name], bodies[joint.parent], bodies[joint.child]) for joint in joints),
        points=tuple(Point(name, bodies[on], *place_of(pose)) for name, (on, pose) in frames.items()),
        gravity=gravity,
        name=robot.name,
        couplings=tuple(
            Coupling(name, named[follower], named[mimic.joint], mimic.multiplier, mimic.offset)
            for name, (follower, mimic) in zip(couplings.values(), followers.items(), strict=True)
        ),
        notes=(*robot.notes, *told("assumed", assumed)),
    )
    return mechanism.with_drives(still)


def body_of(body: Link, name: str) -> Body:
    """The body of a mechanism, by its name there."""
    if body.mass == 0:
        return Body(name)
    (xx, xy, xz), (_, yy, yz), (*_, zz) = body.inertia.tolist()
    is_point = np.abs(body.inertia).max() <= body.mass * SMALLEST**2
    inertia = None if is_point else Inertia(xx, yy, zz, *present_of((xy, xz, yz)), rounding=ROUNDED)
    return Body(name, body.mass, inertia, position_of(triple(body.center)))


def ends_of(robot: Robot, whole: Assembly, free: bool) -> list[str]:
    """The links at the ends of limbs: neither the link nor its body carries a joint, and the body moves."""
    carrying = {joint.parent for joint in robot.joints}
    inner = {joint.parent for joint in whole.joints} | (set() if free else {whole.root})
    outer = (link.name for link in robot.links if link.name not in carrying)
    return [name for name in outer if whole.frames[name].body not in inner]


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
    how = {"limits": joint.limits, "rotor_inertia": joint.rotor if joint.rotor > 0 else None}
    motion = Motion(position=_start(joint.limits or Limits()), actuators=_losses(joint), **how)
    return kind(**ends, axis=as_axis(joint.axis), motion=motion)


def _losses(joint: Joint) -> tuple[AbstractActuator, ...]:
    """Actuators for its spring, damping and friction, along each coordinate of the joint."""
    spring = JointSpring(joint.stiffness, joint.damping, joint.rest)
    damper = (spring,) if joint.damping > 0 or joint.stiffness > 0 else ()
    return (*damper, JointFriction(joint.friction)) if joint.friction > 0 else damper


def _start(limits: Limits) -> float:
    """The initial coordinate: 0 if it is within the limits, else their middle, or the only one."""
    ends = [end for end in (limits.lower, limits.upper) if end is not None]
    is_within = (limits.lower or 0.0) <= 0 <= (limits.upper or 0.0)
    return 0.0 if is_within else sum(ends) / len(ends)


def place_of(pose: FramePose) -> tuple[Position, Orientation | None]:
    """Position and orientation of a frame."""
    rpy = NOWHERE if is_identity(pose.rotation) else triple(rpy_of(pose.rotation))
    return position_of(triple(pose.position)), orientation_of(rpy)


def position_of(xyz: Triple) -> Position:
    """A position [m]; zero components become `None`."""
    return ORIGIN if xyz == NOWHERE else Position(*present_of(xyz))


def orientation_of(rpy: Triple) -> Orientation | None:
    """An orientation [rad]; zero angles become `None`, as does a zero rotation."""
    return None if rpy == NOWHERE else Orientation(*present_of(rpy))


def present_of(numbers: Iterable[float]) -> list[float | None]:
    """The numbers, with `None` for zero."""
    return [None if number == 0 else number for number in numbers]


def unique_names(written: Iterable[str], what: str, taken: set[str]) -> dict[str, str]:
    """A unique name by each name in the file, added to those `taken`: the same if possible, with `_` for `.` and `=`.
    (Links and joints may share names there.) Else `what` is appended, the kind of these parts in one word.
    """
    names = {}
    for name in written:
        wanted = name.replace(".", "_").replace("=", "_")
        more = (f"{wanted}_{what}_{count}" for count in itertools.count(2))
        names[name] = next(n for n in itertools.chain((wanted, f"{wanted}_{what}"), more) if n not in taken)
        taken.add(names[name])
    return names
