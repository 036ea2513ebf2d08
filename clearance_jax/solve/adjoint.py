"""Derivatives of a solve by any number of numbers: an adjoint over the steps of one solve.

The solve integrates the motion and its derivative along one random direction, and controls the error of both: the
steps that a random direction needs are almost always those that any other needs. Then the steps are gone through
backwards (`steps/pull`). The states at their starts are kept; of a long motion every so many, and the others are
computed again. So the memory is bounded, and the time hardly depends on how many numbers vary.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array

from clearance_jax._compile.kept import kept_jit
from clearance_jax._compile.once import compute_once
from clearance_jax._compile.one_function import one_function
from clearance_jax.dynamics.closures import project
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.solve.drivers.tape import Tape, put_row, taped
from clearance_jax.solve.first_state import initial
from clearance_jax.solve.flow import (
    Inputs,
    Which,
    compiled_solve,
    later,
    refuse_jumps,
    solution_of,
    states_of,
    task_of,
    unstacked,
    variations,
)
from clearance_jax.solve.settings import AUTO, MANY, Settings
from clearance_jax.solve.solution import Solution
from clearance_jax.solve.steps.problem import Problem, depends, reach
from clearance_jax.solve.steps.pull import Bars, ByNumbers, back, forth
from clearance_jax.solve.steps.step import dense
from clearance_jax.solve.steps.tolerances import CLOSEST

# Part of the tolerance within which the errors along a random direction are controlled: along others they are larger.
# (Two directions would need less, but a compiler gives their products with a network's weights to a library.)
SEED, WITHIN = 20, 0.15
# The direction of an array without any number but zero.
NOTHING = 1e-3


class StateBars(NamedTuple):
    """Derivatives of a number by states of the motion: at the start, and at times [s] in order."""

    initial: Array
    time: Array
    y: Array


# The rule of differentiation -----------------------------------------------------------------------------------------


def adjoint_flow(inputs: Inputs, options: Settings) -> Solution:
    """As `flow.flow`, for derivatives in reverse mode."""
    rest = inputs._replace(mechanism=None, y0=None, integrands=(), t1=None, save_at=None)
    return _flow((inputs.varied, inputs.t1, inputs.save_at), rest, options)


@eqx.filter_custom_vjp
def _flow(given, inputs: Inputs, options: Settings) -> Solution:
    return compiled_solve(_with(inputs, given), options)


def _with(inputs: Inputs, given: tuple) -> Inputs:
    (mechanism, y0, integrands), t1, save_at = given
    return inputs._replace(mechanism=mechanism, y0=y0, integrands=integrands, t1=t1, save_at=save_at)


@_flow.def_fwd
def _forth(perturbed, given, inputs: Inputs, options: Settings):
    inputs, which = _with(inputs, given), _which(perturbed, given)
    refuse_jumps(inputs.mechanism)
    if not any(which):
        value, kept = compiled_solve(inputs, options), None
    elif (options.derivatives == AUTO and _count(inputs, which) < MANY) or _breaks_move(inputs, which):
        # At a moved break the slope of a motion jumps, and only directions tell by how much the break moves.
        value, kept = variations(inputs, which, options)
    else:
        value, kept = _record(inputs, options, which)
    return value, (value, kept)


@_flow.def_bwd
def _back(residuals, grad, perturbed, given, inputs: Inputs, options: Settings):
    (value, kept), which = residuals, _which(perturbed, given)
    inputs = _with(inputs, given)
    chosen = [i for i, pick in enumerate(value.picked) if pick is not None]
    states = [grad.initial, grad.final, grad.y, *(grad.picked[i].y for i in chosen)]
    states = [jnp.zeros_like(y) if bar is None else bar for bar, y in zip(states, states_of(value), strict=True)]
    if isinstance(kept, Tape):
        start, final, y, *picks = states
        times = [value.time, value.end_time[None], *(value.picked[i].time for i in chosen)]
        time, bars = jnp.concatenate(times), jnp.concatenate([y, final[None], *picks])
        order = jnp.argsort(time)
        numbers = _rewind(inputs, options, which, kept, StateBars(start, time[order], bars[order]))
    else:
        numbers = [sum(jnp.tensordot(slope, bar, bar.ndim) for slope, bar in zip(kept or [], states, strict=False))]
        numbers = _shared(inputs, which, numbers[0]) if any(which) else []
    rest, tree = iter(numbers), _leaves(inputs.varied)[1]
    varied = jax.tree.unflatten(tree, [next(rest) if varies else None for varies in which])
    # The end and the sample times move all states along the motion, and themselves.
    moved = [t for t, moves in zip(given[1:], perturbed[1:], strict=True) if moves is True]
    if not moved:
        return varied, None, None

    def along(*rates):
        rest = iter(rates)
        t1, save_at = (next(rest) if moves is True else None for moves in perturbed[1:])
        nothing = [jnp.zeros_like(y) for y in states_of(value)]
        now = later(inputs, inputs._replace(t1=t1, save_at=save_at), value, nothing, options)
        zero = jnp.zeros_like(value.end_time)
        end = zero if t1 is None else t1
        shift = save_at if inputs.save_at is not None else end[None]
        time = jnp.zeros_like(value.time) if shift is None else shift
        at = [jnp.where(value.picked[i].time == inputs.t1, end, zero) for i in chosen]
        return [*now, time, end, *at]

    times = [grad.time, grad.end_time, *(grad.picked[i].time for i in chosen)]
    like = [value.time, value.end_time, *(value.picked[i].time for i in chosen)]
    times = [jnp.zeros_like(x) if bar is None else bar for bar, x in zip(times, like, strict=True)]
    bars = iter(jax.linear_transpose(along, *moved)([*states, *times]))
    return varied, *(next(bars) if moves is True else None for moves in perturbed[1:])


def _leaves(tree: Any) -> tuple[list, Any]:
    return jax.tree.flatten(tree, is_leaf=lambda x: x is None)


def _which(perturbed, given) -> tuple[bool, ...]:
    flags = iter(jax.tree.leaves(perturbed[0]))
    return tuple(leaf is not None and next(flags) for leaf in _leaves(given[0])[0])


def _numbers(inputs: Inputs, which: Which) -> tuple[list[Array], Any]:
    """The numbers that are varied, and a function that puts others in their place in `inputs.varied`."""
    leaves, tree = _leaves(inputs.varied)
    varied = [leaf for leaf, varies in zip(leaves, which or (), strict=True) if varies]

    def put(numbers):
        rest = iter(numbers)
        return jax.tree.unflatten(
            tree, [next(rest) if v else leaf for v, leaf in zip(which or (), leaves, strict=True)]
        )

    return varied, put


def _count(inputs: Inputs, which: Which) -> int:
    return sum(number.size for number in _numbers(inputs, which)[0])


def _shared(inputs: Inputs, which: Which, flat: Array) -> list[Array]:
    """Derivatives by all entries, as arrays of the numbers' shapes."""
    numbers, _ = _numbers(inputs, which)
    parts = jnp.split(flat, np.cumsum([number.size for number in numbers])[:-1])
    return [part.reshape(number.shape) for part, number in zip(parts, numbers, strict=True)]


def _breaks_move(inputs: Inputs, which: Which) -> bool:
    numbers, put = _numbers(inputs, which)
    return depends(lambda numbers: drive_breaks(put(numbers)[0].prepare()), numbers)


# Forwards ------------------------------------------------------------------------------------------------------------


@kept_jit
def _record(inputs: Inputs, options: Settings, which: Which) -> tuple[Solution, Tape]:
    arrays, rest = eqx.partition((inputs, options), eqx.is_array)

    def single(arrays):
        inputs, options = eqx.combine(arrays, rest)
        numbers, _ = _numbers(inputs, which)
        rng, leaves = np.random.default_rng(SEED), iter(numbers)
        probe = [_direction(next(leaves), rng)[None] if varies else None for varies in which or ()]
        closer = jnp.where(inputs.rtol < CLOSEST, inputs.rtol, jnp.maximum(WITHIN * inputs.rtol, CLOSEST))
        probes = jax.tree.unflatten(_leaves(inputs.varied)[1], probe)
        task = task_of(inputs._replace(rtol=closer), options, probes)
        out, tape = one_function(taped)(task, options)
        return unstacked(solution_of(task, out, inputs.t1, options))[0], tape

    return sequential_vmap(compute_once(single))(arrays)


def _direction(number: Array, rng: np.random.Generator) -> Array:
    """A random direction of a number: as far as it is large, and a zero as far as the others of its array."""
    size = jnp.sqrt(jnp.mean(number**2))
    size = jnp.where(number == 0, jnp.where(size > 0, size, NOTHING), jnp.abs(number))
    return size * rng.choice([-1.0, 1.0], number.shape)


# Backwards -----------------------------------------------------------------------------------------------------------


@kept_jit
def _rewind(inputs: Inputs, options: Settings, which: Which, tape: Tape, bars: StateBars) -> list[Array]:
    """Derivatives by the numbers, from those by states of the motion."""
    arrays, rest = eqx.partition((inputs, options, tape, bars), eqx.is_array)

    def single(arrays):
        inputs, options, tape, bars = eqx.combine(arrays, rest)
        numbers, put = _numbers(inputs, which)

        def begin(numbers):
            mechanism, y0, integrands = put(numbers)
            problem = Problem(mechanism.prepare(), integrands, energy_balance=options.energy_balance)
            return problem, initial(problem, inputs.t0, y0, options.start)[0]

        program, shapes, others = eqx.filter_make_jaxpr(begin)(numbers)
        leaves, tree = jax.tree.flatten(shapes)
        floats = [jnp.issubdtype(leaf.dtype, jnp.inexact) for leaf in leaves]
        varies = [bool(by) and is_float for by, is_float in zip(reach(program), floats, strict=True)]

        def made(numbers):
            values = jaxpr_as_fun(program)(*numbers)
            return [value for value, moves in zip(values, varies, strict=True) if moves], values

        _, pull, values = jax.vjp(made, numbers, has_aux=True)
        problem, _ = eqx.combine(jax.tree.unflatten(tree, values), others)
        # The state is the last leaf; of the problem's own some are no arrays, and constant.
        places = {id(value): moves for value, moves in zip(values, varies, strict=True)}
        moved = ByNumbers.of(problem, tuple(places.get(id(leaf), False) for leaf in jax.tree.leaves(problem)))
        bar, more = one_function(_through)(moved, options, tape, bars)
        return pull([*more, bar] if varies[-1] else more)[0]

    return sequential_vmap(compute_once(single))(arrays)


def _through(moved: ByNumbers, options: Settings, tape: Tape, bars: StateBars) -> tuple[Array, list[Array]]:
    """Derivatives by the state at the start and by the problem's numbers."""
    closes = moved.problem(moved.numbers).mechanism.has_manifold

    def seen(times, trial, y_bar, query, numbers):
        """The bars of what a step has made, from those of the states that are seen in it."""

        def goes_on(state):
            place, *_ = state
            return (place >= 0) & (bars.time[jnp.maximum(place, 0)] > times[0])

        def look(state):
            place, made_bars, numbers = state
            time = bars.time[place]

            def at(start, end, slopes, numbers):
                y = dense(options.solver, trial._replace(start=start, end=end, slopes=slopes), times).evaluate(time)
                return project(time, y, moved.problem(numbers).mechanism, 2) if closes else y

            _, pull = jax.vjp(at, trial.start, trial.end, trial.slopes, moved.numbers)
            *more, by_number = pull(bars.y[place])
            return place - 1, Bars(*map(jnp.add, made_bars, more)), jax.tree.map(jnp.add, numbers, by_number)

        none = Bars(jnp.zeros_like(y_bar), y_bar, jnp.zeros_like(trial.slopes))
        return jax.lax.while_loop(goes_on, look, (query, none, numbers))

    def one(times, y, carry):
        bar, numbers, query = carry
        trial = forth(moved, options.solver, times, y)
        query, made, numbers = seen(times, trial, bar, query, numbers)
        bar, more = back(moved, options.solver, times, y, trial, made)
        return bar, jax.tree.map(jnp.add, numbers, more), query

    room = jnp.zeros((tape.begin.size // tape.states.shape[0], tape.states.shape[1]))

    def stretch(k, carry):
        first = (chunks - 1 - k) * tape.stride
        count = jnp.minimum(tape.stride, tape.count - first)

        def fill(j, states):
            times = tape.begin[first + j - 1], tape.end[first + j - 1]
            return put_row(states, forth(moved, options.solver, times, states[j - 1]).end, j)

        states = jax.lax.fori_loop(1, count, fill, put_row(room, tape.states[first // tape.stride], 0))

        def step(j, carry):
            i = count - 1 - j
            return one((tape.begin[first + i], tape.end[first + i]), states[i], carry)

        return jax.lax.fori_loop(0, count, step, carry)

    chunks = -(-tape.count // jnp.maximum(tape.stride, 1))
    nothing = [jnp.zeros_like(number) for number in moved.numbers]
    begun = jnp.zeros_like(bars.initial), nothing, jnp.asarray(bars.time.size - 1)
    bar, numbers, query = jax.lax.fori_loop(0, chunks, stretch, begun)
    # What is seen at the start, or of a motion that has none.
    left = jnp.where(jnp.arange(bars.time.size)[:, None] <= query, bars.y, 0.0)
    return bar + bars.initial + jnp.sum(left, 0), numbers
