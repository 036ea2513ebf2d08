"""What an ideal joint that closes a loop asks for: its conditions, each with its Jacobian and what it exerts."""

from typing import NamedTuple

from clearance_jax.dynamics.frames import AbstractMoves, Frames
from clearance_jax.dynamics.kinematics import sleeve_rotation
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import (
    UNIT,
    ZERO,
    Term,
    Vector,
    absent,
    add,
    cross,
    dot,
    plus,
    scale,
    subtract,
)
from clearance_jax.symmetric import AbstractRow


class Condition(NamedTuple):
    """One condition of a loop: how far it is violated [m or rad], the rate of that, its acceleration without the free
    coordinates' accelerations, its Jacobian; what a unit of its multiplier exerts on the child; and the whole relative
    velocity (or spin) that each free coordinate makes, of which the row is a component.
    """

    gap: Term
    rate: Term
    acceleration: Term
    row: AbstractRow
    force: Vector
    torque: Vector
    moves: AbstractMoves

    @property
    def is_met(self) -> bool:
        """Whether it is met by structure."""
        return self.row.is_absent and absent((self.gap, self.rate, self.acceleration))


def conditions(loop: AbstractJoint, motion: Frames) -> list[Condition]:
    """The conditions of an ideal joint that closes a loop. One that is met by structure, as those out of its plane by a
    plane mechanism, is left out.
    """
    hold = loop.joint_constraint()
    a, b = motion[loop.parent], motion[loop.child]
    here, there = a.point(loop.at_parent.vector), b.point(loop.at_child.vector)
    sleeve = sleeve_rotation(loop, motion)
    if hold.along is None:
        found = _point_conditions(loop, motion, here, there)
    else:
        found = _plane_conditions([sleeve.apply(along) for along in hold.along], loop, motion, here, there)
    if hold.square:
        pin = loop.on_child(b)
        found += _square([(sleeve.apply(e), pin.apply(f)) for e, f in hold.square], loop, motion)
    return [c for c in found if not c.is_met]


def _point_conditions(loop: AbstractJoint, motion: Frames, here: Vector, there: Vector) -> list[Condition]:
    """A point of the child b stays at a point of the parent a."""
    a, b = motion[loop.parent], motion[loop.child]
    gap = subtract(there, here)
    rate = subtract(b.velocity_at(there), a.velocity_at(here))
    acceleration = subtract(b.acceleration_at(there), a.acceleration_at(here))
    moves = motion.velocities(loop.child, there, loop.parent, here)
    return [
        Condition(gap[k], rate[k], acceleration[k], moves.along(along), along, ZERO, moves)
        for k, along in enumerate(UNIT)
    ]


def _plane_conditions(
    directions: list[Vector], loop: AbstractJoint, motion: Frames, here: Vector, there: Vector
) -> list[Condition]:
    """A point of the child b stays in planes through a point of the parent a that are square to directions of a. (Seen
    from a: what moves is the point of b over the point of a that it is at.)
    """
    a, b = motion[loop.parent], motion[loop.child]
    velocity = subtract(b.velocity_at(there), a.velocity_at(there))
    coriolis = cross(scale(2.0, a.spin), velocity)
    acceleration = subtract(subtract(b.acceleration_at(there), a.acceleration_at(there)), coriolis)
    moves = motion.velocities(loop.child, there, loop.parent, there)
    return [
        Condition(
            dot(along, subtract(there, here)),
            dot(along, velocity),
            dot(along, acceleration),
            moves.along(along),
            along,
            ZERO,
            moves,
        )
        for along in directions
    ]


def _square(pairs: list[tuple[Vector, Vector]], loop: AbstractJoint, motion: Frames) -> list[Condition]:
    """Axes of the parent a and of the child b stay perpendicular."""
    a, b = motion[loop.parent], motion[loop.child]
    spin, spin_rate = subtract(b.spin, a.spin), subtract(b.spin_rate, a.spin_rate)
    moves, found = motion.spins(loop.child, loop.parent), []
    for e, f in pairs:
        normal = cross(f, e)
        change = add(cross(cross(b.spin, f), e), cross(f, cross(a.spin, e)))
        acceleration = plus(dot(spin_rate, normal), dot(spin, change))
        row = moves.along(normal)
        found.append(Condition(dot(e, f), dot(spin, normal), acceleration, row, ZERO, normal, moves))
    return found


def wrong_way(loop: AbstractJoint, motion: Frames) -> list[Term]:
    """Of the axes that are to be one line: the cosine between them, 1 where they point the same way."""
    sleeve, pin = sleeve_rotation(loop, motion), loop.on_child(motion[loop.child])
    found = [dot(sleeve.apply(e), pin.apply(f)) for e, f in loop.joint_constraint().parallel]
    return [cosine for cosine in found if not isinstance(cosine, float)]
