"""The static bound of an error: the largest that play alone allows at an instant, wherever loads press the pins."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax.dynamics.pose import displaced
from clearance_jax.joints.reach import farthest
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.metrics.signals import AbstractSignal

# Starting points, and iterations from each. An iteration never lowers a norm, and few are needed if one end of the
# mechanism moves by sums of parts.
STARTS, CLIMB = 6, 6


class Farthest(AbstractSignal):
    """The largest value of a signal over all places that rigid pins may have in their play.

    An error is nearly a norm of a linear function of the play, so it is largest on the boundary. Each iteration moves
    the play to the boundary point farthest along the error's gradient. It may end at a lower maximum, which is rare.
    The derivative is that at the place found, where the error is stationary but for the play's size.
    """

    needs_ideal: ClassVar[bool] = True
    signal: AbstractSignal

    @property
    def unit(self) -> str:  # type: ignore[override]
        return self.signal.unit

    def prepare(self, mechanism, t1, options):
        return Farthest(self.signal.prepare(mechanism, t1, options))

    def value(self, time, y, mechanism: PreparedMechanism, reference: Array | None):
        joints = mechanism.clearance_joints()
        counts = [len(joint.joint.play()) for joint in joints]
        given = time, mechanism, reference
        fixed = without_derivatives(given)

        def split(values):
            return tuple(jnp.split(values, np.cumsum(counts)[:-1]))

        def error(play, given):
            time, mechanism, reference = given
            return self.signal.value(time, displaced(time, mechanism, split(play), reference), mechanism, reference)

        def corner(weights, given):
            pins = [joint.clearance.joint for joint in given[1].clearance_joints()]
            return jnp.concatenate([farthest(pin, w) for pin, w in zip(pins, split(weights), strict=True)])

        def climb(weights):
            def once(_, weights):
                return jax.grad(error)(corner(weights, fixed), fixed)

            weights = jax.lax.fori_loop(0, CLIMB, once, weights)
            return weights, error(corner(weights, fixed), fixed)

        plays = [joint.joint.play() for joint in fixed[1].clearance_joints()]
        sizes = jnp.concatenate([jnp.stack([play.scale for play in joint_play]) for joint_play in plays])
        directions = np.random.default_rng(0).standard_normal((STARTS, sum(counts)))
        weights, reached = jax.vmap(climb)(directions / sizes[None])
        return error(corner(weights[jnp.argmax(reached)], given), given)
