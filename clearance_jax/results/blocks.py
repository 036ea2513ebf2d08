"""Evaluates functions of many states in blocks of one size, so that one compiled program serves any number of states.

A program for the exact number of states would be compiled again for every solve, which takes longer than the solve.
Between blocks Python reports progress and handles interrupts.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.kept import kept_jit
from clearance_jax.dynamics.field import slope
from clearance_jax.dynamics.quantities import observe
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.ideal import ideal_state
from clearance_jax.results.episodes import Inside
from clearance_jax.results.places import body_poses, mark_positions
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.step import try_step

# States per call: smaller blocks cost more calls, larger ones leave the processor's cache.
BLOCK = 2048
# Instants inside steps per call: there are few, and each costs an integration step.
FEW = 64
# Up to this number of samples, the program of a trace's step ends observes the samples too. It is slower per state, but
# a second program takes seconds to compile.
SHARED = 20 * BLOCK

Progress = Callable[[float], None]


def in_blocks(program, mechanism: Mechanism, *arrays, size: int = BLOCK, progress: Progress | None = None) -> Any:
    """`program(mechanism, *arrays)`, jitted, over the arrays' leading axis, as NumPy arrays (a tree of them);
    `progress`: called with the fraction done.
    """
    count = len(arrays[0])
    out = None
    for begin in range(0, max(count, 1), size):
        part = slice(begin, min(begin + size, count))
        blocks = (_pad(np.asarray(a[part]), size) for a in arrays)
        now = program(mechanism, *blocks)
        if out is None:
            out = jax.tree.map(lambda x: np.empty((count, *x.shape[1:]), x.dtype), now)
        for whole, x in zip(jax.tree.leaves(out), jax.tree.leaves(now), strict=True):
            whole[part] = np.asarray(x)[: part.stop - part.start]
        if progress is not None:
            progress(part.stop / count if count else 1.0)
    return out


def _pad(block: np.ndarray, size: int) -> np.ndarray:
    """The block filled up with its last entry (an empty one with zeros)."""
    missing = ((0, size - len(block)), *[(0, 0)] * (block.ndim - 1))
    return np.pad(block, missing, mode="edge" if len(block) else "constant")


def _batch(function):
    """A jitted program over blocks of states; in space the mechanism is a table, which compiles faster."""

    def block(mechanism, *arrays):
        return jax.vmap(partial(function, mechanism.prepare().as_small_program()))(*arrays)

    return kept_jit(block, (function,))


def _observe(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, Array]:
    placed = {"mark_position": mark_positions(mechanism, time, y)} | body_poses(mechanism, time, y)
    return observe(time, y, mechanism) | placed


def _ideal_mark_places(mechanism: PreparedMechanism, time: Scalar, y: Array) -> Array:
    """The marks of the ideal mechanism, which drives and closures place."""
    return mark_positions(mechanism.intended(), time, ideal_state(time, y[: layout(mechanism).size], mechanism))


def _observe_with_rates(mechanism: PreparedMechanism, time: Scalar, y: Array) -> dict[str, Array]:
    """As `_observe`, with the rates of all contact forces [N/s] and contact powers [W/s] along the motion."""
    # The energy balance follows the state in `y`; no contact depends on it.
    rate, size = jnp.zeros_like(y), layout(mechanism).size
    rate = rate.at[:size].set(slope(time, y[:size], mechanism))
    seen, rates = _along(mechanism, time, y, rate)
    return seen | rates


def _along(
    mechanism: PreparedMechanism, time: Scalar, y: Array, rate: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """What `_observe` gives of a state that changes at a `rate`, and the rates of the contact forces and powers."""

    def contact(time, y):
        seen = _observe(mechanism, time, y)
        return {RATES[name]: seen[name] for name in RATES if name in seen}, seen

    _, rates, seen = jax.jvp(contact, (time, y), (jnp.ones_like(time), rate), has_aux=True)
    return seen, rates


def _inside(mechanism: PreparedMechanism, time: Scalar, y: Array, h: Scalar, s: Scalar) -> dict[str, Any]:
    """Contacts, and velocity and acceleration of points, at a fraction s of the step of size h from a step end. A step
    of order eight leads there: an interpolated penetration in a long step would have six correct digits only.
    """
    # The end of a step up to a drive's break is recorded just past the break: the step itself is that much shorter.
    part, y = s * jnp.maximum(h - 16 * jnp.finfo(h.dtype).eps * jnp.abs(time), 0.0), y[: layout(mechanism).size]
    end = time + part
    trial = try_step(Problem(mechanism), EXACT, (time, end), y, jnp.zeros_like(y), True)
    if not mechanism.contacts():
        seen, rates = _observe(mechanism, end, trial.end), {}
    else:
        seen, rates = _along(mechanism, end, trial.end, trial.slope1)
    contact = {
        f"{begin}contact": Inside(
            seen[f"{begin}contact_force"],
            rates[f"{begin}force_rate"] * h,
            seen[f"{begin}contact_power"],
            rates[f"{begin}power_rate"] * h,
        )
        for begin in ("", "gap_")
        if f"{begin}force_rate" in rates
    }
    return contact | {name: seen[name] for name in OF_POINTS if name in seen}


EXACT = diffrax.Dopri8()
RATES = {f"{begin}contact_{what}": f"{begin}{what}_rate" for begin in ("", "gap_") for what in ("force", "power")}
"""The rates of contacts, by the names of what changes."""
OF_POINTS = ("velocity", "acceleration")
observed, observed_with_rates = _batch(_observe), _batch(_observe_with_rates)
inside = _batch(_inside)
mark_places, ideal_mark_places = _batch(mark_positions), _batch(_ideal_mark_places)


def inside_steps(mechanism: Mechanism, time: np.ndarray, y: np.ndarray, step: np.ndarray, s: np.ndarray) -> dict:
    """What `_inside` gives at fractions s of steps, by the indices of their starts; `time` [s], `y`: at step ends."""
    arrays = time[step], y[step], time[step + 1] - time[step], s
    return in_blocks(inside, mechanism, *arrays, size=FEW)
