"""Simulation of a free impact of a mass on a wall: the restitution of a law without a closed form."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError

# Dormand and Prince's method of order 5, and its error by that of order 4.
STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
RTOL, FIRST_STEP, MOST = 1e-10, 1e-12, 200_000
# A damping is sought in this many decades to either side of a first guess, with this many bisections.
DECADES, HALVINGS = 12, 40


def needed(given: Any, name: str, law: Any) -> Any:
    """A number of an impact that a law needs. **Raises** `ClearanceError` if it was not given."""
    if given is None:
        raise ClearanceError(f"`{name}` must be given: the restitution of `{type(law).__name__}` depends on it.")
    return given


@jax.jit
def free_impact(ready: Any, memory: tuple[Scalar, ...], speed: Scalar, mass: Scalar) -> Scalar:
    """The speed after a free impact over that before it (NaN: the mass does not come off), of a prepared law (`ready`)
    and its `memory` at first touch; `speed` [m/s], `mass` [kg].
    """

    # The state: penetration and its rate, both over the speed; memory.
    def slope(y):
        depth, rate, now = speed * y[0], speed * y[1], tuple(y[2:])
        rates = ready.memory_rate(depth, rate, now)
        return jnp.stack([y[1], -ready.force(depth, rate, now) / (mass * speed), *rates])

    def attempt(carry):
        y, h, largest, count = carry
        slopes, moved = [slope(y)], y
        for weights in STAGES:
            moved = y + h * sum(w * s for w, s in zip(weights, slopes, strict=True))
            slopes.append(slope(moved))
        error = jnp.abs(h * sum(w * s for w, s in zip(ERROR, slopes, strict=True)))
        size = jnp.maximum(largest, jnp.abs(moved))
        ratio = jnp.max(jnp.where(error > 0, error / (RTOL * jnp.where(size > 0, size, 1.0)), 0.0))
        good = ratio <= 1
        longer = jnp.clip(0.9 * jnp.maximum(ratio, 1e-10) ** -0.2, 0.2, 5.0)
        return jnp.where(good, moved, y), h * longer, jnp.where(good, size, largest), count + 1

    def impacts(carry):
        y, *_, count = carry
        return ((y[0] > 0) | (y[1] > 0)) & (count < MOST)

    start = jnp.stack([jnp.zeros(()), jnp.ones(()), *memory])
    end, *_ = jax.lax.while_loop(impacts, attempt, (start, jnp.asarray(FIRST_STEP), jnp.abs(start), 0))
    return jnp.where(end[0] > 0, jnp.nan, -end[1])


def damping_for(delivered: Callable[[float], Any], restitution: Any, guess: Any) -> float:
    """The damping for a `restitution`, which falls with it, by bisection. **Raises** `ClearanceError` without one."""
    wanted = float(restitution)

    def above(decade: float) -> bool:
        return bool(delivered(float(guess) * 10.0**decade) > wanted)

    low = next((-d for d in range(DECADES) if above(float(-d))), None)
    high = next((d for d in range(DECADES) if not above(float(d))), None)
    if low is None or high is None:
        text = f"No damping of this law delivers a restitution of {wanted:g}."
        raise ClearanceError(text).about("restitution", wanted)
    low, high = float(low), float(high)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if above(middle) else (low, middle)
    return float(guess) * 10.0 ** (0.5 * (low + high))
