"""Ideal loops: their constraints, the forces that keep them closed, projection on them, assembly."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.inertia import Pair, mass_matrix
from clearance_jax.dynamics.kinematics import Frames, frames, sleeve_rotation
from clearance_jax.dynamics.table import Columns
from clearance_jax.mechanism.frame import Frame
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout, moved, parts
from clearance_jax.mechanism.tree import AbstractJoint, Revolute
from clearance_jax.spatial import (
    UNIT,
    ZERO,
    Term,
    Vector,
    absent,
    add,
    as_array,
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
from clearance_jax.symmetric import Dense, Factored, dense, factor

# Factor on the inertia of a coordinate that is to stay: it takes less than a nanometre of a closing loop's metre.
FIRM = 1e9
# Newton iterations of an assembly: so many with pins all but held in their sleeves, then so many with all free; the
# last of all only measures.
HELD, LOOSE = 8, 5
# A condition of which less than this is its own, in the square of a sine, repeats others: such is the square of how
# far from closed the stages of a step may be.
REPEATED = 1e-6


class Condition(NamedTuple):
    """One condition of a loop: how far it is violated [m or rad], the rate of that, its acceleration without the free
    coordinates' accelerations, its Jacobian; what a unit of its multiplier exerts on the child; and the whole relative
    velocity (or spin) that each free coordinate makes, of which the row is a component.
    """

    gap: Term
    rate: Term
    acceleration: Term
    row: Any
    force: Vector
    torque: Vector
    moves: Any

    @property
    def is_met(self) -> bool:
        """Whether it is met by structure."""
        row = (1.0,) if isinstance(self.row, jax.Array) else self.row
        return absent((*row, self.gap, self.rate, self.acceleration))

    def reached(self, values: list[Term]) -> Term:
        """Its row times values of the free velocities."""
        if isinstance(self.row, jax.Array):
            return self.row @ as_array(values)
        return total(times(r, value) for r, value in zip(self.row, values, strict=True))


def conditions(loop: AbstractJoint, motion: Frames, count: int) -> list[Condition]:
    """The conditions of an ideal joint that closes a loop, of a mechanism with `count` free velocities. One that is
    met by structure, as those out of its plane by a plane mechanism, is left out.
    """
    hold = loop.hold()
    a, b = motion[loop.parent], motion[loop.child]
    here, there = a.point(loop.at_parent.vector), b.point(loop.at_child.vector)
    sleeve = sleeve_rotation(loop, motion)
    if hold.along is None:
        found = _held(a, here, b, there, count)
    else:
        found = _held_along([sleeve.apply(along) for along in hold.along], a, here, b, there, count)
    if hold.square:
        pin = loop.on_child(b)
        found += _square([(sleeve.apply(e), pin.apply(f)) for e, f in hold.square], a, b, count)
    return [c for c in found if not c.is_met]


def _moves(a: Frame, b: Frame, count: int, of_a, of_b) -> Any:
    """Of every free coordinate what it does to b, seen from a; by what each column of the two bodies does."""
    if isinstance(b.free, Columns):
        return of_b(b.free) - of_a(a.free)
    moves = [ZERO] * count
    for column in b.free:
        moves[column.index] = of_b(column)
    for column in a.free:
        moves[column.index] = subtract(moves[column.index], of_a(column))
    return moves


def _along(direction: Vector, moves: Any) -> Any:
    """A component of what the free coordinates do."""
    if isinstance(moves, jax.Array):
        return moves @ as_array(direction)
    return [dot(direction, move) for move in moves]


def _held(a: Frame, here: Vector, b: Frame, there: Vector, count: int) -> list[Condition]:
    """A point of b stays at a point of a."""
    gap = subtract(there, here)
    rate = subtract(b.velocity_at(there), a.velocity_at(here))
    acceleration = subtract(b.acceleration_at(there), a.acceleration_at(here))
    moves = _moves(a, b, count, lambda c: c.velocity_at(here), lambda c: c.velocity_at(there))
    return [
        Condition(gap[k], rate[k], acceleration[k], _along(along, moves), along, ZERO, moves)
        for k, along in enumerate(UNIT)
    ]


def _held_along(
    directions: list[Vector], a: Frame, here: Vector, b: Frame, there: Vector, count: int
) -> list[Condition]:
    """A point of b stays in planes through a point of a that are square to directions of a. (Seen from a: what moves is
    the point of b over the point of a that it is at.)
    """
    velocity = subtract(b.velocity_at(there), a.velocity_at(there))
    coriolis = cross(scale(2.0, a.spin), velocity)
    acceleration = subtract(subtract(b.acceleration_at(there), a.acceleration_at(there)), coriolis)
    moves = _moves(a, b, count, lambda c: c.velocity_at(there), lambda c: c.velocity_at(there))
    return [
        Condition(
            dot(along, subtract(there, here)),
            dot(along, velocity),
            dot(along, acceleration),
            _along(along, moves),
            along,
            ZERO,
            moves,
        )
        for along in directions
    ]


def _square(pairs: list[tuple[Vector, Vector]], a: Frame, b: Frame, count: int) -> list[Condition]:
    """Axes of a and of b stay perpendicular."""
    spin, spin_rate = subtract(b.spin, a.spin), subtract(b.spin_rate, a.spin_rate)
    moves, found = _moves(a, b, count, lambda c: c.spin, lambda c: c.spin), []
    for e, f in pairs:
        normal = cross(f, e)
        change = add(cross(cross(b.spin, f), e), cross(f, cross(a.spin, e)))
        acceleration = plus(dot(spin_rate, normal), dot(spin, change))
        row = _along(normal, moves)
        found.append(Condition(dot(e, f), dot(spin, normal), acceleration, row, ZERO, normal, moves))
    return found


def wrong_way(loop: AbstractJoint, motion: Frames) -> list[Term]:
    """Of the axes that are to be one line: the cosine between them, 1 where they point the same way."""
    sleeve, pin = sleeve_rotation(loop, motion), loop.on_child(motion[loop.child])
    found = [dot(sleeve.apply(e), pin.apply(f)) for e, f in loop.hold().parallel]
    return [cosine for cosine in found if not isinstance(cosine, float)]


class Constraint(NamedTuple):
    """The changes M^-1 J^T that a unit multiplier makes, and J M^-1 J^T factored; `kept`: which conditions are asked
    for (1) and which repeat others (0), `None` where all are.
    """

    spread: list[list[Term]]
    factored: Factored | Dense
    kept: list[Term] | None

    def closing(self, right: list[Term]) -> tuple[list[Term], list[Term]]:
        """The smallest change x (in the kinetic norm) with J x = right, and the multipliers that make it."""
        if self.kept is not None:
            right = [times(k, r) for k, r in zip(self.kept, right, strict=True)]
        multipliers = self.factored.solve(right)
        count = len(self.spread[0])
        change = [total(times(m, s[k]) for m, s in zip(multipliers, self.spread, strict=True)) for k in range(count)]
        return change, multipliers


class DenseConstraint(NamedTuple):
    """The same of many conditions or coordinates, as arrays (see `Dense`)."""

    spread: Array
    lower: Array
    kept: Array | None

    def closing(self, right: list[Term]) -> tuple[list[Term], list[Term]]:
        """As that of `Constraint`."""
        asked = as_array(right) if self.kept is None else self.kept * as_array(right)
        multipliers = cho_solve((self.lower, True), asked)
        change = self.spread @ multipliers
        return [change[i] for i in range(change.shape[0])], [multipliers[i] for i in range(multipliers.shape[0])]


def constraint(
    inertia: Factored | Dense, held: Sequence[Condition], mechanism: Mechanism
) -> Constraint | DenseConstraint:
    """What conditions ask of the inertia."""
    if isinstance(inertia, Dense):
        rows = jnp.stack([now.row if isinstance(now.row, jax.Array) else as_array(now.row) for now in held])
        spread = cho_solve((inertia.lower, True), rows.T)
        compliance = rows @ spread
        asked = _kept(mechanism, compliance, held, inertia)
        if asked is not None:
            compliance = compliance * asked[:, None] * asked[None, :] + jnp.diag(1 - asked)
        return DenseConstraint(spread, jnp.linalg.cholesky(compliance), asked)
    spread = [inertia.solve(now.row) for now in held]
    compliance = [
        [total(times(p, q) for p, q in zip(now.row, spread[j], strict=True)) for j in range(i + 1)]
        for i, now in enumerate(held)
    ]
    chosen = _kept(mechanism, compliance, held, inertia)
    if chosen is None:
        return Constraint(spread, factor(compliance), None)
    kept: list[Term] = [chosen[i] for i in range(len(held))]
    for i, row in enumerate(compliance):
        row[:i] = [times(times(kept[i], kept[j]), row[j]) for j in range(i)]
        row[i] = jnp.where(kept[i] > 0, row[i], 1.0)
    return Constraint(spread, factor(compliance), kept)


def _kept(mechanism: Mechanism, compliance, held, inertia) -> Array | None:
    """Which conditions are asked for, of a mechanism whose conditions may repeat each other."""
    if not mechanism.may_repeat:
        return None
    if mechanism.chosen is not None:
        return mechanism.chosen
    matrix = compliance if isinstance(compliance, jax.Array) else dense(compliance)
    return independent(matrix, held, inertia)


def independent(matrix: Array, held: Sequence[Condition], inertia: Factored | Dense) -> Float[Array, " conditions"]:
    """Which conditions to ask for (1), where others follow from them (0): a loop in space repeats itself as a rule (a
    four-bar linkage of parallel pins holds its plane three times). One after the other the one that most of is left of,
    without what those before it hold already.

    Each is measured by the whole motion that it is a component of (not by its own: of one that is met always that is
    round-off); forces and moments apart, for neither says how large the other is.
    """
    count, sizes = len(held), []
    for now in held:
        if isinstance(now.moves, jax.Array):
            sizes.append(jnp.sum(now.moves**2, axis=1) @ as_array(inertia.inverse_diagonal))
            continue
        moves = [dot(m, m) for m in now.moves]
        sizes.append(total(times(inertia.inverse_diagonal[i], m) for i, m in enumerate(moves) if not is_zero(m)))
    whole = as_array(sizes)
    forces = jnp.asarray([absent(now.torque) for now in held])
    largest = jnp.where(forces, jnp.max(jnp.where(forces, whole, 0.0)), jnp.max(jnp.where(forces, 0.0, whole)))
    unit = jnp.sqrt(jnp.where(largest > 0, largest, 1.0))

    def once(_, carry):
        left, kept = carry
        own = jnp.where(kept > 0, 0.0, jnp.diagonal(left))
        best = jnp.argmax(own)
        good = own[best] > REPEATED
        column = left[best] / jnp.sqrt(jnp.where(good, own[best], 1.0))
        left = jnp.where(good, left - column[:, None] * column[None, :], left)
        return left, kept.at[best].set(jnp.where(good, 1.0, kept[best]))

    begin = jax.lax.stop_gradient(matrix / (unit[:, None] * unit[None, :])), jnp.zeros(count)
    return jax.lax.fori_loop(0, min(count, len(held[0].moves)), once, begin)[1]


def choice(time: Scalar, y: Array, mechanism: Mechanism) -> Float[Array, " conditions"]:
    """Which conditions of the closures to ask for at a state, see `independent`."""
    plan = layout(mechanism)
    motion = frames(mechanism, time, plan.split(y))
    held = [now for loop in mechanism.closures() for now in conditions(loop, motion, plan.free)]
    asked = constraint(mass_matrix(mechanism, motion), held, mechanism)
    assert asked.kept is not None  # conditions that cannot repeat are not chosen from
    return as_array(asked.kept) if isinstance(asked, Constraint) else asked.kept


def closing_pairs(loops: Sequence[AbstractJoint], motion: Frames, held: list[list[Condition]], forces) -> list[Pair]:
    """The wrench of every closure on its child, by the multipliers of its conditions."""
    rest, out = iter(forces), []
    for loop, own in zip(loops, held, strict=True):
        force = torque = ZERO
        for condition in own:
            multiplier = next(rest)
            force = add(force, scale(multiplier, condition.force))
            torque = add(torque, scale(multiplier, condition.torque))
        out.append(Pair(loop.parent, loop.child, force, torque, motion[loop.child].point(loop.at_child.vector)))
    return out


def corrected(
    time: Scalar,
    y: Array,
    mechanism: Mechanism,
    loops: Sequence[AbstractJoint],
    firm: Mapping[int, Term] | None = None,
    settle: Term = 1.0,
) -> tuple[Array, Float[Array, " loops"]]:
    """One Newton step towards closed loops, of positions and velocities by the one Jacobian; and how far each was open.

    **Arguments:** `firm`: factors on the inertia of coordinates that are to stay; `settle`: factor on the velocities'
    change (0: only the positions).
    """
    plan = layout(mechanism)
    state = plan.split(y)
    motion = frames(mechanism, time, state)
    held, gaps, rates, opened = [], [], [], []
    for loop in loops:
        offset = initial_offset(loop, motion)
        turning = cross(motion[loop.parent].spin, offset)
        errors = []
        for now in conditions(loop, motion, plan.free):
            errors.append(minus(now.gap, dot(now.force, offset)))
            gaps.append(minus(0.0, errors[-1]))
            rates.append(minus(0.0, minus(now.rate, dot(now.force, turning))))
            held.append(now)
        opened.append(_openness(errors, wrong_way(loop, motion)))
    if not held:
        return y, jnp.stack(opened)
    asked = constraint(mass_matrix(mechanism, motion, firm), held, mechanism)
    place, speed = asked.closing(gaps)[0], asked.closing(rates)[0]
    q = moved(mechanism, state.q, place)
    v = [plus(v, times(settle, s)) for v, s in zip(state.v, speed, strict=True)]
    return jnp.concatenate([as_array(q), as_array(v), y[plan.v.stop :]]), jnp.stack(opened)


def _openness(errors: list[Term], cosines: list[Term]) -> Array:
    """How far a loop is open: its violated conditions, and one more where an axis points the wrong way."""
    if len(errors) == 2 and not cosines:
        return jnp.hypot(*(jnp.asarray(error, float) for error in errors))
    size = jnp.sqrt(sum((jnp.asarray(error, float) ** 2 for error in errors), jnp.zeros(())))
    for cosine in cosines:
        size = size + jnp.where(jnp.asarray(cosine) < 0, 1.0, 0.0)
    return size


def projected(time: Scalar, y: Array, mechanism: Mechanism, iterations: int = 1) -> Array:
    """The nearest state (in the kinetic norm) whose ideal loops are closed in position and velocity.

    A step leaves a loop open by its own error, of which one iteration leaves the square; further from closed take more.
    """
    loops = mechanism.closures()
    if not loops:
        return of_unit_length(y, mechanism)
    if iterations == 1:
        return corrected(time, y, mechanism, loops)[0]
    return jax.lax.fori_loop(0, iterations, lambda _, y: corrected(time, y, mechanism, loops)[0], y)


def of_unit_length(y: Array, mechanism: Mechanism) -> Array:
    """The same state with its orientations of unit length."""
    plan = layout(mechanism)
    still = (0.0,) * plan.free
    return jnp.concatenate([as_array(moved(mechanism, plan.split(y).q, still)), y[plan.v.start :]])


def assembled(time: Scalar, y: Array, mechanism: Mechanism) -> tuple[Array, Float[Array, " loops"]]:
    """The nearest state whose loops all are closed, ideal ones and those with clearance (their pins where
    `eccentricity` has them, at rest there); and how far each is open still [m].

    Pins all but stay where they are in their sleeves; what is left then, where only play can close a loop that is a
    little too long, play takes.
    """
    played = [part.v.start for part in parts(mechanism) if part.coordinate.play is not None]

    def once(k, carry):
        held = k < HELD
        firm = {i: jnp.where(held, FIRM, 1.0) for i in played}
        # Velocities belong to closed positions.
        settle = jnp.where(k >= HELD - 1, 1.0, 0.0)
        moved, opened = corrected(time, carry[0], mechanism, mechanism.loops, firm, settle)
        return jnp.where(k < HELD + LOOSE - 1, moved, carry[0]), opened

    return jax.lax.fori_loop(0, HELD + LOOSE, once, (y, jnp.zeros(len(mechanism.loops))))


def initial_offset(loop: AbstractJoint, motion: Frames) -> Vector:
    """Where in its sleeve the pin of a loop with clearance starts, at rest there, along the world's axes."""
    if not isinstance(loop, Revolute) or loop.clearance is None:
        return ZERO
    return sleeve_rotation(loop, motion).apply(loop.eccentricity.vector)
