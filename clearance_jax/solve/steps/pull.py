"""A Runge-Kutta step backwards: from derivatives by its end to those by its start and by the mechanism's numbers.

The stages are gone through backwards, and the field is pulled back at each, so that nothing of a stage but its slope is
kept. The ends of steps are fixed. For laws of class C0 and better this loses nothing: where an event ends a step, the
slope is the same on both sides, and what a law latches there says itself how it changes with the touch.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.closures import project
from clearance_jax.dynamics.conditions import choice
from clearance_jax.mechanism.state import layout
from clearance_jax.solve.steps.problem import Problem, field
from clearance_jax.solve.steps.step import STAGE_BEFORE_END, Trial, begun, tableau_of, try_step


class ByNumbers(NamedTuple):
    """A problem by the `numbers` that are varied and its `others`; `moves`: by leaf of its `tree` whether it varies."""

    numbers: list[Array]
    others: list[Any]
    moves: tuple[bool, ...]
    tree: Any

    @classmethod
    def of(cls, problem: Problem, moves: tuple[bool, ...]) -> "ByNumbers":
        """A problem of which some leaves are varied."""
        leaves, tree = jax.tree.flatten(problem)
        numbers, others = ([x for x, m in zip(leaves, moves, strict=True) if m is varied] for varied in (True, False))
        return cls(numbers, others, moves, tree)

    def problem(self, numbers: list[Array]) -> Problem:
        """The problem at other values of the numbers."""
        varied, others = iter(numbers), iter(self.others)
        return jax.tree.unflatten(self.tree, [next(varied if moves else others) for moves in self.moves])


class Bars(NamedTuple):
    """Derivatives of a number by what a step has made: its start (laws latched), its end, its slopes."""

    start: Array
    end: Array
    slopes: Array


def forth(moved: ByNumbers, solver: Any, times: tuple[Scalar, Scalar], y: Array) -> Trial:
    """The step, of the motion alone."""
    return try_step(moved.problem(moved.numbers), solver, times, y, jnp.zeros_like(y), True)


def back(
    moved: ByNumbers, solver: Any, times: tuple[Scalar, Scalar], y: Array, trial: Trial, bars: Bars
) -> tuple[Array, list[Array]]:
    """Derivatives by the state `y` at the start of a step and by the numbers."""
    (t0, t1), tableau = times, tableau_of(solver)
    problem = moved.problem(moved.numbers)
    h, last, size = t1 - t0, len(tableau.nodes) - 1, problem.size
    lower, nodes = jnp.asarray(tableau.lower), jnp.asarray(tableau.nodes)
    closes = problem.mechanism.has_manifold
    chosen = choice(t0, trial.start, problem.mechanism) if problem.mechanism.may_repeat else None

    def again(numbers: list[Array]) -> Problem:
        made = moved.problem(numbers)
        if chosen is None:
            return made
        return eqx.tree_at(lambda p: p.mechanism.chosen, made, chosen, is_leaf=lambda x: x is None)

    # Quadratures are sums of their rates; the last stage is the end, which is projected where loops close.
    is_state = np.arange(bars.end.size) < size
    state, beside = jnp.where(is_state, bars.end, 0.0), jnp.where(is_state, 0.0, bars.end)
    slopes = bars.slopes + h * jnp.asarray(tableau.weights)[:, None] * beside[None]
    start = bars.start + beside
    first = jnp.asarray(0)
    if not closes:
        slopes = slopes + h * lower[last][:, None] * state[None]
        start = start + state
        # The slope at the end is the next step's, and often nothing depends on it here.
        first = jnp.where(jnp.any(slopes[last] != 0), 0, 1)

    def stage(k, carry):
        start, slopes, numbers = carry
        i = last - k
        raw = trial.start + h * jnp.sum(lower[i][:, None] * trial.slopes, 0)
        now = jnp.where(nodes[i] == 1, t1 - STAGE_BEFORE_END * jnp.abs(t1), t0 + nodes[i] * h)

        def value(raw, numbers):
            made, y = again(numbers), raw[:size]
            if closes:
                y = jax.lax.cond(i == last, lambda y: project(t1, y, made.mechanism), lambda y: y, y)
            return field(now, y, made), y

        _, pull = jax.vjp(value, raw, moved.numbers)
        end = jnp.where(i == last, state, 0.0) if closes else jnp.zeros_like(state)
        bar, more = pull((slopes[i], end[:size]))
        slopes = slopes + h * lower[i][:, None] * bar[None]
        return start + bar, slopes, jax.tree.map(jnp.add, numbers, more)

    nothing = [jnp.zeros_like(number) for number in moved.numbers]
    start, _, numbers = jax.lax.fori_loop(first, last + 1, stage, (start, slopes, nothing))
    if not (layout(problem.mechanism).is_latched or (problem.energy_balance and problem.mechanism.has_payloads)):
        return start, numbers
    _, pull = jax.vjp(
        lambda y, numbers: begun(moved.problem(numbers), t0, y, jnp.zeros_like(y), True)[0], y, moved.numbers
    )
    bar, more = pull(start)
    return bar, jax.tree.map(jnp.add, numbers, more)
