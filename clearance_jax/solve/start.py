"""Whether a motion can begin and go on: in words for one motion, in codes for a batch, which cannot raise."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Code, Each, EachFlag, Flag, Scalar
from clearance_jax._compile.lane_axis import each_lane
from clearance_jax.dynamics.closures import StartErrors, mobility
from clearance_jax.dynamics.kinematics import relative_motions
from clearance_jax.dynamics.seated import Seated
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.parameters import bounds_hold
from clearance_jax.solve.codes import Result
from clearance_jax.solve.steps.tolerances import Tolerances, are_resolved, largest_length

# A loop open by more than this part of the largest length is not assembled.
CLOSED = 1e-10
# A pin is not settled if more than this part of its load is not borne, or if it moves by more than this part of its
# play from round to round. A successful search leaves far less than 1e-9.
AT_REST = 1e-3


def is_possible(errors: StartErrors, mechanism: Mechanism, closed: float = CLOSED, at_rest: float = AT_REST) -> Flag:
    """Whether all loops are closed (by a part of the largest length), and all pins rest (by parts of load and play)."""
    loops = jnp.all(errors.loops <= closed * largest_length(mechanism))
    return loops & jnp.all(errors.unborne <= at_rest) & jnp.all(errors.moved <= at_rest)


def check_start(mechanism: Mechanism, t0: Any, errors: StartErrors) -> None:
    """Raise if a loop stays open at the start or a pin finds no rest, naming it."""
    _check_assembled(mechanism, t0, errors.loops, errors.unborne.size > 0)
    unborne, moved = (np.nan_to_num(np.asarray(part), nan=np.inf) for part in (errors.unborne, errors.moved))
    if np.all(unborne <= AT_REST) and np.all(moved <= AT_REST):
        return
    worst = int(np.argmax(np.maximum(unborne, moved)))
    name = mechanism.clearance_joints()[worst].name
    raise ClearanceError(
        f"The mechanism cannot be settled: at t = {float(t0):g} s joint `{name}` "
        f"finds no rest under the load of the ideal joint: it does not bear {100 * unborne[worst]:.3g} % of it, and "
        f"its play still changes by {100 * moved[worst]:.3g} % from round to round. Give it a stiffer normal law, or "
        'begin with `start = "centre"`.'
    ).about(name)


def rest_words(mechanism: Mechanism, seated: Seated | None) -> str:
    """Which joints of a settled start begin at relative rest, and why, in words; empty if there are none."""
    joints = [joint.name for joint in mechanism.clearance_joints()]
    rest = np.asarray(0.0 if seated is None else seated.rest)
    if seated is None or not np.any(rest):
        return ""
    pace, limit = np.asarray(seated.pace), 2 * np.pi * float(seated.frequency)
    rests = [k for k in range(len(joints)) if rest[k] > 0]
    named = ", ".join(f"`{joints[k]}` ({pace[k]:.3g} of its play a second)" for k in rests)
    text = (
        f"begins at relative rest at the wall: {named}. A pin follows where its load presses it up to {limit:.3g} of "
        f"its play a second, 2 pi times the lowest frequency of the pose, {float(seated.frequency):.3g} Hz"
    )
    if np.any(pace[rests] <= limit):
        text += "; pins that close a loop begin so together"
    return text + "."


def _check_assembled(mechanism: Mechanism, t0: Any, open_loops: Array, settled: bool) -> None:
    """Raise if a loop stays open at the start, naming it; `open_loops`: openings [m]; `settled`: with pins at walls."""
    gaps = np.nan_to_num(np.asarray(open_loops), nan=np.inf)
    if np.all(gaps <= CLOSED * float(largest_length(mechanism, np))):
        return
    worst = int(np.argmax(gaps))
    loop = mechanism.loops[worst].name
    message = (
        f"The mechanism cannot be assembled: at t = {float(t0):g} s its loop `{loop}` stays "
        f"open by {float(gaps[worst]) * 1e3:.4g} mm"
        f"{', or a pin leaves its sleeve by as much' * bool(mechanism.clearance_joints())}. "
    )
    finite = np.all(np.isfinite(gaps))
    if finite and settled and (repeated := mobility(mechanism.ideal(), float(t0)).repeated):
        raise ClearanceError(
            f"The mechanism cannot be settled: without its clearances it is over-constrained ({repeated} of the "
            "conditions of its loops only repeat others), and with its pins at their walls its loops do not close. "
            "Where pins rest then depends on how all joints together give way, which a settled start does not find. "
            'Begin with `start = "centre"`.'
        )
    repeated = mobility(mechanism, float(t0)).repeated if finite else 0
    if repeated:
        message += (
            f"It is over-constrained: {repeated} of the conditions of its loops only repeat others, so that it closes "
            "only where its lengths and angles fit each other. Give them with all digits, or by the exact relation "
            "between them, or close the loop by a joint of more freedom (a `Spherical` instead of a `Revolute`, say). "
            "Where it is open by far, change"
        )
    else:
        message += "Change"
    raise ClearanceError(f"{message} lengths, or the joints' `position`, to start nearer to a closed one.").about(loop)


def refusal_of(
    mechanism: Mechanism, span: tuple[Scalar, Scalar], start: Array, errors: StartErrors, save_at: Array | None
) -> Code:
    """The code of a motion over a `span` (t0, t1) that cannot begin, by its numbers, errors or samples; 0 if it can."""
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
        pairs = list(zip(mechanism.contacts(), relative_motions(time, y, mechanism), strict=True))
        reaches = [joint.clearance.joint.overhang(at) for joint, at in pairs if joint.clearance.joint.has_ends]
        return jnp.any(jnp.stack(reaches) > 0)

    return each_lane(beyond, time)(time, y, mechanism)


def why_stopped(code: Code, mechanism: PreparedMechanism, time: Scalar, y: Array) -> Any:
    """The code of a motion that stopped in a state, where a part may have left its walls."""
    if not leaves_walls(mechanism):
        return code
    left = (code == int(Result.STEP_COLLAPSED)) & has_left(mechanism, time, y)
    return jnp.where(left, int(Result.LEFT), code)
