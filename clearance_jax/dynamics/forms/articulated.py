"""The mass matrix of a tree, factored joint by joint from the leaves to the root, in the world's axes and with the
zeros of the structure: articulated bodies (Featherstone 2008, chapter 7).

A joint passes on to its parent the inertia that its free coordinates do not take up. A pin, ball or block that slides
freely along all axes takes up every force, so only a couple is passed on, if what it carries passes on no force either.
The couple of a sleeve that turns its pin about one axis as prescribed has rank one. The parent's mass stays one number.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx

from clearance_jax._basis.module import Module
from clearance_jax._basis.symmetric import DEEP, AbstractFactors, Symmetric, factor
from clearance_jax._compile.barriers import share, with_barriers
from clearance_jax.dynamics.forms.frames import SpatialForce
from clearance_jax.dynamics.forms.inertia import Composite
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.tree.frame import JacobianColumn
from clearance_jax.spatial import (
    ZERO,
    Matrix,
    Term,
    Vector,
    absent,
    add,
    cross,
    dot,
    is_zero,
    minus,
    plus,
    scale,
    subtract,
    times,
    total,
)


class Twist(NamedTuple):
    """What a free coordinate does per unit rate: the velocity of the pivot, and the spin."""

    index: int
    velocity: Vector
    spin: Vector

    def power(self, wrench: SpatialForce) -> Term:
        """The power of a wrench about the pivot."""
        return plus(dot(self.velocity, wrench.force), dot(self.spin, wrench.moment))


class Articulated(NamedTuple):
    """An inertia about a pivot: with an acceleration a of the pivot and a spin rate b it takes the force `mass` a +
    `coupling`^T b and the moment `coupling` a + `inertia` b.
    """

    mass: Symmetric
    coupling: Matrix
    inertia: Symmetric

    @classmethod
    def of(cls, body: "Composite | Articulated") -> "Articulated":
        """The same for a body that moves as one."""
        if isinstance(body, Articulated):
            return body
        x, y, z = body.moment
        hat = (0.0, minus(0.0, z), y), (z, 0.0, minus(0.0, x)), (minus(0.0, y), x, 0.0)
        return cls(Symmetric(lambda i, j: body.mass if i == j else 0.0), hat, body.inertia)

    def map(self, function: Callable) -> "Articulated":
        """The same with a function of every number."""
        mass, inertia = self.mass.map(function), self.inertia.map(function)
        return Articulated(mass, function(self.coupling), inertia)

    def move(self, by: Vector) -> "Articulated":
        """The same about another pivot, from which `by` leads to its own."""
        if absent(by):
            return self
        columns = [tuple(self.mass.entry(i, j) for i in range(3)) for j in range(3)]
        moved = [cross(by, column) for column in columns]
        coupling = _rows(lambda i, j: plus(self.coupling[i][j], moved[j][i]))
        before, after = ([cross(by, row) for row in rows] for rows in (self.coupling, coupling))
        inertia = Symmetric(lambda i, j: plus(self.inertia.entry(i, j), plus(before[j][i], after[i][j])))
        return Articulated(self.mass, coupling, inertia)

    def __add__(self, other) -> "Articulated":
        coupling = _rows(lambda i, j: plus(self.coupling[i][j], other.coupling[i][j]))
        return Articulated(self.mass + other.mass, coupling, self.inertia + other.inertia)

    def along(self, twist: Twist) -> SpatialForce:
        """The wrench that it takes for a unit acceleration of a coordinate."""
        by_force = tuple(total(times(self.coupling[i][j], twist.spin[i]) for i in range(3)) for j in range(3))
        by_moment = tuple(dot(row, twist.velocity) for row in self.coupling)
        return SpatialForce(
            add(self.mass.apply(twist.velocity), by_force),  # pyright: ignore[reportArgumentType]
            add(by_moment, self.inertia.apply(twist.spin)),  # pyright: ignore[reportArgumentType]
        )

    def without(self, wrench: SpatialForce, inverse: Term) -> "Articulated":
        """What is left where a coordinate with this wrench and inverse inertia gives way."""
        (f, m), g, n = wrench, scale(inverse, wrench.force), scale(inverse, wrench.moment)
        return Articulated(
            Symmetric(lambda i, j: minus(self.mass.entry(i, j), times(f[i], g[j]))),
            _rows(lambda i, j: minus(self.coupling[i][j], times(m[i], g[j]))),
            Symmetric(lambda i, j: minus(self.inertia.entry(i, j), times(m[i], n[j]))),
        )


def _rows(entry: Any) -> Matrix:
    rows = tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))
    return rows  # pyright: ignore[reportReturnType]


Inertial = Composite | Articulated
"""The inertia of a body, by itself or with what its joints pass on."""


def sum_of(parts: Sequence[Inertial]) -> Inertial:
    """The sum of inertias about one pivot."""
    if not all(isinstance(part, Composite) for part in parts):
        parts = [Articulated.of(part) for part in parts]
    out = parts[0]
    for part in parts[1:]:
        out = out + part  # pyright: ignore[reportOperatorIssue]
    return out


class Stepwise(Module):
    """A joint's coordinates, each with the wrench that its acceleration takes and the inverse of its inertia."""

    columns: list[tuple[Twist, SpatialForce, Term]]

    def inward(self, right: list[Term], bias: SpatialForce) -> tuple[Any, SpatialForce]:
        """The accelerations if the parent stays, and the wrench that the parent must take up."""
        kept = []
        for twist, wrench, inverse in reversed(self.columns):
            by = times(inverse, minus(right[twist.index], twist.power(bias)))
            bias = SpatialForce(add(bias.force, scale(by, wrench.force)), add(bias.moment, scale(by, wrench.moment)))
            kept.append(by)
        return kept[::-1], bias

    def outward(self, kept: Any, velocity: Vector, spin: Vector, out: list[Term]) -> tuple[Vector, Vector]:
        """The accelerations into `out`, and the motion of the body, from those of the parent at the pivot."""
        for (twist, wrench, inverse), by in zip(self.columns, kept, strict=True):
            lag = plus(dot(wrench.force, velocity), dot(wrench.moment, spin))
            out[twist.index] = by = minus(by, times(inverse, lag))
            velocity, spin = add(velocity, scale(by, twist.velocity)), add(spin, scale(by, twist.spin))
        return velocity, spin

    def inverses(self) -> dict[int, Term]:
        """The inverse of the pivots, by index."""
        return {twist.index: inverse for twist, _, inverse in self.columns}


class Loose(Module):
    """A joint whose coordinates take up all forces: three `slides` (in the plane two), then `turns`.

    `inverse`: of the mass; `moment`: the mass times the arm of the centre, from the pivot. `moments`: of a unit
    acceleration of each turn, about the centre; `factored`: the inertia of the turns; `spread`: by turn, the part of
    its acceleration that a spin rate of the parent takes away.
    """

    slides: list[Twist]
    inverse: Term
    moment: Vector
    turns: list[Twist]
    moments: list[Vector]
    factored: AbstractFactors | None
    spread: list[Vector]

    def inward(self, right: list[Term], bias: SpatialForce) -> tuple[Any, SpatialForce]:
        """As of `Stepwise`."""
        force = ZERO
        for slide in self.slides:
            force = add(force, scale(right[slide.index], slide.velocity))
        pull = subtract(force, bias.force)
        swing = scale(self.inverse, cross(self.moment, pull))
        left = add(bias.moment, swing)
        by: list[Term] = []
        if self.factored is not None:
            by = self.factored.solve([minus(right[turn.index], dot(turn.spin, left)) for turn in self.turns])
        for moment, acceleration in zip(self.moments, by, strict=True):
            left = add(left, scale(acceleration, moment))
        return (pull, by), SpatialForce(force, left)

    def outward(self, kept: Any, velocity: Vector, spin: Vector, out: list[Term]) -> tuple[Vector, Vector]:
        """As of `Stepwise`."""
        pull, by = kept
        turned = spin
        for turn, acceleration, row in zip(self.turns, by, self.spread, strict=True):
            out[turn.index] = rate = minus(acceleration, dot(row, spin))
            turned = add(turned, scale(rate, turn.spin))
        moved = scale(self.inverse, subtract(pull, cross(turned, self.moment)))
        apart = subtract(moved, velocity)
        for slide in self.slides:
            out[slide.index] = dot(slide.velocity, apart)
        return moved, turned

    def inverses(self) -> dict[int, Term]:
        """The inverse of the pivots, by index."""
        out: dict[int, Term] = {slide.index: self.inverse for slide in self.slides}
        if self.factored is not None:
            pivots = self.factored.inverse_diagonal
            out |= {turn.index: pivots[k] for k, turn in enumerate(self.turns)}
        return out


class MovedBody(NamedTuple):
    """A moved body: the number of its parent (-1: one that no free coordinate moves), the way from the parent's pivot
    to its own, and its joint's coordinates (`None`: it moves with its parent).
    """

    parent: int
    by: Vector
    joint: Stepwise | Loose | None


class ArticulatedFactors(AbstractFactors):
    """The factored mass matrix of a tree of `count` free velocities; parents come before their children. `once`: what
    passes from link to link goes through it (`chain_barriers`).
    """

    links: list[MovedBody]
    count: int
    once: Callable = eqx.field(static=True)

    @property
    def inverse_diagonal(self):
        inverses = {i: x for link in self.links if link.joint is not None for i, x in link.joint.inverses().items()}
        return [inverses[i] for i in range(self.count)]

    def solve(self, right):
        bias = [SpatialForce()] * len(self.links)
        kept: list[Any] = [None] * len(self.links)
        for i in reversed(range(len(self.links))):
            parent, by, joint = self.links[i]
            wrench = bias[i]
            if joint is not None:
                kept[i], wrench = self.once(joint.inward(right, wrench))
            if parent >= 0:
                bias[parent] = bias[parent] + wrench.move(by)
        out: list[Term] = [0.0] * self.count
        motions: list[tuple[Vector, Vector]] = []
        for (parent, by, joint), answer in zip(self.links, kept, strict=True):
            velocity, spin = motions[parent] if parent >= 0 else (ZERO, ZERO)
            velocity = add(velocity, cross(spin, by))
            motions.append((velocity, spin) if joint is None else self.once(joint.outward(answer, velocity, spin, out)))
        return out


def chain_barriers(count: int, is_plane: bool) -> Callable:
    """The barriers between the links of a chain of so many free velocities: without them each would be computed again
    for every link beyond. (A program that is read, `_compile.once`, has its own.)
    """
    return with_barriers if not is_plane else share if count >= DEEP else lambda tree: tree


def eliminate(
    inertia: Inertial,
    columns: Sequence[JacobianColumn],
    pivot: Vector,
    rotors: dict[int, Term],
    is_loose: bool,
    is_plane: bool,
) -> tuple[Stepwise | Loose | None, Inertial | None]:
    """A joint's coordinates with the inertia that they move, and the inertia that they leave to the parent (`None`:
    nothing). `rotors`: added inertia by index; `is_loose`: whether the coordinates take up all forces.

    **Raises:** `Weightless` for a coordinate that moves no inertia.
    """
    if not columns:
        return None, inertia
    if is_loose and isinstance(inertia, Composite):
        return _loosen(inertia, [_twist(column, pivot) for column in columns], is_plane)
    left, out = Articulated.of(inertia), []
    for column in reversed(columns):
        twist = _twist(column, pivot)
        wrench = left.along(twist)
        resisting = plus(twist.power(wrench), rotors.get(column.index, 0.0))
        if is_zero(resisting):
            raise Weightless(column.index)
        out.append((twist, wrench, 1.0 / resisting))
        left = left.without(wrench, out[-1][2])
    return Stepwise(out[::-1]), left


class Weightless(ClearanceError):
    """No inertia moves with a coordinate, by the `index` of its velocity."""

    def __init__(self, index: int):
        super().__init__("No inertia moves with a coordinate.")
        self.index = index


def _twist(column: JacobianColumn, pivot: Vector) -> Twist:
    return Twist(column.index, column.velocity_at(pivot), column.spin)


def _loosen(body: Composite, twists: list[Twist], is_plane: bool) -> tuple[Loose, Composite | None]:
    count = 2 if is_plane else 3
    slides, turns = twists[:count], twists[count:]
    if is_zero(body.mass):
        raise Weightless(slides[0].index)
    inverse, h = 1.0 / body.mass, body.moment
    inertia = body.about_centre(inverse)
    moments = [inertia.apply(turn.spin) for turn in turns]
    couples = [[dot(turns[i].spin, moments[j]) for j in range(i + 1)] for i in range(len(turns))]
    for i, turn in enumerate(turns):
        if is_zero(couples[i][i]):
            raise Weightless(turn.index)
    factored, spread = None, []
    if turns:
        factored = factor(couples)
        columns = [factored.solve([moment[k] for moment in moments]) for k in range(3)]
        spread = [(columns[0][i], columns[1][i], columns[2][i]) for i in range(len(turns))]
    joint = Loose(slides, inverse, h, turns, moments, factored, spread)
    if len(turns) == (1 if is_plane else 3):
        return joint, None
    if len(turns) == 2:
        left = _held_about(inertia, cross(turns[0].spin, turns[1].spin))
    else:
        taken = [*zip(moments, spread, strict=True)]
        left = Symmetric(lambda i, j: minus(inertia.entry(i, j), total(times(m[i], s[j]) for m, s in taken)))
    return joint, Composite(0.0, ZERO, left)


def _held_about(inertia: Symmetric, axis: Vector) -> Symmetric:
    """What a body free to turn about all axes across `axis` (of any length) passes on: k a a^T, k = 1 / a.I^-1 a."""
    rows = [tuple(inertia.entry(i, j) for j in range(3)) for i in range(3)]
    cofactors = cross(rows[1], rows[2]), cross(rows[2], rows[0]), cross(rows[0], rows[1])
    size = dot(rows[0], cofactors[0])
    stiff = times(size, 1.0 / dot(axis, tuple(dot(row, axis) for row in cofactors)))
    along = scale(stiff, axis)
    return Symmetric(lambda i, j: times(axis[i], along[j]))
