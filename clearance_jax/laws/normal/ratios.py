"""The damping ratio a(e) of the laws F = K d^n (1 + a(e) d'/v0), and the restitution that a ratio delivers.

A free impact of any mass, stiffness, exponent and speed delivers the root e of a (1 + e) = ln((1 + a)/(1 - a e)), which
follows from the phase-plane integral of the impact. Every ratio but the exact one is an approximation of it.

An impact of a linear oscillator has the damping ratio z = b / (2 sqrt(m k)). For F = K d^n + c d^((n-1)/2) d' the phase
plane of x = d^((n+1)/2) and d' is that of a linear oscillator with z = c / sqrt(2 (n + 1) m K): the restitution is the
same at every speed.
"""

import jax
import jax.numpy as jnp

from clearance_jax._basis.roots import newton
from clearance_jax._basis.types import Scalar

# A ratio below which the restitution that it delivers is a series.
SMALL = 1e-3


def hunt_crossley_ratio(restitution):
    """The ratio a = 3 (1 - e) / 2 (Hunt and Crossley 1975, doi 10.1115/1.3423596)."""
    return 1.5 * (1 - restitution)


def herbert_mcwhannell_ratio(restitution):
    """The ratio a = 6 (1 - e) / ((2 e - 1)^2 + 3) (Herbert and McWhannell 1977)."""
    return 6 * (1 - restitution) / ((2 * restitution - 1) ** 2 + 3)


def lee_wang_ratio(restitution):
    """The ratio a = 3 (1 - e) / 4 (Lee and Wang 1983)."""
    return 0.75 * (1 - restitution)


def gonthier_ratio(restitution):
    """The ratio a = (1 - e^2) / e (Gonthier et al. 2004)."""
    return (1 - restitution**2) / restitution


def zhiying_qishao_ratio(restitution):
    """The ratio a = 3 (1 - e^2) exp(2 (1 - e)) / 4 (Zhiying and Qishao 2006)."""
    return 0.75 * (1 - restitution**2) * jnp.exp(2 * (1 - restitution))


def hu_guo_ratio(restitution):
    """The ratio a = 3 (1 - e) / (2 e) (Hu and Guo 2015)."""
    return 1.5 * (1 - restitution) / restitution


def gharib_hurmuzlu_ratio(restitution):
    """The ratio a = 1 / e (Gharib and Hurmuzlu 2012); its source was not at hand. Poor for e above 0.3."""
    return 1 / restitution


def lankarani_nikravesh_ratio(restitution):
    """The ratio a = 3 (1 - e^2) / 4 (Lankarani and Nikravesh 1990, doi 10.1115/1.2912617)."""
    return 0.75 * (1 - restitution**2)


def flores_ratio(restitution):
    """The ratio a = 8 (1 - e) / (5 e) (Flores et al. 2011, doi 10.1007/s11044-010-9237-4)."""
    return 1.6 * (1 - restitution) / restitution


def exact_ratio(restitution):
    """The root of a (1 + e) = ln((1 + a)/(1 - a e)): delivers e exactly for every n, K, mass and speed.

    Newton from a fit that is good to 0.002 in e.
    """
    e = restitution
    # Newton for w = ln(1 - a e): near a = 1/e (small e) the logarithm's pole is gone, and for e -> 1 the fit starts on
    # the right side of the trivial root a = 0.
    fit = (1 - e) / e * (1.5 - 0.5 * (1 - e) ** 2.85)
    start = jnp.where(e < 0.3, jnp.log1p(1 / e) - (1 + e) / e, jnp.log1p(-e * jnp.where(e < 0.3, 0.0, fit)))

    def step(w, e):
        a = -jnp.expm1(w) / e
        slope = 1 - jnp.exp(w) / e * ((1 + e) - 1 / (1 + a))
        return w - (w - jnp.log1p(a) + a * (1 + e)) / slope

    return -jnp.expm1(newton(step, start, 12, e)) / e


def delivered_restitution(ratio: Scalar) -> Scalar:
    """The restitution e that a damping ratio a > 0 delivers: the root of a (1 + e) = ln((1 + a)/(1 - a e)).

    Newton for w = ln(1 - a e): the function is concave, so the iterations approach the root from the left. Below
    `SMALL`, where the function would lose its digits, e is a series.
    """
    small = ratio < SMALL
    series = 1 - ratio * (2 / 3 - ratio * (4 / 9 - ratio * (44 / 135 - ratio * (104 / 405))))
    ratio = jnp.where(small, 1.0, ratio)

    def step(w, a):
        # a (1 + e) - ln(1 + a) + w = 0 with a e = 1 - exp(w).
        return w - (a - jnp.expm1(w) - jnp.log1p(a) + w) / (1 - jnp.exp(w))

    # The start is the root without the term exp(w), which lies left of the root. For a small ratio the first iterations
    # only halve the distance: hence 40.
    w = newton(step, jnp.log1p(ratio) - ratio - 1, 40, ratio)
    return jnp.where(small, series, -jnp.expm1(w) / ratio)


# About z = 1 the angle over its sine is a series.
NEAR = 1e-3
NEWTON = 30


def _angle_over_sine(z: Scalar) -> Scalar:
    """The function A(z) = arccos(z) / sqrt(1 - z^2) for z < 1, and arccosh(z) / sqrt(z^2 - 1) beyond."""
    u = 1 - z
    near, below = jnp.abs(u) < NEAR, z < 1
    series = 1 + u * (1 / 3 + u * (2 / 15 + u * (2 / 35)))
    root = jnp.sqrt(jnp.where(near, 1.0, jnp.abs(u * (1 + z))))
    inside = jnp.arctan2(root, jnp.where(below & ~near, z, 0.0)) / root
    outside = jnp.log(jnp.where(below | near, 2.0, z + root)) / root
    return jnp.where(near, series, jnp.where(below, inside, outside))


def oscillator_restitution(ratio: Scalar, clipped: bool) -> Scalar:
    """The restitution of an impact with the damping `ratio` z: exp(-2 z A(z)) where the force is `clipped`, so that the
    mass leaves where it is zero; exp(-pi z / sqrt(1 - z^2)) where it pulls, and 0 from z = 1 on.
    """
    if clipped:
        return jnp.exp(-2 * ratio * _angle_over_sine(ratio))
    swings = ratio < 1
    z = jnp.where(swings, ratio, 0.0)
    return jnp.where(swings, jnp.exp(-jnp.pi * z / jnp.sqrt(1 - z * z)), 0.0)


def oscillator_ratio(restitution: Scalar, clipped: bool) -> Scalar:
    """The damping ratio z at which an impact has this `restitution`: Newton on a concave function, from the left."""
    logarithm = -jnp.log(restitution)
    if not clipped:
        return logarithm / jnp.sqrt(jnp.pi**2 + logarithm**2)

    def step(z, target):
        value, slope = jax.value_and_grad(lambda x: 2 * x * _angle_over_sine(x))(z)
        return z - (value - target) / slope

    return newton(step, logarithm / jnp.pi, NEWTON, logarithm)
