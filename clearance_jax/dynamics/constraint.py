"""Closure conditions as a constraint of the inertia, and the choice of independent conditions."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.symmetric import AbstractConstraint, AbstractFactors
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.conditions import Condition, closure_conditions
from clearance_jax.dynamics.frames import Frames, Pair
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import ZERO, absent, add, as_array, scale

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

    The part is relative to the whole motion of which the condition is a component, because the condition's own motion
    may be round-off. Forces and moments are compared apart, because their sizes are not comparable.
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
