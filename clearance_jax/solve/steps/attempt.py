"""One attempt at a step: try it, judge it, decide, record. Every driver of a solve uses it, with the same input and
output.

Diffrax drives single solves and calls the two halves one after the other (`driver`). Blocks that keep every step end
drive attempts themselves (`trace`).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Code, Each, EachFlag, Scalar
from clearance_jax._compile.lane_axis import each_lane, sharing_lanes
from clearance_jax.dynamics.seated import Seated
from clearance_jax.solve.settings import Settings
from clearance_jax.solve.start import has_left, leaves_walls
from clearance_jax.solve.steps.control import Control, Decision, Means, first_end, judge, next_step
from clearance_jax.solve.steps.problem import Problem, motion
from clearance_jax.solve.steps.step import SolvedStep, Trial, try_step
from clearance_jax.solve.steps.tolerances import Tolerances


class SolveTask(NamedTuple):
    """A motion (or lanes of motions) to be integrated from `t0` to `t1`, from a state (or stack) `start`; `save_at`:
    sample times; `seated`: how pins of a settled start begin. A `refused` one (a `codes.Result` as a number; 0: not
    refused) ends where it begins.
    """

    problem: Problem
    t0: Each
    t1: Each
    start: Array
    save_at: Array | None
    allowed: Tolerances
    refused: Code
    seated: Seated | None = None


class Outcome(NamedTuple):
    """The last state and its time; samples; the observers' records; a `codes.Result`; steps kept and rejected,
    and how many of the latter because they crossed an event.
    """

    final: Array
    end_time: Each
    samples: tuple[Array, Array] | None
    record: Any
    code: Array
    accepted: Array
    rejected: Array
    cuts: Array


def means_of(options: Settings, allowed) -> Means:
    """The criteria by which the attempts of a solve are judged."""
    longest = None
    for observer in options.observers:
        # A plain number holds for every lane; an array would lack the axis of lanes.
        both = isinstance(longest, float) and isinstance(observer.longest, float)
        least = min if both else jnp.minimum
        longest = observer.longest if longest is None else least(longest, observer.longest)
    return Means(allowed, options.locate_events, float(options.solver.error_order(None)), longest)


def start_records(options: Settings, t0: Scalar, y0: Array, problem: Problem) -> tuple:
    """The observers' records before the first step."""
    return tuple(observer.start(t0, y0, problem) for observer in options.observers)


@eqx.filter_jit
def decide(
    problem: Problem, trial: Trial, times: tuple, means: Means, control: Control, options: Settings, record: tuple
) -> tuple[Decision, tuple]:
    """The second half of an attempt: decision and records. (Jitted: diffrax traces its loop three times.)"""
    with sharing_lanes(times[0]):
        decision = next_step(problem, judge(problem, trial, times, means, control), times, means, control)
    if leaves_walls(problem.mechanism):
        left = decision.keep & has_left(problem.mechanism, times[1], motion(problem, trial.end))
        decision = decision._replace(collapsed=decision.collapsed | left)

    def see(observers, record, step, problem):
        return tuple(observer(entry, step, problem) for observer, entry in zip(observers, record, strict=True))

    step = SolvedStep(times, trial, options.solver)
    seen = each_lane(see, times[0])(options.observers, record, step, problem)
    return decision, jax.tree.map(lambda new, old: jnp.where(decision.keep, new, old), seen, record)


class Carry(NamedTuple):
    """State of a solve under way: time and state, end of the next try, slope at the state (unless `fresh`), memory of
    the control, records of the observers, counts of kept and rejected tries, and whether it has failed.
    """

    time: Array
    end: Array
    y: Array
    slope: Array
    fresh: EachFlag
    past_break: EachFlag
    control: Control
    record: tuple
    accepted: Array
    rejected: Array
    collapsed: EachFlag


def attempt(
    carry: Carry, problem: Problem, options: Settings, means: Means, last: Each
) -> tuple[Carry, Trial, EachFlag]:
    """One attempt on the way to `last`: the new carry, the try, and whether it was kept."""
    times = carry.time, carry.end
    trial = try_step(problem, options.solver, times, carry.y, carry.slope, carry.fresh)
    decision, record = decide(problem, trial, times, means, carry.control, options, carry.record)
    keep = decision.keep
    time = jnp.minimum(decision.start, last)
    # As diffrax does: a try that ends within a round-off of the last time ends there, or after a rejection halfway.
    near = decision.end > last - 100 * jnp.spacing(last)
    end = jnp.where(near, jnp.where(keep, last, jnp.minimum(0.5 * (time + last), decision.end)), decision.end)
    moved = Carry(
        time,
        end,
        jnp.where(keep, trial.end, carry.y),
        jnp.where(keep, trial.slope1, carry.slope),
        jnp.where(keep, decision.past_break, carry.fresh),
        decision.past_break,
        decision.control,
        record,
        carry.accepted + keep,
        carry.rejected + ~keep,
        decision.collapsed,
    )
    return moved, trial, keep


def start_carry(problem: Problem, options: Settings, means: Means, t0: Each, t1: Each, y0: Array) -> Carry:
    """The carry before the first attempt."""
    end = jnp.minimum(first_end(problem, t0, t1, y0, means), t1)
    yes, no, none = (jnp.full(jnp.shape(t0), value) for value in (True, False, 0))
    record = each_lane(start_records, t0)(options, t0, y0, problem)
    return Carry(t0, end, y0, jnp.zeros_like(y0), yes, no, Control.begin(t0), record, none, none, no)
