"""The impact of a linear oscillator with the damping ratio z = b / (2 sqrt(m k)), and of equivalent laws.

For F = K d^n + c d^((n-1)/2) d' the phase plane of x = d^((n+1)/2) and d' is that of a linear oscillator with z = c /
sqrt(2 (n + 1) m K): the restitution is the same at every speed.
"""

import jax
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar

# About z = 1 the angle over its sine is a series.
NEAR = 1e-3
NEWTON = 30


def _angle_over_sine(z: Scalar) -> Scalar:
    """A(z) = arccos(z) / sqrt(1 - z^2), which goes on beyond 1 as arccosh(z) / sqrt(z^2 - 1)."""
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
    """The damping ratio z at which an impact has this `restitution`: its inverse.

    Newton on a concave function comes to the root from the left; the last iteration is the implicit derivative.
    """
    logarithm = -jnp.log(restitution)
    if not clipped:
        return logarithm / jnp.sqrt(jnp.pi**2 + logarithm**2)

    def newton(z, target):
        value, slope = jax.value_and_grad(lambda x: 2 * x * _angle_over_sine(x))(z)
        return z - (value - target) / slope

    fixed = jax.lax.stop_gradient(logarithm)
    z = jax.lax.fori_loop(0, NEWTON, lambda _, z: newton(z, fixed), fixed / jnp.pi)
    z = jax.lax.stop_gradient(z)
    slope = jax.lax.stop_gradient(jax.grad(lambda x: 2 * x * _angle_over_sine(x))(z))
    return z - (2 * z * _angle_over_sine(z) - logarithm) / slope
