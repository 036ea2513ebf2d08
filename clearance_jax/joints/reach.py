"""The largest displacement of a pin in a direction that play alone allows, with rigid walls."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.pin import AbstractPin
from clearance_jax.spatial import as_array


def farthest(clearance: AbstractClearance, weights: Float[Array, " play"]) -> Float[Array, " play"]:
    """The values of the play coordinates [m or rad] within free play that maximise their weighted sum.

    In a sleeve each end of the pin's axis may be anywhere in the radial clearance, in a guide each end of the block at
    any wall. Axial play and a turn about the axis have their own bounds. (Where a face and an edge touch at once, walls
    stop a pin earlier: the values are an upper bound.)

    **Raises:** `ClearanceError` for a sleeve that is worn by stations.
    """
    play = clearance.play()
    within = jnp.sign if clearance.flat else _ball
    worn = isinstance(clearance, AbstractPin) and clearance.depth is not None
    if all(c.turns is None for c in play):
        return _in_bore(clearance, weights) if worn else play[0].scale * within(weights)
    if worn:
        raise ClearanceError(
            "How far play lets a pin go that tilts must be asked of a round sleeve, but this one is worn by stations. "
            "Leave out its `depth`, or ask for the motion itself."
        )
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


def _in_bore(clearance: AbstractClearance, weights: Array) -> Array:
    """The place in a worn bore that is farthest along a direction, where the wall is normal to it."""
    size = jnp.linalg.norm(jnp.where(weights == 0, 0.0, weights))
    known = size > 0
    x, y = jnp.where(known, weights / jnp.where(known, size, 1.0), jnp.array([1.0, 0.0]))
    return jnp.where(known, as_array(clearance.press((x, y, 0.0), jnp.zeros(()))[:2]), 0.0)


def _ball(weights: Array) -> Array:
    """The point of the unit ball that is farthest along a direction; the middle for a zero direction."""
    size = jnp.linalg.norm(jnp.where(weights == 0, 0.0, weights))
    return weights / jnp.where(size > 0, size, 1.0)
