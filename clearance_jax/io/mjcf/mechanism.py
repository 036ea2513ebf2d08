"""Mechanisms of robots in MJCF files: the joints of a compiled file, and what else of it has a counterpart."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from clearance_jax.errors import ClearanceError, naming, quote, unknown_name
from clearance_jax.io.keys.kinds import Word
from clearance_jax.io.mjcf.source import Source, names_of, outermost, rotation_by
from clearance_jax.io.urdf import mechanism as urdf
from clearance_jax.io.urdf.bodies import LinkFrame, merge
from clearance_jax.io.urdf.robot import Joint, Link, Robot, rpy_of, triple
from clearance_jax.mechanism.body import GROUND, Force, Point, Wrench
from clearance_jax.mechanism.couplings import Coupling
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Gravity, Orientation
from clearance_jax.mechanism.tree.compounds import Ball, Free, Slide, Spherical
from clearance_jax.mechanism.tree.tree import AbstractJoint


def load_mjcf(path: str | Path, *, end_effector: str | Sequence[str] | None = None, mimic: str = "follow") -> Mechanism:
    """The mechanism of a robot's MJCF file. Needs the extra `mjcf`.

    Bodies without joints are one body with what carries them. Several joints of one body become joints with massless
    bodies between them. A coordinate has MuJoCo's value (`qpos`) and starts at `qpos0`. Springs, damping and friction
    loss become actuators, armatures rotors (`Motion.rotor_inertia`), ranges `Motion.limits` (which do not bound the
    motion), and compensation of gravity constant loads. An equality constraint of joints becomes a coupling, a
    `connect` a ball joint that closes a loop. Both hold exactly here, while MuJoCo's are soft.

    **Arguments:**

    - `path`: of the file.
    - `end_effector`: a site or a body, or several, whose frames become points of the mechanism under this name (if a
      part has it, `NAME_frame`). By default every body at the end of a limb.
    - `mimic`: "follow": a joint that an equality constraint ties to another one follows it. "independent": it moves by
      itself.

    **Raises:** `ClearanceError` for a file that MuJoCo's compiler refuses, in its words; without the package `mujoco`;
    if nothing moves, or a name is unknown.

    **Warns:** `NotReadWarning` of what is physics and was not read (actuators, tendons, welds, ...), and of hinges that
    stand for backlash. The mechanism's `notes` say it too. Contacts of shapes are never read.
    """
    mechanism = read_mjcf(path, end_effector=end_effector, mimic=mimic)[1]
    urdf.warn_of_notes(path, mechanism)
    return mechanism


def read_mjcf(path: str | Path, end_effector: Any = None, mimic: str = "follow") -> tuple[str, Mechanism]:
    """As `load_mjcf`, with the file's text."""
    Word("", "", allowed=urdf.MIMICS).read(mimic, "`mimic`", {})
    text, top = outermost(path)
    with naming(f"`{path}`"), jax.ensure_compile_time_eval():
        # Numbers stay numbers where a robot is loaded inside a jitted function.
        if top != "mujoco":
            raise ClearanceError(f"is no MJCF file: its outermost element must be <mujoco>, but it is <{top}>.")
        return text, _mechanism(Source(path), end_effector, mimic == "follow")


def _mechanism(source: Source, asked: Any, follow: bool) -> Mechanism:
    hung = tuple(source.hung())
    if all(joint.kind == "fixed" for joint in hung):
        raise ClearanceError("nothing of the robot moves: no body has a joint. Give one a <joint> or a <freejoint>.")
    source.check_moved()
    between = [joint.child for joint in hung if joint.child not in source.bodies]
    massless = (Link(name, 0.0, np.zeros(3), np.zeros((3, 3)), 0) for name in between)
    robot = Robot(source.name, (*source.links(), *massless), hung, GROUND)
    whole = merge(robot)
    moving = {joint.child: whole.bodies[joint.child] for joint in whole.joints}
    taken = {GROUND, "gravity", "drive", "target"}
    bodies = {GROUND: GROUND, **urdf.unique_names(moving, "body", taken)}
    joints = urdf.unique_names((joint.name for joint in whole.joints), "joint", taken)
    frames = {name: LinkFrame(bodies[frame.body], frame.pose) for name, frame in whole.frames.items()}
    couplings = tuple(_couplings(source, joints, taken)) if follow else ()
    loops = tuple(_loops(source, frames, taken))
    asked = urdf.ends_of(robot, whole, False) if asked is None else asked
    points = dict(_points(source, frames, [asked] if isinstance(asked, str) else asked))
    named = urdf.unique_names(points, "frame", taken)
    source.list_left_out()
    gravity = np.zeros(3) if source.is_off("GRAVITY") else source.model.opt.gravity
    return Mechanism(
        tuple(urdf.body_of(body, bodies[name]) for name, body in moving.items()),
        tuple(
            _joint(source, joint, joints[joint.name], bodies[joint.parent], bodies[joint.child])
            for joint in whole.joints
        ),
        loops,
        points=tuple(Point(named[name], on, *urdf.place_of(pose)) for name, (on, pose) in points.items()),
        gravity=Gravity(*urdf.present_of(triple(gravity))),
        name=source.name,
        wrenches=tuple(_compensations(source, frames, gravity, taken)),
        couplings=couplings,
        notes=(*([f"not read: {', '.join(source.left_out)}"] if source.left_out else []), *source.backlashes()),
    )


def _joint(source: Source, joint: Joint, name: str, parent: str, child: str) -> AbstractJoint:
    """The joint of the mechanism, at its start in the file."""
    made: Any = urdf.joint_of(joint, name, parent, child)
    number = source.joints.index(joint.name)
    start, at_child = source.start(number), urdf.position_of(triple(source.pivot(number)))
    if source.kind(number) == "BALL":
        place = {"at_parent": made.at_parent, "at_child": at_child, "orientation": made.orientation}
        return Spherical(name, parent, child, motion=made.motion, **place)
    if not isinstance(made, Free):
        motion = dataclasses.replace(made.motion, position=float(start[0]))
        return dataclasses.replace(made, at_child=at_child, motion=motion)
    turned = urdf.orientation_of(triple(rpy_of(rotation_by(start[3:7])))) or Orientation()
    slides: dict[str, Slide] = {
        key: dataclasses.replace(getattr(made, key), position=float(place))
        for key, place in zip(("slide_x", "slide_y", "slide_z"), start[:3], strict=True)
    }
    return dataclasses.replace(made, **slides, motion=Ball(turned, damping=made.motion.damping))


def _compensations(
    source: Source, frames: Mapping[str, LinkFrame], gravity: np.ndarray, taken: set[str]
) -> Iterator[Wrench]:
    """The compensation of bodies' weight: a constant load in the centre of mass of each."""
    model = source.model
    for i, name in enumerate(source.bodies):
        body, pose = frames[name]
        force = -model.body_gravcomp[i] * model.body_mass[i] * gravity
        if body != GROUND and force.any():
            center = urdf.position_of(triple(pose.of(model.body_ipos[i], np.eye(3)).position))
            unique = _unique(f"{name}_gravcomp", "load", taken)
            yield Wrench(unique, body, center, Force(*urdf.present_of(triple(force))))


def _points(source: Source, frames: Mapping[str, LinkFrame], asked: Sequence[Any]) -> Iterator[tuple[str, LinkFrame]]:
    """Frames of sites and bodies by their names."""
    model = source.model
    for name in asked:
        if not isinstance(name, str) or name not in (*source.sites, *frames):
            text = f"`end_effector` must name sites or bodies, but there is none called {quote(name)}."
            raise unknown_name(text, name if isinstance(name, str) else "", {*source.sites, *frames}, "end_effector")
        if name in source.sites:
            i = source.sites.index(name)
            body, pose = frames[source.bodies[model.site_bodyid[i]]]
            yield name, LinkFrame(body, pose.of(model.site_pos[i], rotation_by(model.site_quat[i])))
        else:
            yield name, frames[name]


# Equality constraints -------------------------------------------------------------------------------------------------


def _couplings(source: Source, joints: Mapping[str, str], taken: set[str]) -> Iterator[Coupling]:
    """Joints that follow others; `joints`: their names in the mechanism. Other relations of joints are left out."""
    leaders: dict[int, int] = {}
    out = []
    for i, name in _active(source, "JOINT"):
        relation = _relation(source, i, leaders)
        if relation is None:
            out.append(name)
            continue
        follower, leader, ratio, offset = relation
        follower, leader = joints[source.joints[follower]], joints[source.joints[leader]]
        word = source.model.equality(i).name or f"{follower}_follows"
        yield Coupling(_unique(word, "coupling", taken), follower, leader, ratio, offset)
    source.leave_out("relations of joints that are not linear, or follow from others:", out)


def _active(source: Source, kind: str) -> Iterator[tuple[int, str]]:
    """Numbers and names of the equality constraints of a kind that act."""
    model = source.model
    names = names_of(model.equality, range(model.neq), "equality")
    if not (source.is_off("EQUALITY") or source.is_off("CONSTRAINT")):
        number = int(getattr(source.mujoco.mjtEq, f"mjEQ_{kind}"))
        yield from ((i, names[i]) for i in range(model.neq) if model.eq_active0[i] and model.eq_type[i] == number)


def _unique(word: str, what: str, taken: set[str]) -> str:
    return urdf.unique_names([word], what, taken)[word]


def _relation(source: Source, number: int, leaders: dict[int, int]) -> tuple[int, int, float, float] | None:
    """Follower, leader, ratio and offset of a linear relation of two joints. `None`: it is another one, or follows from
    those of the `leaders` (by followers), which it is added to.
    """
    model = source.model
    first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
    constant, ratio, *higher = (float(factor) for factor in model.eq_data[number][:5])
    if second < 0 or ratio == 0 or any(higher):
        return None
    offset = float(source.start(first)[0]) + constant - ratio * float(source.start(second)[0])
    for follower, leader, rate, shift in ((first, second, ratio, offset), (second, first, 1 / ratio, -offset / ratio)):
        root = leader
        while root in leaders:
            root = leaders[root]
        if follower not in leaders and root != follower:
            leaders[follower] = leader
            return follower, leader, rate, shift
    return None


def _loops(source: Source, frames: Mapping[str, LinkFrame], taken: set[str]) -> Iterator[Spherical]:
    """Ball joints for points that stay together. Other constraints of bodies are left out."""
    model, out = source.model, []
    of_sites = int(source.mujoco.mjtObj.mjOBJ_SITE)
    for i, name in _active(source, "CONNECT"):
        ends, anchors = [model.eq_obj1id[i], model.eq_obj2id[i]], model.eq_data[i][:6].reshape(2, 3)
        if model.eq_objtype[i] == of_sites:
            ends, anchors = model.site_bodyid[ends], model.site_pos[ends]
        here = [frames[source.bodies[end]] for end in ends]
        places = [
            (body, urdf.position_of(triple(pose.of(anchor, np.eye(3)).position)))
            for (body, pose), anchor in zip(here, anchors, strict=True)
        ]
        (child, at_child), (parent, at_parent) = places if places[0][0] != GROUND else places[::-1]
        if child == parent:
            out.append(name)
        else:
            yield Spherical(_unique(name, "loop", taken), parent, child, at_parent, at_child)
    source.leave_out("connections within one body", out)
    for kind in ("WELD", "TENDON", "DISTANCE", "FLEX", "FLEXVERT", "FLEXSTRAIN"):
        if hasattr(source.mujoco.mjtEq, f"mjEQ_{kind}"):
            source.leave_out(f"equality constraints <{kind.lower()}>", [name for _, name in _active(source, kind)])
