"""Piecewise polynomials of time, the prepared form of several drives."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.mechanism.motion_laws import AbstractMotionLaw, Motion3, Values
from clearance_jax.parameters import physical


class Pieces(AbstractMotionLaw):
    """Piecewise polynomials: a drive as a solve evaluates it.

    **Arguments:** `coefficients` (n + 1, powers), lowest power first, of the time since a piece began (of the first,
    which has no begin: since it ended); `times` (n,) [s] at which a piece ends and the next begins.
    """

    coefficients: Float[Array, "pieces powers"]
    times: Values = physical("s")

    @whole
    def __call__(self, time):
        return self.within(time, time)

    def within(self, time: Scalar, beside: Scalar) -> Motion3:
        """The value on the piece at the time `beside`; at a time that two pieces share it decides between them."""
        # Two of these times may be one (a move that never reaches its speed): the last piece that begins there counts.
        index = jnp.sum(beside >= self.times)
        u = time - self.times[jnp.maximum(index - 1, 0)]
        powers = self.coefficients[index]
        q = v = a = jnp.zeros(())
        for k in reversed(range(self.coefficients.shape[1])):  # Horner's rule for the polynomial and its derivatives
            q, v, a = powers[k] + u * q, q + u * v, 2 * v + u * a
        return q, v, a

    def breaks(self):
        return self.times
