"""Inertia and loads by free coordinate.

Kane's equations by composite bodies: what hangs on a joint moves as one body where only the joint's own coordinates
move, so its mass, its centre and its inertia, summed from the leaves to the root, give a row of the mass matrix; and
the sum of its weights and inertia forces, projected on the joint's columns, gives the load.

Moments of what hangs on a joint are taken about the joint's own place, not about the world's origin: so nothing is lost
on a mechanism that stands far from it. Only coordinates that are states have rows; a prescribed coordinate's driving
force is found by projecting the same balance on its own column, where it is wanted (`energy.driving`).
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp

from clearance_jax._sharing import kept
from clearance_jax.dynamics.kinematics import Extra, Frames
from clearance_jax.dynamics.table import Table, three
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.body import GROUND, Body, needs_six
from clearance_jax.mechanism.frame import Column, Frame
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.mechanism.state import layout, parts
from clearance_jax.spatial import (
    ZERO,
    Term,
    Vector,
    Z,
    absent,
    add,
    as_array,
    cross,
    dot,
    is_zero,
    minus,
    plus,
    same_line,
    scale,
    subtract,
    times,
)
from clearance_jax.symmetric import NOTHING, Dense, Factored, Symmetric, factor, of_point, rotated, shifted


class Pair(NamedTuple):
    """Equal and opposite wrenches between two bodies: force and torque on `child` at the world point `at`."""

    parent: str
    child: str
    force: Vector
    torque: Vector
    at: Vector


class Composite(NamedTuple):
    """A body with all that hangs on it, as one: mass, mass times the arm of its centre, inertia, about its pivot."""

    mass: Term
    moment: Vector
    inertia: Symmetric

    def moved(self, by: Vector) -> "Composite":
        """Seen from another pivot, from which `by` leads to its own."""
        if absent(by):
            return self
        moment = add(self.moment, scale(self.mass, by))
        return Composite(self.mass, moment, shifted(self.inertia, by, self.moment, moment))

    def __add__(self, other) -> "Composite":
        return Composite(plus(self.mass, other.mass), add(self.moment, other.moment), self.inertia + other.inertia)

    def kept(self) -> "Composite":
        """With every number computed once."""
        mass, moment = kept((self.mass, self.moment))
        return Composite(mass, moment, Symmetric(lambda i, j: kept(self.inertia.entry(i, j))))

    def momentum(self, column: Column, pivot: Vector) -> "Wrench":
        """Momentum and angular momentum (about its pivot) per unit rate of a column that moves all of it."""
        velocity, spin = column.velocity_at(pivot), column.spin
        return Wrench(
            add(scale(self.mass, velocity), cross(spin, self.moment)),
            add(self.inertia.apply(spin), cross(self.moment, velocity)),
        )


class Wrench(NamedTuple):
    """A force and a moment about a pivot (or a momentum, and an angular momentum about it)."""

    force: Vector = ZERO
    moment: Vector = ZERO

    def moved(self, by: Vector) -> "Wrench":
        """The same about another pivot, from which `by` leads to its own."""
        return Wrench(self.force, add(self.moment, cross(by, self.force)))

    def on(self, column: Column, pivot: Vector) -> Term:
        """Projected on a column."""
        if column.pivot is None:
            return dot(column.axis, self.force)
        return dot(column.axis, self.moved(subtract(pivot, column.pivot)).moment)

    def __add__(self, other) -> "Wrench":
        return Wrench(add(self.force, other.force), add(self.moment, other.moment))


def inertia_of(body: Body, frame: Frame) -> Symmetric:
    """A body's inertia about its centre of mass, in the world's axes."""
    if body.inertia is None:
        return NOTHING
    if isinstance(body.inertia, Inertia):
        return rotated(body.inertia.symmetric, frame.rotation)
    about_z = body.inertia
    if same_line(frame.rotation.rows[2], Z) <= 0:
        raise needs_six(body)
    return Symmetric(lambda i, j: about_z if i == j == 2 else 0.0)


def composites(mechanism: Mechanism, motion: Frames) -> dict[str, Composite]:
    """Of every body that a free coordinate moves, with all that hangs on it."""
    bodies, out = {body.name: body for body in mechanism.bodies}, {}
    for joint in reversed(mechanism.joints):
        frame = motion[joint.child]
        if not frame.free:
            continue
        body = bodies[joint.child]
        mass = 0.0 if body.mass is None else body.mass
        arm = subtract(frame.point(body.center_of_mass.vector), frame.pivot)
        moment = scale(mass, arm)
        whole = Composite(mass, moment, inertia_of(body, frame) + of_point(mass, arm, moment))
        for other in mechanism.joints:
            if other.parent == joint.child:
                whole += out[other.child].moved(subtract(motion[other.child].pivot, frame.pivot))
        out[joint.child] = whole if mechanism.is_plane else whole.kept()
    return out


def own_columns(mechanism: Mechanism, motion: Frames) -> dict[str, tuple[Column, ...]]:
    """By each body the free columns of the joint that carries it."""
    return {j.child: motion[j.child].free[len(motion[j.parent].free) :] for j in mechanism.joints}


def rotors(mechanism: Mechanism) -> dict[int, Term]:
    """The inertia of motors' rotors, by the free velocity that they turn with."""
    found = {part.v.start: part.coordinate.motion.rotor_inertia for part in parts(mechanism)}
    return {i: inertia for i, inertia in found.items() if inertia is not None}


def mass_matrix(mechanism: Mechanism, motion: Frames, firm: Mapping[int, Term] | None = None) -> Factored | Dense:
    """The factored mass matrix of the free coordinates (lower triangle, structural zeros absent), with factors on the
    inertia of those that are to stay.
    """
    if isinstance(motion, Table):
        whole = motion.mass_matrix()
        for i, inertia in rotors(mechanism).items():
            whole = whole.at[i, i].add(inertia)
        for i, times_as_much in (firm or {}).items():
            whole = whole.at[i, i].multiply(times_as_much)
        return Dense(jnp.linalg.cholesky(whole))
    names = layout(mechanism).velocities
    matrix: list[list[Term]] = [[0.0] * (i + 1) for i in range(len(names))]
    whole, columns = composites(mechanism, motion), own_columns(mechanism, motion)
    parents = {joint.child: joint.parent for joint in mechanism.joints}
    # A chain in space is deep: what one link does is made of what the others do.
    once = (lambda momentum: momentum) if mechanism.is_plane else kept
    for joint in mechanism.joints:
        for column in columns[joint.child]:
            at = joint.child
            pivot = motion[at].pivot
            momentum = once(whole[at].momentum(column, pivot))
            while at != GROUND and motion[at].free:
                for other in columns[at]:
                    row, entry = max(column.index, other.index), min(column.index, other.index)
                    if at != joint.child or other.index <= column.index:
                        matrix[row][entry] = momentum.on(other, pivot)
                at = parents[at]
                if at != GROUND:
                    momentum = once(momentum.moved(subtract(pivot, motion[at].pivot)))
                    pivot = motion[at].pivot
    for i, inertia in rotors(mechanism).items():
        matrix[i][i] = plus(matrix[i][i], inertia)
    for i, name in enumerate(names):
        if is_zero(matrix[i][i]):
            raise ClearanceError(
                f"Nothing with inertia moves with the free coordinate `{name}`: give a body beyond it a mass (where it "
                "turns, an inertia), or prescribe it with a drive."
            )
    for i, times_as_much in (firm or {}).items():
        matrix[i][i] = times(times_as_much, matrix[i][i])
    return factor(matrix)


def inertial_wrenches(
    mechanism: Mechanism, motion: Frames, extra: Extra | None = None, every: bool = False
) -> dict[str, Wrench]:
    """By each body weight minus inertia forces of it and all that hangs on it, about its pivot; of bodies that a free
    coordinate moves, or of `every` one. The accelerations are those of the frames and `extra`.
    """
    if isinstance(motion, Table):
        return _tabled_wrenches(mechanism, motion, extra)
    bodies, out = {body.name: body for body in mechanism.bodies}, {}
    for joint in reversed(mechanism.joints):
        frame = motion[joint.child]
        if not (frame.free or every):
            continue
        whole = _deficit(mechanism, bodies[joint.child], frame, extra)
        for other in mechanism.joints:
            if other.parent == joint.child:
                whole += out[other.child].moved(subtract(motion[other.child].pivot, frame.pivot))
        out[joint.child] = whole if mechanism.is_plane else kept(whole)
    return out


def _tabled_wrenches(mechanism: Mechanism, motion: Table, extra: Extra | None) -> dict[str, Wrench]:
    force, moment = motion.wrenches(None if extra is None else as_array(extra.acceleration))
    out = {}
    for joint in mechanism.joints:
        hanging = motion.hanging_on(joint.child)
        whole = Wrench(three(hanging @ force), three(hanging @ moment))
        out[joint.child] = whole.moved(subtract(three(motion.origin), motion[joint.child].pivot))
    return out


def _deficit(mechanism: Mechanism, body: Body, frame: Frame, extra: Extra | None) -> Wrench:
    """A body's weight minus its inertia forces, about its pivot."""
    centre = frame.point(body.center_of_mass.vector)
    force = moment = ZERO
    if body.mass is not None:
        acceleration = frame.acceleration_at(centre)
        if extra is not None:
            acceleration = add(acceleration, extra.at(frame, centre))
        force = scale(body.mass, subtract(mechanism.gravity.vector, acceleration))
        moment = cross(subtract(centre, frame.pivot), force)
    if body.inertia is not None:
        inertia = inertia_of(body, frame)
        spin_rate = frame.spin_rate if extra is None else add(frame.spin_rate, extra.spin_rate(frame))
        gyroscopic = cross(frame.spin, inertia.apply(frame.spin))
        moment = subtract(moment, add(inertia.apply(spin_rate), gyroscopic))
    return Wrench(force, moment)


def generalised_load(mechanism: Mechanism, motion: Frames, pairs: list[Pair], extra: Extra | None = None) -> list[Term]:
    """Weight, inertia of the prescribed and centripetal motion, and wrenches between bodies, by free coordinate; with
    `extra` also the inertia of free accelerations.
    """
    if isinstance(motion, Table):
        load = _tabled_load(motion, pairs, extra)
    else:
        load: list[Term] = [0.0] * layout(mechanism).free
        wrenches = inertial_wrenches(mechanism, motion, extra)
        for name, columns in own_columns(mechanism, motion).items():
            for column in columns:
                load[column.index] = wrenches[name].on(column, motion[name].pivot)
        for pair in pairs:
            for index, term in pair_load(pair, motion).items():
                load[index] = plus(load[index], term)
    if extra is not None:
        for i, inertia in rotors(mechanism).items():
            load[i] = minus(load[i], times(inertia, extra.acceleration[i]))
    return load


def _tabled_load(motion: Table, pairs: list[Pair], extra: Extra | None) -> list[Term]:
    load = motion.load(None if extra is None else as_array(extra.acceleration))
    for pair in pairs:
        load = load + motion.pair(*pair)[: motion.count]
    return [load[i] for i in range(motion.count)]


def pair_load(pair: Pair, motion: Frames) -> dict[int, Term]:
    """Projection of a wrench pair on the free columns that move only one of its bodies (the others cancel)."""
    child = {column.index: column for column in motion[pair.child].free}
    parent = {column.index: column for column in motion[pair.parent].free}
    out: dict[int, Term] = {}
    for index in sorted(child.keys() ^ parent.keys()):
        column = child[index] if index in child else parent[index]
        work = pair_work(pair, column)
        out[index] = work if index in child else minus(0.0, work)
    return out


def pair_work(pair: Pair, column: Column) -> Term:
    """Work of a pair's wrench on its child per unit rate of a column that moves the child only."""
    return plus(dot(column.velocity_at(pair.at), pair.force), dot(column.spin, pair.torque))
