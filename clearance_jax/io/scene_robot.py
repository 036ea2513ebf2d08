"""The robot of a scene: a URDF file, how its joints move, what it carries."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.io.scene_contact import PLAYS, play_of
from clearance_jax.io.scene_joint import motion_of, orientation_at
from clearance_jax.io.scene_keys import MOTION, PAYLOAD, ROBOT
from clearance_jax.io.table import TomlTable
from clearance_jax.io.urdf.mechanism import place_of, read_robot
from clearance_jax.io.urdf.robot import FramePose, rotation_of
from clearance_jax.mechanism.body import GROUND, Body, Point
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Gravity, Orientation, Position
from clearance_jax.mechanism.tree import SLIDING, TURNING, AbstractJoint, Fixed, Prismatic, Revolute


class RobotParts(NamedTuple):
    """Parts that a robot adds to a scene; `trajectory`: its file; `notes`: what of the URDF file was not read."""

    bodies: tuple[Body, ...] = ()
    joints: tuple[AbstractJoint, ...] = ()
    points: tuple[Point, ...] = ()
    gravity: Gravity | None = None
    trajectory: Path | None = None
    notes: tuple[str, ...] = ()


NO_ROBOT = RobotParts()


def robot_of(top: TomlTable, path: Path) -> RobotParts:
    """Read the table `robot` of a scene."""
    table = top.table("robot", ROBOT)
    robot = read_robot(path.parent / table.get("file"), **table.arguments("file", "trajectory", "payload", "joint"))[1]
    joints = {joint.name: joint for joint in robot.joints}
    for name, values, where in table.entries("joint"):
        if name not in joints:
            raise ClearanceError(f"{where}: the robot has no joint of this name. " + suggest(name, joints))
        joints[name] = _joint(joints[name], values, where, path)
    carried = [_payload(robot, *part) for part in table.parts("payload")]
    return RobotParts(
        (*robot.bodies, *(body for body, _ in carried)),
        (*joints.values(), *(grip for _, grip in carried)),
        robot.points,
        robot.gravity,
        path.parent / table.get("trajectory") if table.has("trajectory") else None,
        robot.notes,
    )


def _joint(joint: AbstractJoint, values: Any, where: str, path: Path) -> AbstractJoint:
    """A joint of the robot with the motion and the clearance that the scene gives it."""
    if not isinstance(joint, (Revolute, Prismatic)):
        raise ClearanceError(f"{where} must be a revolute or prismatic joint of the robot, but it is another one.")
    kind = type(joint)
    table = TomlTable(values, where, MOTION + PLAYS[kind].keys, TURNING if kind is Revolute else SLIDING)
    given, motion = motion_of(table, path), joint.motion
    if given.drive is None:
        position = given.position if table.has("position") else motion.position
        rotor = motion.rotor_inertia if given.rotor_inertia is None else given.rotor_inertia
        actuators = *motion.actuators, *given.actuators
        given = dataclasses.replace(given, position=position, actuators=actuators, rotor_inertia=rotor)
    motion = dataclasses.replace(given, limits=motion.limits)
    return dataclasses.replace(joint, motion=motion, **play_of(kind, table, path, usual=True))


def _payload(robot: Mechanism, name: str, values: Any, where: str) -> tuple[Body, Fixed]:
    """A payload, and the fixed joint that carries it."""
    table = TomlTable(values, where, PAYLOAD)
    on, points = table.get("on"), {point.name: point for point in robot.points}
    bodies = {GROUND, *(body.name for body in robot.bodies)}
    if on not in points and on not in bodies:
        raise ClearanceError(
            f"{table.key('on')} must name a body or a point of the robot, but it is `{on}`. "
            + suggest(on, bodies | set(points))
        )
    point = points.get(on) or Point(on, on)
    carrier = _pose(point.at, point.orientation)
    pose = carrier.of(*_pose(Position(*table.get("at")), orientation_at(table, "orientation")))
    position, orientation = place_of(pose)
    grip = Fixed(f"{name}_grip", point.body, name, position, orientation=orientation)
    return body_of(name, table), grip


def _pose(at: Position, orientation: Orientation | None) -> FramePose:
    angles = (None,) * 3 if orientation is None else (orientation.roll, orientation.pitch, orientation.yaw)
    rpy = [0.0 if angle is None else float(angle) for angle in angles]
    return FramePose(np.array([float(x) for x in at.vector]), rotation_of(rpy))


def body_of(name: str, table: TomlTable) -> Body:
    """The body that a table describes."""
    numbers = {key: table.get(key) for key in ("mass", "inertia", "picked_up", "put_down")}
    return Body(name, center_of_mass=Position(*table.get("center_of_mass")), **numbers)
