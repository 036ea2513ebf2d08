"""The initial state of a solve: given values, loops assembled, pins settled if asked for."""

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.dynamics.applied import renew
from clearance_jax.dynamics.closures import StartErrors, assemble
from clearance_jax.dynamics.deflected import deflect, deflections, has_drives, hold_drives, released
from clearance_jax.dynamics.field import balance_at_start
from clearance_jax.dynamics.settled import settle_start
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.solve.settings import CENTRE, SETTLED
from clearance_jax.solve.steps.problem import Problem, widths


def initial(problem: Problem, t0: Scalar, y0: Array | None, start: str = CENTRE) -> tuple[Array, StartErrors]:
    """The state at t0 with its quadratures, and the errors of the start."""
    size, mechanism = problem.size, problem.mechanism
    errors = StartErrors.nothing()
    if y0 is None:
        y0, errors = closed_start(mechanism, t0, start)
    energy_balance = []
    if problem.energy_balance:
        energy_balance = [y0[size:] if y0.shape[0] > size else balance_at_start(t0, y0, mechanism)]
    return jnp.concatenate([y0[:size], *energy_balance, jnp.zeros(sum(widths(problem)))]), errors


@whole
def initial_state(mechanism: PreparedMechanism, t0: Scalar, start: str = CENTRE) -> Array:
    """The state `[q, v, memory]` at t0, see `closed_start`."""
    return closed_start(mechanism, t0, start)[0]


def closed_start(mechanism: PreparedMechanism, t0: Scalar, start: str = CENTRE) -> tuple[Array, StartErrors]:
    """The state at t0: the given initial values, then the nearest ones at which every loop is assembled; and the errors
    of the start (of a mechanism that is not to be assembled, none of loops).

    Every joint with clearance starts with its pin at `eccentricity` in the sleeve and at relative rest, with the
    positions and velocities of the ideal mechanism; or, with a settled `start`, pressed at the wall (see
    `settle_start`).
    """
    y, errors = _without_commands(mechanism, t0, start)
    plan = layout(mechanism)
    return measure_first(t0, jnp.concatenate([y, jnp.zeros(plan.integrated + plan.held)]), mechanism), errors


def _without_commands(mechanism: PreparedMechanism, t0: Scalar, start: str) -> tuple[Array, StartErrors]:
    """`closed_start`, without integrals and the efforts that sampled sources hold."""
    if start == SETTLED and mechanism.clearance_joints():
        return settle_start(t0, mechanism)
    if has_drives(mechanism):
        # Loops are closed and pins placed with drives and couplings held: they would be moved out of their gaps.
        if start == SETTLED:
            moved = deflect(t0, mechanism)
            y, errors = _without_commands(moved.held(), t0, start)
            return released(moved.mechanism, t0, y, moved.places), errors
        places = deflections(mechanism)
        y, errors = _without_commands(hold_drives(mechanism, places), t0, start)
        y = released(mechanism, t0, y, places, given=True)
        if any(coupling.backlash is not None for coupling in mechanism.couplings):
            # What a follower is given beside its leaders opens loops again, but by less than its gap.
            return _assembled(mechanism, t0, y, errors)
        return y, errors
    plan, errors = layout(mechanism), StartErrors.nothing()
    y = jnp.concatenate([initial_values(mechanism), jnp.zeros(plan.remembered - plan.integrated - plan.held)])
    return _assembled(mechanism, t0, y, errors)


def _assembled(mechanism: PreparedMechanism, t0: Scalar, y: Array, errors: StartErrors) -> tuple[Array, StartErrors]:
    """A state with loops assembled, if they are to be."""
    if mechanism.loops and mechanism.assemble:
        y, opened = assemble(t0, y, mechanism.as_small_program())
        errors = errors._replace(loops=opened)
    return y, errors


def measure_first(t0: Scalar, y: Array, mechanism: PreparedMechanism) -> Array:
    """The state with the first commands of everything that is sampled."""
    plan = layout(mechanism)
    if not plan.held:
        return y
    return y.at[plan.size - plan.held : plan.size].set(jnp.stack(renew(mechanism, t0, plan.split(y), starts=True)))
