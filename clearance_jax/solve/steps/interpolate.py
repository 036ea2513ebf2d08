"""Interpolation inside a step by Hermite polynomials."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.types import Each
from clearance_jax._compile.barriers import share
from clearance_jax._compile.lane_axis import component_axis, components
from clearance_jax.mechanism.state import Layout


def hermite(y0, s0, y1, s1, x):
    """The cubic through both ends with slopes s0 and s1 (per unit of x), at x in [0, 1]."""
    d = y1 - y0
    return y0 + x * (s0 + x * ((3 * d - 2 * s0 - s1) + x * (s0 + s1 - 2 * d)))


def quintic_coefficients(start, end) -> tuple:
    """Coefficients, constant first, of the quintic through values, slopes and second derivatives at both ends."""
    (p, v, c), (q, w, g) = start, end
    d, e, f = share((q - p - v - 0.5 * c, w - v - c, g - c))
    return p, v, 0.5 * c, 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f


def polynomial(coefficients, x) -> tuple:
    """The value and the slope of a polynomial at x, for its coefficients (two at least), the constant first."""
    value, slope = coefficients[-1] * x + coefficients[-2], coefficients[-1]
    for c in coefficients[-3::-1]:
        value, slope = value * x + c, slope * x + value
    return value, slope


def between(ends: tuple[Array, Array, Array, Array], h: Each, x, plan: Layout) -> Array:
    """The state at a fraction x of a step of size h; ends (y0, y1, slope0, slope1), states `[q, v, ...]` along the last
    axis but the lanes'. By the quintic through accelerations where positions have their speeds; the rest by the cubic.
    """
    y0, y1, slope0, slope1 = ends
    if plan.positions != plan.velocities:
        return hermite(y0, h * slope0, y1, h * slope1, x)

    def of(y, part):
        return components(y, part, h)

    q, v, rest = plan.q, plan.v, slice(plan.v.stop, None)
    start, end = ((of(y, q), h * of(y, v), h * h * of(slope, v)) for y, slope in ((y0, slope0), (y1, slope1)))
    coefficients = quintic_coefficients(start, end)
    place, change = polynomial(coefficients, x)
    others = hermite(of(y0, rest), h * of(slope0, rest), of(y1, rest), h * of(slope1, rest), x)
    return jnp.concatenate([place, change / h, others], axis=component_axis(h))


def tops(value: Array, slope: Array, width: Any = 1.0) -> tuple[Array, Array, Array]:
    """Place in [0, 1], height (minus infinity: none) and second derivative of the maximum of the cubic on each part
    between places (first axis), from values and slopes there; `width` of the parts.

    A part that rises though its slopes at both ends fall holds a jump: its top is its end, without a second derivative.
    """
    a, b, rise = slope[:-1] * width, slope[1:] * width, value[1:] - value[:-1]
    smooth = (a > 0) & (b <= 0)
    cubic, square = a + b - 2 * rise, 3 * rise - 2 * a - b
    root = jnp.sqrt(jnp.where(smooth, square * square - 3 * cubic * a, 1.0))
    x = jnp.where(smooth, a / jnp.where(smooth, root - square, 1.0), 1.0)
    jumps = (a <= 0) & (b <= 0) & (rise > 1e-9 * jnp.abs(value[1:]))
    height = jnp.where(jumps, value[1:], value[:-1] + x * (a + x * (square + x * cubic)))
    return x, jnp.where(smooth | jumps, height, -jnp.inf), jnp.where(smooth, -2 * root, 0.0)
