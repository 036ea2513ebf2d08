"""Functions of several alike arguments with one copy in the program."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax._compile.barriers import is_sharing, share

# From so many on small alike things are mapped too, of one motion: half the program. Of lanes they are faster apart.
MANY = 6


def side_by_side(function: Callable, several: Sequence[tuple]) -> list[Any]:
    """`function(*arguments)` for each of several arguments. Alike ones are mapped, so that the function stands in the
    program once for them all.
    """
    out: list[Any] = [None] * len(several)
    for members in alike(several):
        if len(members) == 1:
            out[members[0]] = function(*several[members[0]])
            continue
        mapped = eqx.filter_vmap(function, in_axes=eqx.if_array(0))
        stacked = mapped(*stack_trees([several[i] for i in members]))
        for k, i in enumerate(members):
            out[i] = jax.tree.map(lambda x, k=k: x[k] if eqx.is_array(x) else x, stacked)
    return out


def each_joint(function: Callable, several: Sequence[tuple]) -> list[Any]:
    """`function(joint, ...)` for each of `several` prepared joints and their arguments. Alike ones with several points,
    or many, are stacked: one copy in the program. Others are small, and one more axis would slow a batch.
    """
    large = [args[0].joint.count > 1 for args in several]
    beside = [i for kind in alike(several) for i in kind if large[i] or (len(kind) >= MANY and not is_sharing())]
    stacked = dict(zip(beside, side_by_side(function, [several[i] for i in beside]), strict=True))
    return [stacked[i] if i in stacked else share(function(*args)) for i, args in enumerate(several)]


def results_together(function: Callable, several: Sequence[tuple]) -> Any:
    """`function(*arguments)` for each of several arguments, as one tree along a new first axis."""
    if len(alike(several)) > 1:
        return stack_trees(side_by_side(function, several))
    return eqx.filter_vmap(function, in_axes=eqx.if_array(0))(*stack_trees(several))


def alike(several: Sequence[Any]) -> list[list[int]]:
    """Indices of alike trees, in groups: one structure, arrays of the same shapes, the same constants."""
    groups: list[tuple[Any, list[int]]] = []
    for i, tree in enumerate(several):
        leaves, structure = jax.tree.flatten(tree)
        signature = structure, [(x.shape, x.dtype) if eqx.is_array(x) else x for x in leaves]
        known = next((members for other, members in groups if other == signature), None)
        if known is None:
            groups.append((signature, [i]))
        else:
            known.append(i)
    return [members for _, members in groups]


def stack_trees(trees: Sequence[Any], axis: int = 0) -> Any:
    """Alike trees as one, with their arrays stacked along a new axis."""
    return jax.tree.map(lambda *x: jnp.stack(x, axis) if eqx.is_array(x[0]) else x[0], *trees)


def numbers_of(tree: Any) -> tuple[list[jax.Array], Callable[[list[jax.Array]], Any]]:
    """The arrays of a tree, each once, and a function that rebuilds the tree with other arrays in their places."""
    leaves, structure = jax.tree.flatten(tree)
    places: dict[int, int] = {}
    numbers = []
    for x in leaves:
        if isinstance(x, jax.Array) and id(x) not in places:
            places[id(x)] = len(numbers)
            numbers.append(x)

    def rebuilt(others: list[jax.Array]) -> Any:
        return structure.unflatten([others[places[id(x)]] if isinstance(x, jax.Array) else x for x in leaves])

    return numbers, rebuilt
