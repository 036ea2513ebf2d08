"""Inertia and loads by free coordinate.

Kane's equations: for every body and every free coordinate, the column that the coordinate moves the body along projects
inertia and load. Only coordinates that are states have rows; a prescribed coordinate's driving force is found by
projecting the same balance on its own column, where it is wanted (`energy.driving`).
"""

from collections.abc import Mapping
from typing import NamedTuple

from clearance_jax._types import Scalar
from clearance_jax.dynamics.kinematics import Extra, Frames
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.body import Body
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.mechanism.tree import Column, Frame
from clearance_jax.spatial import (
    Factored,
    Term,
    Vector,
    add,
    dot,
    factor,
    is_zero,
    minus,
    plus,
    subtract,
    times,
)


class Pair(NamedTuple):
    """Equal and opposite wrenches between two bodies: force and torque on `child` at the world point `at`."""

    parent: str
    child: str
    force: Vector
    torque: Term
    at: Vector


def mass_matrix(mechanism: Mechanism, motion: Frames, firm: Mapping[int, Term] | None = None) -> Factored:
    """The factored mass matrix of the free coordinates (lower triangle, structural zeros absent), with factors on the
    inertia of those that are to stay.
    """
    names = layout(mechanism).velocities
    matrix: list[list[Term]] = [[0.0] * (i + 1) for i in range(len(names))]
    for body in mechanism.bodies:
        frame = motion[body.name]
        centre = frame.point(body.center_of_mass.vector)
        for a in frame.free:
            for b in frame.free:
                if b.index <= a.index:
                    matrix[a.index][b.index] = plus(matrix[a.index][b.index], coupling(body, a, b, centre))
    for i, name in enumerate(names):
        if is_zero(matrix[i][i]):
            raise ClearanceError(
                f"Nothing with inertia moves with the free coordinate `{name}`: give a body beyond it a mass (where it "
                "turns, an inertia), or prescribe it with a drive."
            )
    for i, times_as_much in (firm or {}).items():
        matrix[i][i] = times(times_as_much, matrix[i][i])
    return factor(matrix)


def coupling(body: Body, a: Column, b: Column, centre: Vector) -> Term:
    """A body's contribution to the inertia between two coordinates that move it."""
    sliding = 0.0 if body.mass is None else times(body.mass, dot(a.velocity_at(centre), b.velocity_at(centre)))
    turning = 0.0 if body.inertia is None else times(body.inertia, times(a.spin, b.spin))
    return plus(sliding, turning)


def generalised_load(mechanism: Mechanism, time: Scalar, state: State, motion: Frames, pairs: list[Pair]) -> list[Term]:
    """Weight, inertia of the prescribed and centripetal motion, internal wrenches and actuators, by free coordinate."""
    load: list[Term] = [0.0] * layout(mechanism).free
    for body in mechanism.bodies:
        frame = motion[body.name]
        for column in frame.free:
            load[column.index] = plus(load[column.index], inertial_load(mechanism, body, frame, column))
    for pair in pairs:
        for index, term in pair_load(pair, motion).items():
            load[index] = plus(load[index], term)
    for i, coordinate in enumerate(mechanism.free_coordinates()):
        load[i] = plus(load[i], coordinate.motion.effort(time, state.q[i], state.v[i]))
    return load


def inertial_load(mechanism: Mechanism, body: Body, frame: Frame, column: Column, extra: Extra | None = None) -> Term:
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
