"""A solve in blocks of steps that keeps every step end: for progress, interruption, contact episodes and exact peaks.

Every touch and separation is the end of a step, so the step ends hold each contact episode exactly. A block is one
compiled call of at most `BLOCK` steps. Between blocks Python has control: it shows progress, and a keyboard interrupt
keeps what was computed. Blocks make the same attempts as `simulate`, and pass on the same memory.
"""

from collections.abc import Callable
from typing import NamedTuple, Unpack

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.once import compute_once
from clearance_jax._compile.one_function import one_function
from clearance_jax.dynamics.field import energy_residual
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.solve.codes import Result, words
from clearance_jax.solve.flow import Inputs, problem_of, project_samples
from clearance_jax.solve.settings import ALL, Settings, SolveOptions, settings_of
from clearance_jax.solve.simulate import warn_of_energy
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.start import check_start, unresolved, why_stopped
from clearance_jax.solve.steps.attempt import Carry, attempt, means_of, start_carry
from clearance_jax.solve.steps.problem import Problem
from clearance_jax.solve.steps.step import Trial, dense
from clearance_jax.solve.steps.tolerances import Tolerances

BLOCK = 4096


class Trace(Module):
    """A motion with the end of every step: `time` [s], shape (steps,), and the states `y`, shape (steps, n);
    `solution`: the same motion at its samples; `message`: why the solve failed, or empty.
    """

    solution: Solution
    time: np.ndarray
    y: np.ndarray
    message: str = eqx.field(static=True)

    @property
    def rests(self) -> str:
        """Which joints of a settled start begin at relative rest, and why; empty where none does."""
        return self.solution.rests

    def __getitem__(self, name: str) -> Array:
        """A quantity by name at the samples, as `Solution` gives it."""
        return self.solution[name]

    def __repr__(self) -> str:
        return f"{self.solution!r}\n  a trace of {self.time.size} step ends"


class Steps(NamedTuple):
    """By step of a block: begin, end, where the next begins (past a break before which this one ends), its try."""

    begin: Array
    end: Array
    next: Array
    trial: Trial


@kept_jit
def _block(problem: Problem, allowed: Tolerances, carry: Carry, last, grid, options: Settings):
    """A block of steps, see `_step`."""
    return compute_once(_step)(problem, allowed, carry, last, grid, options)


def _step(problem: Problem, allowed: Tolerances, carry: Carry, last, grid, options: Settings):
    """At most `BLOCK` more steps: the new carry, the ends of the steps, their number, and the samples among them."""
    carry, steps, count = one_function(_steps)(problem, allowed, carry, last, options)

    ends = jnp.where(jnp.arange(BLOCK) < count, steps.end, jnp.inf)
    place = jnp.clip(jnp.searchsorted(ends, grid), 0, BLOCK - 1)

    def sample(time, k):
        step = jax.tree.map(lambda x: x[k], steps)
        return dense(options.solver, step.trial, (step.begin, step.end)).evaluate(time)

    sampled = project_samples(problem, grid, jax.vmap(sample)(grid, place))
    inside = (grid > steps.begin[0]) & (grid <= jnp.where(count > 0, steps.end[count - 1], -jnp.inf))
    return carry, steps.next, steps.trial.end, count, jnp.where(inside[:, None], sampled, jnp.nan)


def _steps(problem: Problem, allowed: Tolerances, carry: Carry, last, options: Settings) -> tuple[Carry, Steps, Array]:
    """The carry after a block of steps, the steps, and their number."""
    means = means_of(options, allowed)

    def goes_on(state):
        carry, _, count = state
        tries = carry.accepted + carry.rejected
        return (count < BLOCK) & (carry.time < last) & ~carry.collapsed & (tries < options.max_steps)

    def once(state):
        carry, steps, count = state
        moved, trial, keep = attempt(carry, problem, options, means, last)
        now = Steps(carry.time, carry.end, moved.time, trial)
        # A try that was not kept is overwritten by the next one.
        steps = jax.tree.map(lambda room, x: jax.lax.dynamic_update_index_in_dim(room, x, count, 0), steps, now)
        return moved, steps, count + keep

    shape = jax.eval_shape(lambda c: attempt(c, problem, options, means, last)[1], carry)
    empty = Steps(carry.time, carry.end, carry.time, shape)
    room = jax.tree.map(lambda x: jnp.zeros((BLOCK, *x.shape)), empty)
    return jax.lax.while_loop(goes_on, once, (carry, room, jnp.zeros((), int)))


@kept_jit
def _begin(inputs: Inputs, options: Settings):
    problem, start, allowed, errors = problem_of(inputs, options)
    carry = start_carry(problem, options, means_of(options, allowed), inputs.t0, inputs.t1, start)
    return problem, allowed, carry, errors


_residual = kept_jit(energy_residual)


# Options of a trace: it always has the energy balance, and no derivatives.
KNOWN = tuple(name for name in ALL if name not in ("energy_balance", "derivatives"))


def trace(
    mechanism: Mechanism, t1: float, *, progress: Callable[[float], None] | None = None, **options: Unpack[SolveOptions]
) -> Trace:
    """Simulate as `simulate` does, and keep the end of every step. Use it for datasets with contact episodes.

    **Arguments:** `mechanism`, `t1` and the options of `simulate`, without `energy_balance` and `derivatives`;
    `save_at`: 1001 samples unless you say otherwise; `progress`: called with the fraction done.
    """
    settings = settings_of(mechanism, t1, options, KNOWN, energy_balance=True, save_at=1001)
    chosen, t0, t1 = settings.compiled_in(), float(settings.t0), float(t1)
    start, last = settings.t0, np.asarray(t1)
    grid = np.array([t1]) if settings.save_at is None else np.sort(np.asarray(settings.save_at))
    inputs = Inputs(mechanism, start, last, None, settings.rtol, settings.atol, settings.y0)
    problem, allowed, carry, errors = _begin(inputs, chosen)
    first = carry.y
    if settings.y0 is None:
        check_start(mechanism, t0, errors)
    times, states = [np.array([t0])], [np.asarray(first)[None]]
    sampled = np.full((grid.size, first.size), np.nan)
    sampled[grid == t0] = np.asarray(first)  # whatever happens, the start is known
    code = Result(int(unresolved(jnp.asarray(0), settings.rtol, settings.atol, allowed)))
    try:
        while float(carry.time) < t1 and code == Result.REACHED_END:
            # Donating the carry would save nothing: a block takes long.
            carry, reached, y, count, some = _block(problem, allowed, carry, last, grid, chosen)
            kept = int(count)
            times.append(np.asarray(reached)[:kept])
            states.append(np.asarray(y)[:kept])
            some = np.asarray(some)
            new = np.isfinite(some[:, 0])
            sampled[new] = some[new]
            if progress is not None:
                progress((float(carry.time) - t0) / (t1 - t0))
            code = _code(carry, t1, settings.max_steps, problem)
    except KeyboardInterrupt:
        code = Result.INTERRUPTED
    time, y = np.concatenate(times), np.concatenate(states)
    if settings.save_at is None:
        grid, sampled = time[-1:], y[-1:]
    done = np.isfinite(sampled[:, 0])
    residual = _residual(problem.mechanism, (start, time[-1]), (first, y[-1]))
    at, known, last, end, number = jax.device_put((grid[done], sampled[done], y[-1], time[-1], np.asarray(int(code))))
    counts = carry.accepted, carry.rejected, carry.control.cuts
    asked = {"seated": errors.seated, "sampled": settings.save_at is not None}
    solution = Solution(at, known, first, last, number, *counts, residual, end, **asked).of(mechanism)
    warn_of_energy(solution)
    return Trace(solution, time, y, words(code))


def _code(carry: Carry, t1: float, max_steps: int, problem: Problem) -> Result:
    """`REACHED_END` if another block may follow, else the reason why not."""
    if bool(carry.collapsed):
        stopped = jnp.asarray(int(Result.STEP_COLLAPSED))
        return Result(int(why_stopped(stopped, problem.mechanism, carry.time, carry.y)))
    done = int(carry.accepted) + int(carry.rejected)
    return Result.MAX_STEPS if done >= max_steps and float(carry.time) < t1 else Result.REACHED_END
