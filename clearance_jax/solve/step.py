"""One explicit Runge-Kutta step of a mechanism: what a step is, what happens at its two ends."""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.dynamics.equations import projected
from clearance_jax.mechanism.mechanism import Mechanism, drive_breaks, layout
from clearance_jax.solve.problem import Problem, lift, split
from clearance_jax.solve.switches import signals_and_rates

_EPS = float(np.finfo(np.float64).eps)


class StepEnds(NamedTuple):
    """What a step tells the controller in place of a bare error estimate: its error, the state from which it really
    started (with laws latched), and the slopes at its ends.
    """

    error: Array
    start: Array
    slope0: Array
    slope1: Array


class Stepper(diffrax.AbstractAdaptiveSolver):
    """One explicit Runge-Kutta step of a mechanism's flat state, or of a stack (see `variation`).

    The tableau is diffrax's. Around the step, laws with memory are latched at its start and ideal loops are projected
    at its end.
    """

    solver: Any
    moving_breaks: bool = False
    """Whether the times of the drives' breaks are varied."""
    term_structure: ClassVar = diffrax.AbstractTerm

    @property
    def interpolation_cls(self):  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.solver.interpolation_cls

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        return terms.vf(t0, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        problem: Problem = args
        mechanism = problem.mechanism
        tableau, h = self.solver.tableau, t1 - t0
        slope = solver_state
        if layout(mechanism).remembered:
            y0 = lift(lambda m, y, f: latch(t0, y, f, m), problem, y0, slope)
        if self.moving_breaks and made_jump is not False:
            y0 = jnp.where(made_jump, past_moving_break(terms, t0, y0, problem), y0)
        if layout(mechanism).remembered or mechanism.closures() or self.moving_breaks:
            # The slope kept from the last step belongs to another memory, or to the state before its projection.
            slope = terms.vf(t0, y0, args)
        elif made_jump is not False:
            slope = jax.lax.cond(made_jump, lambda: terms.vf(t0, y0, args), lambda: solver_state)
        stages = _looped_stages if problem.varies else _unrolled_stages
        slopes = stages(terms, t0, t1, y0, slope, args, tableau)
        y1 = y0 + h * _weighted(tableau.b_sol, slopes)
        last = slopes[-1] if tableau.fsal else terms.vf(t1, y1, args)
        error = StepEnds(h * _weighted(tableau.b_error, slopes), y0, slopes[0], last)
        if mechanism.closures():
            y1 = lift(lambda m, y: projected(t1, y, m, m.closures(), 1), problem, y1)
        dense = {"y0": y0, "y1": y1, "k": h * jnp.stack(list(slopes))}
        return y1, error, dense, last, diffrax.RESULTS.successful


def _unrolled_stages(terms, t0, t1, y0, slope, args, tableau) -> list[Array]:
    """The slopes at the stages, as separate rows: XLA then keeps a whole stage in one kernel (measured 2 to 3 times
    faster than a loop over stages, single and batched).
    """
    h, slopes = t1 - t0, [slope]
    for weights, node in zip(tableau.a_lower, tableau.c, strict=True):
        y = y0 + h * _weighted(weights, slopes)
        slopes.append(terms.vf(t1 if node == 1 else t0 + float(node) * h, y, args))
    return slopes


def _looped_stages(terms, t0, t1, y0, slope, args, tableau) -> Array:
    """The slopes of a stack: unrolled, its many more operations take thrice as long to compile and no less to run."""
    count = len(tableau.a_lower) + 1
    lower, h = np.zeros((count, count)), t1 - t0
    for i, weights in enumerate(tableau.a_lower):
        lower[i + 1, : len(weights)] = weights
    lower, nodes = jnp.asarray(lower), jnp.asarray([0.0, *tableau.c])

    def stage(i, slopes):
        y = y0 + h * jnp.tensordot(lower[i], slopes, 1)
        now = jnp.where(nodes[i] == 1, t1, t0 + nodes[i] * h)
        return slopes.at[i].set(terms.vf(now, y, args))

    return jax.lax.fori_loop(1, count, stage, jnp.zeros((count, *y0.shape)).at[0].set(slope))


def _weighted(weights, slopes) -> Array:
    if not isinstance(slopes, list):
        return jnp.tensordot(jnp.asarray(weights), slopes, 1)
    terms = [float(w) * slope for w, slope in zip(weights, slopes, strict=False) if w != 0]
    return sum(terms[1:], terms[0])


def latch(time: Array, y: Array, slope: Array, mechanism: Mechanism) -> Array:
    """The state with every law's memory brought up to date.

    A touch or a separation lies a little before `time`. The joints are told how long ago, as a function of the state:
    so what they latch is what held AT the touch, and its derivative knows that a parameter moves the touch.
    """
    plan = layout(mechanism)
    memory = plan.memory_of(y)
    parts = []
    now, rates = signals_and_rates(time, y, slope, mechanism)
    for joint, signal, rate in zip(mechanism.clearance_joints(), now, rates, strict=True):
        if joint.clearance is not None and joint.clearance.remembers:
            parts.append(joint.clearance.latch(memory[joint.name], signal, rate))
    start = 2 * plan.free
    return jnp.concatenate([y[:start], *parts, y[start + plan.remembered :]])


def past_moving_break(terms, time: Array, stack: Array, problem: Problem) -> Array:
    """The stack just past breaks whose times t_b are varied.

    A break makes the slope jump from f- to f+; a direction that delays it by dt_b leaves the state on f- for that much
    longer, so its derivative jumps by (f- - f+) dt_b. (Each smooth piece of a drive does not know of it: a parameter
    that acts only through a time of switching would have derivative zero.) Several breaks may lie at this one time, and
    a direction moves one of them: so f- is the slope of the mechanism moved along the direction until that one break,
    and no other, lies just ahead.
    """
    times = lift(drive_breaks, problem)
    ahead = 32 * _EPS * jnp.abs(time)  # a step starts 4 eps past a break, see `ContactController`
    here = jnp.abs(times[0] - time) <= 0.5 * ahead
    delays = jnp.where(here[None], times[1:], 0.0)
    delay = jnp.take_along_axis(delays, jnp.argmax(jnp.abs(delays), axis=1)[:, None], axis=1)[:, 0]
    varied, fixed = split(problem.mechanism, problem.directions)

    def before(direction, delay):
        by = jnp.where(delay == 0, 0.0, ahead / jnp.where(delay == 0, 1.0, delay))
        moved = jax.tree.map(lambda x, d: x + by * d, varied, direction)
        return terms.vf(time, stack[0], Problem(eqx.combine(moved, fixed), None, problem.integrands))

    jumps = (
        jax.vmap(before)(problem.directions, delay)
        - terms.vf(time, stack[0], Problem(problem.mechanism, None, problem.integrands))[None]
    )
    return stack.at[1:].add(delay[:, None] * jumps)
