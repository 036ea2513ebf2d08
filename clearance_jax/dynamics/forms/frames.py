"""Pose and motion of all bodies in one state, and their inertia, loads and energies: one interface to two forms.

A small mechanism is written out number by number (`write_out`); a large one is a few loops over a table of its links
(`table`). `kinematics.frames` takes the form of the mechanism, and its callers need not know which it is.
"""

import abc
from collections.abc import Callable, Mapping
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.symmetric import AbstractFactors, Row
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.body import Motor
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import parts
from clearance_jax.mechanism.tree.frame import Frame, JacobianColumn
from clearance_jax.spatial import (
    ZERO,
    Term,
    Vector,
    absent,
    add,
    as_array,
    cross,
    dot,
    is_zero,
    minus,
    subtract,
    times,
    total,
)


class Pair(NamedTuple):
    """Equal and opposite wrenches between two bodies: force and torque on `child` at the world point `at`."""

    parent: str
    child: str
    force: Vector
    torque: Vector
    at: Vector


class SpatialForce(NamedTuple):
    """A force and a moment about a pivot (or a momentum, and an angular momentum about it)."""

    force: Vector = ZERO
    moment: Vector = ZERO

    def move(self, by: Vector) -> "SpatialForce":
        """The same wrench about another pivot, from which `by` leads to its own."""
        return SpatialForce(self.force, add(self.moment, cross(by, self.force)))

    def on(self, column: JacobianColumn, pivot: Vector) -> Term:
        """Its power per unit rate of a column."""
        if column.pivot is None:
            return dot(column.axis, self.force)
        return dot(column.axis, self.move(subtract(pivot, column.pivot)).moment)

    def __add__(self, other) -> "SpatialForce":
        return SpatialForce(add(self.force, other.force), add(self.moment, other.moment))


class Moves:
    """The velocity or spin by each free coordinate per unit of its rate: vectors, or an array (free, 3)."""

    def __init__(self, every: list[Vector] | Array):
        self.every = every

    @property
    def array(self) -> Float[Array, "free 3"]:
        """All of them as one array."""
        if isinstance(self.every, list):
            return jnp.stack([jnp.zeros(3) if absent(move) else as_array(move) for move in self.every])
        return self.every

    @property
    def count(self) -> int:
        """The number of free velocities."""
        return len(self.every)

    def along(self, direction: Vector) -> Row:
        """Their components along a direction."""
        if isinstance(self.every, list):
            return Row([dot(direction, move) for move in self.every])
        return Row(self.every @ as_array(direction))

    def square(self, weights) -> Term:
        """The sum of their squares, weighted."""
        if isinstance(self.every, list):
            squares = [dot(move, move) for move in self.every]
            return total(times(weights[i], square) for i, square in enumerate(squares) if not is_zero(square))
        return jnp.sum(self.every**2, axis=1) @ as_array(weights)


class Extra(NamedTuple):
    """What the free accelerations add to those of `Frame`: `at(body, point)` to the acceleration of a body's point, and
    `spin_rate(body)` to its spin rate. (Use it in the trace that made it.)
    """

    at: Callable[[str, Vector], Vector]
    spin_rate: Callable[[str], Vector]


class Frames(abc.ABC):
    """The frames of all bodies in one state, by name, with inertia, loads and energies there. `acceleration`: of each
    free velocity; `None`: accelerations without that part, as in `Frame`.
    """

    mechanism: PreparedMechanism
    is_solved_implicitly: ClassVar[bool]
    """Whether derivatives of accelerations follow from those of the equations' residual, by the known factors, and not
    from the derivatives of each operation that computes them.
    """

    @abc.abstractmethod
    def __getitem__(self, body: str) -> Frame:
        """The frame of a body."""

    def with_motions(self) -> "Frames":
        """The same, with what several quantities need of the bodies' motions computed once."""
        return self

    @abc.abstractmethod
    def velocities(self, body: str, point: Vector, base: str | None = None, beside: Vector = ZERO) -> Moves:
        """The velocity by each free coordinate of a body's place `point`, less that of a base's place `beside`."""

    @abc.abstractmethod
    def spins(self, body: str, base: str | None = None) -> Moves:
        """The spin that each free coordinate gives to a body, less that of a base."""

    @abc.abstractmethod
    def extra(self, acceleration: list[Term]) -> Extra:
        """What free accelerations add to the accelerations of `Frame`."""

    @abc.abstractmethod
    def mass_matrix(self, firm: Mapping[int, Term] | None = None) -> AbstractFactors:
        """The factored mass matrix of the free coordinates; `firm`: factors on the inertia of some of them. (If it is
        given, even empty, the matrix is written down first, except in a table.)
        """

    @abc.abstractmethod
    def wrenches(self, acceleration: list[Term]) -> dict[str, SpatialForce]:
        """By body: weight minus inertia forces of it and of all that hangs on it, about its pivot."""

    @abc.abstractmethod
    def load_without_rotors(self, pairs: list[Pair], acceleration: list[Term] | None) -> list[Term]:
        """`load` without the inertia of rotors."""

    @abc.abstractmethod
    def drive_forces(self, pairs: list[Pair], acceleration: list[Term]) -> list[tuple[Term, Term]]:
        """Driving force and speed of every prescribed coordinate, by d'Alembert's principle on its own column."""

    @abc.abstractmethod
    def kinetic_exchange(self, acceleration: list[Term]) -> Array:
        """Rate at which kinetic energy is exchanged [W]: in the plane the absolute rate of the whole. In space each
        body and axis counts by itself, because free flight exchanges energy between them at a constant total.
        """

    @abc.abstractmethod
    def energies(self) -> tuple[Term, Term]:
        """Kinetic energy, without rotors, and potential energy of weight [J]."""

    def load(self, pairs: list[Pair], acceleration: list[Term] | None = None) -> list[Term]:
        """Generalised forces of the free coordinates: weight, inertia of the prescribed and centripetal motion, and
        wrenches between bodies; with `acceleration` also its inertia.
        """
        load = self.load_without_rotors(pairs, acceleration)
        if acceleration is not None:
            for i, inertia in rotors(self.mechanism).items():
                load[i] = minus(load[i], times(inertia, acceleration[i]))
        return load


def rotors(mechanism: PreparedMechanism) -> dict[int, Term]:
    """The inertia of motors' rotors, by the index of their free velocity.

    **Raises:** `ClearanceError` for a free motor of an elastic drive that has none: nothing would say how it moves.
    """
    out = {}
    for coordinate, _, v in parts(mechanism):
        inertia = coordinate.motion.rotor_inertia
        if inertia is not None:
            out[v.start] = inertia
        elif isinstance(coordinate.motion, Motor):
            text = (
                f"The motor `{coordinate.name}` moves freely and has no inertia: give its `rotor_inertia`, or a drive."
            )
            raise ClearanceError(text).about(coordinate.name)
    return out
