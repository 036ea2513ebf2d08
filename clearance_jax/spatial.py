"""Scalars, vectors and rotations of space with structural zeros and ones.

A Python float is a constant of the compiled program, an array is a number of the model. Products with the floats 0.0
and 1.0 vanish while the program is traced, so that an absent offset, an identity rotation or an uncoupled pair of
coordinates costs nothing (matrix products would cost a library call each).

Vectors are triples `(x, y, z)`. A plane mechanism is not a mode: its z components, and all turns but those about z, are
structural zeros, and so is everything computed from them. The same functions take pairs `(x, y)` of a plane.
"""

import functools
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from clearance_jax._basis.numerics import safe_norm, safe_sqrt, sincos
from clearance_jax._compile.barriers import share

Term = Array | float
Vector = tuple[Term, Term, Term]
Pair = tuple[Term, Term]
Matrix = tuple[Vector, Vector, Vector]
Terms = TypeVar("Terms", bound=tuple[Term, ...])

ZERO: Vector = (0.0, 0.0, 0.0)
X: Vector = (1.0, 0.0, 0.0)
Y: Vector = (0.0, 1.0, 0.0)
Z: Vector = (0.0, 0.0, 1.0)
UNIT: Matrix = (X, Y, Z)


def is_zero(a: Term) -> bool:
    """Whether `a` is absent from the program (the Python number 0), as opposed to an array that happens to be 0."""
    return isinstance(a, (int, float)) and a == 0


def absent(a: tuple[Term, ...]) -> bool:
    """Whether every component is absent."""
    return all(is_zero(term) for term in a)


def _alike(a: Term, b: Term) -> bool:
    """Whether two terms are arrays of one kind, which `lax` can join. (The operators of arrays promote kinds first, by
    programs of their own, and take longer to trace.)
    """
    return isinstance(a, Array) and isinstance(b, Array) and a.shape == b.shape and a.dtype == b.dtype


def plus(a: Term, b: Term) -> Term:
    """The sum a + b."""
    if _alike(a, b):
        return lax.add(a, b)
    return b if is_zero(a) else a if is_zero(b) else a + b


def minus(a: Term, b: Term) -> Term:
    """The difference a - b; that of a term with itself is absent."""
    if a is b:
        return 0.0
    if _alike(a, b):
        return lax.sub(a, b)
    return a if is_zero(b) else -b if is_zero(a) else a - b


def times(a: Term, b: Term) -> Term:
    """The product a b."""
    if _alike(a, b):
        return lax.mul(a, b)
    if is_zero(a) or is_zero(b):
        return 0.0
    for factor, other in ((a, b), (b, a)):
        if isinstance(factor, float) and abs(factor) == 1.0:
            return other if factor > 0 else -other
    return a * b


def total(terms) -> Term:
    """The sum of `terms`, 0.0 for none."""
    return functools.reduce(plus, terms, 0.0)


def add(a: Terms, b: Terms) -> Terms:
    """The vector a + b."""
    return tuple(plus(p, q) for p, q in zip(a, b, strict=True))  # pyright: ignore[reportReturnType]


def subtract(a: Terms, b: Terms) -> Terms:
    """The vector a - b."""
    return tuple(minus(p, q) for p, q in zip(a, b, strict=True))  # pyright: ignore[reportReturnType]


def scale(k: Term, a: Terms) -> Terms:
    """The vector k a."""
    return tuple(times(k, p) for p in a)  # pyright: ignore[reportReturnType]


def dot(a, b) -> Term:
    """The scalar product a . b."""
    return total(times(p, q) for p, q in zip(a, b, strict=True))


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a x b: the moment of a force b at the arm a, the velocity at the arm b of a spin a."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def centripetal(spin: Vector, arm: Vector) -> Vector:
    """The centripetal acceleration spin x (spin x arm)."""
    return add(scale(dot(spin, arm), spin), scale(minus(0.0, dot(spin, spin)), arm))


def product(a: Matrix, b: Matrix) -> Matrix:
    """The matrix a b."""
    columns = transpose(b)
    rows = tuple(tuple(dot(row, column) for column in columns) for row in a)
    return rows[0], rows[1], rows[2]  # pyright: ignore[reportReturnType]


def transpose(a: Matrix) -> Matrix:
    """The transpose of a matrix."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = a
    return (xx, yx, zx), (xy, yy, zy), (xz, yz, zz)


class Rotation(NamedTuple):
    """A rotation by its matrix, which takes the rotated frame's components to the outer ones. It stores its last turn
    (by `angle` about `axis`, after `before`). A further turn about the same axis adds the angles, so a chain in a plane
    needs one sine and cosine a body, of the sum.
    """

    rows: Matrix = UNIT
    before: Matrix = UNIT
    axis: Vector = Z
    angle: Term = 0.0

    def apply(self, a: Vector) -> Vector:
        """From the rotated frame's axes to the outer axes."""
        x, y, z = (dot(row, a) for row in self.rows)
        return x, y, z

    def undo(self, a: Vector) -> Vector:
        """From the outer axes to the rotated frame's axes."""
        x, y, z = (dot(row, a) for row in transpose(self.rows))
        return x, y, z

    @property
    def is_plane(self) -> bool:
        """Whether its structure is a turn about z."""
        return self.before is UNIT and same_line(self.axis, Z) > 0

    def turn(self, axis: Vector, angle: Term) -> "Rotation":
        """The rotation followed by a turn about an axis (unit, in the rotated frame's axes)."""
        if is_zero(angle):
            return self
        before, whole, sign = self.rows, angle, same_line(axis, self.axis)
        if sign:
            axis, before, whole = self.axis, self.before, plus(self.angle, times(sign, angle))
        return Rotation(product(before, about(axis, whole)), before, axis, whole)

    def compose(self, rows: Matrix) -> "Rotation":
        """The rotation followed by one that is given by its matrix."""
        whole = product(self.rows, rows)
        return Rotation(whole, whole)


IDENTITY = Rotation()


def same_line(a: Vector, b: Vector) -> float:
    """1 if two axes are structurally the same, -1 if opposite, else 0."""
    if a is b:
        return 1.0
    if not all(isinstance(term, float) for term in (*a, *b)):
        return 0.0
    return 1.0 if a == b else -1.0 if a == scale(-1.0, b) else 0.0


def about(axis: Vector, angle: Term) -> Matrix:
    """The matrix of a turn by `angle` [rad] about a unit vector (Rodrigues)."""
    sine, cosine = share(sincos(jnp.asarray(angle)))
    if all(isinstance(term, float) for term in axis) and sum(map(is_zero, axis)) == 2:
        k = next(i for i in range(3) if not is_zero(axis[i]))
        s, rows = times(axis[k], sine), [[*row] for row in UNIT]
        i, j = (k + 1) % 3, (k + 2) % 3
        rows[i][i], rows[j][j], rows[i][j], rows[j][i] = cosine, cosine, minus(0.0, s), s
    else:
        outer = [[times(1 - cosine, times(p, q)) for q in axis] for p in axis]
        x, y, z = (times(sine, p) for p in axis)
        turning = ((0.0, minus(0.0, z), y), (z, 0.0, minus(0.0, x)), (minus(0.0, y), x, 0.0))
        rows = [[plus(plus(outer[i][j], turning[i][j]), cosine if i == j else 0.0) for j in range(3)] for i in range(3)]
    return tuple(tuple(row) for row in rows)  # pyright: ignore[reportReturnType]


def across(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors that make a right-handed frame with a third: (first, second, axis)."""
    # Without a branch that a small change of the axis could flip (Duff et al. 2017).
    x, y, z = (jnp.asarray(term, float) for term in axis)
    sign = jnp.where(z < 0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    first = (1.0 + sign * x * x * a, sign * x * y * a, -sign * x)
    return first, cross((x, y, z), first)


def of_quaternion(w: Term, x: Term, y: Term, z: Term) -> Matrix:
    """The matrix of a quaternion of any length, so that the vector field does not depend on the length."""
    size = total(times(p, p) for p in (w, x, y, z))
    double = 2.0 / size
    xx, yy, zz = (times(double, times(p, p)) for p in (x, y, z))
    xy, xz, yz = (times(double, times(p, q)) for p, q in ((x, y), (x, z), (y, z)))
    wx, wy, wz = (times(double, times(w, p)) for p in (x, y, z))
    return (
        (1.0 - plus(yy, zz), minus(xy, wz), plus(xz, wy)),
        (plus(xy, wz), 1.0 - plus(xx, zz), minus(yz, wx)),
        (minus(xz, wy), plus(yz, wx), 1.0 - plus(xx, yy)),
    )


class Swing(NamedTuple):
    """A rotation by two tilts: matrix, spins per unit rate of each in outside and inside axes, `part` 1 / (1 + g^2)."""

    rows: Matrix
    outside: tuple[Vector, Vector]
    inside: tuple[Vector, Vector]
    part: Term


def swing(u: Vector, v: Vector, a: Term, b: Term) -> Swing:
    """The rotation about g = (a u + b v) / 2 by 2 atan |g|. (Two successive turns about u and v would favour these axes
    over others in their plane.)

    Its spin is 2 (g' + g x g') / (1 + g^2), and with the other sign of g x g' in the rotated axes (Rodrigues).
    """
    x, y = times(0.5, a), times(0.5, b)
    part, normal = 1.0 / (1.0 + plus(times(x, x), times(y, y))), cross(u, v)
    first, second = scale(times(part, y), normal), scale(times(part, x), normal)
    u_part, v_part = scale(part, u), scale(part, v)
    return Swing(
        of_quaternion(1.0, *add(scale(x, u), scale(y, v))),
        (subtract(u_part, first), add(v_part, second)),
        (add(u_part, first), subtract(v_part, second)),
        part,
    )


def quaternion_of(roll: Term, pitch: Term, yaw: Term) -> tuple[Term, ...]:
    """The quaternion (w, x, y, z) of Rz(yaw) Ry(pitch) Rx(roll)."""
    q: tuple[Term, ...] = (1.0, 0.0, 0.0, 0.0)
    for axis, angle in ((Z, yaw), (Y, pitch), (X, roll)):
        if not is_zero(angle):
            sine, cosine = sincos(0.5 * jnp.asarray(angle))
            q = hamilton(q, (cosine, *scale(sine, axis)))
    return q


def hamilton(p: tuple[Term, ...], q: tuple[Term, ...]) -> tuple[Term, ...]:
    """The product of two quaternions."""
    (a, *u), (b, *v) = p, q
    u, v = (u[0], u[1], u[2]), (v[0], v[1], v[2])
    return minus(times(a, b), dot(u, v)), *add(add(scale(a, v), scale(b, u)), cross(u, v))


def rotation_vector(q: tuple[Term, ...]) -> Vector:
    """The rotation vector (axis times angle, at most half a turn) [rad] of a quaternion of any length."""
    w, x, y, z = (jnp.asarray(term, float) for term in q)
    sign = jnp.where(w < 0, -1.0, 1.0)
    size, w = safe_sqrt(x * x + y * y + z * z), sign * w
    small = size < 1e-8 * w
    factor = jnp.where(small, 2 / jnp.where(small, w, 1.0), 2 * jnp.arctan2(size, w) / jnp.where(small, 1.0, size))
    return scale(sign * factor, (x, y, z))


def quaternion_of_matrix(a: Matrix) -> tuple[Term, ...]:
    """A quaternion (w, x, y, z), of any length, of a rotation's matrix, from the largest of its numbers."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = ((jnp.asarray(term, float) for term in row) for row in a)
    rows = (
        (1 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz),
    )
    square = jnp.stack([jnp.stack(row) for row in rows])
    q = square[jnp.argmax(jnp.diagonal(square))]
    return q[0], q[1], q[2], q[3]


def rotation_between(a: Rotation, b: Rotation) -> Vector:
    """The rotation vector [rad], in the outer axes, that takes `a` to `b`; of half a turn its sign is undefined."""
    if a.is_plane and b.is_plane:
        return 0.0, 0.0, minus(b.angle, a.angle)
    return rotation_vector(quaternion_of_matrix(product(b.rows, transpose(a.rows))))


def length_of(vector: Vector) -> Array:
    """The length of a vector, with gradient 0 where it is zero."""
    if is_zero(vector[2]):
        return safe_norm(jnp.asarray(vector[0], float), jnp.asarray(vector[1], float))
    return safe_sqrt(jnp.asarray(dot(vector, vector), float))


def quaternion_rate(q: tuple[Term, ...], spin: Vector) -> tuple[Term, ...]:
    """The rate of a quaternion (w, x, y, z) by the spin in the rotated frame's own axes: q' = q (0, spin) / 2."""
    return scale(0.5, hamilton(q, (0.0, *spin)))


def three(a: Array) -> Vector:
    """An array of three as a vector."""
    return a[0], a[1], a[2]


def as_array(terms) -> Array:
    """Stack terms into one array, absent ones as zeros; an array is returned as it is."""
    if isinstance(terms, jax.Array):
        return terms
    terms = list(terms)
    return jnp.stack([jnp.asarray(term, dtype=float) for term in terms]) if terms else jnp.zeros(0)


def matrix(rows: Matrix) -> Array:
    """A matrix as an array."""
    return jnp.stack([as_array(row) for row in rows])


def put(whole: Array, places: np.ndarray, values: Array) -> Array:
    """`whole` (n, ...) with `values` (k, ...) in its `places` (k,), which are known when it is traced. It avoids a
    scatter: a program that has one cannot be compiled as one function (see `_compile.one_function`).
    """
    source = np.arange(len(whole))
    source[places] = len(whole) + np.arange(len(places))
    return jnp.concatenate([whole, values])[source]
