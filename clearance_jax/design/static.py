"""What play alone can do to a mechanism at rest: a bound to hold a simulated error against."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.ideal import ASSEMBLE, freedom
from clearance_jax.dynamics.closures import projected
from clearance_jax.dynamics.mobility import mobility
from clearance_jax.dynamics.observe import axes_of
from clearance_jax.dynamics.quantities import evaluated
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run


def static_weights(
    mechanism: Mechanism,
    point: str,
    t1: float,
    samples: int = 181,
    t0: float = 0.0,
    joints: Sequence[str] | None = None,
) -> dict[str, float]:
    """How far a named point of the ideal mechanism moves per clearance of each joint, at most over time: the largest
    singular value of its place by an offset of the pin in the sleeve, along all axes of the mechanism (two in the
    plane, three in space). The sum of weight times clearance bounds what play alone can do to a mechanism at rest, as
    far as pins stay parallel to their sleeves; deformation and impacts can do more.

    **Arguments:** `joints`: names of joints of any kind, with clearance or without (`None`: those with clearance).

    **Raises:** `ClearanceError` for an unknown point or joint, where there is no joint to ask for, and for an ideal
    mechanism that moves freely (where it is depends on forces) or is over-constrained (an offset strains it).
    """
    ideal = mechanism.ideal()
    if freedom(ideal) > 0:
        raise ClearanceError("An ideal mechanism that moves freely has no static bound: drive its joints.")
    if ideal.may_repeat and (repeated := mobility(ideal, t0).repeated):
        raise ClearanceError(
            f"An over-constrained mechanism has no static bound: {repeated} of the conditions of its loops only repeat "
            "others, so that an offset in one joint strains it. Close its loops by joints of more freedom (`Spherical` "
            "instead of `Revolute`, say)."
        )
    known = [p.name for p in mechanism.points]
    if point not in known:
        raise ClearanceError(f"There is no point `{point}`. Allowed: {', '.join(known)}.")
    names = tuple(joint.name for joint in mechanism.clearance_joints()) if joints is None else tuple(joints)
    if not names:
        raise ClearanceError("No joint has clearance here: name the joints that are to be asked for, `joints=`.")
    for name in names:
        mechanism.joint(name)
    found = _weights(ideal, known.index(point), names, jnp.asarray(t0, float), jnp.asarray(t1, float), samples)
    return dict(zip(names, np.asarray(found).tolist(), strict=True))


@eqx.filter_jit
def _weights(ideal: Mechanism, index: int, names: tuple[str, ...], t0, t1, samples: int):
    solution = run(ideal, t1, settings_of(ideal, t1, {"t0": t0, "save_at": samples}))
    times, states, axes = solution.time, solution.y, len(axes_of(ideal))

    def place(offsets, t, y):
        moved = ideal
        for name, offset in zip(names, offsets, strict=True):
            moved = _offset(moved, name, offset)
        ready = moved.prepared()
        closed = projected(t, y, ready, ASSEMBLE) if ready.closures() else y
        return evaluated("position", t, closed, ready)[index]

    slopes = jax.vmap(jax.jacfwd(place), (None, 0, 0))(jnp.zeros((len(names), axes)), times, states)
    # Of each joint's square matrix the largest singular value, the largest over time.
    return jnp.max(jnp.linalg.norm(jnp.moveaxis(slopes, 1, 2), ord=2, axis=(2, 3)), axis=0)


def _offset(mechanism: Mechanism, name: str, offset) -> Mechanism:
    """The mechanism with a joint's place on its parent moved [m]."""
    joint = mechanism.joint(name)
    x, y, z = joint.at_parent.vector
    plane = offset.shape[0] == 2
    at = Position(x + offset[0], y + offset[1], joint.at_parent.z if plane else z + offset[2])
    return mechanism.with_joint(dataclasses.replace(joint, at_parent=at))
