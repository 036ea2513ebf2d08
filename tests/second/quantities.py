"""Quantities of scene files: `"0.1 mm"` is 1e-4 (SI units)."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

FACTORS = {"mm": 1e-3, "um": 1e-6, "mm/s": 1e-3, "deg": np.pi / 180, "rpm": 2 * np.pi / 60}
FACTORS |= {"ms": 1e-3, "us": 1e-6, "g": 1e-3, "GPa": 1e9}
"""Units that are not those of the SI."""
SI = ("m", "s", "kg", "N", "rad", "Pa", "N*m", "kg*m^2", "m/s", "rad/s", "m/s^2", "N*s/m", "N*m*s/rad", "N/m")
SI += ("N*m/rad", "Pa*s", "Pa/m", "1/m", "s/m", "N/m^1.5", "N/m^1.4", "s/rad", "1/rad", "N*m/rad^3", "N/m^3")
SI += ("N/(m*s)", "N*m/(rad*s)")


def number(value) -> float:
    """A number, or a quantity in a string."""
    if not isinstance(value, str):
        return float(value)
    digits, _, unit = value.partition(" ")
    if unit not in FACTORS and unit not in SI:
        raise ValueError(f"The second simulator does not know the unit {unit!r}.")
    return float(digits) * FACTORS.get(unit, 1.0)


def vector(values=None) -> Vector:
    """A pair or triple of quantities, shape (3,)."""
    given = [number(value) for value in values or ()]
    return np.array(given + [0.0] * (3 - len(given)))


def cross(a: Vector, b: Vector) -> Vector:
    """Vector products along the last axis (`np.cross` takes ten times as long for a few vectors)."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    return np.stack([x, y, a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]], -1)


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


def quaternion(matrix: Vector) -> Vector:
    """The unit quaternion (w, x, y, z) of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(matrix).as_quat()
    return np.array([w, x, y, z])
