"""A solve that keeps its steps, to go through them backwards."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax.solve.codes import Result
from clearance_jax.solve.drivers.driver import StepSamples
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.steps.attempt import Outcome, SolveTask, attempt, means_of, start_carry
from clearance_jax.solve.steps.problem import motion
from clearance_jax.solve.steps.step import dense

# Steps whose times are kept; and states: of more steps than that every second, fourth and so on.
TIMES, STATES = 2**17, 2**12


class Tape(NamedTuple):
    """The steps of a solve: where they `begin` and `end` [s], shape (TIMES,), their `count`; and the states at their
    begins, shape (STATES, n), of every `stride`-th step.
    """

    begin: Array
    end: Array
    count: Array
    states: Array
    stride: Array


def taped(task: SolveTask, options: Settings) -> tuple[Outcome, Tape]:
    """The solve of a task, and its steps."""
    problem, last, means = task.problem, task.t1, means_of(options, task.allowed)

    def goes_on(state):
        carry, _, (_, _, count, *_) = state
        tries = carry.accepted + carry.rejected
        return (carry.time < last) & ~carry.collapsed & (tries < options.max_steps) & (count < TIMES)

    def once(state):
        carry, samples, (begin, end, count, states, stride) = state
        moved, trial, keep = attempt(carry, problem, options, means, last)
        # What was not kept is overwritten by the next try.
        begin, end = put_row(begin, carry.time, count), put_row(end, carry.end, count)
        states, stride = _with_state(states, stride, motion(problem, carry.y), count)
        if task.save_at is not None:
            samples = samples.more(task.save_at, dense(options.solver, trial, (carry.time, carry.end)), keep)
        return moved, samples, (begin, end, count + keep, states, stride)

    carry = start_carry(problem, options, means, task.t0, last, task.start)._replace(collapsed=task.refused > 0)
    samples = None if task.save_at is None else StepSamples.none(task.save_at, task.t0, last, task.start)
    width = motion(problem, task.start).size
    tape = jnp.zeros(TIMES), jnp.zeros(TIMES), jnp.zeros((), int), jnp.zeros((STATES, width)), jnp.ones((), int)
    carry, samples, (begin, end, count, states, stride) = jax.lax.while_loop(goes_on, once, (carry, samples, tape))
    code = jnp.where(carry.collapsed, int(Result.STEP_COLLAPSED), int(Result.MAX_STEPS))
    code = jnp.where((carry.time < last) | carry.collapsed, code, int(Result.REACHED_END))
    sampled = None
    if samples is not None:
        sampled = jnp.where(jnp.arange(samples.y.shape[0]) < samples.count, task.save_at, jnp.inf), samples.y
    counts = carry.accepted, carry.rejected, carry.control.cuts
    out = Outcome(carry.y, carry.time, sampled, carry.record, code, *counts)
    return out, Tape(begin, end, count, states, stride)


def _with_state(states: Array, stride: Array, y: Array, place: Array) -> tuple[Array, Array]:
    """The states of every `stride`-th step with that of one more, and their stride. If there is no more room, every
    second one is left. (States that are computed again from far back are other ones: through impacts round-off grows,
    and a step that ends just past an event may then end just before it, where derivatives jump.)
    """

    def halved():
        return jnp.concatenate([states[::2], jnp.zeros_like(states[::2])]), 2 * stride

    states, stride = jax.lax.cond(place == STATES * stride, halved, lambda: (states, stride))
    row = place // stride
    return put_row(states, jnp.where(place % stride == 0, y, states[row]), row), stride


def put_row(rows: Array, row: Array, place: Array | int) -> Array:
    """Rows with one of them replaced."""
    return jax.lax.dynamic_update_index_in_dim(rows, row, place, 0)
