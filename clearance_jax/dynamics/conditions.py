"""What an ideal joint that closes a loop asks for: its conditions, each with its Jacobian and what it exerts."""

from typing import Any, NamedTuple

import jax

from clearance_jax.dynamics.kinematics import Frames, sleeve_rotation
from clearance_jax.dynamics.table import Columns
from clearance_jax.mechanism.frame import Frame
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import (
    UNIT,
    ZERO,
    Term,
    Vector,
    absent,
    add,
    as_array,
    cross,
    dot,
    plus,
    scale,
    subtract,
    times,
    total,
)


class Condition(NamedTuple):
    """One condition of a loop: how far it is violated [m or rad], the rate of that, its acceleration without the free
    coordinates' accelerations, its Jacobian; what a unit of its multiplier exerts on the child; and the whole relative
    velocity (or spin) that each free coordinate makes, of which the row is a component.
    """

    gap: Term
    rate: Term
    acceleration: Term
    row: Any
    force: Vector
    torque: Vector
    moves: Any

    @property
    def is_met(self) -> bool:
        """Whether it is met by structure."""
        row = (1.0,) if isinstance(self.row, jax.Array) else self.row
        return absent((*row, self.gap, self.rate, self.acceleration))

    def reached(self, values: list[Term]) -> Term:
        """Its row times values of the free velocities."""
        if isinstance(self.row, jax.Array):
            return self.row @ as_array(values)
        return total(times(r, value) for r, value in zip(self.row, values, strict=True))


def conditions(loop: AbstractJoint, motion: Frames, count: int) -> list[Condition]:
    """The conditions of an ideal joint that closes a loop, of a mechanism with `count` free velocities. One that is
    met by structure, as those out of its plane by a plane mechanism, is left out.
    """
    hold = loop.hold()
    a, b = motion[loop.parent], motion[loop.child]
    here, there = a.point(loop.at_parent.vector), b.point(loop.at_child.vector)
    sleeve = sleeve_rotation(loop, motion)
    if hold.along is None:
        found = _held(a, here, b, there, count)
    else:
        found = _held_along([sleeve.apply(along) for along in hold.along], a, here, b, there, count)
    if hold.square:
        pin = loop.on_child(b)
        found += _square([(sleeve.apply(e), pin.apply(f)) for e, f in hold.square], a, b, count)
    return [c for c in found if not c.is_met]


def _moves(a: Frame, b: Frame, count: int, of_a, of_b) -> Any:
    """Of every free coordinate what it does to b, seen from a; by what each column of the two bodies does."""
    if isinstance(b.free, Columns):
        return of_b(b.free) - of_a(a.free)
    moves = [ZERO] * count
    for column in b.free:
        moves[column.index] = of_b(column)
    for column in a.free:
        moves[column.index] = subtract(moves[column.index], of_a(column))
    return moves


def _along(direction: Vector, moves: Any) -> Any:
    """A component of what the free coordinates do."""
    if isinstance(moves, jax.Array):
        return moves @ as_array(direction)
    return [dot(direction, move) for move in moves]


def _held(a: Frame, here: Vector, b: Frame, there: Vector, count: int) -> list[Condition]:
    """A point of b stays at a point of a."""
    gap = subtract(there, here)
    rate = subtract(b.velocity_at(there), a.velocity_at(here))
    acceleration = subtract(b.acceleration_at(there), a.acceleration_at(here))
    moves = _moves(a, b, count, lambda c: c.velocity_at(here), lambda c: c.velocity_at(there))
    return [
        Condition(gap[k], rate[k], acceleration[k], _along(along, moves), along, ZERO, moves)
        for k, along in enumerate(UNIT)
    ]


def _held_along(
    directions: list[Vector], a: Frame, here: Vector, b: Frame, there: Vector, count: int
) -> list[Condition]:
    """A point of b stays in planes through a point of a that are square to directions of a. (Seen from a: what moves is
    the point of b over the point of a that it is at.)
    """
    velocity = subtract(b.velocity_at(there), a.velocity_at(there))
    coriolis = cross(scale(2.0, a.spin), velocity)
    acceleration = subtract(subtract(b.acceleration_at(there), a.acceleration_at(there)), coriolis)
    moves = _moves(a, b, count, lambda c: c.velocity_at(there), lambda c: c.velocity_at(there))
    return [
        Condition(
            dot(along, subtract(there, here)),
            dot(along, velocity),
            dot(along, acceleration),
            _along(along, moves),
            along,
            ZERO,
            moves,
        )
        for along in directions
    ]


def _square(pairs: list[tuple[Vector, Vector]], a: Frame, b: Frame, count: int) -> list[Condition]:
    """Axes of a and of b stay perpendicular."""
    spin, spin_rate = subtract(b.spin, a.spin), subtract(b.spin_rate, a.spin_rate)
    moves, found = _moves(a, b, count, lambda c: c.spin, lambda c: c.spin), []
    for e, f in pairs:
        normal = cross(f, e)
        change = add(cross(cross(b.spin, f), e), cross(f, cross(a.spin, e)))
        acceleration = plus(dot(spin_rate, normal), dot(spin, change))
        row = _along(normal, moves)
        found.append(Condition(dot(e, f), dot(spin, normal), acceleration, row, ZERO, normal, moves))
    return found


def wrong_way(loop: AbstractJoint, motion: Frames) -> list[Term]:
    """Of the axes that are to be one line: the cosine between them, 1 where they point the same way."""
    sleeve, pin = sleeve_rotation(loop, motion), loop.on_child(motion[loop.child])
    found = [dot(sleeve.apply(e), pin.apply(f)) for e, f in loop.hold().parallel]
    return [cosine for cosine in found if not isinstance(cosine, float)]
