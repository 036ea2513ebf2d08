"""A model without its numbers, as a key for whatever follows from its structure alone."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import equinox as eqx
import jax


class TreeShape(NamedTuple):
    """A tree with a shape in place of every array; hashable if everything else in the tree is."""

    structure: Any
    leaves: tuple[Any, ...]

    @property
    def shapes(self) -> list[jax.ShapeDtypeStruct]:
        """The shapes of the arrays, in order."""
        return [leaf for leaf in self.leaves if isinstance(leaf, jax.ShapeDtypeStruct)]

    def fill(self, arrays: Iterable[Any]) -> Any:
        """The tree with these arrays."""
        rest = iter(arrays)
        leaves = [next(rest) if isinstance(leaf, jax.ShapeDtypeStruct) else leaf for leaf in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)


def tree_shape(tree: Any) -> TreeShape:
    """The shape of a tree of arrays, tracers, and anything else."""
    leaves, structure = jax.tree.flatten(tree)
    return TreeShape(structure, tuple(map(_shape, leaves)))


def _shape(leaf: Any) -> Any:
    return jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) if eqx.is_array(leaf) else leaf
