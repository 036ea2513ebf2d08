"""Errors of a point where pins rest under their loads: the whole, and what the pin of each joint makes alone; and its
reach: derivatives of its place in the ideal motion by the play, or by an offset, in joints.
"""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._compile.solo import solo_jit
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.deflected import deflections, hold_drives, released, springs_of
from clearance_jax.dynamics.gaps import gap_motions
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.dynamics.pose import check_driven, displaced, frequencies, ideal_states, poses
from clearance_jax.dynamics.quantities import axes_of, evaluate
from clearance_jax.joints import PlayCoordinate
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree.tree import AbstractPlayed
from clearance_jax.mechanism.variants import DRIVE
from clearance_jax.metrics.ideal import ASSEMBLE
from clearance_jax.solve.quasi_static import are_poses
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run
from clearance_jax.spatial import X, as_array, subtract

__all__ = ["PoseErrors", "check_driven", "deviations", "place_slopes", "play_of", "pose_errors"]


class PoseErrors(NamedTuple):
    """Quasi-static errors of a point [m]: `whole` (times, 3), and `joints` (times, joints, 3) with the offset of one
    pin at a time, then of one drive that gives way or one coupling with backlash at a time (`budget_names`); `good`:
    whether there is a pose at each time; its lowest `frequency` [Hz]; what is `drawn` of it.
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

    def at_instant(time, y, pose, frequency):
        at_rest = tuple(jnp.zeros_like(play) for play in pose.play)
        wanted = _place(ready, index, time, displaced(time, ready, at_rest, y))
        whole = subtract(_place(ready, index, time, pose.y), wanted)
        alone = []
        for k in range(len(pose.play)):
            play = (*at_rest[:k], pose.play[k], *at_rest[k + 1 :])
            alone.append(as_array(subtract(_place(ready, index, time, displaced(time, ready, play, y)), wanted)))
        for moved, places in _one_drive_at_a_time(ready, time, pose.y):
            firm = displaced(time, hold_drives(moved, places), at_rest, y)
            place = _place(ready, index, time, released(moved, time, firm, places))
            alone.append(as_array(subtract(place, wanted)))
        good = are_poses(mechanism, pose.errors) & jnp.all(jnp.isfinite(pose.y))
        return PoseErrors(as_array(whole), jnp.stack(alone), good, frequency, draw(ready, time, pose.y))

    posed = poses(times, ready, ideal)
    return jax.vmap(at_instant)(times, ideal, posed, frequencies(times, ready, posed))


def budget_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of what makes errors, in the order of `PoseErrors.joints`."""
    drives = (DRIVE.format(name) for name in deflections(mechanism))
    meshes = (coupling.name for coupling in mechanism.couplings if coupling.backlash is not None)
    return (*(joint.name for joint in mechanism.clearance_joints()), *drives, *meshes)


def has_waves(mechanism: Mechanism) -> bool:
    """Whether a drive has a transmission error."""
    return any(spring.wave is not None for spring in springs_of(mechanism).values())


def _one_drive_at_a_time(
    mechanism: PreparedMechanism, time: Any, y: Array
) -> Iterator[tuple[PreparedMechanism, dict[str, Any]]]:
    """The mechanism and the deflections of its drives, where all but one drive or coupling are as they are meant."""
    state, rest = layout(mechanism).split(y), dict.fromkeys(deflections(mechanism), 0.0)
    places = dict(zip(layout(mechanism).positions, state.q, strict=True))
    for name in rest:
        yield mechanism, rest | {name: places[name]}
    for gap, at in zip(mechanism.gaps, gap_motions(mechanism, time, state), strict=True):
        if gap.is_play and gap.name in {coupling.name for coupling in mechanism.couplings}:
            couplings = tuple(
                dataclasses.replace(c, offset=c.offset + at.now.place[0]) if c.name == gap.name else c
                for c in mechanism.couplings
            )
            yield dataclasses.replace(mechanism, couplings=couplings), rest


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


def play_of(mechanism: Mechanism, name: str) -> tuple[PlayCoordinate, ...]:
    """The coordinates of a joint's play, or of a gap's; none for a joint that cannot have play."""
    for gap in mechanism.gaps:
        if gap.name == name:
            return (PlayCoordinate("", gap.size, slides=X),)
    joint = mechanism.joint(name)
    return joint.play() if isinstance(joint, AbstractPlayed) else ()


@eqx.filter_jit
def place_slopes(mechanism: Mechanism, index: int, names: tuple[str, ...], t0, t1, samples: int):
    """Derivatives of the place of the point with an index, in the ideal motion, by the play of each named joint or by
    its offset: (times, axes, play) for each name.
    """
    ideal = mechanism.intended()
    solution = run(ideal, t1, settings_of(ideal, t1, {"t0": t0, "save_at": samples}))
    times, states, axes = solution.time, solution.y, len(axes_of(ideal))
    counts = [len(play_of(mechanism, name)) for name in names]

    def place(values, t, y):
        offsets = {name: tuple(offset) for name, offset, count in zip(names, values, counts, strict=True) if count}
        moved = mechanism.intended(offsets)
        for name, offset, count in zip(names, values, counts, strict=True):
            moved = moved if count else _offset(moved, name, offset)
        ready = moved.prepare()
        closed = project(t, y, ready, ASSEMBLE) if ready.closures() else y
        return evaluate("position", t, closed, ready)[index]

    zero = [jnp.zeros(count or axes) for count in counts]
    return jax.vmap(jax.jacfwd(place), (None, 0, 0))(zero, times, states)


def _offset(mechanism: Mechanism, name: str, offset) -> Mechanism:
    """The mechanism with a joint's place on its parent moved [m]."""
    joint = mechanism.joint(name)
    x, y, z = joint.at_parent.vector
    plane = offset.shape[0] == 2
    at = Position(x + offset[0], y + offset[1], joint.at_parent.z if plane else z + offset[2])
    return mechanism.with_joint(dataclasses.replace(joint, at_parent=at))
