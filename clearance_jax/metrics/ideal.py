"""The ideal mechanism beside the actual one: how freely it moves, and where it is."""

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.mobility import mobility
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout

# Newton steps from a pin's place in its sleeve to the ideal mechanism: each squares the error, some 1e-3 at first.
ASSEMBLE = 4


def freedom(ideal: Mechanism) -> int:
    """How many velocities drives and closures leave free; in space, where conditions repeat each other, as it is
    assembled. While its numbers are traced (jit, vmap, derivatives) all conditions are taken to be independent.

    **Raises:** `ClearanceError` where loops demand more than the joints can give: in the plane, and in space while
    which of them repeat others cannot be known.
    """
    free, loops = layout(ideal).free, ideal.closures()
    if ideal.may_repeat and not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(ideal)):
        with jax.ensure_compile_time_eval():
            return mobility(ideal).freedom
    left = free - sum(_condition_count(loop) for loop in loops) if ideal.may_repeat else free - 2 * len(loops)
    if left >= 0:
        return left
    if ideal.may_repeat:
        raise ClearanceError(
            "The loops of this mechanism are over-constrained: whether it moves freely depends on its numbers, which "
            "are not known under jit, vmap or differentiation. Ask for its error outside of them, or close a loop by "
            "a joint of more freedom (a `Spherical` instead of a `Revolute`, say)."
        )
    raise ClearanceError(
        "Without its clearances this mechanism is over-constrained: its loops demand more than its joints can "
        "give. For an error against the ideal mechanism free more coordinates."
    )


def _condition_count(loop) -> int:
    """How many conditions a loop's joint asks for in space."""
    hold = loop.joint_constraint()
    return (3 if hold.along is None else len(hold.along)) + len(hold.square)


def ideal_state(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """The state of the ideal mechanism, where drives and closures determine it: the actual one's, loops closed."""
    ideal = mechanism.ideal()
    plan, ideal_plan = layout(mechanism), layout(ideal)
    if ideal_plan.free == 0:
        return jnp.zeros(0)
    state = plan.split(y)
    places = (state.q[plan.positions.index(name)] for name in ideal_plan.positions)
    rates = (state.v[plan.velocities.index(name)] for name in ideal_plan.velocities)
    guess = jnp.stack([*places, *rates])
    return project(time, guess, ideal, ASSEMBLE)
