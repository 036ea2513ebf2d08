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

from clearance_jax._types import Each, Flag
from clearance_jax.dynamics.field import rate, where_it_counts
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout, vector
from clearance_jax.solve.lane_axis import each_lane


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

    if not problem.varies:
        # Rows in, rows out: lanes stay the last axis, without a copy.
        return vector(each_lane(rows, time)(time, tuple(y[i] for i in range(problem.size)), problem))

    def whole(model, y):
        return vector(rows(time, tuple(y[i] for i in range(problem.size)), with_model(problem, model)))

    return lift(whole, problem, y)


def lift(function, problem: Problem, *stacks: Array) -> Array:
    """`function(model, *arrays)` of the motion and, where the problem varies, its derivatives, as a stack."""
    if not problem.varies:
        return function(problem.model, *stacks)
    varied, fixed = split(problem.model, problem.directions)

    def along(direction, *rates):
        at = (varied, *(stack[0] for stack in stacks))
        return jax.jvp(lambda v, *y: function(eqx.combine(v, fixed), *y), at, (direction, *rates))

    value, rates = jax.vmap(along, out_axes=(None, 0))(problem.directions, *(stack[1:] for stack in stacks))
    return jnp.concatenate([value[None], rates])


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
    program = jax.make_jaxpr(function)(argument).jaxpr
    reached = set(program.invars)
    for equation in program.eqns:
        if any(not isinstance(v, Literal) and v in reached for v in equation.invars):
            reached.update(equation.outvars)
    return [not isinstance(v, Literal) and v in reached for v in program.outvars]
