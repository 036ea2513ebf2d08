"""Mobility and state of the ideal mechanism, to which errors refer."""

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import mobility, project
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout

# Newton steps from a pin's place to the ideal mechanism. Each squares the error, which is small at first.
ASSEMBLE = 4


def freedom(ideal: Mechanism) -> int:
    """The number of velocities that drives and closures leave free. In space, where conditions may repeat each other,
    it is that of the assembled mechanism. For traced numbers (jit, vmap, derivatives) all conditions count as
    independent.

    **Raises:** `ClearanceError` if loops demand more than the joints can give: in the plane, and in space if repeated
    conditions cannot be known.
    """
    free, loops = layout(ideal).free, ideal.closures()
    if ideal.may_repeat and not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(ideal)):
        with jax.ensure_compile_time_eval():
            return mobility(ideal).freedom
    counts = (loop.joint_constraint().count if ideal.may_repeat else 2 for loop in loops)
    left = free - sum(counts)
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


def ideal_state(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """The state of an ideal mechanism that drives and closures determine: the actual one's, with loops closed."""
    ideal = mechanism.intended()
    plan, ideal_plan = layout(mechanism), layout(ideal)
    if ideal_plan.free == 0:
        return jnp.zeros(0)
    state = plan.split(y)
    places = (state.q[plan.positions.index(name)] for name in ideal_plan.positions)
    rates = (state.v[plan.velocities.index(name)] for name in ideal_plan.velocities)
    guess = jnp.stack([*places, *rates])
    return project(time, guess, ideal, ASSEMBLE)
