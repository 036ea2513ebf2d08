"""The start of drives that give way: at rest under their load."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.field import slope
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.coordinate import Coordinate
from clearance_jax.mechanism.driving import gives_way, with_motions
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, parts
from clearance_jax.mechanism.tree import AbstractJoint

# Newton's iterations: what gives way is nearly linear, and so the second is round-off; the last two have derivatives.
ROUNDS = 4


def deflect(time: Scalar, mechanism: PreparedMechanism) -> PreparedMechanism:
    """The mechanism whose drives that give way start deflected, at rest relative to their motors: they do not
    accelerate while joints are ideal and everything else moves as prescribed.
    """
    springs = [part for part in parts(mechanism.ideal()) if gives_way(part.coordinate.motion)]
    if not springs:
        return mechanism
    ideal = mechanism.ideal().without_sampling().as_small_program()
    places, speeds = (np.array([getattr(part, which).start for part in springs]) for which in "qv")
    begin = initial_values(ideal)

    def accelerations(x: Array) -> Array:
        return slope(time, begin.at[places].set(x), ideal)[layout(ideal).v][speeds]

    def once(_, x):
        stiff = jax.lax.stop_gradient(jax.jacfwd(accelerations)(jax.lax.stop_gradient(x)))
        return x - jnp.linalg.solve(stiff, accelerations(x))

    positions = jax.lax.fori_loop(0, ROUNDS, once, begin[places])
    at = {part.coordinate.name: positions[i] for i, part in enumerate(springs)}

    def move(joint: AbstractJoint) -> AbstractJoint:
        def change(coordinate: Coordinate) -> Motion:
            if coordinate.name not in at:
                return coordinate.motion
            return dataclasses.replace(coordinate.motion, position=at[coordinate.name])

        return with_motions(joint, change)

    return dataclasses.replace(mechanism, joints=tuple(move(joint) for joint in mechanism.joints))
