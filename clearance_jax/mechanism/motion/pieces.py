"""Piecewise polynomials of time, the prepared form of several drives; quintic ones of least jerk through points.

Between two points with values, speeds and accelerations the curve of least jerk, which minimises the integral of
q'''^2, is a quintic, whose integral is a quadratic form of these numbers. The sum over all intervals is like a beam of
finite elements: the unknown numbers follow from a positive definite system with one small block for each inner point.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax._compile.solo import whole
from clearance_jax.mechanism.motion.motion_laws import AbstractTable, Motion3, Values
from clearance_jax.parameters import physical


class Pieces(AbstractTable):
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
        """The motion at a time by the polynomial of the piece that holds at the time `beside`. Where a piece ends and
        the next begins, `beside` decides between them.
        """
        # Two of these times may be one (a move that never reaches its speed): the last piece that begins there counts.
        index = jnp.sum(beside >= self.times)
        u = time - _row(self.times, jnp.maximum(index - 1, 0))
        powers = _row(self.coefficients, index)
        q = v = a = jnp.zeros(())
        for k in reversed(range(self.coefficients.shape[1])):  # Horner's rule for the polynomial and its derivatives
            q, v, a = powers[k] + u * q, q + u * v, 2 * v + u * a
        return q, v, a

    def window(self, time):
        several = len(self.times) > 1
        return (jnp.maximum(jnp.sum(time >= self.times) - 1, 0), (2, 1)) if several else None

    def breaks(self):
        return self.times


def _row(table: Array, index: Array) -> Array:
    """A row of a table. Of few rows (a `window`) by selection: for the derivative of an index, which differs between
    lanes, a compiled loop is cut in pieces.
    """
    if len(table) > 2:
        return table[index]
    return jnp.where(index > 0, table[-1], table[0])


Blocks = Float[Array, "..."]

# The quintic on 0 <= x <= 1 with q = 0 at x = 0: its powers 3, 4 and 5 by (speed, acceleration, speed, acceleration) at
# both ends and by the rise between them.
HERMITE = np.array([[-6.0, -1.5, -4.0, 0.5, 10.0], [8.0, 1.5, 7.0, -1.0, -15.0], [-3.0, -0.5, -3.0, 0.5, 6.0]])
# Integrals over x of the products of 6, 24 x and 60 x^2, the third derivatives of these powers.
_JERK = np.array([[36.0, 72.0, 120.0], [72.0, 192.0, 360.0], [120.0, 360.0, 720.0]])
_ELEMENT = HERMITE.T @ _JERK @ HERMITE


def least_jerk(times: Values, values: Values, speeds: Values | None) -> tuple[Values, Values]:
    """Speeds and accelerations at every point, of a motion from rest to rest or with given `speeds`; accelerations at
    both ends are zero. **Arguments:** `times` [s] (increasing), `values`.
    """
    n = times.shape[0]
    known = jnp.stack([jnp.zeros(n) if speeds is None else speeds, jnp.zeros(n)], axis=-1)
    if n == 2:
        return known[:, 0], known[:, 1]
    sought = slice(0 if speeds is None else 1, 2)
    diagonal, beside, slope = _assemble(times, values, known)
    correction = _solve(diagonal[1:-1, sought, sought], beside[1:-1, sought, sought], -slope[1:-1, sought])
    full = known.at[1:-1, sought].add(correction)
    return full[:, 0], full[:, 1]


def _assemble(times: Values, values: Values, known: Blocks) -> tuple[Blocks, Blocks, Blocks]:
    """Half the integral's second derivatives, (n, 2, 2) and (n - 1, 2, 2), and half its slope (n, 2), at `known`."""
    h = jnp.diff(times)
    unit = jnp.stack([h, h * h], axis=-1)  # speed and acceleration on 0 <= x <= 1; the integral scales by h^-5
    unit = jnp.concatenate([unit, unit], axis=-1) * h[:, None] ** -2.5
    element = unit[:, :, None] * _ELEMENT[None, :4, :4] * unit[:, None, :]
    pull = unit * _ELEMENT[None, :4, 4] * (jnp.diff(values) * h**-2.5)[:, None]
    ends = jnp.concatenate([known[:-1], known[1:]], axis=-1)
    pull = pull + jnp.einsum("nij,nj->ni", element, ends)
    diagonal = jnp.zeros((times.shape[0], 2, 2)).at[:-1].add(element[:, :2, :2]).at[1:].add(element[:, 2:, 2:])
    slope = jnp.zeros((times.shape[0], 2)).at[:-1].add(pull[:, :2]).at[1:].add(pull[:, 2:])
    return diagonal, element[:, :2, 2:], slope


def _solve(diagonal: Blocks, beside: Blocks, right: Blocks) -> Blocks:
    """Solve a positive definite system of three bands of blocks: (n, b, b), (n - 1, b, b), (n, b)."""

    def eliminate(before, row):
        # `before`, of the row above: its inverse diagonal block times the block beside it, and times its right side.
        down, block, above, side = row
        block = block - above.T @ before[0]
        side = side - above.T @ before[1]
        done = jnp.linalg.solve(block, jnp.concatenate([down, side[:, None]], axis=-1))
        now = done[:, :-1], done[:, -1]
        return now, now

    def substitute(after, row):
        now = row[1] - row[0] @ after
        return now, now

    none = jnp.zeros_like(diagonal[:1])
    rows = (jnp.concatenate([beside, none]), diagonal, jnp.concatenate([none, beside]), right)
    start = (jnp.zeros_like(diagonal[0]), jnp.zeros_like(right[0]))
    _, kept = jax.lax.scan(eliminate, start, rows)
    return jax.lax.scan(substitute, start[1], kept, reverse=True)[1]
