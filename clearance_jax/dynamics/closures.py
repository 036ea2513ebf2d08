"""Ideal loops: their constraints, the forces that keep them closed, projection on them, assembly."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._types import Scalar
from clearance_jax.dynamics.inertia import mass_matrix
from clearance_jax.dynamics.kinematics import Frames, frames, sleeve_rotation
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import layout
from clearance_jax.mechanism.tree import Revolute
from clearance_jax.spatial import (
    ZERO,
    Factored,
    Term,
    Vector,
    as_array,
    factor,
    minus,
    plus,
    spin_cross,
    subtract,
    times,
    total,
)

# Factor on the inertia of a coordinate that is to stay: it takes less than a nanometre of a closing loop's metre.
FIRM = 1e9
# Newton iterations of an assembly: so many with pins all but held in their sleeves, then so many with all free; the
# last of all only measures.
HELD, LOOSE = 8, 5


class Gap(NamedTuple):
    """A loop's constraint: the pin's centre from the sleeve's, its rate, its acceleration without the free
    coordinates' accelerations, and its Jacobian by rows.
    """

    gap: Vector
    rate: Vector
    acceleration: Vector
    rows: list[list[Term]]


def closure(loop: Revolute, motion: Frames) -> Gap:
    """The constraint of an ideal revolute joint that closes a loop."""
    sleeve, pin = motion[loop.parent], motion[loop.child]
    a, b = sleeve.point(loop.at_parent.vector), pin.point(loop.at_child.vector)
    n = 1 + max(c.index for frame in motion.values() for c in frame.free)
    rows: list[list[Term]] = [[0.0] * n, [0.0] * n]
    for frame, point, sign in ((pin, b, 1.0), (sleeve, a, -1.0)):
        for column in frame.free:
            velocity = column.velocity_at(point)
            for k in (0, 1):
                term = velocity[k] if sign > 0 else minus(0.0, velocity[k])
                rows[k][column.index] = plus(rows[k][column.index], term)
    return Gap(
        subtract(b, a),
        subtract(pin.velocity_at(b), sleeve.velocity_at(a)),
        subtract(pin.acceleration_at(b), sleeve.acceleration_at(a)),
        rows,
    )


class Constraint(NamedTuple):
    """Rows J, the changes M^-1 J^T that a unit multiplier makes, and the factored J M^-1 J^T."""

    spread: list[list[Term]]
    compliance: Factored

    def closing(self, right: list[Term]) -> tuple[list[Term], list[Term]]:
        """The smallest change x (in the kinetic norm) with J x = right, and the multipliers that make it."""
        multipliers = self.compliance.solve(right)
        count = len(self.spread[0])
        change = [total(times(m, s[k]) for m, s in zip(multipliers, self.spread, strict=True)) for k in range(count)]
        return change, multipliers


def constraint(inertia: Factored, rows: list[list[Term]]) -> Constraint:
    """What constraint rows J ask of the inertia."""
    spread = [inertia.solve(row) for row in rows]
    compliance = [
        [total(times(p, q) for p, q in zip(rows[i], spread[j], strict=True)) for j in range(i + 1)]
        for i in range(len(rows))
    ]
    return Constraint(spread, factor(compliance))


def corrected(
    time: Scalar,
    y: Array,
    mechanism: Mechanism,
    loops: Sequence[Revolute],
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
    rows, gaps, rates, opened = [], [], [], []
    for loop in loops:
        gap, offset = closure(loop, motion), initial_offset(loop, motion)
        turning = spin_cross(motion[loop.parent].spin, offset)
        error, drift = subtract(gap.gap, offset), subtract(gap.rate, turning)
        rows += gap.rows
        gaps += [minus(0.0, error[0]), minus(0.0, error[1])]
        rates += [minus(0.0, drift[0]), minus(0.0, drift[1])]
        opened.append(jnp.hypot(jnp.asarray(error[0], float), jnp.asarray(error[1], float)))
    asked = constraint(mass_matrix(mechanism, motion, firm), rows)
    place, speed = asked.closing(gaps)[0], asked.closing(rates)[0]
    rest = jnp.zeros(y.shape[0] - plan.v.stop)
    change = jnp.concatenate([as_array(place), as_array([times(settle, s) for s in speed]), rest])
    return y + change, jnp.stack(opened)


def projected(time: Scalar, y: Array, mechanism: Mechanism, iterations: int = 1) -> Array:
    """The nearest state (in the kinetic norm) whose ideal loops are closed in position and velocity.

    A step leaves a loop open by its own error, of which one iteration leaves the square; further from closed take more.
    """
    loops = mechanism.closures()
    if iterations == 1:
        return corrected(time, y, mechanism, loops)[0]
    return jax.lax.fori_loop(0, iterations, lambda _, y: corrected(time, y, mechanism, loops)[0], y)


def assembled(time: Scalar, y: Array, mechanism: Mechanism) -> tuple[Array, Float[Array, " loops"]]:
    """The nearest state whose loops all are closed, ideal ones and those with clearance (their pins where
    `eccentricity` has them, at rest there); and how far each is open still [m].

    Pins all but stay where they are in their sleeves; what is left then, where only play can close a loop that is a
    little too long, play takes.
    """
    played = [i for i, c in enumerate(mechanism.free_coordinates()) if c.play is not None]

    def once(k, carry):
        held = k < HELD
        firm = {i: jnp.where(held, FIRM, 1.0) for i in played}
        # Velocities belong to closed positions.
        settle = jnp.where(k >= HELD - 1, 1.0, 0.0)
        moved, opened = corrected(time, carry[0], mechanism, mechanism.loops, firm, settle)
        return jnp.where(k < HELD + LOOSE - 1, moved, carry[0]), opened

    return jax.lax.fori_loop(0, HELD + LOOSE, once, (y, jnp.zeros(len(mechanism.loops))))


def initial_offset(loop: Revolute, motion: Frames) -> Vector:
    """Where in its sleeve the pin of a loop with clearance starts, at rest there, along the world's axes."""
    return ZERO if loop.clearance is None else sleeve_rotation(loop, motion).apply(loop.eccentricity.vector)
