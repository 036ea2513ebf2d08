"""The joints of a scene and of its robot: where they are, what drives or forces them, which of them close a loop."""

import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError, naming, unknown_name
from clearance_jax.io.files import read_table
from clearance_jax.io.keys import scene as keys
from clearance_jax.io.keys.coupling import FLANK_KEYS
from clearance_jax.io.keys.kinds import Words
from clearance_jax.io.robot import read_any_robot
from clearance_jax.io.scene.contact import PLAYS, play_of
from clearance_jax.io.table import TomlTable, check_table, variant
from clearance_jax.io.urdf.mechanism import IN_SCENE, place_of
from clearance_jax.io.urdf.robot import FramePose, rotation_of
from clearance_jax.laws import Flank
from clearance_jax.mechanism.actuators import Servo
from clearance_jax.mechanism.body import GROUND, Body, Limits, Motion, Point, Stops
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.motion.expressions import read_expression
from clearance_jax.mechanism.motion.motion_laws import AbstractDrive, Spline
from clearance_jax.mechanism.placement import Axis, Orientation, Position
from clearance_jax.mechanism.tree.compounds import Ball, Free, Slide, Spin, Turn
from clearance_jax.mechanism.tree.tree import AbstractJoint, Fixed, Prismatic, Revolute
from clearance_jax.parameters import check_demands
from clearance_jax.units import SLIDING, TURNING, to_si

# What only a joint of the tree has.
OF_THE_TREE = ("drive", "actuator", "position", "velocity", "eccentricity", "start", "spin", "slide", "turn")
OF_THE_TREE += ("stops", "slide_x", "slide_y", "slide_z", "turn_1", "turn_2")


def joints_of(top: TomlTable, path: Path, known: Collection[str] = ()) -> tuple[list, list]:
    """The joints of a scene: those of the tree, and those that close a loop. A joint belongs to the tree if no earlier
    joint has placed its child (and it is not `known` to be placed).
    """
    tree, loops, placed = [], [], {GROUND, *known}
    for name, values, where in top.parts("joint"):
        kind, table = variant(values, where, keys.JOINT_TABLES)
        joint = _joint(name, kind, table, path)
        if joint.child in placed:
            loops.append(_closure(joint, table))
        else:
            tree.append(joint)
            placed.add(joint.child)
    return tree, loops


def _closure(joint: AbstractJoint, table: TomlTable) -> AbstractJoint:
    loop = f"closes a loop (`{joint.child}` is placed already)"
    if isinstance(joint, Free):
        raise ClearanceError(f"{table.where} {loop} and holds nothing.")
    fix = "Move it to a joint of the tree, or write this joint before the one that places the body."
    table.refuse(*OF_THE_TREE, why=f"has no effect: the joint {loop}. {fix}")
    return joint


def _joint(name: str, kind: str, table: TomlTable, path: Path) -> AbstractJoint:
    common = {"name": name, "parent": table.get("parent"), "child": table.get("child")}
    common |= table.only("at_parent", "at_child", "angle", "orientation", "child_orientation")
    if kind == "fixed":
        return Fixed(**common)
    make = keys.JOINTS[kind]
    if kind not in ("revolute", "prismatic"):
        return make(**common, **_several(make, table, path))
    # The kind of joint decides the units of its coordinate and efforts.
    table.words = TURNING if kind == "revolute" else SLIDING
    return make(**common, motion=motion_of(table, path), **play_of(make, table, path), **table.only("axis"))


def _several(cls: type, table: TomlTable, path: Path) -> dict[str, Any]:
    """Arguments of a joint with several coordinates, beyond those of every joint."""
    out = play_of(cls, table, path) if cls in PLAYS else {}
    for field in dataclasses.fields(cls):
        if field.type is Axis:
            out |= table.only("axis")
        if field.type is Ball:
            spin, start = (table.only(key).get(key) for key in ("spin", "start"))
            spin = Spin(*(rate or 0.0 for rate in spin or ()))
            out["motion"] = Ball(Orientation() if start is None else start, spin, table.get("damping"))
        if field.type in (Slide, Turn) and table.has(field.name):
            words = SLIDING if field.type is Slide else TURNING
            inner = TomlTable(table.get(field.name), table.key(field.name), keys.MOTION, words)
            out[field.name] = motion_of(inner, path)
    return out


def motion_of(table: TomlTable, path: Path, limits: Limits | None = None) -> Motion:
    """The motion of a coordinate: driven, or free with actuators; `limits`: of a robot's joint."""
    drive = drive_of(table, "drive", path) if table.has("drive") else None
    if drive is not None and any(table.has(key) for key in ("position", "velocity", "actuator", "stops")):
        text = f"{table.where} has a drive: it takes no initial position or velocity, no actuator and no stops."
        raise ClearanceError(text)
    actuators = []
    for name, values, where in table.parts("actuator"):
        word, inner = variant(values, where, keys.ACTUATOR_TABLES, table.words)
        cls, given = keys.ACTUATORS[word], inner.arguments("type")
        given |= {"target": drive_of(inner, "target", path)} if cls is Servo else {}
        with naming(inner.where):
            actuators.append(cls(**given, name=name))
    rotor, stops = table.get("rotor_inertia"), None
    if table.has("stops"):
        inner = TomlTable(table.get("stops"), table.key("stops"), keys.STOPS, table.words)
        stops = stops_of(inner, limits)
    if drive is not None and rotor is not None:
        raise ClearanceError(f"{table.key('rotor_inertia')} has no effect beside a drive, which is followed exactly.")
    return Motion(
        drive, table.get("position"), table.get("velocity"), tuple(actuators), rotor_inertia=rotor, stops=stops
    )


def stops_of(table: TomlTable, limits: Limits | None) -> Stops:
    """The stops that a table describes, by default at the limits of a robot's joint."""
    table.need("stiffness")
    ends = table.only("lower", "upper")
    if not ends and limits is not None:
        known = {"lower": limits.lower, "upper": limits.upper}
        ends = {name: float(value) for name, value in known.items() if value is not None}
    with naming(table.where):
        stops = Stops(**ends, flank=Flank(**table.only(*FLANK_KEYS)))
        check_demands(stops, words=lambda: table.words)
        check_demands(stops.flank, words=lambda: table.words)
        return stops


def drive_of(table: TomlTable, name: str, path: Path) -> AbstractDrive:
    """The drive that a key of a table describes."""
    return read_drive(table.get(name), table.key(name), table.words, path)


def read_drive(values: Any, where: str, words: Words, path: Path) -> AbstractDrive:
    """A drive from an expression or a table; `words`: units of its coordinate by placeholder."""
    with naming(where):
        if isinstance(values, str):
            return read_expression(values)
        if check_table(values, where).get("type") == "spline" and "file" in values:
            table = TomlTable(values, where, keys.SPLINE_FILE, words)
            times, numbers = read_table(path.parent / table.get("file"), table.key("file"))
            scale = to_si(f"1 {table.get('unit')}", words["coordinate"], table.key("unit"))
            return Spline(times, numbers * scale, table.get("ends"))
        kind, inner = variant(values, where, keys.DRIVE_TABLES, words)
        return keys.DRIVES[kind](**inner.arguments("type"))


def robot_of(top: TomlTable, path: Path) -> tuple[Mechanism, Path | None]:
    """Read the table `robot` of a scene: the robot with what it carries, and the file of its trajectory."""
    table = top.table("robot", keys.ROBOT)
    options = table.arguments("file", "trajectory", "payload", "joint")
    robot = read_any_robot(path.parent / table.get("file"), **options, written=IN_SCENE)[1]
    joints = {joint.name: joint for joint in robot.joints}
    for name, values, where in table.entries("joint"):
        if name not in joints:
            raise unknown_name(f"{where}: the robot has no joint of this name.", name, joints, where)
        joints[name] = _robot_joint(joints[name], values, where, path)
    carried = [_payload(robot, *part) for part in table.tables("payload", keys.PAYLOAD)]
    bodies, grips = (*robot.bodies, *(body for body, _ in carried)), (grip for _, grip in carried)
    trajectory = path.parent / table.get("trajectory") if table.has("trajectory") else None
    return dataclasses.replace(robot, bodies=bodies, joints=(*joints.values(), *grips)), trajectory


def _robot_joint(joint: AbstractJoint, values: Any, where: str, path: Path) -> AbstractJoint:
    """A joint of the robot with the motion and the clearance that the scene gives it."""
    if not isinstance(joint, (Revolute, Prismatic)):
        raise ClearanceError(f"{where} must be a revolute or prismatic joint of the robot, but it is another one.")
    kind = type(joint)
    table = TomlTable(values, where, keys.MOTION + PLAYS[kind].keys, TURNING if kind is Revolute else SLIDING)
    added, motion = motion_of(table, path, joint.motion.limits), joint.motion
    if added.drive is None:
        position = added.position if table.has("position") else motion.position
        rotor = motion.rotor_inertia if added.rotor_inertia is None else added.rotor_inertia
        actuators = *motion.actuators, *added.actuators
        added = dataclasses.replace(added, position=position, actuators=actuators, rotor_inertia=rotor)
    motion = dataclasses.replace(added, limits=motion.limits)
    return dataclasses.replace(joint, motion=motion, **play_of(kind, table, path, usual=True))


def _payload(robot: Mechanism, name: str, table: TomlTable) -> tuple[Body, Fixed]:
    on, points = table.get("on"), {point.name: point for point in robot.points}
    bodies = {GROUND, *(body.name for body in robot.bodies)}
    if on not in points and on not in bodies:
        text = f"{table.key('on')} must name a body or a point of the robot, but it is `{on}`."
        raise unknown_name(text, on, bodies | set(points), table.key("on"))
    point = points.get(on) or Point(on, on)
    pose = _pose(point.at, point.orientation).of(*_pose(table.get("at"), table.get("orientation")))
    position, orientation = place_of(pose)
    grip = Fixed(f"{name}_grip", point.body, name, position, orientation=orientation)
    return body_of(name, table), grip


def _pose(at: Position, orientation: Orientation | None) -> FramePose:
    angles = (None,) * 3 if orientation is None else (orientation.roll, orientation.pitch, orientation.yaw)
    rotation = rotation_of([0.0 if angle is None else float(angle) for angle in angles])
    return FramePose(np.array([float(x) for x in at.vector]), rotation)


def body_of(name: str, table: TomlTable) -> Body:
    """The body that a table describes."""
    return Body(name, **table.only(*(key.name for key in keys.BODY.keys)))
