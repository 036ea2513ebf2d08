"""Quantities of scene files: `"0.1 mm"` is 1e-4 (SI units)."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FACTORS = {
    "mm": 1e-3,
    "um": 1e-6,
    "deg": np.pi / 180,
    "rpm": 2 * np.pi / 60,
    "ms": 1e-3,
    "g": 1e-3,
    "GPa": 1e9,
}
"""Units beside those of the SI."""


def number(value) -> float:
    """A number, or a quantity in a string."""
    if not isinstance(value, str):
        return float(value)
    digits, _, unit = value.partition(" ")
    return float(digits) * FACTORS.get(unit, 1.0)


def vector(values=None) -> Vector:
    """A pair or triple of quantities, shape (3,)."""
    given = [number(value) for value in values or ()]
    return np.array(given + [0.0] * (3 - len(given)))


def cross(a: Vector, b: Vector) -> Vector:
    """Vector products along the last axis (`np.cross` takes ten times as long for a few vectors)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def dot(a: Vector, b: Vector) -> Vector:
    """Scalar products along the last axis."""
    return (a * b).sum(-1)


def about(axis: int, angle: float) -> Vector:
    """The matrix of a turn about x, y or z (0, 1, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def roll_pitch_yaw(values) -> Vector:
    """The matrix of a roll, pitch and yaw."""
    roll, pitch, yaw = vector(values)
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


def matrices(quaternions: Vector) -> Vector:
    """Rotation matrices, shape (n, 3, 3), of quaternions (w, x, y, z), shape (n, 4), of about unit length."""
    w, x, y, z = (quaternions / np.sqrt(dot(quaternions, quaternions))[:, None]).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quaternion(matrix: Vector) -> Vector:
    """The unit quaternion (w, x, y, z) of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(matrix).as_quat()
    return np.array([w, x, y, z])
