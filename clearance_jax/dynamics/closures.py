"""Closing of loops: projection of a state, assembly at the start, and the mobility that ideal loops leave."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.conditions import closure_conditions, conditions, constraint, independent, wrong_way
from clearance_jax.dynamics.kinematics import frames, sleeve_axes
from clearance_jax.dynamics.seated import Seated
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import initial_values, layout, move, parts
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed
from clearance_jax.mechanism.variants import gives_way
from clearance_jax.spatial import ZERO, Term, as_array, cross, dot, minus, plus, times

# Factor on the inertia of a coordinate that is to stay. While a loop closes by a metre, it moves less than a nanometre.
FIRM = 1e9
# Newton iterations of an assembly: with pins almost held in their sleeves, then with everything free; the very last one
# only measures.
HELD, LOOSE = 8, 5
# A pin that these move by more than so many times its play has left its sleeve: its loop is open.
LEFT = 4.0


class StartErrors(NamedTuple):
    """Errors of a start: openings of loops [m]; by settled pin the part of its load not borne, of its play moved."""

    loops: Float[Array, " loops"]
    unborne: Float[Array, " joints"]
    moved: Float[Array, " joints"]
    seated: Seated | None = None

    @classmethod
    def nothing(cls) -> "StartErrors":
        """For a start that is neither assembled nor settled."""
        return cls(jnp.zeros(0), jnp.zeros(0), jnp.zeros(0))


def correct(
    time: Scalar,
    y: Array,
    mechanism: PreparedMechanism,
    loops: Sequence[AbstractJoint],
    firm: Mapping[int, Term] | None = None,
    settle: Term = 1.0,
) -> tuple[Array, Float[Array, " loops"]]:
    """One Newton step of positions and velocities towards closed loops, and how far each loop was open [m]; `firm`:
    factors on the inertia of coordinates that are to stay; `settle`: factor on the change of velocities.
    """
    mechanism, plan = mechanism.at(time), layout(mechanism)
    state = plan.split(y)
    motion = frames(mechanism, time, state)
    loop_conditions, gaps, rates, opened = [], [], [], []
    for loop in loops:
        # The pin of a joint with clearance is held at its `eccentricity`, where it starts.
        offset = ZERO
        if isinstance(loop, AbstractPlayed) and loop.clearance is not None:
            offset = sleeve_axes(loop, motion).apply(loop.eccentricity.vector)
        turning = cross(motion[loop.parent].spin, offset)
        errors = []
        for now in conditions(loop, motion):
            errors.append(minus(now.gap, dot(now.force, offset)))
            gaps.append(minus(0.0, errors[-1]))
            rates.append(minus(0.0, minus(now.rate, dot(now.force, turning))))
            loop_conditions.append(now)
        opened.append(_openness(errors, wrong_way(loop, motion)))
    if not loop_conditions:
        return y, jnp.stack(opened)
    asked = constraint(motion.mass_matrix(firm), loop_conditions, mechanism)
    place, speed = asked.closure_step(gaps)[0], asked.closure_step(rates)[0]
    q = move(mechanism, state.q, place)
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


def project(time: Scalar, y: Array, mechanism: PreparedMechanism, iterations: int = 1) -> Array:
    """The nearest state (in the kinetic norm) whose ideal loops are closed in position and velocity.

    A step opens a loop by its own error, and one iteration leaves the square of that; a state further away needs more.
    """
    loops = mechanism.closures()
    if not loops:  # orientations of unit length
        plan = layout(mechanism)
        q = move(mechanism, plan.split(y).q, (0.0,) * plan.free)
        return jnp.concatenate([as_array(q), y[plan.v.start :]])
    if iterations == 1:
        return correct(time, y, mechanism, loops)[0]
    return jax.lax.fori_loop(0, iterations, lambda _, y: correct(time, y, mechanism, loops)[0], y)


def assemble(time: Scalar, y: Array, mechanism: PreparedMechanism) -> tuple[Array, Float[Array, " loops"]]:
    """The nearest state (in the kinetic norm) in which all loops are closed, with the remaining opening of each [m].
    The pin of a loop with clearance is at rest at its `eccentricity`.

    The first iterations hold pins in their sleeves, and drives that give way; the last ones let them move, for loops
    that only play closes. A pin that left its sleeve counts as an opening.
    """
    plays = [part for part in parts(mechanism) if part.coordinate.play is not None]
    springs = [part for part in parts(mechanism) if gives_way(part.coordinate.motion)]
    played = [part.v.start for part in (*plays, *springs)]
    sliding = [part for part in plays if part.coordinate.slides is not None]

    of_played = np.isin(np.arange(y.shape[0]), layout(mechanism).v.start + np.array(played, int))

    def once(k, carry):
        firm = {i: jnp.where(k < HELD, FIRM, 1.0) for i in played}
        # Velocities belong to closed positions. Those of pins are found twice: first a pin takes its small part of the
        # loop's rates, from what it began with again the small part of that.
        settle = jnp.where(k >= HELD - 2, 1.0, 0.0)
        begin = jnp.where(of_played & (k < HELD), y, carry[0])
        moved, opened = correct(time, begin, mechanism, mechanism.loops, firm, settle)
        return jnp.where(k < HELD + LOOSE - 1, moved, carry[0]), opened

    closed, opened = jax.lax.fori_loop(0, HELD + LOOSE, once, (y, jnp.zeros(len(mechanism.loops))))
    if sliding:
        places = np.array([part.q.start for part in sliding])
        moved, sizes = jnp.abs(closed - y)[places], as_array([part.coordinate.play for part in sliding])
        opened = jnp.maximum(opened, jnp.max(jnp.where(moved > LEFT * sizes, moved, 0.0)))
    return closed, opened


class Mobility(NamedTuple):
    """How a mechanism can move: free `velocities`, `conditions` of its ideal loops, and `independent` ones of these."""

    velocities: int
    conditions: int
    independent: int

    @property
    def freedom(self) -> int:
        """The number of free motions."""
        return self.velocities - self.independent

    @property
    def repeated(self) -> int:
        """The number of conditions that others imply: the degree of over-constraint."""
        return self.conditions - self.independent

    def __str__(self) -> str:
        text = f"{self.freedom} of {self.velocities} free velocities, under {self.conditions} conditions"
        if not self.repeated:
            return text
        return (
            f"{text}, of which {self.repeated} only repeat others (over-constrained): it moves while its lengths and "
            "angles are exact, and how its joints share the load is not determined"
        )


def mobility(mechanism: Mechanism, time: float = 0.0) -> Mobility:
    """The mobility of a mechanism as it is assembled at a `time` [s]. At a singular position (a dead centre, for
    example) fewer conditions may be independent.

    A condition counts as repeated if a solve leaves it out (`conditions.independent`). So rounded lengths do not turn a
    linkage that moves into a rigid one. The numbers of the `mechanism` must be known: this does not work under jit,
    vmap or derivatives.
    """
    ready, plan = mechanism.prepare(), layout(mechanism)
    if not ready.closures():
        return Mobility(plan.free, 0, 0)
    kept = np.asarray(_independence(ready, jnp.asarray(time, float)))
    return Mobility(plan.free, kept.size, int(np.sum(kept > 0)))


@eqx.filter_jit
def _independence(ready: PreparedMechanism, time: Scalar) -> Array:
    """By condition of the closures: 1 where it is independent, 0 where others imply it."""
    plan = layout(ready)
    y = assemble(time, jnp.concatenate([initial_values(ready), jnp.zeros(plan.remembered)]), ready)[0]
    motion = frames(ready, time, plan.split(y))
    loop_conditions = closure_conditions(motion)
    if not loop_conditions or plan.free == 0:
        return jnp.zeros(len(loop_conditions))
    inertia = motion.mass_matrix()
    rows = jnp.stack([now.row.array for now in loop_conditions])
    spread = jnp.stack([as_array(inertia.solve(list(row))) for row in rows])
    return independent(rows @ spread.T, loop_conditions, inertia)
