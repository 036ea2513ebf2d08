"""Reach of a point: derivatives of its place in the ideal motion by the play, or by an offset, in joints."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.quantities import axes_of, evaluate
from clearance_jax.joints import PlayCoordinate
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.mechanism.tree.tree import AbstractPlayed
from clearance_jax.metrics.ideal import ASSEMBLE
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run


def play_of(mechanism: Mechanism, name: str) -> tuple[PlayCoordinate, ...]:
    """The coordinates of a joint's play; none for a joint that cannot have play."""
    joint = mechanism.joint(name)
    return joint.play() if isinstance(joint, AbstractPlayed) else ()


@eqx.filter_jit
def place_slopes(mechanism: Mechanism, index: int, names: tuple[str, ...], t0, t1, samples: int):
    """Derivatives of the place of the point with an index, in the ideal motion, by the play of each named joint or by
    its offset: (times, axes, play) for each name.
    """
    ideal = mechanism.ideal()
    solution = run(ideal, t1, settings_of(ideal, t1, {"t0": t0, "save_at": samples}))
    times, states, axes = solution.time, solution.y, len(axes_of(ideal))
    counts = [len(play_of(mechanism, name)) for name in names]

    def place(values, t, y):
        offsets = {name: tuple(offset) for name, offset, count in zip(names, values, counts, strict=True) if count}
        moved = mechanism.hold_pins(offsets)
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
