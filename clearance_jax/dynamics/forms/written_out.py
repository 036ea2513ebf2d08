"""The dynamics of a small mechanism, written out number by number: the frames of its bodies, and the columns of the
coordinates that move them.

Kane's equations. The sum of the weights and inertia forces of what hangs on a joint, projected on the joint's columns,
gives the load. What hangs on a joint moves as one body if only the joint's own coordinates move, so its mass, centre
and inertia, summed from the leaves to the root, give a row of the mass matrix (composite bodies). Where that takes more
operations, the matrix is factored joint by joint and never written down (`articulated`).

Moments of what hangs on a joint are about the joint's own place, which keeps the digits of a mechanism far from the
world's origin. Only free coordinates have rows; `drive_forces` projects the same balance on the columns of prescribed
ones.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.module import Module
from clearance_jax._basis.symmetric import AbstractFactors, factor
from clearance_jax._basis.types import Scalar
from clearance_jax._compile.barriers import share, with_barriers
from clearance_jax.dynamics.forms.articulated import (
    ArticulatedFactors,
    Inertial,
    MovedBody,
    Weightless,
    chain_barriers,
    eliminate,
    sum_of,
)
from clearance_jax.dynamics.forms.frames import Extra, Frames, Moves, Pair, SpatialForce, rotors
from clearance_jax.dynamics.forms.inertia import BodyMotion, motion_of_body
from clearance_jax.dynamics.relative_motion import moved_values
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.body import GROUND, Body
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, layout
from clearance_jax.mechanism.tree.frame import Frame, JacobianColumn
from clearance_jax.mechanism.tree.moved import place
from clearance_jax.spatial import (
    ZERO,
    Term,
    Vector,
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


class WrittenOut(Module, Frames):
    """The frames of all bodies by name; `count`: the number of free velocities; `motions`: of the bodies, where they
    are computed once for all (`with_motions`).
    """

    mechanism: PreparedMechanism
    bodies: dict[str, Frame]
    count: int = eqx.field(static=True)
    motions: dict[str, BodyMotion] | None = None

    is_solved_implicitly: ClassVar[bool] = True

    def __getitem__(self, body):
        return self.bodies[body]

    def with_motions(self):
        motions = {body.name: share(self._motion(body)) for body in self.mechanism.bodies}
        return WrittenOut(self.mechanism, self.bodies, self.count, motions)

    def _motion(self, body: Body) -> BodyMotion:
        return motion_of_body(body, self[body.name]) if self.motions is None else self.motions[body.name]

    def _extra_of(self, body: Body, motion: BodyMotion, extra: Extra) -> tuple[Vector, Vector]:
        """What free accelerations add to a body's acceleration of its centre, and inertia times spin rate."""
        centre = add(self[body.name].pivot, motion.arm)
        return extra.at(body.name, centre), motion.about_centre.apply(extra.spin_rate(body.name))

    # Columns --------------------------------------------------------------------------------------------------------

    def velocities(self, body, point, base=None, beside=ZERO):
        return self._moves(body, base, lambda column: column.velocity_at(point), lambda c: c.velocity_at(beside))

    def spins(self, body, base=None):
        return self._moves(body, base, lambda column: column.spin, lambda column: column.spin)

    def _moves(self, body, base, of_body, of_base) -> Moves:
        moves = [ZERO] * self.count
        for column in self[body].free:
            moves[column.index] = of_body(column)
        for column in () if base is None else self[base].free:
            moves[column.index] = subtract(moves[column.index], of_base(column))
        return Moves(moves)

    def extra(self, acceleration):
        # By body: the spin rate by the free coordinates, a place, and the acceleration there.
        moved: dict[str, tuple[Vector, Vector, Vector]] = {GROUND: (ZERO, ZERO, ZERO)}
        columns = self.own_columns()
        for joint in self.mechanism.joints:
            spin_rate, place, there = moved[joint.parent]
            for column in columns[joint.child]:
                by = acceleration[column.index]
                if column.pivot is None:
                    there = add(there, scale(by, column.axis))
                else:
                    there = add(there, cross(spin_rate, subtract(column.pivot, place)))
                    spin_rate, place = add(spin_rate, scale(by, column.axis)), column.pivot
            moved[joint.child] = spin_rate, place, there

        def at(body: str, point: Vector) -> Vector:
            spin_rate, place, there = moved[body]
            return add(there, cross(spin_rate, subtract(point, place)))

        return Extra(at, lambda body: moved[body][0])

    def own_columns(self) -> dict[str, tuple[JacobianColumn, ...]]:
        """By body: the free columns of the joint that carries it."""
        return {j.child: self[j.child].free[len(self[j.parent].free) :] for j in self.mechanism.joints}

    # Inertia --------------------------------------------------------------------------------------------------------

    def _sums(self, alone: Callable, barriers: Callable, every: bool = False) -> dict[str, Any]:
        """By body, the sum of what `alone` gives for it and for all bodies that hang on it, about the body's pivot.
        Only for bodies that a free coordinate moves, or for `every` body.
        """
        bodies, out = {body.name: body for body in self.mechanism.bodies}, {}
        for joint in reversed(self.mechanism.joints):
            frame = self[joint.child]
            if not (frame.free or every):
                continue
            whole = alone(bodies[joint.child])
            for other in self.mechanism.joints:
                if other.parent == joint.child:
                    whole += out[other.child].move(subtract(self[other.child].pivot, frame.pivot))
            out[joint.child] = whole if self.mechanism.is_plane else barriers(whole)
        return out

    def mass_matrix(self, firm=None):
        return self._articulated() if firm is None and self.mechanism.form.by_blocks else self._factored(firm)

    def _articulated(self) -> ArticulatedFactors:
        mechanism, numbers = self.mechanism, rotors(self.mechanism)
        bodies, columns = {body.name: body for body in mechanism.bodies}, self.own_columns()
        moved = [joint for joint in mechanism.joints if self[joint.child].free]
        places = {joint.child: i for i, joint in enumerate(moved)}
        hanging: list[list[Inertial]] = [[] for _ in moved]
        once, links, columns_by = chain_barriers(self.count, mechanism.is_plane), [], mechanism.columns
        for i, joint in reversed([*enumerate(moved)]):
            frame, parent = self[joint.child], places.get(joint.parent, -1)
            whole = sum_of([self._motion(bodies[joint.child]).composite, *hanging[i]])
            try:
                loose = columns_by[joint.name].is_loose
                factors, left = eliminate(whole, columns[joint.child], frame.pivot, numbers, loose, mechanism.is_plane)
            except Weightless as unmoved:
                name = layout(mechanism).velocities[unmoved.index]
                raise ClearanceError(
                    f"No inertia resists the free coordinate `{name}`: what hangs on body `{joint.child}` gives way. "
                    "Give this body a mass (where it turns, an inertia)."
                ) from None
            by = ZERO if parent < 0 else subtract(frame.pivot, self[joint.parent].pivot)
            if parent >= 0 and left is not None:
                hanging[parent].append(left.map(once).move(by))
            links.append(MovedBody(parent, by, once(factors)))
        return ArticulatedFactors(links[::-1], self.count, once)

    def _factored(self, firm: Mapping[int, Term] | None) -> AbstractFactors:
        mechanism = self.mechanism
        matrix: list[list[Term]] = [[0.0] * (i + 1) for i in range(self.count)]
        whole = self._sums(lambda body: self._motion(body).composite, lambda whole: whole.map(with_barriers))
        columns = self.own_columns()
        parents = {joint.child: joint.parent for joint in mechanism.joints}
        # In a chain in space each momentum is computed from the one before it, and would otherwise be computed again.
        once = (lambda momentum: momentum) if mechanism.is_plane else with_barriers
        for joint in mechanism.joints:
            for column in columns[joint.child]:
                at = joint.child
                pivot = self[at].pivot
                momentum = once(whole[at].momentum(column, pivot))
                while at != GROUND and self[at].free:
                    for other in columns[at]:
                        row, entry = max(column.index, other.index), min(column.index, other.index)
                        if at != joint.child or other.index <= column.index:
                            matrix[row][entry] = momentum.on(other, pivot)
                    at = parents[at]
                    if at != GROUND:
                        momentum = once(momentum.move(subtract(pivot, self[at].pivot)))
                        pivot = self[at].pivot
        for i, inertia in rotors(mechanism).items():
            matrix[i][i] = plus(matrix[i][i], inertia)
        for i, row in enumerate(matrix):
            if is_zero(row[i]):
                raise ClearanceError(
                    f"Nothing with inertia moves with the free coordinate `{layout(mechanism).velocities[i]}`: give a "
                    "body beyond it a mass (where it turns, an inertia), or prescribe it with a drive."
                )
        for i, times_as_much in (firm or {}).items():
            matrix[i][i] = times(times_as_much, matrix[i][i])
        return factor(matrix)

    # Loads ----------------------------------------------------------------------------------------------------------

    def wrenches(self, acceleration):
        return self._wrenches(self.extra(acceleration), every=True)

    def _wrenches(self, extra: Extra | None, every: bool = False) -> dict[str, SpatialForce]:
        """`wrenches` of the bodies that a free coordinate moves, or of `every` body."""
        return self._sums(lambda body: self._deficit(body, extra), with_barriers, every)

    def _deficit(self, body: Body, extra: Extra | None) -> SpatialForce:
        """Weight minus inertia forces of a body, about its pivot."""
        motion = self._motion(body)
        return motion.deficit(self.mechanism.gravity.vector, extra and self._extra_of(body, motion, extra))

    def load_without_rotors(self, pairs, acceleration):
        load: list[Term] = [0.0] * self.count
        wrenches = self._wrenches(None if acceleration is None else self.extra(acceleration))
        for name, columns in self.own_columns().items():
            for column in columns:
                load[column.index] = wrenches[name].on(column, self[name].pivot)
        for pair in pairs:
            # On the free columns that move only one of its bodies (the others cancel).
            child, parent = ({column.index: column for column in self[body].free} for body in (pair.child, pair.parent))
            for index in sorted(child.keys() ^ parent.keys()):
                work = pair_work(pair, child[index] if index in child else parent[index])
                load[index] = plus(load[index], work if index in child else minus(0.0, work))
        return load

    def drive_forces(self, pairs, acceleration):
        # By body: names of the prescribed coordinates that move it, from the ground on.
        owners: dict[str, tuple[str, ...]] = {GROUND: ()}
        for joint in self.mechanism.joints:
            names = tuple(c.name for c in joint.own_coordinates() if not c.motion.is_free)
            owners[joint.child] = owners[joint.parent] + names
        wrenches, forces = self.wrenches(acceleration), {}
        for joint in self.mechanism.joints:
            frame, known = self[joint.child], len(owners[joint.parent])
            columns = zip(owners[joint.child][known:], frame.prescribed[known:], strict=True)
            for key, (column, speed) in columns:
                forces[key] = [minus(0.0, wrenches[joint.child].on(column, frame.pivot)), speed]
        for pair in pairs:
            for name, sign in ((pair.child, 1.0), (pair.parent, -1.0)):
                other = pair.parent if sign > 0 else pair.child
                if name == GROUND:
                    continue
                for key, (column, _) in zip(owners[name], self[name].prescribed, strict=True):
                    if key in owners.get(other, ()):
                        continue
                    forces[key][0] = minus(forces[key][0], times(sign, pair_work(pair, column)))
        # In the order of the coordinates, whatever the order of the bodies.
        return [(forces[c.name][0], forces[c.name][1]) for c in self.mechanism.coordinates() if c.name in forces]

    # Energies -------------------------------------------------------------------------------------------------------

    def energies(self):
        kinetic: Term = 0.0
        potential: Term = 0.0
        for body in self.mechanism.bodies:
            motion, frame = self._motion(body), self[body.name]
            kinetic = plus(kinetic, motion.kinetic_energy(frame.spin))
            height = dot(self.mechanism.gravity.vector, add(frame.pivot, motion.arm))
            potential = minus(potential, times(motion.mass, height))
        return kinetic, potential

    def kinetic_exchange(self, acceleration):
        extra, powers = self.extra(acceleration), []
        for body in self.mechanism.bodies:
            motion = self._motion(body)
            powers.append(motion.powers(self[body.name].spin, self._extra_of(body, motion, extra)))
        if self.mechanism.is_plane:
            return jnp.abs(jnp.asarray(total(total(by_axis) for by_axis in powers)))
        every = [jnp.abs(jnp.asarray(power)) for by_axis in powers for power in by_axis]
        return sum(every, jnp.zeros(()))


def write_out(mechanism: PreparedMechanism, time: Scalar, state: State, accelerations: Sequence[Term]) -> WrittenOut:
    """Pose and motion of every body: one sweep from the ground; `accelerations`: that are known."""
    values = moved_values(mechanism, state, accelerations)
    out = {GROUND: Frame()}
    for joint in mechanism.joints:
        frame = place(joint, out[joint.parent], time, values)
        out[joint.child] = frame if mechanism.is_plane else _once(frame, out[joint.parent])
    return WrittenOut(mechanism, out, len(state.v))


def _once(frame: Frame, parent: Frame) -> Frame:
    """The frame with every number of its own computed once; its parent's columns are so already."""
    free, prescribed = frame.free[len(parent.free) :], frame.prescribed[len(parent.prescribed) :]
    frame, free, prescribed = with_barriers((frame._replace(free=(), prescribed=()), free, prescribed))
    return frame._replace(free=(*parent.free, *free), prescribed=(*parent.prescribed, *prescribed))


def pair_work(pair: Pair, column: JacobianColumn) -> Term:
    """Power of a pair's wrench on its child per unit rate of a column that moves only the child."""
    return plus(dot(column.velocity_at(pair.at), pair.force), dot(column.spin, pair.torque))
