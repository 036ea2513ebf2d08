"""A step in between its ends: Hermite polynomials, and the states of a motion by them."""

import jax.numpy as jnp
from jaxtyping import Array


def hermite(y0, s0, y1, s1, x):
    """The cubic through both ends with slopes s0 and s1 (per unit of x), at x in [0, 1]."""
    d = y1 - y0
    return y0 + x * (s0 + x * ((3 * d - 2 * s0 - s1) + x * (s0 + s1 - 2 * d)))


def quintic(start, end, x):
    """The quintic through (value, slope, second derivative), per unit of x, at both ends; and its slope; at x."""
    (p, v, c), (q, w, g) = start, end
    d, e, f = q - p - v - 0.5 * c, w - v - c, g - c
    k3, k4, k5 = 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f
    value = p + x * (v + x * (0.5 * c + x * (k3 + x * (k4 + x * k5))))
    return value, v + x * (c + x * (3 * k3 + x * (4 * k4 + x * 5 * k5)))


def between(ends: tuple[Array, Array, Array, Array], h, x, free: int) -> Array:
    """The state at a fraction x of a step of size h; ends (y0, y1, slope0, slope1), states `[q, v, ...]` along the last
    axis. Its `free` coordinates and their speeds by the quintic through the accelerations, the rest by the cubic.
    """
    y0, y1, slope0, slope1 = ends
    q, v = slice(0, free), slice(free, 2 * free)
    start, end = ((y[..., q], h * y[..., v], h * h * slope[..., v]) for y, slope in ((y0, slope0), (y1, slope1)))
    place, speed = quintic(start, end, x)
    rest = hermite(
        y0[..., 2 * free :], h * slope0[..., 2 * free :], y1[..., 2 * free :], h * slope1[..., 2 * free :], x
    )
    return jnp.concatenate([place, speed / h, rest], axis=-1)
