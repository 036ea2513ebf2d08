"""Roots by a fixed number of iterations, as programs under vmap want them, and with the derivative of the root."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from clearance_jax._basis.numerics import without_derivatives
from clearance_jax._basis.types import Scalar


def newton(step: Callable, start: Any, count: int, *numbers: Any, last: int = 1, unrolled: bool = False) -> Any:
    """The fixed point of `step(x, *numbers)`: `count` steps without derivatives, then `last` steps with them.

    At the root one Newton step gives the first derivatives by the `numbers`, those of the implicit function. Two steps
    also give the second derivatives, if `step` hides its slope from differentiation. `unrolled`: without a loop in the
    program, for few short steps in a vector field.
    """
    x, still = without_derivatives((start, numbers))
    if unrolled:
        for _ in range(count):
            x = step(x, *still)
    else:
        x = jax.lax.fori_loop(0, count, lambda _, x: step(x, *still), x)
    x = jax.lax.stop_gradient(x)
    for _ in range(last):
        x = step(x, *numbers)
    return x


# The number of iterations in logarithms, and the largest change of the logarithm in one of them.
SEARCH, STRIDE = 16, 5.0


def newton_in_logarithms(function: Callable[[Scalar], Scalar], value: Scalar, start: Scalar) -> Scalar:
    """The x > 0 at which a growing function has a value > 0, by Newton's method in logarithms, in which every power law
    is a straight line.

    It can be differentiated twice, although the slope is hidden from differentiation: at the solution each iteration
    makes the derivatives of the next order right.
    """

    def step(_, logarithm):
        x = jnp.exp(logarithm)
        now, slope = function(x), jax.lax.stop_gradient(jax.grad(function)(jax.lax.stop_gradient(x)))
        grows = (now > 0) & (slope > 0)
        now, slope = jnp.where(grows, now, value), jnp.where(grows, slope, 1.0)
        change = jnp.log(now / value) * jax.lax.stop_gradient(now / (slope * x))
        return logarithm - jnp.where(grows, jnp.clip(change, -STRIDE, STRIDE), -1.0)

    return jnp.exp(jax.lax.fori_loop(0, SEARCH, step, jnp.log(start)))


def bisect(is_before: Callable, low: Any, high: Any, count: Any) -> tuple[Any, Any]:
    """The bracket of the place where `is_before(x)` turns false, after `count` halvings."""

    def halve(_, ends):
        low, high = ends
        middle = 0.5 * (low + high)
        before = is_before(middle)
        return jnp.where(before, middle, low), jnp.where(before, high, middle)

    return jax.lax.fori_loop(0, count, halve, (low, high))
