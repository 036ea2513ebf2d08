"""Modes of small oscillations of the play about a settled pose: frequencies and damping ratios."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.kept import kept_jit
from clearance_jax.dynamics.closures import StartErrors
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.seated import play_moves
from clearance_jax.dynamics.settled import settle_start
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, move
from clearance_jax.solve.start import check_start
from clearance_jax.spatial import as_array

# A mode with a smaller damping ratio oscillates for more than a hundred radians (16 periods).
WEAKLY_DAMPED = 0.01


class Mode(NamedTuple):
    """A mode of small oscillations: its undamped natural `frequency` [Hz], and its damping `ratio` (at 1 or more it
    does not oscillate; below 0 it grows).
    """

    frequency: float
    ratio: float


def seated_modes(mechanism: Mechanism, time: float = 0.0) -> tuple[Mode, ...]:
    """The modes of a mechanism's play about its settled pose, the lowest frequency first.

    The accelerations of the play coordinates x are linearised about the pose: x'' = A x + B x'. All other coordinates
    move as they do at this time. An eigenvalue s of this equation has the frequency |s| / 2 pi and the ratio -Re s /
    |s|. For a motion that does not oscillate the ratio is 1.

    **Arguments:** `mechanism`; `time`: of the pose [s].

    **Raises:** `ClearanceError` for a mechanism without play, and if no settled pose is found.
    """
    if not mechanism.clearance_joints():
        raise ClearanceError("A mechanism without play has no modes of its play. Give a joint clearance.")
    stiff, loss, errors = _linearised(jnp.asarray(time, float), mechanism)
    check_start(mechanism, time, errors)
    stiff, loss = np.asarray(stiff), np.asarray(loss)
    roots = np.linalg.eigvals(np.block([[np.zeros_like(stiff), np.eye(len(stiff))], [stiff, loss]]))
    pairs = [(root, size) for root, size in zip(roots, np.abs(roots), strict=True) if root.imag >= 0]
    return tuple(sorted(Mode(float(s / (2 * np.pi)), float(-root.real / s) if s else 0.0) for root, s in pairs))


def _linearise(time: Scalar, mechanism: Mechanism) -> tuple[Array, Array, StartErrors]:
    """`linearise` at the settled pose, and the errors of this pose."""
    ready = mechanism.prepare().without_sampling().as_small_program()  # sampled controllers act continuously here
    y, errors = settle_start(time, ready)
    stiff, loss = linearise(time, y, ready)
    return stiff, loss, errors


def linearise(time: Scalar, y: Array, mechanism: PreparedMechanism) -> tuple[Float[Array, "play play"], ...]:
    """Derivatives of the play's accelerations by the play coordinates [1/s^2] and by their rates [1/s]."""
    plan = layout(mechanism)
    state = plan.split(y)
    ways, moves = play_moves(mechanism, time, y)
    zero = jnp.zeros(len(ways))

    def accelerations(change, rate):
        q = as_array(move(mechanism, state.q, list(moves @ change)))
        there = y.at[plan.q].set(q).at[plan.v].add(moves @ rate)
        return ways @ slope(time, there, mechanism)[plan.v]

    return jax.jacfwd(accelerations, (0, 1))(zero, zero)


_linearised = kept_jit(_linearise)
