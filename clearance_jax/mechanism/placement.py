"""Placement on a body: positions, axes, orientations, and inertia. A number that is left out is absent from the
compiled program, so a plane mechanism is one without z components.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax._basis.module import Module
from clearance_jax._basis.symmetric import Symmetric
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.parameters import as_leaf, physical
from clearance_jax.spatial import IDENTITY, UNIT, Matrix, Rotation, Term, Vector, X, Y, Z, across, scale


def present(value: Any) -> Term:
    """A number as it is, an absent one as the constant 0.0."""
    return 0.0 if value is None else value


class Components(Module):
    """A vector by its components `x`, `y`, `z`."""

    x: eqx.AbstractVar[Scalar | None]
    y: eqx.AbstractVar[Scalar | None]
    z: eqx.AbstractVar[Scalar | None]

    @property
    def vector(self) -> Vector:
        """The components, absent ones as the constant 0.0."""
        return present(self.x), present(self.y), present(self.z)


class Position(Components):
    """A vector of lengths [m]. A component that you leave out is zero, and absent from the compiled program."""

    x: Scalar | None = physical("m", default=None)
    y: Scalar | None = physical("m", default=None)
    z: Scalar | None = physical("m", default=None)


ORIGIN = Position()


class Gravity(Components):
    """The acceleration of free fall [m/s^2]. A component that you leave out is zero, and absent from the program."""

    x: Scalar | None = physical("m/s^2", default=None)
    y: Scalar | None = physical("m/s^2", default=None)
    z: Scalar | None = physical("m/s^2", default=None)


class Orientation(Module):
    """How a frame is turned: by `roll` about x, then by `pitch` about y, then by `yaw` about z [rad], all of them axes
    of the outer frame (R = Rz Ry Rx, as in URDF). An angle that you leave out is zero, and absent from the compiled
    program.
    """

    roll: Scalar | None = physical("rad", default=None)
    pitch: Scalar | None = physical("rad", default=None)
    yaw: Scalar | None = physical("rad", default=None)

    @property
    def rotation(self) -> Rotation:
        """The rotation to the outer frame's axes."""
        turned = IDENTITY.turn(Z, present(self.yaw)).turn(Y, present(self.pitch))
        return turned.turn(X, present(self.roll))

    @property
    def is_plane(self) -> bool:
        """Whether it is a turn about z by its structure."""
        return self.roll is None and self.pitch is None

    def prepare(self) -> "PreparedOrientation":
        """The same with its matrix computed (once a solve)."""
        return as_prepared(self.rotation.rows)


class PreparedOrientation(Module):
    """An orientation by its matrix; entries that are constants of the program stay so."""

    numbers: tuple[Scalar, ...]
    constants: tuple[float | None, ...] = eqx.field(static=True)

    @property
    def rotation(self) -> Rotation:
        rest = iter(self.numbers)
        entries = [next(rest) if constant is None else constant for constant in self.constants]
        x, y, z = (tuple(entries[i : i + 3]) for i in (0, 3, 6))
        return IDENTITY.compose((x, y, z))  # pyright: ignore[reportArgumentType]

    @property
    def is_plane(self) -> bool:
        """Whether it keeps the z axis by its structure."""
        return self.constants[2] == self.constants[5] == 0.0 and self.constants[8] == 1.0


def as_prepared(rows: Matrix) -> PreparedOrientation:
    """The orientation of a rotation's matrix."""
    entries = [term for row in rows for term in row]
    constants = tuple(term if isinstance(term, float) else None for term in entries)
    return PreparedOrientation(tuple(t for t in entries if not isinstance(t, float)), constants)


LETTERS: dict[str, Vector] = {"x": X, "y": Y, "z": Z} | {
    f"-{k}": scale(-1.0, a) for k, a in zip("xyz", UNIT, strict=True)
}


class Axis(Module):
    """A direction. It is an axis of the frame by its `letter`, such as "x" or "-z", which is a constant of the program;
    or any other, by the numbers `x`, `y`, `z` of a vector that is not zero.
    """

    letter: str | None = eqx.field(static=True, default=None)
    x: Scalar | None = physical("", default=None)
    y: Scalar | None = physical("", default=None)
    z: Scalar | None = physical("", default=None)

    @property
    def vector(self) -> Vector:
        """The unit vector."""
        if self.letter is not None:
            return LETTERS[self.letter]
        terms = present(self.x), present(self.y), present(self.z)
        length = jnp.sqrt(sum((jnp.asarray(t) ** 2 for t in terms), jnp.zeros(())))
        return scale(1.0 / length, terms)

    @property
    def across(self) -> tuple[Vector, Vector]:
        """Two unit vectors that make a right-handed frame with it: (first, second, axis)."""
        if self.letter is not None:
            k = "xyz".index(self.letter[-1])
            first, second = UNIT[(k + 1) % 3], UNIT[(k + 2) % 3]
            return (first, second) if len(self.letter) == 1 else (second, first)
        return across(self.vector)


def as_axis(value: Any) -> Any:
    """An `Axis` from a letter, three numbers, or an axis. **Raises** `ClearanceError` for other values."""
    if isinstance(value, Axis) or not isinstance(value, (str, tuple, list, np.ndarray, Position)):
        return value
    if isinstance(value, str):
        if value.removeprefix("+") not in LETTERS:
            raise wrong_value("An axis", "x, y, z, -x, -y, -z or three numbers", value, name="axis")
        return Axis(value.removeprefix("+"))
    numbers = list(value.vector if isinstance(value, Position) else value)
    if len(numbers) != 3:
        raise ClearanceError(f"An axis must have three numbers, but it has {len(numbers)}.")
    if not any(isinstance(n, Tracer) for n in numbers):
        plain = np.asarray([float(n) for n in numbers])
        if not np.all(np.isfinite(plain)) or not np.any(plain):
            raise wrong_value("An axis", "finite and not zero", plain.tolist(), str(plain.tolist()), name="axis")
        if np.count_nonzero(plain) == 1:
            k = int(np.flatnonzero(plain)[0])
            return Axis(("-" if plain[k] < 0 else "") + "xyz"[k])
        numbers = [None if n == 0 else n for n in plain.tolist()]
    return Axis(None, *numbers)


class Inertia(Module):
    """Moments and products of inertia about the centre of mass, in the body's axes: the entries of the tensor. The
    product `xy` is minus the integral of x y dm. An entry that you leave out is zero, and absent from the compiled
    program.
    """

    xx: Scalar = physical("kg*m^2")
    yy: Scalar = physical("kg*m^2")
    zz: Scalar = physical("kg*m^2")
    xy: Scalar | None = physical("kg*m^2", default=None)
    xz: Scalar | None = physical("kg*m^2", default=None)
    yz: Scalar | None = physical("kg*m^2", default=None)
    rounding: float = eqx.field(static=True, default=1e-3)
    """By which part the largest moment may exceed the sum of the others: files print three digits or more."""

    def __check_init__(self):
        six = [self.xx, self.yy, self.zz, self.xy, self.xz, self.yz]
        # Not where a leaf is a tracer, a batch or, while trees are mapped, something else.
        if any(isinstance(n, Tracer) or (n is not None and np.ndim(n)) for n in six):
            return
        if not all(hasattr(n, "dtype") for n in six[:3]):
            return
        xx, yy, zz, xy, xz, yz = (0.0 if n is None else float(n) for n in six)
        check_inertia(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), "An inertia", self.rounding)

    @property
    def symmetric(self) -> Symmetric:
        """The tensor."""
        entries = {
            (0, 0): self.xx, (1, 1): self.yy, (2, 2): self.zz, (0, 1): self.xy, (0, 2): self.xz, (1, 2): self.yz,
        }  # fmt: skip
        return Symmetric(lambda i, j: present(entries[i, j]))


def check_inertia(tensor: np.ndarray, what: str, rounding: float) -> None:
    """Raise for a tensor that no body has: a negative principal moment, or one above the sum of the other two by more
    than the part `rounding`.
    """
    if not np.all(np.isfinite(tensor)):
        raise ClearanceError(f"{what} must be finite.")
    least, middle, most = np.linalg.eigvalsh(tensor)
    size = max(abs(most), abs(least))
    moments = f"its principal moments are {least:g}, {middle:g}, {most:g} kg m^2"
    if least < -1e-6 * size or most <= 0:
        raise ClearanceError(f"{what} must be positive, but {moments}.")
    if least + middle < most * (1 - rounding):
        raise ClearanceError(
            f"{what} belongs to no body: {moments}, of which the largest is more than the other two together. Give it "
            "about the centre of mass, in the body's axes."
        )


def as_inertia(value: Any) -> Any:
    """A body's inertia: one number (about z), an `Inertia`, or a list of its numbers (xx, yy, zz[, xy, xz, yz])."""
    if isinstance(value, (list, tuple)):
        if len(value) not in (3, 6):
            raise ClearanceError(f"An inertia must be one number, three or six, but it has {len(value)}.")
        rest = [None if isinstance(n, (int, float)) and n == 0 else n for n in value[3:]]
        return Inertia(*value[:3], *rest)
    return as_leaf(value)
