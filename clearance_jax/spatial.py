"""A small vocabulary of scalars, plane vectors, rotations and symmetric systems that knows structural zeros and ones.

A Python float is a constant of the compiled program, an array is a number of the model. Products with the float 0.0
and 1.0 vanish while the program is traced, so that an absent offset, an identity rotation or an uncoupled pair of
coordinates costs nothing (matrix products would cost a library call each).

Vectors are pairs `(x, y)`. The space version of the same vocabulary takes triples; the algorithms of
`clearance_jax.mechanism` are written in these words only.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import sincos
from clearance_jax._sharing import shared

Term = Array | float
Vector = tuple[Term, Term]

ZERO: Vector = (0.0, 0.0)


def is_zero(a: Term) -> bool:
    """Whether `a` is absent from the program (the Python number 0), as opposed to an array that happens to be 0."""
    return isinstance(a, (int, float)) and a == 0


def plus(a: Term, b: Term) -> Term:
    """A + b."""
    return b if is_zero(a) else a if is_zero(b) else a + b


def minus(a: Term, b: Term) -> Term:
    """A - b; the difference of a term with itself is absent."""
    return 0.0 if a is b else a if is_zero(b) else -b if is_zero(a) else a - b


def times(a: Term, b: Term) -> Term:
    """A * b."""
    if is_zero(a) or is_zero(b):
        return 0.0
    if isinstance(a, float) and a == 1.0:
        return b
    if isinstance(b, float) and b == 1.0:
        return a
    return a * b


def total(terms) -> Term:
    """The sum of `terms`, 0.0 for none."""
    result: Term = 0.0
    for term in terms:
        result = plus(result, term)
    return result


def add(a: Vector, b: Vector) -> Vector:
    """A + b."""
    return plus(a[0], b[0]), plus(a[1], b[1])


def subtract(a: Vector, b: Vector) -> Vector:
    """A - b."""
    return minus(a[0], b[0]), minus(a[1], b[1])


def scale(k: Term, a: Vector) -> Vector:
    """K a."""
    return times(k, a[0]), times(k, a[1])


def dot(a: Vector, b: Vector) -> Term:
    """A . b."""
    return plus(times(a[0], b[0]), times(a[1], b[1]))


def cross(a: Vector, b: Vector) -> Term:
    """The out-of-plane component of a x b: the moment of a force b at the arm a."""
    return minus(times(a[0], b[1]), times(a[1], b[0]))


def spin_cross(spin: Term, a: Vector) -> Vector:
    """Spin x a for a spin about the plane's normal."""
    return minus(0.0, times(spin, a[1])), times(spin, a[0])


class Rotation(NamedTuple):
    """A plane rotation by its cosine and sine."""

    cosine: Term
    sine: Term

    def apply(self, a: Vector) -> Vector:
        """From the rotated frame's axes to the outer axes."""
        c, s = self
        return minus(times(c, a[0]), times(s, a[1])), plus(times(s, a[0]), times(c, a[1]))

    def undo(self, a: Vector) -> Vector:
        """From the outer axes to the rotated frame's axes."""
        return Rotation(self.cosine, minus(0.0, self.sine)).apply(a)


IDENTITY = Rotation(1.0, 0.0)


def rotation_of(angle: Term) -> Rotation:
    """The rotation by `angle` [rad]; an absent angle is the identity."""
    if is_zero(angle):
        return IDENTITY
    sine, cosine = shared(sincos(jnp.asarray(angle)))
    return Rotation(cosine, sine)


class Factored(NamedTuple):
    """L D L^T of a symmetric positive matrix, `lower[i][j]` for j < i."""

    lower: list[list[Term]]
    inverse_diagonal: list[Term]

    def solve(self, right: list[Term]) -> list[Term]:
        """The solution for one right-hand side."""
        lower, inverse = self
        n = len(right)
        x = list(right)
        for i in range(n):
            x[i] = minus(x[i], total(times(lower[i][j], x[j]) for j in range(i)))
        x = [times(inverse[i], x[i]) for i in range(n)]
        for i in reversed(range(n)):
            x[i] = minus(x[i], total(times(lower[j][i], x[j]) for j in range(i + 1, n)))
        return x


def factor(matrix: list[list[Term]]) -> Factored:
    """Factor a symmetric positive definite matrix given by its lower triangle (structural zeros stay absent).

    n is the number of free coordinates (a handful), so the loops are unrolled into the program.
    """
    lower: list[list[Term]] = []
    inverse: list[Term] = []
    for i, entries in enumerate(matrix):
        row: list[Term] = []
        scaled: list[Term] = []
        for j in range(i):
            coupled = minus(entries[j], total(times(scaled[k], lower[j][k]) for k in range(j)))
            scaled.append(coupled)
            row.append(0.0 if is_zero(coupled) else times(coupled, inverse[j]))
        lower.append(row)
        inverse.append(1.0 / minus(entries[i], total(times(row[k], scaled[k]) for k in range(i))))
    return Factored(lower, inverse)


def as_array(terms: list[Term]) -> Array:
    """Stack terms into one array, absent ones as zeros."""
    return jnp.stack([jnp.asarray(term, dtype=float) for term in terms]) if terms else jnp.zeros(0)
