"""Codes for a motion that cannot begin or has to stop; in a batch nothing can be raised."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Code, Each, EachFlag, Flag, Scalar
from clearance_jax._compile.lane_axis import each_lane
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.parameters import bounds_hold
from clearance_jax.solve.codes import Result
from clearance_jax.solve.start import is_possible
from clearance_jax.solve.tolerances import Tolerances, are_resolved


def refusal_of(
    mechanism: Mechanism, span: tuple[Scalar, Scalar], start: Array, errors: StartErrors, save_at: Array | None
) -> Code:
    """The code of a motion over a `span` (t0, t1) that cannot begin: impossible numbers, a `start` with too large
    `errors`, or sample times outside the span; 0 if it can.
    """
    t0, t1 = span
    possible = jnp.all(jnp.isfinite(start)) & jnp.isfinite(t1) & (t1 > t0)
    possible &= bounds_hold(mechanism) & is_possible(errors, mechanism)
    timely = jnp.asarray(int(Result.REACHED_END))
    if save_at is not None:
        timely = jnp.where(are_within(save_at, span), timely, int(Result.SAMPLE_TIMES))
    return jnp.where(possible, timely, int(Result.IMPOSSIBLE))


def unresolved(refused: Code, rtol: Scalar, atol: Any, allowed: Tolerances) -> Code:
    """The code, or that for tolerances below the resolution of floats."""
    return jnp.where((refused > 0) | are_resolved(rtol, atol, allowed), refused, int(Result.TOLERANCE))


def are_within(times: Array, span: tuple[Scalar, Scalar]) -> Flag:
    """Whether all times lie in a span (NaN does not)."""
    return jnp.all((times >= span[0]) & (times <= span[1]))


def leaves_walls(mechanism: PreparedMechanism) -> bool:
    """Whether a joint has walls that end."""
    return any(joint.clearance.joint.has_ends for joint in mechanism.clearance_joints())


def has_left(mechanism: PreparedMechanism, time: Each, y: Array) -> EachFlag:
    """Whether some joint's part is beyond its walls in a state of the motion; for mechanisms with walls that end."""

    def beyond(time, y, mechanism):
        pairs = zip(mechanism.clearance_joints(), relative_motions(time, y, mechanism), strict=True)
        reaches = [joint.clearance.joint.overhang(at) for joint, at in pairs if joint.clearance.joint.has_ends]
        return jnp.any(jnp.stack(reaches) > 0)

    return each_lane(beyond, time)(time, y, mechanism)


def why_stopped(code: Code, mechanism: PreparedMechanism, time: Scalar, y: Array) -> Any:
    """The code of a motion that stopped in a state, where a part may have left its walls."""
    if not leaves_walls(mechanism):
        return code
    left = (code == int(Result.STEP_COLLAPSED)) & has_left(mechanism, time, y)
    return jnp.where(left, int(Result.LEFT), code)
