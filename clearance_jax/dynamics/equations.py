"""The equations of motion of one state: what the joints exert, accelerations, ideal closures.

They are Kane's: for every body and every free coordinate, the column that the coordinate moves the body along projects
inertia and load. Only coordinates that are states have rows; a prescribed coordinate's driving force is found by
projecting the same balance on its own column, where it is wanted (`energy.driving`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import safe_unit
from clearance_jax._types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import Contact, Signals
from clearance_jax.mechanism.body import Body, Spring
from clearance_jax.mechanism.mechanism import Mechanism, frames, layout
from clearance_jax.mechanism.tree import PLAY, Column, Frame, Revolute
from clearance_jax.spatial import (
    ZERO,
    Factored,
    Rotation,
    Term,
    Vector,
    add,
    as_array,
    dot,
    factor,
    is_zero,
    minus,
    plus,
    scale,
    solve,
    spin_cross,
    subtract,
    times,
    total,
)

Frames = dict[str, Frame]

# Factor on the inertia of a coordinate that is to stay: it takes less than a nanometre of a closing loop's metre.
FIRM = 1e9


class Pair(NamedTuple):
    """Equal and opposite wrenches between two bodies: force and torque on `child` at the world point `at`."""

    parent: str
    child: str
    force: Vector
    torque: Term
    at: Vector


class Balance(NamedTuple):
    """The equations of motion: factored inertia and the solved accelerations of the free coordinates."""

    inertia: Factored
    acceleration: list[Term]
    closures: list[Pair]


# Joints ------------------------------------------------------------------------------------------------------------


class Play(NamedTuple):
    """Kinematics of a clearance joint: vectors along axes that `rotation` takes to the world's."""

    eccentricity: Vector
    rate: Vector
    """As seen by an observer on the sleeve."""
    spin: Term
    rotation: Rotation
    pin: Vector
    """The pin's centre in the world."""


def play(mechanism: Mechanism, joint: Revolute, motion: Frames, y: Array) -> Play:
    """Kinematics of a clearance joint: in the tree its coordinates, in a loop a difference of positions."""
    sleeve, pin = motion[joint.parent], motion[joint.child]
    spin = minus(pin.spin, sleeve.spin)
    centre = pin.point(joint.at_child.vector)
    names = layout(mechanism).names
    if joint.name + PLAY[0] not in names:
        gap = subtract(centre, sleeve.point(joint.at_parent.vector))
        return Play(
            gap, subtract(pin.velocity_at(centre), sleeve.velocity_at(centre)), spin, Rotation(1.0, 0.0), centre
        )
    i, n = names.index(joint.name + PLAY[0]), len(names)
    axis = next(column.axis for column in pin.free if column.index == i)
    assert axis is not None  # a play coordinate slides
    return Play((y[i], y[i + 1]), (y[n + i], y[n + i + 1]), spin, Rotation(*axis), centre)


def contact(mechanism: Mechanism, joint: Revolute, motion: Frames, y: Array) -> Contact:
    """What one clearance joint does now."""
    assert joint.clearance is not None
    at = play(mechanism, joint, motion, y)
    memory = layout(mechanism).memory_of(y)[joint.name]
    return joint.clearance.contact(at.eccentricity, at.rate, jnp.asarray(at.spin, dtype=float), memory)


def signals(time: Scalar, y: Array, mechanism: Mechanism) -> list[Signals]:
    """The watched functions of every clearance joint."""
    motion = frames(mechanism, time, y)
    out = []
    for joint in mechanism.clearance_joints():
        assert joint.clearance is not None
        at = play(mechanism, joint, motion, y)
        out.append(joint.clearance.signals(at.eccentricity, at.rate, jnp.asarray(at.spin, dtype=float)))
    return out


def internal_pairs(mechanism: Mechanism, motion: Frames, y: Array, contacts: dict[str, Contact]) -> list[Pair]:
    """Wrench pairs of the clearance joints and springs."""
    pairs = []
    for joint in mechanism.clearance_joints():
        at, now = play(mechanism, joint, motion, y), contacts[joint.name]
        force = at.rotation.apply(now.force)
        pairs.append(Pair(joint.parent, joint.child, force, now.torque, at.pin))
    for spring in mechanism.springs:
        _, _, tension, along = spring_state(spring, motion)
        # Along the line through both points the place of application does not matter: one point serves both bodies.
        end = motion[spring.body_b].point(spring.at_b.vector)
        pairs.append(Pair(spring.body_a, spring.body_b, scale(-tension, along), 0.0, end))
    return pairs


def spring_state(spring: Spring, motion: Frames) -> tuple[Array, Array, Array, Vector]:
    """Elongation, its rate, tension and direction (a to b) of a spring."""
    frame_a, frame_b = motion[spring.body_a], motion[spring.body_b]
    a, b = frame_a.point(spring.at_a.vector), frame_b.point(spring.at_b.vector)
    span = subtract(b, a)
    length, ux, uy = safe_unit(jnp.asarray(span[0], dtype=float), jnp.asarray(span[1], dtype=float))
    rate = jnp.asarray(dot((ux, uy), subtract(frame_b.velocity_at(b), frame_a.velocity_at(a))))
    elongation = length - spring.free_length
    return elongation, rate, spring.stiffness * elongation + spring.damping * rate, (ux, uy)


def sleeve_rotation(joint: Revolute, motion: Frames) -> Rotation:
    """Orientation of the sleeve's axes: the parent's, turned by the joint's own angle."""
    frame = motion[joint.parent]
    return frame.rotation if joint.angle is None else frame.turned(joint.angle).rotation


# Equations of motion -----------------------------------------------------------------------------------------------


def accelerations(mechanism: Mechanism, time: Scalar, y: Array, motion: Frames, pairs: list[Pair]) -> Balance:
    """Accelerations of the free coordinates under the given internal wrenches, and the closures' forces."""
    inertia = mass_matrix(mechanism, motion)
    load = generalised_load(mechanism, time, y, motion, pairs)
    free = solve(inertia, load)
    loops = mechanism.closures()
    if not loops:
        return Balance(inertia, free, [])
    if not free:
        raise ClearanceError(
            f"The ideal loop `{loops[0].name}` joins bodies that are all prescribed: free one of them."
        )
    rows, lag = [], []
    for loop in loops:
        gap = closure(loop, motion)
        rows += gap.rows
        lag += [
            minus(minus(0.0, a), total(times(r, q) for r, q in zip(row, free, strict=True)))
            for a, row in zip(gap.acceleration, gap.rows, strict=True)
        ]
    correction, forces = constrained(inertia, rows, lag)
    closing = [
        Pair(
            loop.parent,
            loop.child,
            (forces[2 * i], forces[2 * i + 1]),
            0.0,
            motion[loop.child].point(loop.at_child.vector),
        )
        for i, loop in enumerate(loops)
    ]
    return Balance(inertia, [plus(a, b) for a, b in zip(free, correction, strict=True)], closing)


def mass_matrix(mechanism: Mechanism, motion: Frames, firm: Sequence[int] = ()) -> Factored:
    """The factored mass matrix of the free coordinates (lower triangle, structural zeros absent); the `firm` ones are
    all but immovable.
    """
    n = layout(mechanism).free
    matrix: list[list[Term]] = [[0.0] * (i + 1) for i in range(n)]
    for body in mechanism.bodies:
        frame = motion[body.name]
        centre = frame.point(body.center_of_mass.vector)
        for a in frame.free:
            for b in frame.free:
                if b.index <= a.index:
                    matrix[a.index][b.index] = plus(matrix[a.index][b.index], coupling(body, a, b, centre))
    for i, name in enumerate(layout(mechanism).names):
        if is_zero(matrix[i][i]):
            raise ClearanceError(
                f"Nothing with inertia moves with the free coordinate `{name}`: give a body beyond it a mass (where it "
                "turns, an inertia), or prescribe it with a drive."
            )
    for i in firm:
        matrix[i][i] = times(FIRM, matrix[i][i])
    return factor(matrix)


def coupling(body: Body, a: Column, b: Column, centre: Vector) -> Term:
    """A body's contribution to the inertia between two coordinates that move it."""
    sliding = 0.0 if body.mass is None else times(body.mass, dot(a.velocity_at(centre), b.velocity_at(centre)))
    turning = 0.0 if body.inertia is None else times(body.inertia, times(a.spin, b.spin))
    return plus(sliding, turning)


def generalised_load(mechanism: Mechanism, time: Scalar, y: Array, motion: Frames, pairs: list[Pair]) -> list[Term]:
    """Weight, inertia of the prescribed and centripetal motion, internal wrenches and actuators, by free coordinate."""
    plan = layout(mechanism)
    n = plan.free
    load: list[Term] = [0.0] * n
    for body in mechanism.bodies:
        frame = motion[body.name]
        for column in frame.free:
            load[column.index] = plus(load[column.index], inertial_load(mechanism, body, frame, column))
    for pair in pairs:
        for index, term in pair_load(pair, motion).items():
            load[index] = plus(load[index], term)
    for i, coordinate in enumerate(mechanism.free_coordinates()):
        load[i] = plus(load[i], coordinate.motion.effort(time, y[i], y[n + i]))
    return load


def inertial_load(mechanism: Mechanism, body: Body, frame: Frame, column: Column, extra: "Extra | None" = None) -> Term:
    """Projection of weight minus mass times acceleration of one body on a column."""
    centre = frame.point(body.center_of_mass.vector)
    acceleration, spin_rate = frame.acceleration_at(centre), frame.spin_rate
    if extra is not None:
        acceleration, spin_rate = add(acceleration, extra.at(frame, centre)), plus(spin_rate, extra.spin_rate(frame))
    load: Term = 0.0
    if body.mass is not None:
        deficit = subtract(mechanism.gravity.vector, acceleration)
        load = times(body.mass, dot(column.velocity_at(centre), deficit))
    if body.inertia is not None:
        load = minus(load, times(body.inertia, times(column.spin, spin_rate)))
    return load


class Extra(NamedTuple):
    """What the free coordinates' accelerations add to the accelerations of `Frame`."""

    acceleration: list[Term]

    def at(self, frame: Frame, point: Vector) -> Vector:
        """Extra acceleration of a body's point."""
        out: Vector = (0.0, 0.0)
        for column in frame.free:
            out = add(out, scale(self.acceleration[column.index], column.velocity_at(point)))
        return out

    def spin_rate(self, frame: Frame) -> Term:
        """Extra spin rate of a body."""
        return total(times(column.spin, self.acceleration[column.index]) for column in frame.free)


def pair_load(pair: Pair, motion: Frames) -> dict[int, Term]:
    """Projection of a wrench pair on the free columns that move only one of its bodies (the others cancel)."""
    child = {column.index: column for column in motion[pair.child].free}
    parent = {column.index: column for column in motion[pair.parent].free}
    out: dict[int, Term] = {}
    for index in sorted(child.keys() ^ parent.keys()):
        column = child[index] if index in child else parent[index]
        work = plus(dot(column.velocity_at(pair.at), pair.force), times(column.spin, pair.torque))
        out[index] = work if index in child else minus(0.0, work)
    return out


# Ideal closures ----------------------------------------------------------------------------------------------------


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


def initial_offset(loop: Revolute, motion: Frames) -> Vector:
    """Where in its sleeve the pin of a loop with clearance starts, at rest there, along the world's axes."""
    return ZERO if loop.clearance is None else sleeve_rotation(loop, motion).apply(loop.eccentricity.vector)


def openings(time: Scalar, y: Array, mechanism: Mechanism) -> dict[str, Array]:
    """How far every loop is from its initial closure [m]: the pin's centre from the place `eccentricity` gives it."""
    motion = frames(mechanism, time, y)
    out = {}
    for loop in mechanism.loops:
        x, y_ = subtract(closure(loop, motion).gap, initial_offset(loop, motion))
        out[loop.name] = jnp.hypot(jnp.asarray(x, float), jnp.asarray(y_, float))
    return out


def constrained(inertia: Factored, rows: list[list[Term]], right: list[Term]) -> tuple[list[Term], list[Term]]:
    """The smallest change x (in the kinetic norm) with J x = right, and the multipliers that make it."""
    spread = [solve(inertia, row) for row in rows]
    compliance = [
        [total(times(p, q) for p, q in zip(rows[i], spread[j], strict=True)) for j in range(i + 1)]
        for i in range(len(rows))
    ]
    multipliers = solve(factor(compliance), right)
    change = [total(times(m, s[k]) for m, s in zip(multipliers, spread, strict=True)) for k in range(len(spread[0]))]
    return change, multipliers


def projected(
    time: Scalar,
    y: Array,
    mechanism: Mechanism,
    loops: tuple[Revolute, ...],
    iterations: int = 2,
    firm_play: bool = False,
) -> Array:
    """The nearest state (in the kinetic norm) whose loops are closed in position and velocity. With `firm_play` pins
    all but stay where they are in their sleeves.
    """
    plan = layout(mechanism)
    n = plan.free
    firm = [i for i, name in enumerate(plan.names) if name.endswith(PLAY)] if firm_play else []

    def correct(y: Array, what: str) -> Array:
        motion = frames(mechanism, time, y)
        rows, right = [], []
        for loop in loops:
            gap, offset = closure(loop, motion), initial_offset(loop, motion)
            turning = spin_cross(motion[loop.parent].spin, offset)
            error = subtract(gap.gap, offset) if what == "position" else subtract(gap.rate, turning)
            rows += gap.rows
            right += [minus(0.0, error[0]), minus(0.0, error[1])]
        change, _ = constrained(mass_matrix(mechanism, motion, firm), rows, right)
        start = 0 if what == "position" else n
        return jnp.concatenate([y[:start], y[start : start + n] + as_array(change), y[start + n :]])

    for _ in range(iterations):
        y = correct(y, "position")
    return correct(y, "velocity")
