"""How freely a mechanism moves: its free velocities, and what its ideal closures leave of them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.dynamics.closures import assembled
from clearance_jax.dynamics.conditions import conditions
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import initial_values, layout
from clearance_jax.spatial import as_array

# Singular values of the closures' Jacobian that are less than this part of the largest are zeros.
ZERO = 1e-7


class Mobility(NamedTuple):
    """Free velocities, conditions of the ideal closures, and how many of these say something of their own."""

    velocities: int
    conditions: int
    independent: int

    @property
    def freedom(self) -> int:
        """What is free to move."""
        return self.velocities - self.independent

    @property
    def repeated(self) -> int:
        """Conditions that others imply: so many times the mechanism is over-constrained."""
        return self.conditions - self.independent

    def __str__(self) -> str:
        said = f"{self.freedom} of {self.velocities} free velocities, under {self.conditions} conditions"
        if not self.repeated:
            return said
        return (
            f"{said}, of which {self.repeated} only repeat others (over-constrained): it moves while its lengths and "
            "angles are exact, and how its joints share the load is not determined"
        )


def mobility(mechanism: Mechanism, time: float = 0.0) -> Mobility:
    """Of a mechanism as it is assembled at a time [s]: at a singular position, a dead centre say, it may say less."""
    ready, plan = mechanism.prepared(), layout(mechanism)
    if not ready.closures():
        return Mobility(plan.free, 0, 0)

    @jax.jit
    def jacobian(ready: Any):
        begin = initial_values(ready)
        at = jnp.asarray(time, float)
        y = assembled(at, jnp.concatenate([begin, jnp.zeros(plan.remembered)]), ready)[0]
        motion = frames(ready, at, plan.split(y))
        held = [now for loop in ready.closures() for now in conditions(loop, motion, plan.free)]
        return jnp.stack([as_array(now.row) for now in held])

    rows = np.asarray(jacobian(ready))
    sizes = np.linalg.svd(rows, compute_uv=False)
    independent = int(np.sum(sizes > ZERO * sizes[0])) if sizes.size else 0
    return Mobility(plan.free, rows.shape[0], independent)
