"""The vector field in rows: scalars in, scalars out.

It reads as the physics does: where everything is, what the joints exert, the equations of motion, the rates of the
laws' memories, the energy balance. The mechanism is an argument, so that no solve traces it again.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Flag, Rows, Scalar
from clearance_jax.dynamics.energy import powers
from clearance_jax.dynamics.equations import balance
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, position_rates, vector


def rate(
    time: Scalar, y: Rows, mechanism: PreparedMechanism, energy_balance: bool = False, counts: Flag | None = None
) -> Rows:
    """Time derivative of the state `[q, v, memory]`, and of the energy balance if it is integrated. Where `counts` is
    false the balance's rates are zeros.
    """
    mechanism = mechanism.at(time)
    state = layout(mechanism).split(y)
    now = balance(mechanism, time, state)
    memory = [rate for action in now.actions.values() for rate in action.memory_rate]
    memory += [jnp.zeros(())] * layout(mechanism).held
    rates = (*position_rates(mechanism, state.q, state.v), *(jnp.asarray(a, float) for a in now.acceleration), *memory)
    if not energy_balance:
        return rates
    return *rates, *where_it_counts(counts, lambda: powers(mechanism, time, state, now))


def where_it_counts(counts: Flag | None, rows: Callable[[], Rows]) -> Rows:
    """Rates that only some stages of a step need; zeros at the others."""
    if counts is None:
        return rows()
    shapes = jax.eval_shape(rows)
    return jax.lax.cond(counts, rows, lambda: tuple(jnp.zeros(x.shape, x.dtype) for x in shapes))


def slope(time: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """Time derivative of a state given as one vector `[q, v, memory]`."""
    return vector(rate(time, tuple(y[i] for i in range(layout(mechanism).size)), mechanism))
