"""Conditions of closures solved for: the smallest change that meets them, and which of them to ask for at all."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import cho_solve
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.conditions import Condition, conditions
from clearance_jax.dynamics.inertia import Pair, mass_matrix
from clearance_jax.dynamics.kinematics import Frames, frames
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import ZERO, Term, absent, add, as_array, dot, is_zero, scale, times, total
from clearance_jax.symmetric import Dense, Factored, dense, factor

# A condition of which less than this is its own, in the square of a sine, repeats others: such is the square of how
# far from closed the stages of a step may be.
REPEATED = 1e-6


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
    mechanism, plan = mechanism.at(time), layout(mechanism)
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
