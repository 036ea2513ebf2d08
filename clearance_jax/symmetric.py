"""Symmetric systems in the words of `spatial`: mass matrices factored entry by entry, inertias as six numbers."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array

from clearance_jax._sharing import shared
from clearance_jax.spatial import Rotation, Term, Vector, as_array, dot, is_zero, minus, plus, times, total


class Symmetric:
    """A symmetric 3 x 3 matrix whose entries are made when they are asked for: a plane mechanism asks for the last one
    only, and what nobody asks for is not in the program. (Ask in the trace that made it.)
    """

    def __init__(self, entry: Callable[[int, int], Term]):
        self._entry = entry
        self._known: dict[tuple[int, int], Term] = {}

    def entry(self, i: int, j: int) -> Term:
        """The entry in row i and column j."""
        key = min(i, j), max(i, j)
        if key not in self._known:
            self._known[key] = self._entry(*key)
        return self._known[key]

    def apply(self, a: Vector) -> Vector:
        """Times a vector."""
        x, y, z = (total(times(self.entry(i, j), a[j]) for j in range(3) if not is_zero(a[j])) for i in range(3))
        return x, y, z

    def __add__(self, other: "Symmetric") -> "Symmetric":
        return Symmetric(lambda i, j: plus(self.entry(i, j), other.entry(i, j)))


NOTHING = Symmetric(lambda i, j: 0.0)


def rotated(inner: Symmetric, rotation: Rotation) -> Symmetric:
    """R inner R^T."""
    rows = rotation.rows
    half: dict[int, Vector] = {}

    def entry(i: int, j: int) -> Term:
        if j not in half:
            half[j] = inner.apply(rows[j])
        return dot(rows[i], half[j])

    return Symmetric(entry)


def of_point(mass: Term, arm: Vector, moment: Vector) -> Symmetric:
    """The inertia m (r.r 1 - r r^T) of a mass at the arm r, where its moment is m r."""
    return Symmetric(
        lambda i, j: (
            total(times(moment[k], arm[k]) for k in range(3) if k != i)
            if i == j
            else minus(0.0, times(moment[i], arm[j]))
        )
    )


def shifted(inertia: Symmetric, by: Vector, old: Vector, new: Vector) -> Symmetric:
    """An inertia about a point, seen from another: `by` leads from the new point to the old; `old` and `new` are mass
    times the arm of its centre from each.
    """

    def entry(i: int, j: int) -> Term:
        if i == j:
            both = total(times(by[k], plus(old[k], new[k])) for k in range(3) if k != i)
            return plus(inertia.entry(i, j), both)
        return minus(inertia.entry(i, j), plus(times(by[i], new[j]), times(old[i], by[j])))

    return Symmetric(entry)


class Factored(NamedTuple):
    """L D L^T of a symmetric positive matrix, `lower[i][j]` for j < i."""

    lower: list[list[Term]]
    inverse_diagonal: list[Term]

    def solve(self, right: list[Term]) -> list[Term]:
        """The solution for one right-hand side."""
        lower, inverse = self
        n = len(right)
        x, once = list(right), _links(n)
        for i in range(n):
            x[i] = once(minus(x[i], total(times(lower[i][j], x[j]) for j in range(i))))
        x = [times(inverse[i], x[i]) for i in range(n)]
        for i in reversed(range(n)):
            x[i] = once(minus(x[i], total(times(lower[j][i], x[j]) for j in range(i + 1, n))))
        return x


class Dense(NamedTuple):
    """The same of many rows as one array, by a library (lower Cholesky factor): a call costs some microseconds, but the
    program stays small, where one of single numbers takes minutes to compile.
    """

    lower: Array

    @property
    def inverse_diagonal(self) -> Array:
        """One over the pivots."""
        return 1.0 / jnp.diagonal(self.lower) ** 2

    def solve(self, right: list[Term]) -> list[Term]:
        """The solution for one right-hand side."""
        found = cho_solve((self.lower, True), as_array(right))
        return [found[i] for i in range(len(right))]


# From so many rows on a symmetric system is an array.
MANY = 25
# Over lanes, rows of so many are shared: each is made of all before it.
DEEP = 5


def _links(rows: int) -> Callable:
    """What keeps the links of a chain of so many rows from being computed anew in the next ones."""
    return shared if rows >= DEEP else lambda tree: tree


def dense(matrix: list[list[Term]]) -> Array:
    """A symmetric matrix given by its lower triangle, as an array."""
    n = len(matrix)
    return jnp.stack([as_array(matrix[max(i, j)][min(i, j)] for j in range(n)) for i in range(n)])


def factor(matrix: list[list[Term]]) -> Factored | Dense:
    """Factor a symmetric positive definite matrix given by its lower triangle (structural zeros stay absent).

    Of a handful of rows the loops are unrolled into the program.
    """
    if len(matrix) >= MANY:
        return Dense(jnp.linalg.cholesky(dense(matrix)))
    lower: list[list[Term]] = []
    inverse: list[Term] = []
    once = _links(len(matrix))
    for i, entries in enumerate(matrix):
        row: list[Term] = []
        scaled: list[Term] = []
        for j in range(i):
            coupled = minus(entries[j], total(times(scaled[k], lower[j][k]) for k in range(j)))
            scaled.append(coupled)
            row.append(0.0 if is_zero(coupled) else times(coupled, inverse[j]))
        row, scaled = once((row, scaled))
        lower.append(row)
        inverse.append(1.0 / minus(entries[i], total(times(row[k], scaled[k]) for k in range(i))))
    return Factored(lower, inverse)
