"""Driver of lanes: many motions side by side, in chunks; each chunk runs until its slowest lane ends.

A batch of a thousand lanes in one loop runs operation by operation through memory, and waits for its slowest lane. A
chunk stays in the cache and compiles to one function; `jax.vmap` of a solve becomes `over_chunks`. On a GPU an
operation costs the same for one lane and for thousands, so a batch is one loop there (`LANES_ON_GPU`).
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Each, EachFlag
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import each_lane, sharing_lanes
from clearance_jax._compile.one_function import one_function
from clearance_jax._compile.platforms import by_platform
from clearance_jax.solve.codes import Result
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps.attempt import Carry, Outcome, SolveTask, attempt, means_of, start_carry
from clearance_jax.solve.steps.step import dense

# Numbers in one instruction (512 bits): a chunk of whole vectors leaves no lanes to do one by one.
VECTOR = 8
# Lanes of a chunk: the fastest number on one core. (Fewer fit the cache better, but the compiler unrolls their short
# loops, takes much longer, and leaves them scalar in part.)
LANES = 64
# On a GPU a chunk only bounds the memory.
LANES_ON_GPU = 65536


def chunk_on(platform: str | None = None) -> int:
    """The number of lanes of a chunk on a platform, by JAX's name of it ("cpu", "gpu"); by default the current one."""
    return LANES_ON_GPU if (platform or jax.default_backend()) == "gpu" else LANES


def integrate(task: SolveTask, options: Settings) -> Outcome:
    """Every lane of a task to its end. States at samples that a lane does not reach are infinite."""
    # A number for each lane broadcasts with an array of components, see `lane_axis`.
    with jax.numpy_rank_promotion("allow"):
        return one_function(_integrate)(task, options)


def _integrate(task: SolveTask, options: Settings) -> Outcome:
    problem, start, last = task.problem, task.start, task.t1
    means = means_of(options, task.allowed)
    times = jnp.zeros((0, *jnp.shape(last))) if task.save_at is None else task.save_at
    # A last row beyond the end takes the writes of lanes that have no sample now.
    times = jnp.concatenate([times, jnp.full((1, *jnp.shape(last)), jnp.inf)])
    known = times <= task.t0
    samples = jnp.where(jnp.expand_dims(known, range(1, start.ndim)), start[None], jnp.inf)
    place = jnp.sum(known, axis=0)
    due = jnp.take_along_axis(times, place[None], 0)[0]

    def goes_on(carry: Carry) -> EachFlag:
        tries = carry.accepted + carry.rejected
        return (carry.time < last) & ~carry.collapsed & (tries < options.max_steps)

    def once(state):
        carry, saved = state
        with sharing_lanes(last):
            now = share(goes_on(carry))
        moved, trial, keep = attempt(carry, problem, options, means, last)
        if task.save_at is not None:
            ends = carry.time, carry.end
            saved = _sample(saved, times, ends, now & keep, options, trial)
        return jax.tree.map(lambda new, old: jnp.where(now, new, old), moved, carry), saved

    # An impossible lane must end where it begins. Equal times do not ensure it: their computation may be compiled
    # twice, with other last digits, and a lane of NaN never crosses an ulp.
    carry = start_carry(problem, options, means, task.t0, last, start)._replace(collapsed=task.refused > 0)
    state = carry, (samples, place, due)
    carry, (samples, *_) = jax.lax.while_loop(lambda s: jnp.any(goes_on(s[0])), once, state)
    code = jnp.where(carry.collapsed, int(Result.STEP_COLLAPSED), int(Result.MAX_STEPS))
    code = jnp.where((carry.time < last) | carry.collapsed, code, int(Result.REACHED_END))
    sampled = None if task.save_at is None else (times[:-1], samples[:-1])
    counts = carry.accepted, carry.rejected, carry.control.cuts
    return Outcome(carry.y, carry.time, sampled, carry.record, code, *counts)


def _sample(saved: tuple[Array, Array, Array], times: Array, ends: tuple[Each, Each], kept: EachFlag, options, trial):
    """The samples including those in the steps just kept, and the index and time of each lane's next sample."""

    def in_step(time, trial, ends):
        return dense(options.solver, trial, ends, len(kept)).evaluate(time)

    inside = each_lane(in_step, ends[0])

    def now(due):
        return kept & (due <= ends[1])

    def once(state):
        samples, place, due = state
        here = jnp.where(now(due), place, len(times) - 1)
        return by_platform(_put_one_by_one, _put, samples, times, inside(due, trial, ends), here, place + now(due))

    return jax.lax.while_loop(lambda state: jnp.any(now(state[2])), once, saved)


def _put(samples: Array, times: Array, states: Array, here: Array, place: Array) -> tuple[Array, Array, Array]:
    """Samples with the state of each lane put at its place `here`, and the time at its next `place`."""
    lane = jnp.arange(place.shape[0])
    return samples.at[here, ..., lane].set(jnp.moveaxis(states, -1, 0)), place, times[place, lane]


def _put_one_by_one(samples: Array, times: Array, states: Array, here: Array, place: Array):
    """`_put` without scatter and gather, which would split a CPU's compiled loop into separate kernels."""

    def put(lane, state):
        samples, due = state
        new = jax.lax.dynamic_slice_in_dim(states, lane, 1, -1)[None]
        samples = jax.lax.dynamic_update_slice(samples, new, (here[lane], *[0] * (states.ndim - 1), lane))
        time = jax.lax.dynamic_slice(times, (place[lane], lane), (1, 1))[0]
        return samples, jax.lax.dynamic_update_slice_in_dim(due, time, lane, 0)

    samples, due = jax.lax.fori_loop(0, place.shape[0], put, (samples, jnp.zeros_like(times[0])))
    return samples, place, due


def over_chunks(solve: Callable, batch: Any, count: Any, lanes: int) -> Any:
    """`solve` of a batch of `count` (first axis; any number in an exported program) chunk by chunk; copies of the last
    lane fill the last chunk.
    """
    chunks, is_known = -(-count // lanes), isinstance(count, int)
    width = min(lanes, VECTOR * -(-count // (chunks * VECTOR))) if is_known else lanes

    def cut(x):
        filled = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (chunks * width - count, *x.shape[1:]))])
        return filled.reshape(chunks, width, *x.shape[1:])

    filled = jax.tree.map(cut, batch)
    if is_known and chunks == 1:
        out = jax.tree.map(lambda x: x[None], solve(jax.tree.map(lambda x: x[0], filled)))
    else:
        out = jax.lax.map(solve, filled)
    return jax.tree.map(lambda x: x.reshape(chunks * width, *x.shape[2:])[:count], out)


def batch_by(single: Callable, together: Callable) -> Callable:
    """`single` of a tree of arrays; under `jax.vmap` `together`, in chunks. A batch of batches is one batch."""

    def rule(count, in_batched, numbers):
        def spread(x, is_batched):
            return x if is_batched else jnp.broadcast_to(x, (count, *jnp.shape(x)))

        out = many(jax.tree.map(spread, numbers, in_batched[0]))
        return out, jax.tree.map(lambda _: True, out)

    @jax.custom_batching.custom_vmap
    def many(batch):
        count = jax.tree.leaves(batch)[0].shape[0]
        if isinstance(count, int) and count <= LANES:
            return together(batch)

        def chunks(lanes):
            return one_function(lambda batch: over_chunks(together, batch, count, lanes))

        return by_platform(chunks(LANES), chunks(LANES_ON_GPU), batch)

    @many.def_vmap
    def _merged(outer, in_batched, batch):
        inner = next(
            x.shape[1] if is_batched else x.shape[0]
            for x, is_batched in zip(jax.tree.leaves(batch), jax.tree.leaves(in_batched[0]), strict=True)
        )

        def merge(x, is_batched):
            x = x if is_batched else jnp.broadcast_to(x, (outer, *x.shape))
            return x.reshape(outer * inner, *x.shape[2:])

        out = many(jax.tree.map(merge, batch, in_batched[0]))
        out = jax.tree.map(lambda x: x.reshape(outer, inner, *x.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    alone = jax.custom_batching.custom_vmap(single)
    alone.def_vmap(rule)
    return alone
