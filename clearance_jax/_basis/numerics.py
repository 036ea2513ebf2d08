"""Elementary functions with a finite value and a finite gradient everywhere a contact can go.

Every function here is tested for its value, its gradient at the kink, a mixed batch, and arguments of 1e-12.
"""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._compile.barriers import share

Real = Float[Array, "..."]
Number = Real | Float[np.ndarray, "..."] | float
Tree = TypeVar("Tree")

# pi/2 in two parts (Cody and Waite): the first has 33 significant bits, so that n * part is exact for |n| < 2**19.
_HALF_PI_HIGH = float.fromhex("0x1.921fb54400000p+0")
_HALF_PI_LOW = float.fromhex("0x1.0b4611a626331p-34")
# Minimax polynomials of sin and cos on |x| <= pi/4 (Cephes, S. L. Moshier), errors below 1.2e-16.
_SIN = (
    1.58962301576546568060e-10,
    -2.50507477628578072866e-8,
    2.75573136213857245213e-6,
    -1.98412698295895385996e-4,
    8.33333333332211858878e-3,
    -1.66666666666666307295e-1,
)
_COS = (
    -1.13585365213876817300e-11,
    2.08757008419747316778e-9,
    -2.75573141792967388112e-7,
    2.48015872888517045348e-5,
    -1.38888888888730564116e-3,
    4.16666666666665929218e-2,
)


@jax.custom_jvp
def sincos(angle: Real) -> tuple[Real, Real]:
    """`(sin(angle), cos(angle))` in arithmetic that vectorises.

    XLA calls the scalar library for float64 sin and cos on the CPU, which is several times slower. The error is below
    4e-16 for |angle| < 50 and grows as 1e-16 * |angle| beyond, the resolution of such an angle in float64.
    """
    # Sine and cosine both read both polynomials. Without `share` each would compute them, and their inputs, again.
    quarter_turns = share(jnp.floor(angle * (2 / np.pi) + 0.5))
    x = share((angle - quarter_turns * _HALF_PI_HIGH) - quarter_turns * _HALF_PI_LOW)
    xx = x * x
    sine = share(x + x * xx * _horner(_SIN, xx))
    cosine = share(1 - 0.5 * xx + xx * xx * _horner(_COS, xx))
    quadrant = quarter_turns - 4 * jnp.floor(quarter_turns * 0.25)
    swapped = (quadrant == 1) | (quadrant == 3)
    sine, cosine = jnp.where(swapped, cosine, sine), jnp.where(swapped, sine, cosine)
    return (jnp.where(quadrant >= 2, -sine, sine), jnp.where((quadrant == 1) | (quadrant == 2), -cosine, cosine))


@sincos.defjvp
def _sincos_jvp(primals, tangents):
    (angle,), (rate,) = primals, tangents
    sine, cosine = sincos(angle)
    return (sine, cosine), (cosine * rate, -sine * rate)


def without_derivatives(tree: Tree) -> Tree:
    """The same tree, its numbers without derivatives."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if eqx.is_array(x) else x, tree)


# What roots and powers are taken of where their argument is not positive: nothing that is seen. Two kernels may compute
# an argument near 0 with other roundings, and so disagree about its sign. A one here, taken by the kernel that finds
# the argument positive, would be a pin that has gone one metre into its sleeve.
_UNSEEN = 1e-30


def _horner(coefficients, x):
    value = jnp.full_like(x, coefficients[0])
    for coefficient in coefficients[1:]:
        value = value * x + coefficient
    return value


def safe_sqrt(x: Real) -> Real:
    """`sqrt(max(x, 0))` whose gradient at and below 0 is 0, not infinite."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, _UNSEEN)), 0.0)


def safe_norm(x: Real, y: Real) -> Real:
    """`sqrt(x**2 + y**2)`, exact down to 1e-150, with gradient 0 at the origin (no floor: 1e-12 m is a length here)."""
    return safe_sqrt(x * x + y * y)


def safe_unit(x: Real, y: Real) -> tuple[Real, Real, Real]:
    """`(length, x/length, y/length)`; at the origin the direction is undefined and (0, 0) is returned."""
    length = share(safe_norm(x, y))
    inverse = 1 / jnp.where(length > 0, length, 1.0)
    return length, x * inverse, y * inverse


def positive_part(x: Real) -> Real:
    """`max(x, 0)` with gradient 0 at the kink (nothing touches, so nothing changes)."""
    return jnp.where(x > 0, x, 0.0)


def lesser(x: Number, y: Number) -> Real:
    """`min(x, y)`, whose derivative is that of one of the two; where they are equal, the mean of both. (JAX compares
    its minimum with the arguments for a derivative. In a program over lanes another kernel may have computed the same
    argument with other last digits: then it equals neither, and the derivative is zero.)
    """
    return jnp.where(y < x, y, jnp.where(x < y, x, 0.5 * (x + y)))


def greater(x: Number, y: Number) -> Real:
    """`max(x, y)`, as `lesser`."""
    return jnp.where(y > x, y, jnp.where(x > y, x, 0.5 * (x + y)))


def within(x: Number, low: Number, high: Number) -> Real:
    """x, held between two bounds, as `lesser`."""
    return greater(lesser(x, high), low)


def power_three_halves(x: Real) -> Real:
    """`max(x, 0)**1.5` as x * sqrt(x), much cheaper than a general power."""
    return positive_part(x) * safe_sqrt(x)


def positive_power(x: Real, exponent: Real) -> Real:
    """`max(x, 0)**exponent` for exponent >= 1, with gradient 0 for x <= 0."""
    positive = x > 0
    return jnp.where(positive, jnp.where(positive, x, _UNSEEN) ** exponent, 0.0)


def step3(s: Real) -> Real:
    """The cubic STEP from 0 at s <= 0 to 1 at s >= 1: s^2 (3 - 2 s). C1; its second derivative jumps at both ends."""
    s = within(s, 0.0, 1.0)
    return s * s * (3 - 2 * s)


def step5(s: Real) -> Real:
    """The quintic STEP from 0 at s <= 0 to 1 at s >= 1: s^3 (10 - 15 s + 6 s^2). C2."""
    s = within(s, 0.0, 1.0)
    return s * s * s * (10 + s * (6 * s - 15))


def step7(s: Real) -> Real:
    """The STEP of seventh order from 0 at s <= 0 to 1 at s >= 1: s^4 (35 - 84 s + 70 s^2 - 20 s^3). C3."""
    s = within(s, 0.0, 1.0)
    return s**4 * (35 + s * (s * (70 - 20 * s) - 84))


def step7_slope(s: Real) -> Real:
    """The derivative of `step7`, 140 s^3 (1 - s)^3. C2."""
    s = within(s, 0.0, 1.0)
    return 140 * (s * (1 - s)) ** 3


def corner(s: Real) -> Real:
    """The C2 form of |s| minus |s|: (1 - |s|)^3 (3 + |s|) / 8 for |s| < 1, and zero beyond."""
    s = jnp.abs(s)
    return positive_part(1 - s) ** 3 * (3 + s) / 8
