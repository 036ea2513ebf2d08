"""The static bound of an error: the largest that play alone allows at an instant, wherever loads press the pins."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax.dynamics.pose import displaced
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.pin import AbstractPin
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.spatial import as_array

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
        if mechanism.gaps and not all(gap.what in ("friction", "stops") for gap in mechanism.gaps):
            raise ClearanceError(
                f"The fidelity `static` knows the play of joints only, and not the gap of `{mechanism.gaps[0].name}`. "
                "Take `quasi-static` or `dynamics`; the static bound of a point has a weight for every gap."
            ).about("fidelity", "static")
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


def farthest(clearance: AbstractClearance, weights: Float[Array, " play"]) -> Float[Array, " play"]:
    """The values of the play coordinates [m or rad] within free play that maximise their weighted sum: the largest
    displacement of a pin in a direction, with rigid walls.

    In a sleeve each end of the pin's axis may be anywhere in the radial clearance, in a guide each end of the block at
    any wall. Axial play and a turn about the axis have their own bounds. (Where a face and an edge touch at once, walls
    stop a pin earlier: the values are an upper bound.)

    **Raises:** `ClearanceError` for a sleeve that is worn by stations.
    """
    play = clearance.play()
    within = jnp.sign if clearance.flat else _ball
    worn = isinstance(clearance, AbstractPin) and clearance.depth is not None
    if all(c.turns is None for c in play):
        if not worn:
            return play[0].scale * within(weights)
        # In a worn bore the pin goes to the place where the wall is normal to the direction.
        known = jnp.any(jnp.abs(weights) > 0)
        x, y = jnp.where(known, _ball(weights), jnp.array([1.0, 0.0]))
        return jnp.where(known, as_array(clearance.press((x, y, 0.0), jnp.zeros(()))[:2]), 0.0)
    if worn:
        raise ClearanceError(
            "How far play lets a pin go that tilts must be asked of a round sleeve, but this one is worn by stations. "
            "Leave out its `depth`, or ask for the motion itself."
        ).about("depth")
    directions = [np.asarray(c.turns if c.slides is None else c.slides, float) for c in play]
    level = [k for k in range(len(play)) if directions[k][2] == 0]
    # Slides across the axis, and turns across it; the rest is along and about the axis.
    across, tilts = ([k for k in level if (play[k].slides is None) == turns] for turns in (False, True))
    radial, tilt = play[across[0]].scale, play[tilts[0]].scale
    half = radial / tilt
    # Lean of the axis along each slide by each tilt: z turned about the tilt's axis.
    leans = np.array([[np.cross(directions[t], [0, 0, 1]) @ directions[k] for t in tilts] for k in across])
    middle, end = weights[np.array(across)] / 2, leans @ weights[np.array(tilts)] / (2 * half)
    upper, lower = radial * within(middle + end), radial * within(middle - end)
    values = jnp.zeros(len(play)).at[np.array(across)].set((upper + lower) / 2)
    values = values.at[np.array(tilts)].set(leans.T @ (upper - lower) / (2 * half))
    for k in set(range(len(play))) - {*across, *tilts}:
        values = values.at[k].set(play[k].scale * jnp.sign(weights[k]))
    return values


def _ball(weights: Array) -> Array:
    """The point of the unit ball that is farthest along a direction; the middle for a zero direction."""
    size = jnp.linalg.norm(jnp.where(weights == 0, 0.0, weights))
    return weights / jnp.where(size > 0, size, 1.0)
