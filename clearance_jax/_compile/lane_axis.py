"""Lanes: motions solved side by side, as the last axis of every array of a solve.

So a number for each lane broadcasts with an array of state components, one component of all lanes is contiguous in
memory, and the code of an attempt is the same with and without lanes. The physics, written for one motion, is mapped
over them.
"""

import contextlib
import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Each, Rows
from clearance_jax._compile.barriers import share, sharing

LAST = eqx.if_array(-1)


def each_lane(function: Callable, time: Each) -> Callable:
    """`function` of one motion, mapped over the lanes of `time`, if any."""
    if not jnp.ndim(time):
        return function

    def one_lane(*arguments):
        with sharing():
            return function(*arguments)

    return eqx.filter_vmap(one_lane, in_axes=LAST, out_axes=LAST)


def sharing_lanes(time: Each) -> contextlib.AbstractContextManager:
    """A context in which `share` works on arrays of lanes as it does within `each_lane`."""
    return sharing() if jnp.ndim(time) else contextlib.nullcontext()


def components(y: Any, part: slice, time: Each) -> Any:
    """Components of a state or a stack of states (their axis is the last before the lanes')."""
    return y[..., part, :] if jnp.ndim(time) else y[..., part]


def by_component(rows: Rows, time: Each) -> Array:
    """A stack of states from one stack for each component."""
    return together(rows, time, 1)


def together(rows: Sequence[Array], time: Each, axis: int = 0) -> Array:
    """Arrays along a new axis, before the lanes'."""
    if not jnp.ndim(time):
        return jnp.stack(rows, axis)
    # With lanes by selection: a compiled concatenation tests the part of every number, or copies number by number.
    first = jnp.expand_dims(share(rows[0]), axis)
    place = jnp.arange(len(rows)).reshape(-1, *[1] * (first.ndim - axis - 1))
    out = jnp.broadcast_to(first, (*first.shape[:axis], len(rows), *first.shape[axis + 1 :]))
    for i, row in enumerate(rows[1:], 1):
        out = jnp.where(place == i, jnp.expand_dims(share(row), axis), out)
    return out


def component_axis(time: Each) -> int:
    """The axis of a state's components."""
    return -1 - jnp.ndim(time)


def sum_components(y: Array, time: Each) -> Array:
    """The sum over the components of a state, or of each state of a stack."""
    # With lanes one by one: a compiled reduction over another axis than the last goes lane by lane.
    axis = component_axis(time)
    return functools.reduce(jnp.add, [jnp.take(y, i, axis) for i in range(y.shape[axis])])


def least(values: Array) -> Each:
    """The smallest along the first axis, of one motion or by lane."""
    if values.ndim == 1:
        return jnp.min(values)
    # With lanes half by half: a reduction over the first axis would be a loop for every lane.
    values = share(values)
    while len(values) > 1:
        half = -(-len(values) // 2)
        values = jnp.minimum(values[:half], values[-half:])
    return values[0]


def first_highest(values: Array) -> Array:
    """The index of the first largest value along the first axis, by lane."""
    if values.ndim == 1:
        return jnp.argmax(values)
    # With lanes entry by entry, as `least`.
    best, place = values[0], jnp.zeros(values.shape[1:], int)
    for i, value in enumerate(values[1:], 1):
        higher = value > best
        best, place = jnp.where(higher, value, best), jnp.where(higher, i, place)
    return place


def entry(values: Array, place: Array) -> Each:
    """The value at an index along the first axis, by lane."""
    if not place.ndim:
        return jax.lax.dynamic_index_in_dim(values, place, keepdims=False)
    out = values[0]
    for i, value in enumerate(values[1:], 1):
        out = jnp.where(place == i, value, out)
    return out


def to_lanes(tree: Any) -> Any:
    """A batch, along the first axis of every array, as lanes."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1) if eqx.is_array(x) else x, tree)


def from_lanes(tree: Any) -> Any:
    """Lanes as a batch along the first axis of every array."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0) if eqx.is_array(x) else x, tree)
