"""The conditions of ideal joints that close loops, and which of them are independent constraints of the inertia.

A condition has its Jacobian and the wrench of its multiplier.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.symmetric import AbstractConstraint, AbstractFactors, Row
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.forms.frames import Frames, Moves, Pair
from clearance_jax.dynamics.kinematics import frames, sleeve_rotation
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.spatial import UNIT, ZERO, Term, Vector, absent, add, as_array, cross, dot, plus, scale, subtract


class Condition(NamedTuple):
    """One condition of a loop: its `gap` [m or rad], the rate of the gap, its acceleration without the free
    accelerations, and its Jacobian `row`; the force and torque on the child for a unit multiplier; and `moves`, the
    whole relative velocity (or spin) that each free coordinate makes, of which the row is a component.
    """

    gap: Term
    rate: Term
    acceleration: Term
    row: Row
    force: Vector
    torque: Vector
    moves: Moves


def conditions(loop: AbstractJoint, motion: Frames) -> list[Condition]:
    """The conditions of an ideal joint that closes a loop, without those that hold by structure (as in the plane)."""
    hold = loop.joint_constraint()
    a, b = motion[loop.parent], motion[loop.child]
    here, there = a.point(loop.at_parent.vector), b.point(loop.at_child.vector)
    sleeve = sleeve_rotation(loop, motion)
    # A point of b stays at a point of a, or in planes of a through that point. In planes it moves over a, so its
    # velocity is compared with that of the material point of a where it is now (`seen`).
    seen, directions = (here, UNIT) if hold.along is None else (there, [sleeve.apply(along) for along in hold.along])
    gap, rate = subtract(there, here), subtract(b.velocity_at(there), a.velocity_at(seen))
    acceleration = subtract(b.acceleration_at(there), a.acceleration_at(seen))
    if hold.along is not None:
        acceleration = subtract(acceleration, cross(scale(2.0, a.spin), rate))
    moves = motion.velocities(loop.child, there, loop.parent, seen)
    out = [
        Condition(dot(n, gap), dot(n, rate), dot(n, acceleration), moves.along(n), n, ZERO, moves) for n in directions
    ]
    if hold.square:
        pin = loop.on_child(b)
        out += _square([(sleeve.apply(e), pin.apply(f)) for e, f in hold.square], loop, motion)
    return [c for c in out if not (c.row.is_absent and absent((c.gap, c.rate, c.acceleration)))]


def closure_conditions(motion: Frames) -> list[Condition]:
    """The conditions of all ideal closures of a mechanism."""
    return [condition for loop in motion.mechanism.closures() for condition in conditions(loop, motion)]


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


# A condition repeats others if the square of the sine between them is below this. It is the square of how far loops may
# be open at the stages of a step.
REPEATED = 1e-6


def constraint(
    inertia: AbstractFactors, loop_conditions: Sequence[Condition], mechanism: PreparedMechanism
) -> AbstractConstraint:
    """The constraint that conditions put on the inertia."""

    def choose(matrix: Callable[[], Array]) -> Array | None:
        if not mechanism.may_repeat:
            return None
        return independent(matrix(), loop_conditions, inertia) if mechanism.chosen is None else mechanism.chosen

    return inertia.constraint([now.row for now in loop_conditions], choose)


def independent(
    matrix: Array, loop_conditions: Sequence[Condition], inertia: AbstractFactors
) -> Float[Array, " conditions"]:
    """Marks the conditions to solve for with 1, and those that follow from them with 0. In space a loop repeats itself
    as a rule: a four-bar linkage with parallel pins keeps its plane three times. Each turn takes the condition with the
    largest part that is independent of those taken before.

    The part is relative to the whole relative velocity or spin of which the condition is a component. (Relative to the
    component itself it could be large where both are round-off.) Conditions with forces and with moments are compared
    apart, because their sizes are not comparable.
    """
    count = len(loop_conditions)
    whole = as_array([now.moves.square(inertia.inverse_diagonal) for now in loop_conditions])
    forces = jnp.asarray([absent(now.torque) for now in loop_conditions])
    largest = jnp.where(forces, jnp.max(jnp.where(forces, whole, 0.0)), jnp.max(jnp.where(forces, 0.0, whole)))
    unit = jnp.sqrt(jnp.where(largest > 0, largest, 1.0))

    def once(_, carry):
        left, kept = carry
        remainders = jnp.where(kept > 0, 0.0, jnp.diagonal(left))
        best = jnp.argmax(remainders)
        good = remainders[best] > REPEATED
        column = left[best] / jnp.sqrt(jnp.where(good, remainders[best], 1.0))
        left = jnp.where(good, left - column[:, None] * column[None, :], left)
        return left, jnp.where(good & (jnp.arange(count) == best), 1.0, kept)

    begin = jax.lax.stop_gradient(matrix / (unit[:, None] * unit[None, :])), jnp.zeros(count)
    return jax.lax.fori_loop(0, min(count, loop_conditions[0].moves.count), once, begin)[1]


def choice(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Float[Array, " conditions"]:
    """The independent conditions of the closures in a state, see `independent`."""
    mechanism, plan = mechanism.at(time), layout(mechanism)
    motion = frames(mechanism, time, plan.split(y))
    return constraint(motion.mass_matrix(), closure_conditions(motion), mechanism).asked


def closing_pairs(loops: Sequence[AbstractJoint], motion: Frames, by_loop: list[list[Condition]], forces) -> list[Pair]:
    """The wrench of every closure on its child, from the multipliers of its conditions."""
    rest, out = iter(forces), []
    for loop, loop_conditions in zip(loops, by_loop, strict=True):
        force = torque = ZERO
        for condition in loop_conditions:
            multiplier = next(rest)
            force = add(force, scale(multiplier, condition.force))
            torque = add(torque, scale(multiplier, condition.torque))
        out.append(Pair(loop.parent, loop.child, force, torque, motion[loop.child].point(loop.at_child.vector)))
    return out
