"""Checks that every motion of a robot's joints moves mass. Otherwise its acceleration is not determined."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from clearance_jax.errors import ClearanceError
from clearance_jax.io.poses import HERE, FramePose, Matrix3, Vector3, rotation_of
from clearance_jax.io.urdf_merge import Rigid
from clearance_jax.io.urdf_parts import Joint

# Least eigenvalue of the mass matrix, scaled to a unit diagonal, that is no round-off.
NOTHING = 1e-12
X, Y, Z = np.eye(3)


class JointTwist(NamedTuple):
    """The motion at unit rate of one coordinate: a slide along an axis, or a turn about the axis through a pivot."""

    slides: bool
    axis: Vector3
    pivot: Vector3

    def rates(self, point: Vector3) -> Float[np.ndarray, "6"]:
        """Velocity of a point of the moved body [m/s], and its angular velocity [rad/s]."""
        if self.slides:
            return np.concatenate([self.axis, np.zeros(3)])
        return np.concatenate([np.cross(self.axis, point - self.pivot), self.axis])


def check_moved(joints: Sequence[Joint], bodies: Mapping[str, Rigid]) -> None:
    """Raise where the joints (parents first) can move without moving any mass, by the mass matrix at a random pose,
    where no two axes are aligned by chance.
    """
    matrix, owners = mass_matrix(joints, bodies, 0)
    met = np.diag(matrix)
    size = 1 / np.sqrt(np.where(met > 0, met, 1.0))  # so that metres and radians compare
    values, vectors = np.linalg.eigh(matrix * np.outer(size, size))
    if values[0] > NOTHING:
        return
    joint = owners[int(np.argmax(np.abs(vectors[:, 0])))]
    raise ClearanceError(
        f"line {joint.line}: joint `{joint.name}` can move without moving any mass. Give the link `{joint.child}`, or "
        "what it carries, an <inertial>, or make the joint fixed."
    )


def mass_matrix(
    joints: Sequence[Joint], bodies: Mapping[str, Rigid], seed: int
) -> tuple[Float[np.ndarray, "n n"], list[Joint]]:
    """The mass matrix at a random pose, and the joint of each coordinate."""
    twists, moving, poses = _kinematics(joints, seed)
    matrix = np.zeros((len(twists), len(twists)))
    for name, body in bodies.items():
        pose = poses[name]
        center = pose.position + pose.rotation @ body.center
        which = moving[name]
        rates = np.array([twists[i].rates(center) for i in which])
        inertia = np.zeros((6, 6))
        inertia[:3, :3], inertia[3:, 3:] = body.mass * np.eye(3), pose.rotation @ body.inertia @ pose.rotation.T
        matrix[np.ix_(which, which)] += rates @ inertia @ rates.T
    return matrix, [joint for joint in joints for _ in _twists(joint, HERE)]


def _kinematics(
    joints: Sequence[Joint], seed: int
) -> tuple[list[JointTwist], dict[str, list[int]], dict[str, FramePose]]:
    """The twists of all coordinates; for each body the indices of those that move it, and its pose."""
    rng = np.random.default_rng(seed)
    twists: list[JointTwist] = []
    moving: dict[str, list[int]] = {}
    poses: dict[str, FramePose] = {}
    for joint in joints:
        frame = poses.get(joint.parent, HERE).of(np.array(joint.xyz), rotation_of(joint.rpy))
        count = len(twists)
        twists += _twists(joint, frame)
        moving[joint.child] = [*moving.get(joint.parent, []), *range(count, len(twists))]
        poses[joint.child] = frame.of(*_move(joint, rng))
    return twists, moving, poses


def _twists(joint: Joint, frame: FramePose) -> list[JointTwist]:
    """The twists of a joint's coordinates at zero. Those of several coordinates span the same motions at any value."""
    axis = np.array(joint.axis)
    across = np.cross(axis, X if abs(axis[0]) < 0.9 else Y)
    slides = {"prismatic": [axis], "planar": [across, np.cross(axis, across)], "floating": [X, Y, Z]}
    turns = {"revolute": [axis], "continuous": [axis], "planar": [axis], "floating": [X, Y, Z]}
    return [
        JointTwist(is_slide, frame.rotation @ axis, frame.position)
        for is_slide, axes in ((True, slides), (False, turns))
        for axis in axes.get(joint.kind, [])
    ]


def _move(joint: Joint, rng: np.random.Generator) -> tuple[Vector3, Matrix3]:
    """A random position and rotation of the child in the joint's frame that the joint allows."""
    by, turn = np.zeros(3), np.eye(3)
    for slides, axis, _ in _twists(joint, HERE):
        if slides:
            by = by + rng.uniform(0.1, 1.0) * axis
        else:
            turn = turn @ rotation_about(axis, rng.uniform(0.3, 1.2))
    return by, turn


def rotation_about(axis: Vector3, angle: float) -> Matrix3:
    """The rotation about a unit vector by an angle [rad] (Rodrigues)."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
