"""The conditions of an ideal joint that closes a loop, each with its Jacobian and the wrench of its multiplier."""

from typing import NamedTuple

from clearance_jax._basis.symmetric import AbstractRow
from clearance_jax.dynamics.frames import AbstractMoves, Frames
from clearance_jax.dynamics.kinematics import sleeve_rotation
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import UNIT, ZERO, Term, Vector, absent, add, cross, dot, plus, scale, subtract


class Condition(NamedTuple):
    """One condition of a loop: its `gap` [m or rad], the rate of the gap, its acceleration without the free
    accelerations, and its Jacobian `row`; the force and torque on the child for a unit multiplier; and `moves`, the
    whole relative velocity (or spin) that each free coordinate makes, of which the row is a component.
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
        """Whether the structure of the mechanism meets it always."""
        return self.row.is_absent and absent((self.gap, self.rate, self.acceleration))


def conditions(loop: AbstractJoint, motion: Frames) -> list[Condition]:
    """The conditions of an ideal joint that closes a loop, without those that the structure meets (out of the plane of
    a plane mechanism, for example).
    """
    hold = loop.joint_constraint()
    a, b = motion[loop.parent], motion[loop.child]
    here, there = a.point(loop.at_parent.vector), b.point(loop.at_child.vector)
    sleeve = sleeve_rotation(loop, motion)
    if hold.along is None:
        out = _point_conditions(loop, motion, here, there)
    else:
        out = _plane_conditions([sleeve.apply(along) for along in hold.along], loop, motion, here, there)
    if hold.square:
        pin = loop.on_child(b)
        out += _square([(sleeve.apply(e), pin.apply(f)) for e, f in hold.square], loop, motion)
    return [c for c in out if not c.is_met]


def closure_conditions(motion: Frames) -> list[Condition]:
    """The conditions of all ideal closures of a mechanism."""
    return [condition for loop in motion.mechanism.closures() for condition in conditions(loop, motion)]


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
    """A point of the child b stays in planes through a point of the parent a that are normal to directions of a. Seen
    from a, the point of b moves against the point of a at the same place.
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
    moves, out = motion.spins(loop.child, loop.parent), []
    for e, f in pairs:
        normal = cross(f, e)
        change = add(cross(cross(b.spin, f), e), cross(f, cross(a.spin, e)))
        acceleration = plus(dot(spin_rate, normal), dot(spin, change))
        row = moves.along(normal)
        out.append(Condition(dot(e, f), dot(spin, normal), acceleration, row, ZERO, normal, moves))
    return out


def wrong_way(loop: AbstractJoint, motion: Frames) -> list[Term]:
    """The cosine between each pair of axes that must be parallel; 1 where they point the same way."""
    sleeve, pin = sleeve_rotation(loop, motion), loop.on_child(motion[loop.child])
    cosines = [dot(sleeve.apply(e), pin.apply(f)) for e, f in loop.joint_constraint().parallel]
    return [cosine for cosine in cosines if not isinstance(cosine, float)]
