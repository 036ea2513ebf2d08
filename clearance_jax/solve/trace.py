"""A solve in blocks of steps that keeps every step end: for progress, interruption, contact episodes and exact peaks.

Every touch and separation is the end of a step, so the step ends hold each contact episode exactly. A block is one
compiled call of at most `BLOCK` steps; between blocks Python is in control, so that a long solve shows its progress and
a keyboard interrupt keeps what was computed.
"""

from collections.abc import Callable

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np

from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.flow import (
    Options,
    Solution,
    energy_residual,
    initial,
    integrate,
    meaning,
    projected_samples,
    tolerances_of,
)
from clearance_jax.solve.problem import Problem
from clearance_jax.solve.simulate import check_arguments, check_assembled

BLOCK = 4096


class Trace(eqx.Module):
    """A solution with every step end: `time` (steps,), `y` (steps, n); `message` is empty where the solve succeeded."""

    solution: Solution
    time: np.ndarray
    y: np.ndarray
    message: str = eqx.field(static=True)


@eqx.filter_jit
def _block(mechanism, t0, t1, start, grid, allowed, solver, watch):
    problem, options = Problem(mechanism.prepared()), Options(solver, watch, True, BLOCK)
    # Samples before this block are moved to its start, so that the others keep their places in the buffer.
    out = integrate(problem, t0, t1, start, jnp.maximum(grid, t0), allowed, options, steps=True)
    accepted, rejected = out.stats["num_accepted_steps"], out.stats["num_rejected_steps"]
    sampled = projected_samples(problem, out.ts[1], out.ys[1])
    return out.ts[2], out.ys[2], out.ts[1], sampled, out.result, accepted, rejected


@eqx.filter_jit
def _first(mechanism, t0, t1, rtol, atol):
    """The state at t0, and the tolerances of the whole solve."""
    problem = Problem(mechanism.prepared())
    start = initial(problem.mechanism, t0, True, None)
    return start, tolerances_of(problem, t0, t1, start, rtol, atol)


_residual = eqx.filter_jit(lambda m, *args: energy_residual(m.prepared(), *args))


def trace(
    mechanism: Mechanism,
    t1: float,
    *,
    t0: float = 0.0,
    samples: int = 1001,
    rtol: float = 1e-8,
    atol=None,
    solver="tsit5",
    watch: bool = True,
    max_steps: int = 10_000_000,
    progress: Callable[[float], None] | None = None,
) -> Trace:
    """Simulate as `simulate` does, but in blocks of steps, keeping every step end.

    **Arguments** as `simulate`; `samples` equally spaced output times; `progress` is called with the fraction done.
    """
    chosen = check_arguments(mechanism, t0, t1, rtol, solver)
    grid = np.linspace(t0, t1, samples)
    first, allowed = _first(mechanism, jnp.asarray(t0, float), jnp.asarray(t1, float), jnp.asarray(rtol, float), atol)
    check_assembled(mechanism, t0, first)
    now, y = float(t0), np.asarray(first)
    times, states, sampled = [np.array([now])], [y[None]], np.full((samples, y.size), np.nan)
    sampled[0] = y  # whatever happens, the start is known
    accepted, rejected, message = 0, 0, ""
    result = diffrax.RESULTS.successful
    options = (jnp.asarray(grid), allowed, chosen, watch)
    try:
        while now < t1 and not message:
            ts, ys, sample_t, sample_y, result, more, wasted = _block(
                mechanism, jnp.asarray(now), jnp.asarray(t1, float), jnp.asarray(y), *options
            )
            kept = np.isfinite(ts)
            kept[0] = False  # the block's start is the last one's end
            new = np.isfinite(sample_t) & (grid >= now) & np.isnan(sampled[:, 0])
            sampled[new] = np.asarray(sample_y)[new]
            accepted, rejected = accepted + int(more), rejected + int(wasted)
            if np.any(kept):
                times.append(np.asarray(ts)[kept])
                states.append(np.asarray(ys)[kept])
                now, y = float(times[-1][-1]), states[-1][-1]
            if progress is not None:
                progress((now - t0) / (t1 - t0))
            if now < t1:
                message = _failure(result, bool(np.any(kept)), accepted + rejected, max_steps)
    except KeyboardInterrupt:
        message, result = "interrupted", diffrax.RESULTS.event_occurred
    done = np.isfinite(sampled[:, 0])
    solution = Solution(
        jnp.asarray(grid[done]),
        jnp.asarray(sampled[done]),
        first,
        jnp.asarray(y),
        result if message else diffrax.RESULTS.successful,
        jnp.asarray(accepted),
        jnp.asarray(rejected),
        _residual(mechanism, jnp.asarray(float(t0)), jnp.asarray(now), first, jnp.asarray(y)),
    )
    return Trace(solution, np.concatenate(times), np.concatenate(states), message)


def _failure(result, progressed: bool, steps: int, max_steps: int) -> str:
    """Why a block that did not reach the end must not be followed by another; empty where it may."""
    if not bool(result == diffrax.RESULTS.max_steps_reached):
        return meaning(result)
    if not progressed:
        return meaning(diffrax.RESULTS.dt_min_reached)
    return f"stopped after {steps} steps" if steps >= max_steps else ""
