"""The penetration of a pin under a force."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar

# Newton iterations for a depth; the longest of them, in powers of e.
SEARCH, STRIDE = 16, 5.0


def depth_of(borne: Callable[[Scalar], Scalar], force: Scalar, start: Scalar) -> Scalar:
    """The penetration at which a joint bears a force > 0, by Newton's method in logarithms, in which every power law is
    a straight line.

    It can be differentiated twice, although the slope is hidden from differentiation: at the solution each iteration
    makes the derivatives of the next order right.
    """

    def newton(_, logarithm):
        depth = jnp.exp(logarithm)
        now, stiffness = borne(depth), jax.lax.stop_gradient(jax.grad(borne)(jax.lax.stop_gradient(depth)))
        presses = (now > 0) & (stiffness > 0)
        now, stiffness = jnp.where(presses, now, force), jnp.where(presses, stiffness, 1.0)
        step = jnp.log(now / force) * jax.lax.stop_gradient(now / (stiffness * depth))
        return logarithm - jnp.where(presses, jnp.clip(step, -STRIDE, STRIDE), -1.0)

    return jnp.exp(jax.lax.fori_loop(0, SEARCH, newton, jnp.log(start)))
