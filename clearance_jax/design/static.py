"""What play alone can do to a mechanism at rest: a bound to hold a simulated error against."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.signals import ASSEMBLE, freedom
from clearance_jax.dynamics.closures import projected
from clearance_jax.dynamics.observe import observe
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Position
from clearance_jax.solve.settings import settings_of
from clearance_jax.solve.simulate import run


def static_weights(
    mechanism: Mechanism, point: str, t1: float, samples: int = 181, t0: float = 0.0
) -> dict[str, float]:
    """How far a named point of the ideal mechanism moves per clearance of each joint, at most over time: the largest
    singular value of its place by an offset of the pin in the sleeve. The sum of weight times clearance bounds what
    play alone can do to a mechanism at rest; deformation and impacts can do more.

    **Raises:** `ClearanceError` for an unknown point, and for an ideal mechanism that moves freely: where it is depends
    on forces.
    """
    if freedom(mechanism.ideal()) > 0:
        raise ClearanceError("An ideal mechanism that moves freely has no static bound: drive its joints.")
    known = [p.name for p in mechanism.points]
    if point not in known:
        raise ClearanceError(f"There is no point `{point}`. Allowed: {', '.join(known)}.")
    names = tuple(joint.name for joint in mechanism.clearance_joints())
    found = _weights(
        mechanism.ideal(), known.index(point), names, jnp.asarray(t0, float), jnp.asarray(t1, float), samples
    )
    return dict(zip(names, np.asarray(found).tolist(), strict=True))


@eqx.filter_jit
def _weights(ideal: Mechanism, index: int, names: tuple[str, ...], t0, t1, samples: int):
    solution = run(ideal, t1, settings_of(ideal, t1, {"t0": t0, "save_at": samples}))
    times, states = solution.time, solution.y

    def place(offsets, t, y):
        moved = ideal
        for name, offset in zip(names, offsets, strict=True):
            moved = _offset(moved, name, offset)
        closed = projected(t, y, moved, ASSEMBLE) if moved.closures() else y
        return observe(t, closed, moved.prepared())["position"][index]

    slopes = jax.vmap(jax.jacfwd(place), (None, 0, 0))(jnp.zeros((len(names), 2)), times, states)
    # Of each joint's two by two matrix the largest singular value, the largest over time.
    return jnp.max(jnp.linalg.norm(jnp.moveaxis(slopes, 1, 2), ord=2, axis=(2, 3)), axis=0)


def _offset(mechanism: Mechanism, name: str, offset) -> Mechanism:
    """The mechanism with a joint's place on its parent moved [m]."""
    for group in ("joints", "loops"):
        for i, joint in enumerate(getattr(mechanism, group)):
            if joint.name == name:
                at = joint.at_parent
                moved = Position(at.vector[0] + offset[0], at.vector[1] + offset[1], at.z)
                moved_joint = dataclasses.replace(joint, at_parent=moved)
                return eqx.tree_at(lambda m, g=group, i=i: getattr(m, g)[i], mechanism, moved_joint)
    raise ClearanceError(f"There is no joint `{name}`.")
