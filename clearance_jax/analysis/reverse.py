"""Reverse differentiation of one number by many parameters, over steps that a first solve has chosen.

The first solve carries the derivative along one random direction in its error norm: it almost always needs the steps
that any other direction needs. On these fixed steps the solve is a composition of Runge-Kutta steps, which JAX
differentiates in reverse. Two levels of checkpoints recompute steps on the way back, so memory grows with the square
root of their number. The error is not controlled for each parameter by itself.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._compile.solo import solo_jit
from clearance_jax.mechanism.breaks import drive_breaks
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.metrics.measure import Function
from clearance_jax.parameters import replace
from clearance_jax.solve.attempt import Options
from clearance_jax.solve.codes import Result
from clearance_jax.solve.driver import step_ends
from clearance_jax.solve.first_state import initial
from clearance_jax.solve.flow import Inputs, refuse_jumps, task_of
from clearance_jax.solve.problem import Problem, push
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.step import try_step

SHORTEST, LONGEST = 2**10, 2**20
SEED = 20


@solo_jit
def _steps(mechanism, values, inputs: Inputs, options: Options):
    """Ends of the steps that the motion and its derivative need (infinite beyond the last), and the result code."""
    rng = np.random.default_rng(SEED)
    probe = {
        name: jnp.where(value == 0, 1.0, jnp.abs(value))[None] * rng.choice([-1.0, 1.0], value.shape)
        for name, value in values.items()
    }
    changed, direction, _ = push(lambda v: replace(mechanism, v), values, probe)
    task = task_of(inputs._replace(mechanism=changed, save_at=None), options, (direction, None, ()))
    return step_ends(task, options)


@solo_jit
def _sweep(mechanism, values, function, begins, ends, inputs: Inputs, options: Options):

    def of(values):
        changed = replace(mechanism, values)
        problem = Problem(changed.prepare(), (), None, options.energy_balance)
        start, _ = initial(problem, inputs.t0, None)

        def step(y, times):
            begin, end = times
            trial = try_step(problem, options.solver, (begin, end), y, jnp.zeros_like(y), True)
            return jnp.where(end > begin, trial.end, y), None

        @jax.checkpoint
        def stretch(y, times):
            return jax.lax.scan(jax.checkpoint(step), y, times)

        final, _ = jax.lax.scan(stretch, start, (begins, ends))
        none = jnp.zeros((), int)
        reached = jnp.asarray(int(Result.REACHED_END))
        end, unknown = ends[-1, -1], jnp.asarray(jnp.nan)
        counts = reached, none, none
        solution = Solution(
            end[None],
            final[None],
            start,
            final,
            *counts,
            unknown,
            end,
            sampled=False,
            energy_balance=options.energy_balance,
        )
        return function.of(changed, solution.of(changed))

    value, pull = jax.vjp(of, values)
    rows = jax.vmap(pull)(jnp.eye(value.size).reshape(value.size, *value.shape))[0]
    return value, {name: row.reshape(*value.shape, *row.shape[1:]) for name, row in rows.items()}


def reverse(
    mechanism: Mechanism, function: Function, values: dict[str, Array], t1: Any, settings: Settings
) -> tuple[Array, dict[str, Array]]:
    """Value and Jacobian of a function of the final state by the named values. No value may move a time at which a
    drive switches.
    """
    refuse_jumps(mechanism)
    inputs = Inputs(mechanism, settings.t0, jnp.asarray(t1, float), None, settings.rtol, None, None)
    # Without states only the energy balance is there to be integrated.
    energy_balance = settings.energy_balance or layout(mechanism).size == 0
    size = SHORTEST
    while True:
        options = settings._replace(locate_events=True, energy_balance=energy_balance, max_steps=size).as_options()
        times, code = _steps(mechanism, values, inputs, options)
        if int(code) != Result.MAX_STEPS or size >= LONGEST:
            break
        size *= 4
    if int(code) != Result.REACHED_END:
        raise RuntimeError("The solve stopped before t1. Simulate to see why.")
    times = np.asarray(times)
    times = times[np.isfinite(times)]
    begins, ends = times[:-1].copy(), times[1:]
    breaks = np.asarray(drive_breaks(mechanism))
    margin = 4 * np.finfo(float).eps * np.abs(breaks)
    # A step that ends just before a break is followed by one just past it.
    for time, hair in zip(breaks, margin, strict=True):
        begins[(begins < time) & (time - begins <= 2 * hair)] = time + hair
    width = int(np.ceil(np.sqrt(begins.size)))
    padding = width * int(np.ceil(begins.size / width)) - begins.size
    begins, ends = (np.concatenate([x, np.full(padding, ends[-1])]).reshape(-1, width) for x in (begins, ends))
    return _sweep(mechanism, values, function, jnp.asarray(begins), jnp.asarray(ends), inputs, options)
