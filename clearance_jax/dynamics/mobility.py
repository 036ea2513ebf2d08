"""Mobility of a mechanism: its free velocities, less the independent conditions of its ideal closures."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import assemble
from clearance_jax.dynamics.conditions import closure_conditions
from clearance_jax.dynamics.constraint import independent
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.spatial import as_array


class Mobility(NamedTuple):
    """How a mechanism can move: the number of its free `velocities`, the number of `conditions` of its ideal loop
    joints, and how many of these are `independent`.
    """

    velocities: int
    conditions: int
    independent: int

    @property
    def freedom(self) -> int:
        """The number of free motions."""
        return self.velocities - self.independent

    @property
    def repeated(self) -> int:
        """The number of conditions that others imply: the degree of over-constraint."""
        return self.conditions - self.independent

    def __str__(self) -> str:
        text = f"{self.freedom} of {self.velocities} free velocities, under {self.conditions} conditions"
        if not self.repeated:
            return text
        return (
            f"{text}, of which {self.repeated} only repeat others (over-constrained): it moves while its lengths and "
            "angles are exact, and how its joints share the load is not determined"
        )


def mobility(mechanism: Mechanism, time: float = 0.0) -> Mobility:
    """The mobility of a mechanism as it is assembled at a `time` [s]. At a singular position (a dead centre, for
    example) fewer conditions may be independent.

    A condition counts as repeated if a solve leaves it out (`constraint.independent`). So rounded lengths do not turn a
    linkage that moves into a rigid one. The numbers of the `mechanism` must be known: this does not work under jit,
    vmap or derivatives.
    """
    ready, plan = mechanism.prepare(), layout(mechanism)
    if not ready.closures():
        return Mobility(plan.free, 0, 0)
    kept = np.asarray(_independence(ready, jnp.asarray(time, float)))
    return Mobility(plan.free, kept.size, int(np.sum(kept > 0)))


@jax.jit
def _independence(ready: PreparedMechanism, time: Scalar) -> Array:
    """By condition of the closures: 1 where it is independent, 0 where others imply it."""
    plan = layout(ready)
    y = assemble(time, jnp.concatenate([initial_values(ready), jnp.zeros(plan.remembered)]), ready)[0]
    motion = frames(ready, time, plan.split(y))
    loop_conditions = closure_conditions(motion)
    if not loop_conditions or plan.free == 0:
        return jnp.zeros(len(loop_conditions))
    inertia = motion.mass_matrix()
    rows = jnp.stack([now.row.array for now in loop_conditions])
    spread = jnp.stack([as_array(inertia.solve(list(row))) for row in rows])
    return independent(rows @ spread.T, loop_conditions, inertia)
