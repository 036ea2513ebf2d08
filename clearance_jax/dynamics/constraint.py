"""Conditions of closures solved for: the smallest change that meets them, and which of them to ask for at all."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.conditions import Condition, conditions
from clearance_jax.dynamics.frames import Frames, Pair
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import ZERO, absent, add, as_array, scale
from clearance_jax.symmetric import AbstractConstraint, AbstractFactors

# A condition of which less than this is its own, in the square of a sine, repeats others: such is the square of how
# far from closed the stages of a step may be.
REPEATED = 1e-6


def constraint(inertia: AbstractFactors, held: Sequence[Condition], mechanism: PreparedMechanism) -> AbstractConstraint:
    """What conditions ask of the inertia."""

    def choose(matrix: Callable[[], Array]) -> Array | None:
        if not mechanism.may_repeat:
            return None
        return independent(matrix(), held, inertia) if mechanism.chosen is None else mechanism.chosen

    return inertia.constraint([now.row for now in held], choose)


def independent(matrix: Array, held: Sequence[Condition], inertia: AbstractFactors) -> Float[Array, " conditions"]:
    """Which conditions to ask for (1), where others follow from them (0): a loop in space repeats itself as a rule (a
    four-bar linkage of parallel pins holds its plane three times). One after the other the one that most of is left of,
    without what those before it hold already.

    Each is measured by the whole motion that it is a component of (not by its own: of one that is met always that is
    round-off); forces and moments apart, for neither says how large the other is.
    """
    count = len(held)
    whole = as_array([now.moves.square(inertia.inverse_diagonal) for now in held])
    forces = jnp.asarray([absent(now.torque) for now in held])
    largest = jnp.where(forces, jnp.max(jnp.where(forces, whole, 0.0)), jnp.max(jnp.where(forces, 0.0, whole)))
    unit = jnp.sqrt(jnp.where(largest > 0, largest, 1.0))

    def once(_, carry):
        left, kept = carry
        own = jnp.where(kept > 0, 0.0, jnp.diagonal(left))
        best = jnp.argmax(own)
        good = own[best] > REPEATED
        column = left[best] / jnp.sqrt(jnp.where(good, own[best], 1.0))
        left = jnp.where(good, left - column[:, None] * column[None, :], left)
        return left, kept.at[best].set(jnp.where(good, 1.0, kept[best]))

    begin = jax.lax.stop_gradient(matrix / (unit[:, None] * unit[None, :])), jnp.zeros(count)
    return jax.lax.fori_loop(0, min(count, held[0].moves.count), once, begin)[1]


def choice(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Float[Array, " conditions"]:
    """Which conditions of the closures to ask for at a state, see `independent`."""
    mechanism, plan = mechanism.at(time), layout(mechanism)
    motion = frames(mechanism, time, plan.split(y))
    held = [now for loop in mechanism.closures() for now in conditions(loop, motion)]
    return constraint(motion.mass_matrix(), held, mechanism).asked


def closing_pairs(loops: Sequence[AbstractJoint], motion: Frames, held: list[list[Condition]], forces) -> list[Pair]:
    """The wrench of every closure on its child, by the multipliers of its conditions."""
    rest, out = iter(forces), []
    for loop, own in zip(loops, held, strict=True):
        force = torque = ZERO
        for condition in own:
            multiplier = next(rest)
            force = add(force, scale(multiplier, condition.force))
            torque = add(torque, scale(multiplier, condition.torque))
        out.append(Pair(loop.parent, loop.child, force, torque, motion[loop.child].point(loop.at_child.vector)))
    return out
