"""Symmetric systems in terms of `spatial`: mass matrices factored entry by entry, inertias as six numbers.

A large system is an array instead. Both forms have one interface: rows, factors, constraints.
"""

import abc
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._compile.barriers import share
from clearance_jax.spatial import Rotation, Term, Vector, absent, as_array, dot, is_zero, minus, plus, times, total


class Symmetric:
    """A symmetric 3 x 3 matrix whose entries are computed on request, in the trace that made it: few are needed."""

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

    def map(self, function: Callable) -> "Symmetric":
        """The same with a function of every entry."""
        return Symmetric(lambda i, j: function(self.entry(i, j)))

    def __add__(self, other: "Symmetric") -> "Symmetric":
        return Symmetric(lambda i, j: plus(self.entry(i, j), other.entry(i, j)))


NOTHING = Symmetric(lambda i, j: 0.0)


def rotate(inner: Symmetric, rotation: Rotation) -> Symmetric:
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


def shift(inertia: Symmetric, by: Vector, old: Vector, new: Vector) -> Symmetric:
    """An inertia about a point P, moved to a point Q: `by` is the vector from Q to P; `old` and `new` are the mass
    times the vectors from P and from Q to the centre of mass.
    """

    def entry(i: int, j: int) -> Term:
        if i == j:
            both = total(times(by[k], plus(old[k], new[k])) for k in range(3) if k != i)
            return plus(inertia.entry(i, j), both)
        return minus(inertia.entry(i, j), plus(times(by[i], new[j]), times(old[i], by[j])))

    return Symmetric(entry)


class Row(Module):
    """One number for each unknown, one by one or as an array: a row of a Jacobian."""

    numbers: list[Term] | Array

    @property
    def terms(self) -> list[Term]:
        """The numbers one by one."""
        return [self.numbers[i] for i in range(len(self.numbers))]

    @property
    def array(self) -> Array:
        """The numbers as one array."""
        return as_array(self.numbers)

    @property
    def is_absent(self) -> bool:
        """Whether all of them are absent from the program."""
        return isinstance(self.numbers, list) and absent(tuple(self.numbers))

    def dot(self, values: list[Term]) -> Term:
        """The row times values of the unknowns."""
        if isinstance(self.numbers, list):
            return total(times(r, value) for r, value in zip(self.numbers, values, strict=True))
        return self.numbers @ as_array(values)


Choice = Callable[[Callable[[], Array]], Array | None]
"""A function that marks the conditions to solve for with 1 and those that repeat others with 0 (`None`: solve for all).
Its argument is a function that computes J M^-1 J^T, which is not needed where all are solved for.
"""


class AbstractConstraint(Module):
    """Conditions J x = c on a symmetric system M, of which some may be left out."""

    @property
    @abc.abstractmethod
    def asked(self) -> Array:
        """Which conditions are solved for (1) and which are left out (0), if there was a choice."""

    @abc.abstractmethod
    def closure_step(self, right: list[Term]) -> tuple[list[Term], list[Term]]:
        """The smallest change x (in the norm of M) with J x = right, and the multipliers that make it."""


class AbstractFactors(Module):
    """A symmetric positive matrix M, factored."""

    @property
    @abc.abstractmethod
    def inverse_diagonal(self) -> Any:
        """The inverse of the pivots, by row."""

    @abc.abstractmethod
    def solve(self, right: list[Term]) -> list[Term]:
        """The solution for one right-hand side."""

    def constraint(self, rows: Sequence[Row], choose: Choice) -> AbstractConstraint:
        """The constraint of conditions, given by the rows of their Jacobian J."""
        spread = [self.solve(row.terms) for row in rows]
        compliance = [
            [total(times(p, q) for p, q in zip(row.terms, spread[j], strict=True)) for j in range(i + 1)]
            for i, row in enumerate(rows)
        ]
        chosen = choose(lambda: dense(compliance))
        if chosen is None:
            return Constraint(spread, factor(compliance), None)
        kept: list[Term] = [chosen[i] for i in range(len(rows))]
        for i, row in enumerate(compliance):
            row[:i] = [times(times(kept[i], kept[j]), row[j]) for j in range(i)]
            row[i] = jnp.where(kept[i] > 0, row[i], 1.0)
        return Constraint(spread, factor(compliance), kept)


class Constraint(AbstractConstraint):
    """A constraint number by number: `spread` is M^-1 J^T, `factored` is J M^-1 J^T; `kept`: 1 for the conditions to
    solve for, 0 for those that repeat others (`None`: all are solved for).
    """

    spread: list[list[Term]]
    factored: AbstractFactors
    kept: list[Term] | None

    @property
    def asked(self):
        assert self.kept is not None
        return as_array(self.kept)

    def closure_step(self, right):
        if self.kept is not None:
            right = [times(k, r) for k, r in zip(self.kept, right, strict=True)]
        multipliers = self.factored.solve(right)
        count = len(self.spread[0])
        change = [total(times(m, s[k]) for m, s in zip(multipliers, self.spread, strict=True)) for k in range(count)]
        return change, multipliers


class DenseConstraint(AbstractConstraint):
    """A constraint of many conditions or unknowns, as arrays (see `Dense`)."""

    spread: Array
    lower: Array
    kept: Array | None

    @property
    def asked(self):
        assert self.kept is not None
        return self.kept

    def closure_step(self, right):
        asked = as_array(right) if self.kept is None else self.kept * as_array(right)
        multipliers = cho_solve((self.lower, True), asked)
        change = self.spread @ multipliers
        return [change[i] for i in range(change.shape[0])], [multipliers[i] for i in range(multipliers.shape[0])]


class Factored(AbstractFactors):
    """L D L^T of a symmetric positive matrix: `lower[i][j]` for j < i, and the `inverse` of D."""

    lower: list[list[Term]]
    inverse: list[Term]

    @property
    def inverse_diagonal(self):
        return self.inverse

    def solve(self, right):
        lower, inverse = self.lower, self.inverse
        n = len(right)
        x, once = list(right), _sharing(n)
        for i in range(n):
            x[i] = once(minus(x[i], total(times(lower[i][j], x[j]) for j in range(i))))
        x = [times(inverse[i], x[i]) for i in range(n)]
        for i in reversed(range(n)):
            x[i] = once(minus(x[i], total(times(lower[j][i], x[j]) for j in range(i + 1, n))))
        return x


class Dense(AbstractFactors):
    """Factors of a large matrix as an array, by a library: number by number it would compile for minutes."""

    lower: Array

    @property
    def inverse_diagonal(self):
        return 1.0 / jnp.diagonal(self.lower) ** 2

    def solve(self, right):
        solution = cho_solve((self.lower, True), as_array(right))
        return [solution[i] for i in range(len(right))]

    def constraint(self, rows, choose):
        jacobian = jnp.stack([row.array for row in rows])
        return dense_constraint(jacobian, cho_solve((self.lower, True), jacobian.T), choose)


def dense_constraint(jacobian: Array, spread: Array, choose: Choice) -> DenseConstraint:
    """The constraint of a Jacobian J, `spread` being M^-1 J^T."""
    compliance = jacobian @ spread
    asked = choose(lambda: compliance)
    if asked is not None:
        compliance = compliance * asked[:, None] * asked[None, :] + jnp.diag(1 - asked)
    return DenseConstraint(spread, jnp.linalg.cholesky(compliance), asked)


# From this many rows on a symmetric system is an array.
MANY = 25
# A row is computed from all rows before it. With at least this many, each row is shared: without that the compiler may
# compute the earlier ones again in every later one.
DEEP = 5


def _sharing(rows: int) -> Callable:
    """`share` for a system of so many `rows`, or a function that does nothing where they are few."""
    return share if rows >= DEEP else lambda tree: tree


def dense(matrix: list[list[Term]]) -> Array:
    """A symmetric matrix given by its lower triangle, as an array."""
    n = len(matrix)
    return jnp.stack([as_array(matrix[max(i, j)][min(i, j)] for j in range(n)) for i in range(n)])


def factor(matrix: list[list[Term]]) -> AbstractFactors:
    """Factor a symmetric positive definite matrix by its lower triangle (structural zeros stay absent); few rows
    unrolled.
    """
    if len(matrix) >= MANY:
        return Dense(jnp.linalg.cholesky(dense(matrix)))
    lower: list[list[Term]] = []
    inverse: list[Term] = []
    once = _sharing(len(matrix))
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
