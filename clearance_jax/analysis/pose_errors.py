"""Errors of a point where pins rest under their loads: the whole, and what the pin of each joint makes alone."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.pose import check_driven, displaced, ideal_states, poses
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.quasi_static import are_poses
from clearance_jax.spatial import as_array, subtract

__all__ = ["PoseErrors", "check_driven", "deviations", "pose_errors"]


class PoseErrors(NamedTuple):
    """Quasi-static errors of a point [m]: `whole` (times, 3), and `joints` (times, joints, 3) with the offset of one
    pin at a time; `good`: whether there is a pose at each time; its lowest `frequency` [Hz]; what is `drawn` of it.
    """

    whole: Float[Array, "times 3"]
    joints: Float[Array, "times joints 3"]
    good: Array
    frequency: Float[Array, " times"]
    drawn: Any


@solo_jit
def pose_errors(mechanism: Mechanism, index: int, times: Array, draw: Callable) -> PoseErrors:
    """The errors of the point with an index at times [s]. `draw`: a function of (prepared mechanism, time, state)."""
    ready = mechanism.prepare()
    ideal = ideal_states(ready, times)

    def at_instant(time, y, pose):
        at_rest = tuple(jnp.zeros_like(play) for play in pose.play)
        wanted = _place(ready, index, time, displaced(time, ready, at_rest, y))
        whole = subtract(_place(ready, index, time, pose.y), wanted)
        alone = []
        for k in range(len(pose.play)):
            play = (*at_rest[:k], pose.play[k], *at_rest[k + 1 :])
            alone.append(as_array(subtract(_place(ready, index, time, displaced(time, ready, play, y)), wanted)))
        good = are_poses(mechanism, pose.errors) & jnp.all(jnp.isfinite(pose.y))
        return PoseErrors(as_array(whole), jnp.stack(alone), good, pose.frequency, draw(ready, time, pose.y))

    return jax.vmap(at_instant)(times, ideal, poses(times, ready, ideal))


@solo_jit
def deviations(mechanism: Mechanism, index: int, times: Array, y: Array) -> Array:
    """The distance [m] of the point with an index from its ideal place, in states (times, n) of a solve."""
    ready = mechanism.prepare()
    rest = tuple(jnp.zeros(len(joint.joint.play())) for joint in ready.clearance_joints())

    def at_instant(time, y, ideal):
        wanted = _place(ready, index, time, displaced(time, ready, rest, ideal))
        return jnp.linalg.norm(as_array(subtract(_place(ready, index, time, y), wanted)))

    return jax.vmap(at_instant)(times, y[:, : layout(mechanism).size], ideal_states(ready, times))


def _place(mechanism: PreparedMechanism, index: int, time: Any, y: Array) -> Any:
    point = mechanism.points[index]
    return frames(mechanism, time, layout(mechanism).split(y))[point.body].point(point.at.vector)
