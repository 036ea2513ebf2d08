"""Recursions over a tree as loops over its columns: articulated bodies (Featherstone 2008, chapter 7), sums towards the
ground and sums away from it.

A column is what one coordinate does to all that it moves (a ball has three): a spin, and the velocity that it gives to
the point at the origin. A force is a moment about the origin and a force. About one point for all, nothing needs to be
moved from joint to joint. Columns stand in the order of the tree, parents before children; behind them stands the
ground, which moves nothing.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.symmetric import AbstractFactors, dense_constraint
from clearance_jax.spatial import as_array


class Tree(NamedTuple):
    """The structure of the columns: the `parents` of each (their number: the ground), and its `places` among the
    columns of the mechanism, of which the first `free` ones are free.
    """

    parents: tuple[int, ...]
    places: tuple[int, ...]
    free: int

    @property
    def count(self) -> int:
        """The number of columns."""
        return len(self.places)

    @property
    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """The number of every column, and of its parent."""
        return np.arange(self.count), np.array(self.parents)

    def in_tree(self, every: Array) -> Array:
        """Values by column of the mechanism, in the order of the tree."""
        return every[np.array(self.places)]

    def of_mechanism(self, every: Array) -> Array:
        """Values in the order of the tree, by column of the mechanism."""
        return every[np.argsort(self.places)]

    def inward(self, values: Array) -> Array:
        """By column (the ground's row behind), the sum of its values and of all beyond it."""

        def once(sums, at):
            i, parent = at
            return _put(sums, parent, sums[parent] + sums[i]), None

        return jax.lax.scan(once, values, self.rows, reverse=True)[0]

    def outward(self, values: Array) -> Array:
        """By column (the ground's row behind), the sum of its values and of all on the way to the ground."""

        def once(sums, at):
            i, parent = at
            return _put(sums, i, sums[parent] + sums[i]), None

        ground = jnp.zeros((1, *values.shape[1:]))
        return jax.lax.scan(once, jnp.concatenate([values, ground]), self.rows)[0]


def _put(rows: Array, i, row: Array) -> Array:
    return jax.lax.dynamic_update_index_in_dim(rows, row, i, 0)


class LoopFactors(AbstractFactors):
    """The mass matrix factored column by column: the `columns`, the forces that a unit acceleration of each takes from
    what gives way beyond it, and the inverse of its inertia (0 if it is not free).
    """

    tree: Tree = eqx.field(static=True)
    columns: Float[Array, "columns 6"]
    forces: Float[Array, "columns 6"]
    inverse: Float[Array, " columns"]

    @property
    def inverse_diagonal(self):
        return self.tree.of_mechanism(self.inverse)[: self.tree.free]

    def solve(self, right):
        solution = self.solve_all(as_array(right)[:, None])[:, 0]
        return [solution[i] for i in range(len(right))]

    def solve_all(self, right: Float[Array, "free sides"]) -> Float[Array, "free sides"]:
        """The solutions for several right-hand sides."""
        tree, sides = self.tree, right.shape[1]
        driven = jnp.zeros((tree.count - tree.free, sides))
        asked = tree.in_tree(jnp.concatenate([right, driven]))
        rows = *tree.rows, self.columns, self.forces, self.inverse
        none = jnp.zeros((tree.count + 1, 6, sides))

        def inward(bias, at):
            i, parent, column, force, inverse, wanted = at
            by = inverse * (wanted - column @ bias[i])
            return _put(bias, parent, bias[parent] + bias[i] + force[:, None] * by[None]), by

        _, kept = jax.lax.scan(inward, none, (*rows, asked), reverse=True)

        def outward(motion, at):
            i, parent, column, force, inverse, by = at
            acceleration = by - inverse * (force @ motion[parent])
            return _put(motion, i, motion[parent] + column[:, None] * acceleration[None]), acceleration

        _, out = jax.lax.scan(outward, none, (*rows, kept))
        return tree.of_mechanism(out)[: tree.free]

    def constraint(self, rows, choose):
        jacobian = jnp.stack([row.array for row in rows])
        return dense_constraint(jacobian, self.solve_all(jacobian.T), choose)


def factor_tree(
    tree: Tree, columns: Float[Array, "columns 6"], inertias: Float[Array, "rows 6 6"], added: Float[Array, " columns"]
) -> LoopFactors:
    """Factor the mass matrix of `columns`, from the inertia that each carries itself (the ground's row behind) and what
    is `added` to the inertia of each (rotors). All in the order of the tree.
    """
    is_free = np.array(tree.places) < tree.free

    def once(whole, at):
        i, parent, column, more, free = at
        force = jnp.sum(whole[i] * column[:, None], 0)  # (faster than a product of a matrix)
        inverse = jnp.where(free, 1.0 / jnp.where(free, column @ force + more, 1.0), 0.0)
        left = whole[i] - inverse * force[:, None] * force[None, :]
        return _put(whole, parent, whole[parent] + left), (force, inverse)

    along = *tree.rows, columns, added, is_free
    _, (forces, inverse) = jax.lax.scan(once, inertias, along, reverse=True)
    return LoopFactors(tree, columns, forces, inverse)
