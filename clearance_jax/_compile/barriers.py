"""Values that many others use, computed once.

XLA on the CPU fuses elementwise work into one kernel for each result, and computes shared values anew in each. It does
not do so with a division. So in a program over many lanes `share` divides a value by a one that the compiler cannot
recognise. Outside of lanes the value is left as it is.
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

# Name of a barrier's own operations in a compiled program (`experiments/operations` leaves them out).
BARRIER = "shared"

_sharing: ContextVar[bool] = ContextVar("sharing", default=False)


@contextlib.contextmanager
def sharing() -> Iterator[None]:
    """A context in which `share` has its effect."""
    token = _sharing.set(True)
    try:
        yield
    finally:
        _sharing.reset(token)


def is_sharing() -> bool:
    """Whether a program over many lanes is traced."""
    return _sharing.get()


def share(tree: Any) -> Any:
    """The same numbers and flags; a compiled program over lanes computes them once."""
    return jax.tree.map(_once, tree) if _sharing.get() else tree


def with_barriers(tree: Any) -> Any:
    """As `share`, in any program: for chains of values, each used by the next, where repeated work would double with
    every link. A value in several places stays one value. A program that is read (`once`) loses them and gets its own.
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
    # Nothing is beyond infinity. The one is computed from `x` itself: a common one would be inverted first, and a
    # product with the inverse is computed anew again.
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
