"""Damping factors a(e) of the hysteresis family: from the restitution that is asked for to the loss in the law."""

import abc

import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import Real
from clearance_jax._types import Number, Scalar, physical
from clearance_jax.laws._base import AbstractParameter, number


class AbstractDampingFactor(AbstractParameter):
    """A damping factor that is computed from a coefficient of restitution."""

    @abc.abstractmethod
    def factor(self) -> Number:
        """The damping factor a [1]."""

    def value(self, pin_radius: Scalar, radial_clearance: Scalar) -> Number:
        return self.factor()


class Exact(AbstractDampingFactor):
    """The damping factor that delivers exactly the restitution that is asked for.

    a (1 + e) = ln[(1 + a) / (1 - a e)]

    Source: phase-plane integral of F = K d^n (1 + a d_dot / v0), independent of n, K, m and v0 (FACTS.md 4.2).
    Solved to 14 digits for 1e-3 <= e <= 0.999; the smallest e are as good, nearer to 1 the digits of 1 - e are lost.

    **Arguments:**

    - `restitution`: e [1], delivered rebound speed over impact speed.
    """

    restitution: Number = physical("1", above=0.0, below=1.0)

    def factor(self) -> Number:
        return exact_damping_factor(number(self.restitution))


class LankaraniNikravesh(AbstractDampingFactor):
    """The damping factor of Lankarani and Nikravesh (1990), for nearly elastic impacts.

    a = 3 (1 - e^2) / 4

    Source: FACTS.md 1.2. Asked for 0.9 it delivers 0.913, asked for 0.5 it delivers 0.725.

    **Arguments:**

    - `restitution`: e [1], the restitution that is asked for.
    """

    restitution: Number = physical("1", above=0.0, below=1.0)

    def factor(self) -> Number:
        return 0.75 * (1 - self.restitution * self.restitution)


class Flores(AbstractDampingFactor):
    """The damping factor of Flores, Machado, Silva and Martins (2011), for soft and hard materials.

    a = 8 (1 - e) / (5 e)

    Source: FACTS.md 1.2. Asked for 0.9 it delivers 0.894, asked for 0.5 it delivers 0.470.

    **Arguments:**

    - `restitution`: e [1], the restitution that is asked for.
    """

    restitution: Number = physical("1", above=0.0, below=1.0)

    def factor(self) -> Number:
        return 1.6 * (1 - self.restitution) / self.restitution


@jax.custom_jvp
def exact_damping_factor(restitution: Real) -> Real:
    """The root a in (0, 1/e) of a (1 + e) = ln[(1 + a) / (1 - a e)].

    Newton's method for s = -ln(1 - a e), because a itself sticks to 1/e as e falls, on the equation divided by a^2,
    because a = 0 is a double root that would swallow the wanted one as e -> 1. From the start value the worst case
    (e = 0.999) needs five iterations; the sixth is free.
    """
    e = restitution

    def iterate(_, s):
        a = -jnp.expm1(-s) / e
        residual = e * e * _log_remainder(-a * e, -s) - _log_remainder(a, jnp.log1p(a))
        slope_of_a = jnp.exp(-s) / e
        slope = (slope_of_a / (1 + a) - e - 2 * slope_of_a * residual) / a
        return s - residual / slope

    s = jax.lax.fori_loop(0, 6, iterate, (1 + e) / e - jnp.log1p(1 / e))
    return -jnp.expm1(-s) / e


@exact_damping_factor.defjvp
def _exact_damping_factor_jvp(primals, tangents):
    # The implicit function theorem, simplified by hand; it can be differentiated again.
    (e,), (rate,) = primals, tangents
    a = exact_damping_factor(e)
    return a, a * e * (1 + a) / ((1 + e) * (1 - e - a * e)) * rate


def _log_remainder(x: Array, logarithm: Array) -> Array:
    """[ln(1 + x) - x] / x^2 for a given ln(1 + x), by its series where the difference would cancel."""
    series = jnp.zeros_like(x)
    for k in reversed(range(18)):  # the first term left out is below 1e-18 at |x| = 0.1
        series = series * x + (-1) ** (k + 1) / (k + 2)
    return jnp.where(jnp.abs(x) < 0.1, series, (logarithm - x) / (x * x))
