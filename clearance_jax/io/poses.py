"""Poses of frames as numpy arrays: R = Rz(yaw) Ry(pitch) Rx(roll), zeros and identities exact."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Vector3 = Float[np.ndarray, "3"]
Matrix3 = Float[np.ndarray, "3 3"]

# Round-off of a zero in a product of a few rotations, relative to the largest entries.
ROUNDING = 8 * np.finfo(float).eps


class FramePose(NamedTuple):
    """A frame in another one: its origin there [m], and the rotation from its axes to the other's."""

    position: Vector3
    rotation: Matrix3

    def of(self, position: Vector3, rotation: Matrix3) -> "FramePose":
        """The pose in the outer frame of what has this `position` and `rotation` in the frame."""
        moved = self.rotation @ position
        scale = max(np.abs(self.position).max(), np.abs(position).max())
        return FramePose(clean(self.position + moved, scale), clean(self.rotation @ rotation))


HERE = FramePose(np.zeros(3), np.eye(3))


def clean(values: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """The values with round-off set to zero, so that the compiled program can leave it out."""
    return np.where(np.abs(values) <= ROUNDING * scale, 0.0, values)


def rotation_of(rpy) -> Matrix3:
    """The rotation by roll, pitch and yaw [rad]; a zero among them leaves exact zeros and ones."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return z @ y @ x


def rpy_of(rotation: Matrix3) -> Vector3:
    """Roll, pitch and yaw [rad] of a rotation: the inverse of `rotation_of`.

    Near a pitch of 90 deg only the sum or difference of roll and yaw is well defined. So the yaw is taken out of the
    rotation before the roll is computed.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    if np.hypot(rotation[1, 0], rotation[0, 0]) <= ROUNDING:
        yaw = 0.0  # any will do
    rest = rotation_of((0.0, 0.0, -yaw)) @ rotation
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    roll = np.arctan2(-rest[1, 2], rest[1, 1])
    return clean(np.array([roll, pitch, yaw]))


def is_identity(rotation: Matrix3) -> bool:
    """Whether the rotation is exactly the identity."""
    return bool(np.array_equal(rotation, np.eye(3)))
