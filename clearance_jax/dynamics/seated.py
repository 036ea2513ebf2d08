"""Frequencies of a seated pose: how fast pins swing about where they are pressed, and which loads they can follow.

The contact's stiffness K holds a pin that is pressed at its wall. Along the wall the stiffness is about force over
clearance, and about zero without a force. With the mass M of the play coordinates p, small motions about the pose obey
p'' = A (p - p0) with A = -M^-1 K. The frequencies are the roots of the eigenvalues of -A.

The place at which a load presses a pin moves with the load. A pin follows it only far below the lowest of these
frequencies, as a driven oscillator follows quasi-statically only far below resonance.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.small_matrices import small_eigh
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.conditions import closure_conditions, constraint
from clearance_jax.dynamics.kinematics import frames, relative_motions
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, parts
from clearance_jax.spatial import as_array, dot, minus, plus

# A direction with less than this part of the largest stiffness is held by round-off only.
LOOSE = 1e-12
Square = Float[Array, "play play"]


class Seated(NamedTuple):
    """How settled pins begin: which joints `rest` (1: at relative rest in the sleeve, as the place of rest is too fast
    to follow; 0: moving with it); by joint the `pace` of that place, in sizes of its play [1/s]; the lowest `frequency`
    of the pose [Hz].
    """

    rest: Float[Array, " joints"]
    pace: Float[Array, " joints"]
    frequency: Scalar


def followers(pace: Float[Array, " joints"], frequency: Scalar, together: bool) -> Float[Array, " joints"]:
    """Which joints rest (1): those whose place of rest crosses the play faster than a radian of the slowest motion."""
    rest = pace > 2 * jnp.pi * frequency
    return jnp.where(jnp.any(rest) if together else rest, jnp.ones(len(pace)), 0.0)


def lowest_frequency(
    mechanism: PreparedMechanism, time: Scalar, y: Array, stiffnesses: Sequence[Array], sizes: Sequence[Array]
) -> Scalar:
    """The lowest frequency [Hz] of the contacts in a state; by joint their `stiffnesses` [J, for play in units of its
    size], and the `sizes`. Directions without stiffness have no place of rest and are left out; 0 where it is negative.
    (The weight is left out too: it would add g over a length of the mechanism to (2 pi f)^2.)
    """
    size = jnp.concatenate(sizes)
    inverse = play_mobility(mechanism.as_small_program(), time, y) / (size[:, None] * size[None, :])
    values, ways = small_eigh(jax.scipy.linalg.block_diag(*stiffnesses))
    loose = jnp.sum(jnp.abs(values) <= LOOSE * jnp.max(jnp.abs(values)))
    root = (ways * jnp.sqrt(jnp.maximum(values, 0.0))[None, :]) @ ways.T
    # Directions that nothing holds come first, with zeros.
    squares, _ = small_eigh(root @ inverse @ root)
    return jnp.sqrt(jnp.maximum(squares[jnp.minimum(loose, len(squares) - 1)], 0.0)) / (2 * jnp.pi)


def play_mobility(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Square:
    """M^-1, the accelerations of the play by forces along it with ideal loops closed [1/kg], of turns [1/(kg m^2)]."""
    at, plan = mechanism.at(time), layout(mechanism)
    motion = frames(at, time, plan.split(y))
    inertia, ways = motion.mass_matrix(), _ways(mechanism, time, y)
    every = closure_conditions(motion)
    asked = constraint(inertia, every, at) if every else None

    def accelerations(force):
        free = inertia.solve([force[i] for i in range(plan.free)])
        if asked is not None:
            change, _ = asked.closure_step([minus(0.0, now.row.dot(free)) for now in every])
            free = [plus(a, b) for a, b in zip(free, change, strict=True)]
        return ways @ as_array(free)

    return jax.vmap(accelerations)(ways)


def play_moves(
    mechanism: PreparedMechanism, time: Scalar, y: Array
) -> tuple[Float[Array, "play free"], Float[Array, "free play"]]:
    """The rates of the play by the free velocities, and the smallest velocities that keep loops closed for them."""
    at, plan, ways = mechanism.at(time), layout(mechanism), _ways(mechanism, time, y)
    every = closure_conditions(frames(at, time, plan.split(y)))
    # The Jacobian of the conditions of ideal loops.
    closing = [jnp.stack([now.row.array for now in every])] if every else []
    return ways, jnp.linalg.pinv(jnp.concatenate([ways, *closing]))[:, : len(ways)]


def _ways(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Float[Array, "play free"]:
    """The rates of the play coordinates by the free velocities; in the tree the former are among the latter."""
    plan, joints = layout(mechanism), mechanism.clearance_joints()
    if all(joint.in_tree for joint in joints):
        places = {part.coordinate.name: part.v.start for part in parts(mechanism)}
        chosen = [places[joint.name + c.suffix] for joint in joints for c in joint.joint.play()]
        return jnp.asarray(np.eye(plan.free)[chosen])

    def rates(v):
        motions = relative_motions(time, y.at[plan.v].set(v), mechanism)[: len(joints)]
        # Slides come first, and turns are small: the sleeve's axes are those of the play.
        return as_array(
            dot(now.spin, c.turns) if c.slides is None else dot(now.velocity, c.slides)
            for joint, now in zip(joints, motions, strict=True)
            for c in joint.joint.play()
        )

    return jax.jacfwd(rates)(jnp.zeros(plan.free))
