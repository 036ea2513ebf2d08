"""Values that many others are made of, computed once.

XLA on the CPU fuses elementwise work into one kernel for each of its results, and computes what they share anew in each
(twice to three times the arithmetic of a batch). It does not do so with a division. So where a program runs over many
lanes, what is `shared` is divided by a one that the compiler cannot see through; alone it is left as it is.
"""

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

_one: ContextVar[Array | None] = ContextVar("one", default=None)


@contextlib.contextmanager
def sharing(one: Array) -> Iterator[None]:
    """Within, `shared` divides by `one`."""
    token = _one.set(one)
    try:
        yield
    finally:
        _one.reset(token)


def shared(tree: Any) -> Any:
    """The same numbers, which a compiled program over lanes computes once."""
    one = _one.get()
    if one is None:
        return tree
    return jax.tree.map(
        lambda x: x / one if isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.inexact) else x, tree
    )
