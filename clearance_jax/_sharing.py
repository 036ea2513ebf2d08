"""Values that many others are made of, computed once.

XLA on the CPU fuses elementwise work into one kernel for each of its results, and computes what they share anew in each
(twice to three times the arithmetic of a batch). It does not do so with a division. So where a program runs over many
lanes, what is `share` is divided by a one that the compiler cannot see through; alone it is left as it is.
"""

import contextlib
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

# What a barrier's own operations are named in a compiled program (`experiments/operations` leaves them out).
BARRIER = "shared"

_sharing: ContextVar[bool] = ContextVar("sharing", default=False)


@contextlib.contextmanager
def sharing() -> Iterator[None]:
    """Within, `share` keeps its promise."""
    token = _sharing.set(True)
    try:
        yield
    finally:
        _sharing.reset(token)


def share(tree: Any) -> Any:
    """The same numbers and flags, which a compiled program over lanes computes once."""
    return jax.tree.map(_once, tree) if _sharing.get() else tree


def compute_once(tree: Any) -> Any:
    """As `share`, in any program: of values that a chain of others is made of, each of the one before it, where the
    work done anew would double with every link. What stands in several places stays one value.
    """
    known: dict[int, Any] = {}

    def once(x):
        if id(x) not in known:
            known[id(x)] = _once(x)
        return known[id(x)]

    return jax.tree.map(once, tree)


def _once(x: Any) -> Any:
    counts = isinstance(x, jax.Array) and (x.dtype == bool or jnp.issubdtype(x.dtype, jnp.inexact))
    return barrier.bind(x) if counts else x


def _barrier(x: jax.Array) -> jax.Array:
    if x.dtype == bool:
        with jax.named_scope(BARRIER):
            numbers = lax.select(x, jnp.ones(x.shape), jnp.zeros(x.shape))
            return lax.gt(_barrier(numbers), jnp.zeros(x.shape))
    # Nothing is beyond infinity. The one is made of `x` itself: one for all its entries would be inverted first, and
    # a product with the inverse is computed anew again.
    with jax.named_scope(BARRIER):
        beyond, two, unity = (lax.full(x.shape, value, x.dtype) for value in (np.inf, 2.0, 1.0))
        return lax.div(x, lax.select(lax.gt(x, beyond), two, unity))


barrier = Primitive(BARRIER)
"""The identity, across which XLA on the CPU does not fuse."""
barrier.def_impl(lambda x: x)
barrier.def_abstract_eval(lambda x: x)
ad.deflinear2(barrier, lambda tangent, _: [barrier.bind(tangent)])
batching.defvectorized(barrier)
mlir.register_lowering(barrier, mlir.lower_fun(lambda x: x, multiple_results=False))
mlir.register_lowering(barrier, mlir.lower_fun(_barrier, multiple_results=False), platform="cpu")
