"""What is integrated: a motion, or a motion and its derivatives as one stack.

The derivative of a solve by a number is the solve of the variational equations on the SAME steps. So the state of a
differentiated solve is a stack: row 0 the motion, row 1 + k its derivative along direction k. A Runge-Kutta step treats
the rows alike; what differs is only how a function of the state is applied to a stack, and that is `lift`.

Beside the state stand quadratures: the energy books and whatever else is integrated along. Nothing depends on them.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal
from jaxtyping import Array

from clearance_jax._sharing import shared
from clearance_jax._types import Each, Flag, Rows
from clearance_jax.dynamics.field import rate, where_it_counts
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout, vector
from clearance_jax.solve.lane_axis import by_component, each_lane, sharing_lanes, with_first


class Problem(eqx.Module):
    """What a solve is of: a prepared mechanism, and the directions in which its numbers are varied.

    `integrands` are functions of (time, state, mechanism), of any shape, whose integrals follow the state; `books`:
    whether the energy books do, before them. `directions` is a tree like `model`: with a leading axis (one entry a
    direction) for a number that is varied, `None` for one that is not; altogether `None` where nothing is
    differentiated: then a state is a flat vector, not a stack.
    """

    mechanism: Mechanism
    integrands: tuple = ()
    directions: Any = None
    books: bool = eqx.field(static=True, default=False)

    @property
    def varies(self) -> bool:
        """Whether states are stacks."""
        return self.directions is not None

    @property
    def model(self) -> tuple:
        """All that a rate depends on beside time and state."""
        return self.mechanism, self.integrands

    @property
    def size(self) -> int:
        """Length of a state without quadratures."""
        return layout(self.mechanism).size

    @property
    def places(self) -> slice:
        """The positions that have a speed of their own."""
        return layout(self.mechanism).q

    @property
    def speeds(self) -> slice:
        """The velocities."""
        return layout(self.mechanism).v

    @property
    def without_directions(self) -> "Problem":
        """The motion alone."""
        return Problem(self.mechanism, self.integrands, None, self.books)


def with_model(problem: Problem, model: tuple) -> Problem:
    """The same problem of another mechanism, without directions."""
    return Problem(model[0], model[1], None, problem.books)


def widths(problem: Problem) -> list[int]:
    """How many numbers each integrand is."""
    y, time = jnp.zeros(problem.size), jnp.zeros(())
    return [int(np.prod(jax.eval_shape(f, time, y, problem.mechanism).shape)) for f in problem.integrands]


# Traced once and called wherever a rate is wanted; XLA inlines the calls.
@jax.jit
def field(time: Each, y: Array, problem: Problem, counts: Flag | None = None) -> Array:
    """The rate of a state, or of a stack, (..., size, *lanes), and of the quadratures behind it, (..., size +
    quadratures, *lanes): zeros for these where they do not count.
    """

    def rows(time, y, problem):
        mechanism, integrands = problem.model
        rates = rate(time, y, mechanism, problem.books, counts)

        def added():
            flat = [jnp.ravel(f(time, vector(y), mechanism)) for f in integrands]
            return tuple(one[i] for one in flat for i in range(one.shape[0]))

        return tuple(jnp.asarray(x, float) for x in (*rates, *where_it_counts(counts, added)))

    def rates(model, state):
        # Rows in, rows out: lanes stay the last axis, without a copy.
        return each_lane(rows, time)(time, state, with_model(problem, model))

    if not problem.varies:
        return vector(rates(problem.model, tuple(y[i] for i in range(problem.size))))
    stacks = tuple(y[:, i] for i in range(problem.size))
    count = y.shape[0] - 1
    outputs = jax.eval_shape(rates, problem.model, tuple(stack[0] for stack in stacks))
    speeds = problem.speeds.stop - problem.speeds.start
    push = lift if len(outputs) - speeds > count else pulled
    with sharing_lanes(time):
        return by_component(push(rates, problem, stacks), time)


def pulled(function, problem: Problem, stacks: Rows) -> Rows:
    """`function(model, rows)` of a motion and its derivatives, by reverse mode: each row of the answer is pulled back
    once, and what comes of it is applied to all directions; cheaper than a push of each direction where these are more
    than the rows.
    """
    varied, fixed = split(problem.model, problem.directions)
    leaves, tree = jax.tree.flatten(varied)
    directions = jax.tree.leaves(problem.directions)

    def flat(*numbers):
        model = eqx.combine(jax.tree.unflatten(tree, numbers[: len(leaves)]), fixed)
        return function(model, numbers[len(leaves) :])

    inputs = (*leaves, *(stack[0] for stack in stacks))
    moving = (*directions, *(stack[1:] for stack in stacks))
    values, along = jax.linearize(flat, *inputs)
    count = stacks[0].shape[0] - 1
    out = []
    for i, (value, reached) in enumerate(zip(values, _reach(flat, *inputs), strict=True)):
        pulls = jax.linear_transpose(lambda *rates, i=i: along(*rates)[i], *inputs)(jnp.ones_like(value))
        rate = jnp.zeros((count, *value.shape))
        for j in sorted(reached):
            product = shared(pulls[j])[None] * moving[j]
            own = tuple(range(1, product.ndim - value.ndim))
            rate = rate + (jnp.sum(product, axis=own) if own else product)
        out.append(with_first(value, rate))
    return tuple(out)


def lift(function, problem: Problem, *stacks: Any) -> Any:
    """`function(model, *trees)` of the motion and, where the problem varies, its derivatives, as stacks: by a push of
    every direction.
    """
    if not problem.varies:
        return function(problem.model, *stacks)
    varied, fixed = split(problem.model, problem.directions)
    first, moving = (jax.tree.map(lambda stack, p=part: stack[p], stacks) for part in (0, slice(1, None)))

    def along(direction, *rates):
        return jax.jvp(lambda v, *y: function(eqx.combine(v, fixed), *y), (varied, *first), (direction, *rates))

    value, rates = jax.vmap(along, out_axes=(None, 0))(problem.directions, *moving)
    return jax.tree.map(lambda value, rate: jnp.concatenate([value[None], rate]), value, rates)


def motion(problem: Problem, stack: Array) -> Array:
    """The state itself."""
    return stack[0] if problem.varies else stack


def split(tree, directions):
    """`tree` as its varied leaves and the others, each with `None` in the places of the other."""
    return eqx.partition(tree, jax.tree.map(lambda d: d is not None, directions, is_leaf=lambda d: d is None))


def push(function, tree: Any, directions: Any) -> tuple[Any, Any]:
    """`function(tree)` and its derivatives along the directions: `None` for leaves that do not depend on them."""
    varied, fixed = split(tree, directions)

    def of(v):
        return function(eqx.combine(v, fixed))

    numbers, rest = eqx.partition(of(varied), eqx.is_inexact_array)
    shape = jax.tree.structure(numbers)

    def flat(v):
        return jax.tree.leaves(eqx.filter(of(v), eqx.is_inexact_array))

    # The value that goes with the rates, not that of the call above: what is computed twice is compiled twice.
    value, rates = jax.vmap(lambda d: jax.jvp(flat, (varied,), (d,)), out_axes=(None, 0))(directions)
    kept = [r if moved else None for r, moved in zip(rates, _dependent(flat, varied), strict=True)]
    return eqx.combine(jax.tree.unflatten(shape, value), rest), jax.tree.unflatten(shape, kept)


def moves(function, problem: Problem) -> bool:
    """Whether `function(mechanism)` depends on a varied number at all."""
    varied, fixed = split(problem.model, problem.directions)
    return depends(lambda v: function(eqx.combine(v, fixed)[0]), varied)


def depends(function, argument) -> bool:
    """Whether any output of a function depends on its argument at all."""
    return any(_dependent(function, argument))


def basis(varied: Any) -> Any:
    """One direction for every entry of every leaf of `varied` (`None`: not varied), stacked along a leading axis."""
    leaves, tree = jax.tree.flatten(varied)
    sizes = [leaf.size for leaf in leaves]
    rows = np.eye(sum(sizes))
    starts = np.cumsum([0, *sizes])
    blocks = [
        jnp.asarray(rows[:, start : start + leaf.size].reshape(-1, *leaf.shape))
        for start, leaf in zip(starts, leaves, strict=False)
    ]
    return jax.tree.unflatten(tree, blocks)


def _dependent(function, argument) -> list[bool]:
    """Which outputs of a function depend on its argument at all, by its program."""
    leaves, tree = jax.tree.flatten(argument)
    return [bool(one) for one in _reach(lambda *x: function(jax.tree.unflatten(tree, x)), *leaves)]


def _reach(function, *arguments) -> list[frozenset[int]]:
    """For every output of a function, the arguments (arrays) that it depends on at all, by its program."""
    program = jax.make_jaxpr(function)(*arguments).jaxpr
    nothing: frozenset[int] = frozenset()
    reached = {v: frozenset([i]) for i, v in enumerate(program.invars)}
    for equation in program.eqns:
        own = nothing.union(*(reached.get(v, nothing) for v in equation.invars if not isinstance(v, Literal)))
        reached.update(dict.fromkeys(equation.outvars, own))
    return [nothing if isinstance(v, Literal) else reached.get(v, nothing) for v in program.outvars]
