"""The problem that a solve integrates: a motion, or a motion and its derivatives as one stack.

The derivative of a solve by a number is the solve of the variational equations on the same steps. So the state of a
differentiated solve is a stack: row 0 is the motion, row 1 + k its derivative along direction k. A Runge-Kutta step
treats all rows alike; `lift` applies a function of the state to a stack.

Quadratures stand behind the state: the energy balance and other integrals. Nothing depends on them.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Literal, jaxpr_as_fun
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Each, Flag, Rows, Scalar
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import by_component, each_lane, sharing_lanes
from clearance_jax.dynamics.field import rate, where_it_counts
from clearance_jax.mechanism.motion.motion_laws import AbstractTable
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import layout, position_rates, vector

# A number moved by more directions than this is applied to all directions at once.
THIN = 8
# Entries of a varied array up to which it counts as numbers: the coordinates of a point.
POINT = 3


class Unchanged(frozenset):
    """The one argument of a function that a result of it is, as it is."""


class Problem(Module):
    """The problem of a solve: a prepared mechanism, and the directions in which its numbers are varied.

    `integrands` are functions of (time, state, mechanism), of any shape, whose integrals follow the state;
    `energy_balance`: whether the energy balance stands before them. `directions` is a tree like `model`: with a leading
    axis (one entry a direction) for a varied number, `None` for another; `None` as a whole where nothing is
    differentiated, and a state is then a flat vector. `sparsity`: for each varied number the directions that move it,
    usually few of many; a `range` where they move its entries one by one (the weights of a law, say).
    """

    mechanism: PreparedMechanism
    integrands: tuple = ()
    directions: Any = None
    energy_balance: bool = eqx.field(static=True, default=False)
    sparsity: tuple[tuple[int, ...] | range, ...] = eqx.field(static=True, default=())

    @property
    def varies(self) -> bool:
        """Whether states are stacks."""
        return self.directions is not None

    @property
    def model(self) -> tuple:
        """Everything besides time and state on which a rate depends."""
        return self.mechanism, self.integrands

    @property
    def size(self) -> int:
        """Length of a state without quadratures."""
        return layout(self.mechanism).size

    @property
    def places(self) -> slice:
        """The slice of the positions."""
        return layout(self.mechanism).q

    def place_rates(self, y: Array) -> Array:
        """The rates of the positions in a state of the motion."""
        plan = layout(self.mechanism)
        if len(plan.positions) == len(plan.velocities):
            return y[plan.v]
        state = plan.split(y)
        return vector(position_rates(self.mechanism, state.q, state.v))


def with_model(problem: Problem, model: tuple) -> Problem:
    """The same problem of another mechanism, without directions."""
    return Problem(model[0], model[1], energy_balance=problem.energy_balance)


def widths(problem: Problem) -> list[int]:
    """The number of components of each integrand."""
    y, time = jnp.zeros(problem.size), jnp.zeros(())
    return [int(np.prod(jax.eval_shape(f, time, y, problem.mechanism).shape)) for f in problem.integrands]


def field(time: Each, y: Array, problem: Problem, counts: Flag | None = None) -> Array:
    """The rate of a state or stack, (..., size, *lanes), with its quadratures behind, zero where they do not count."""
    of_arrays = all(map(eqx.is_array_like, jax.tree.leaves(problem)))
    return (_field_of_arrays if of_arrays else _field_of_any)(time, y, problem, counts)


def _field(time: Each, y: Array, problem: Problem, counts: Flag | None) -> Array:
    def rows(time, y, problem):
        mechanism, integrands = problem.model
        rates = rate(time, y, mechanism, problem.energy_balance, counts)

        def add():
            flat = [jnp.ravel(f(time, vector(y), mechanism)) for f in integrands]
            return tuple(values[i] for values in flat for i in range(values.shape[0]))

        return tuple(jnp.asarray(x, float) for x in (*rates, *where_it_counts(counts, add)))

    def rates(model, state):
        # Rows in, rows out: lanes stay the last axis, without a copy.
        return each_lane(rows, time)(time, state, with_model(problem, model))

    if not problem.varies:
        return vector(rates(problem.model, tuple(y[i] for i in range(problem.size))))
    stacks = tuple(y[:, i] for i in range(problem.size))
    arrays = _has_arrays(problem, time)
    problem = each_lane(_near, time)(problem, time)
    push = lift
    if arrays:
        outputs = eqx.filter_eval_shape(rates, problem.model, tuple(stack[0] for stack in stacks))
        many = y.shape[0] - 1 >= len(outputs) - layout(problem.mechanism).free
        push = vjp_rows if many else lift
    with sharing_lanes(time):
        return by_component(push(rates, problem, stacks), time)


# Traced once and called wherever a rate is wanted; XLA inlines the calls.
_field_of_arrays, _field_of_any = jax.jit(_field), eqx.filter_jit(_field)


def _has_arrays(problem: Problem, time: Each) -> bool:
    """Whether tables or weights are varied: along many directions derivatives of the rate cost less in reverse mode
    then (by 15 weights a tenth), by numbers in forward mode (by 12 of an arm with three sleeves 60 %, and a fifth of
    the compile time).
    """
    varied, _ = split(problem.model, problem.directions)
    shapes = [leaf.shape[: leaf.ndim - jnp.ndim(time)] for leaf in jax.tree.leaves(varied)]
    return any(len(shape) > 1 or np.prod(shape) > POINT for shape in shapes)


def _near(problem: Problem, time: Scalar) -> Problem:
    """The problem with those rows alone of its drives' tables that count at a time: the others are not pulled back."""

    def is_table(part):
        return isinstance(part, AbstractTable)

    def cut(part, direction):
        start, counts = (is_table(part) and part.window(time)) or (None, ())

        def rows(tree, axis):
            arrays, shape = jax.tree.flatten(tree, is_leaf=lambda x: x is None)
            each = [(lambda x, n=n: jax.lax.dynamic_slice_in_dim(x, start, n, axis)) for n in counts]
            return jax.tree.unflatten(shape, [x if x is None else f(x) for x, f in zip(arrays, each, strict=True)])

        return (part, direction) if start is None else (rows(part, 0), rows(direction, 1))

    parts, shape = jax.tree.flatten(problem.model, is_leaf=is_table)
    both = [cut(*pair) for pair in zip(parts, shape.flatten_up_to(problem.directions), strict=True)]
    model, directions = (jax.tree.unflatten(shape, [pair[k] for pair in both]) for k in (0, 1))
    was, now = jax.tree.leaves(problem.directions), jax.tree.leaves(directions)
    same = (old.shape == new.shape for old, new in zip(was, now, strict=True))
    movers = tuple(by if kept else tuple(by) for by, kept in zip(problem.sparsity, same, strict=True))
    return Problem(model[0], model[1], directions, problem.energy_balance, movers)


def vjp_rows(function, problem: Problem, stacks: Rows) -> Rows:
    """`function(model, rows)` of a motion and its derivatives, by reverse mode: each output is pulled back once and the
    result applied to all directions.
    """
    varied, fixed = split(problem.model, problem.directions)
    leaves, tree = jax.tree.flatten(varied)
    numbers = list(zip(jax.tree.leaves(problem.directions), problem.sparsity, strict=True))

    def flat(*inputs):
        model = eqx.combine(jax.tree.unflatten(tree, inputs[: len(leaves)]), fixed)
        return function(model, inputs[len(leaves) :])

    inputs = (*leaves, *(stack[0] for stack in stacks))
    values, along = jax.linearize(flat, *inputs)
    out = []
    for i, (value, reached) in enumerate(zip(values, reach(jax.make_jaxpr(flat)(*inputs)), strict=True)):
        pulls = jax.linear_transpose(lambda *rates, i=i: along(*rates)[i], *inputs)(jnp.ones_like(value))
        pulls = {j: share(pulls[j]) for j in sorted(reached)}
        pulled = [(pull, *numbers[j]) for j, pull in pulls.items() if j < len(leaves)]
        states = [(pull, stacks[j - len(leaves)]) for j, pull in pulls.items() if j >= len(leaves)]
        out.append(_apply(share(value), pulled, states, stacks[0].shape[0]))
    return tuple(out)


def _apply(value: Array, pulls: list[tuple], states: list[tuple], rows: int) -> Array:
    """A number and its derivatives, as a stack, from its derivatives by the mechanism's numbers (`pulls`: with
    the directions of these numbers, and the few directions that move each) and by the state (with the state's stacks).
    """

    def whole(p: Array, axis: int) -> Array:
        return jnp.sum(p, axis=tuple(range(axis, p.ndim - value.ndim)))

    def total(terms: list[Array], nothing: tuple[int, ...]) -> Array:
        return functools.reduce(jnp.add, terms) if terms else jnp.zeros(nothing)

    # Of entries that directions move one by one, the derivatives are the rows: no product.
    units = [(pull.reshape(-1, *value.shape), by) for pull, _, by in pulls if isinstance(by, range)]
    around = [(flat, [(1 + by.start, rows - 1 - by.stop), *[(0, 0)] * value.ndim]) for flat, by in units]
    placed = [jnp.pad(flat, edges) for flat, edges in around]
    pulls = [(pull, along, by) for pull, along, by in pulls if not isinstance(by, range)]
    if not value.ndim:
        # Without lanes everything by all directions: a row is one number, and costs more to place than to compute.
        products = [pull[None] * along for pull, along, _ in pulls] + [pull[None] * stack[1:] for pull, stack in states]
        terms = [whole(p, 1) for p in products] + [entries[1:] for entries in placed]
        return jnp.concatenate([value[None], total(terms, (rows - 1,))])
    thin = [(pull, along, movers) for pull, along, movers in pulls if len(movers) <= THIN]
    wide = [(pull, jnp.pad(along, [(1, 0)] + [(0, 0)] * pull.ndim)) for pull, along, by in pulls if len(by) > THIN]
    everywhere = [*states, *wide]
    out = total([*placed, *(whole(pull[None] * stack, 1) for pull, stack in everywhere)], (rows, *value.shape))
    first = jnp.arange(rows).reshape(-1, *[1] * value.ndim) == 0
    out = share(jnp.where(first, value, out))
    for row in range(1, rows):
        here = [whole(pull * along[row - 1], 0) for pull, along, movers in thin if row - 1 in movers]
        if here:
            # The whole row anew: to add to it, a compiler would copy the whole stack.
            here += [whole(pull * stack[row], 0) for pull, stack in everywhere] + [entries[row] for entries in placed]
            out = jax.lax.dynamic_update_index_in_dim(out, total(here, ()), row, 0)
    return out


def lift(function, problem: Problem, *stacks: Any) -> Any:
    """`function(model, *trees)` of the motion and, where the problem varies, its derivatives, as stacks."""
    if not problem.varies:
        return function(problem.model, *stacks)
    varied, fixed = split(problem.model, problem.directions)
    first, moving = (jax.tree.map(lambda stack, p=part: stack[p], stacks) for part in (0, slice(1, None)))

    def along(direction, *rates):
        return jax.jvp(lambda v, *y: function(eqx.combine(v, fixed), *y), (varied, *first), (direction, *rates))

    value, rates = jax.vmap(along, out_axes=(None, 0))(problem.directions, *moving)
    return jax.tree.map(lambda value, rate: jnp.concatenate([value[None], rate]), value, rates)


def motion(problem: Problem, stack: Array) -> Array:
    """The state of the motion, without its derivatives."""
    return stack[0] if problem.varies else stack


def split(tree, directions):
    """`tree` as its varied leaves and the others, each with `None` in the places of the other."""
    return eqx.partition(tree, jax.tree.map(lambda d: d is not None, directions, is_leaf=lambda d: d is None))


def push(function, tree: Any, directions: Any) -> tuple[Any, Any, Any]:
    """`function(tree)`, its derivatives along the directions, and by leaf the varied leaves on which it depends."""
    varied, fixed = split(tree, directions)
    # Traced once, for value, derivatives and dependences: to trace a settled start takes long.
    program, out, rest = eqx.filter_make_jaxpr(lambda v: function(eqx.combine(v, fixed)))(varied)
    leaves, shape = jax.tree.flatten(out)
    smooth = [jnp.issubdtype(leaf.dtype, jnp.inexact) for leaf in leaves]

    def flat(v):
        values = jaxpr_as_fun(program)(*jax.tree.leaves(v))
        return [x if moves else None for x, moves in zip(values, smooth, strict=True)], values

    pushed = jax.vmap(lambda along: jax.jvp(flat, (varied,), (along,), has_aux=True), out_axes=(None, 0, None))
    _, rates, values = pushed(directions)
    reached = [by if moves else frozenset() for by, moves in zip(reach(program), smooth, strict=True)]
    given, ends = {v: Unchanged((i,)) for i, v in enumerate(program.jaxpr.invars)}, program.jaxpr.outvars
    reached = [by if isinstance(v, Literal) else given.get(v, by) for by, v in zip(reached, ends, strict=True)]
    kept = [rate if by else None for rate, by in zip(rates, reached, strict=True)]
    movers = [by or None for by in reached]
    value = eqx.combine(jax.tree.unflatten(shape, values), rest)
    return value, jax.tree.unflatten(shape, kept), jax.tree.unflatten(shape, movers)


def sparsity(movers: Any, directions: Any) -> tuple[tuple[int, ...] | range, ...]:
    """For every moved number the directions that move it; `movers`: by leaf, the leaves on which it depends."""

    def of(direction) -> frozenset[int]:
        # Constants, such as a `basis`, are known; other directions may move anything.
        count = direction.shape[0]
        constant = isinstance(direction, np.ndarray)
        return frozenset(np.flatnonzero(direction.reshape(count, -1).any(1)).tolist() if constant else range(count))

    def by(sources) -> tuple[int, ...] | range:
        if isinstance(sources, Unchanged) and len(alone := _own_directions(leaves[next(iter(sources))])) > THIN:
            return alone
        return tuple(sorted(frozenset().union(*(moving[i] for i in sources))))

    leaves = jax.tree.leaves(directions)
    moving = [of(direction) for direction in leaves]
    return tuple(by(sources) for sources in jax.tree.leaves(movers))


def _own_directions(direction: Any) -> range:
    """The directions of a number whose entries are moved one by one, in order; empty if they are not."""
    if not (isinstance(direction, np.ndarray) and direction.size):
        return range(0)
    flat = direction.reshape(direction.shape[0], -1)
    start = int(np.argmax(flat.any(1)))
    return range(start, start + flat.shape[1]) if np.array_equal(flat, np.eye(*flat.shape, k=-start)) else range(0)


def moves(function, problem: Problem) -> bool:
    """Whether `function(mechanism)` depends on a varied number at all."""
    varied, fixed = split(problem.model, problem.directions)
    return depends(lambda v: function(eqx.combine(v, fixed)[0]), varied)


def depends(function, argument) -> bool:
    """Whether any output of a function depends on its argument at all."""
    return any(reach(jax.make_jaxpr(function)(argument)))


def basis(varied: Any) -> Any:
    """One direction for every entry of every leaf of `varied` (`None`: not varied), stacked along a leading axis."""
    leaves, tree = jax.tree.flatten(varied)
    sizes = [leaf.size for leaf in leaves]
    cuts = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1], axis=1)
    blocks = [cut.reshape(-1, *leaf.shape) for leaf, cut in zip(leaves, cuts, strict=False)]
    return jax.tree.unflatten(tree, blocks)


def reach(closed: ClosedJaxpr) -> list[frozenset[int]]:
    """For every output of a program, the arguments on which it depends."""
    program = closed.jaxpr
    nothing: frozenset[int] = frozenset()
    reached = {v: frozenset([i]) for i, v in enumerate(program.invars)}
    for equation in program.eqns:
        sources = nothing.union(*(reached.get(v, nothing) for v in equation.invars if not isinstance(v, Literal)))
        reached.update(dict.fromkeys(equation.outvars, sources))
    return [nothing if isinstance(v, Literal) else reached.get(v, nothing) for v in program.outvars]
