"""What brings a point of a mechanism where it should be: the coordinates that are sought, and how they move it.

The point's frame is looked at through the columns of the kinematics, which are its exact Jacobian. Ideal closures add
their conditions as further rows, so that a parallel robot is a chain like any other, with passive coordinates that are
sought too.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._module import Module
from clearance_jax._types import Scalar
from clearance_jax.dynamics.conditions import conditions, wrong_way
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND, Body, Point
from clearance_jax.mechanism.coordinate import Coordinate
from clearance_jax.mechanism.driving import drivable, gives_way
from clearance_jax.mechanism.limits import Limits
from clearance_jax.mechanism.mechanism import NO_GRAVITY, Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, initial_values, layout, parts
from clearance_jax.mechanism.tree import AbstractJoint
from clearance_jax.spatial import IDENTITY, Term, absent, as_array, length_of, rotation_between

NO_LIMITS = Limits()


class Aim(NamedTuple):
    """Where a frame should be: its place, and its rotation matrix, `None` where any will do."""

    place: Float[Array, "3"]
    rotation: Float[Array, "3 3"] | None


class Look(NamedTuple):
    """How far a frame is from its aim, and its closures from closed (`gap`, lengths as parts of the chain's size), how
    that changes with the velocities that are sought (`jacobian`, of slides by the size) and by what moves anyway
    (`drift`); `closed`: whether no axis of a closure points the wrong way.
    """

    gap: Float[Array, " rows"]
    jacobian: Float[Array, "rows sought"]
    drift: Float[Array, " rows"]
    closed: Array


class AbstractChain(Module):
    """An ideal mechanism whose `joints` (coordinates, by name) are free, a point of it, and `sought`: which of its free
    velocities move it, those of passive coordinates among them. Its bodies weigh nothing: masses do not matter here.
    """

    mechanism: eqx.AbstractVar[AbstractMechanism]
    point: eqx.AbstractVar[str]
    joints: eqx.AbstractVar[tuple[str, ...]]
    sought: eqx.AbstractVar[tuple[int, ...]]

    @property
    def frame(self) -> Point:
        """The point."""
        return next(point for point in self.mechanism.points if point.name == self.point)

    @property
    def coordinates(self) -> list[Coordinate]:
        """The coordinate of every free velocity."""
        return [part.coordinate for part in parts(self.mechanism) for _ in part.coordinate.velocities]

    @property
    def limits(self) -> list[Limits]:
        """Of what is sought."""
        every = self.coordinates
        return [every[i].motion.limits or NO_LIMITS for i in self.sought]

    @property
    def size(self) -> Array:
        """How long it is, joint to joint [m]: what makes lengths comparable with angles."""
        carried = _towards_ground(self.mechanism, self.frame.body)
        places = [at for joint in carried for at in (joint.at_parent, joint.at_child)]
        length = sum((length_of(at.vector) for at in (*places, self.frame.at)), jnp.zeros(()))
        return jax.lax.stop_gradient(jnp.where(length > 0, length, 1.0))

    @property
    def units(self) -> Array:
        """What a unit of each of the sought velocities is: the size for a slide, one for a turn."""
        every, size = self.coordinates, self.size
        return jnp.stack([jnp.ones(()) if every[i].slides is None else size for i in self.sought])

    def places(self, names: Sequence[str]) -> np.ndarray:
        """Where named coordinates are among the positions."""
        return np.array([layout(self.mechanism).positions.index(name) for name in names], int)


class PreparedChain(AbstractChain):
    """A chain of a prepared mechanism."""

    mechanism: PreparedMechanism
    point: str = eqx.field(static=True)
    joints: tuple[str, ...] = eqx.field(static=True)
    sought: tuple[int, ...] = eqx.field(static=True)


class Chain(AbstractChain):
    """A chain as it is given."""

    mechanism: Mechanism
    point: str = eqx.field(static=True)
    joints: tuple[str, ...] = eqx.field(static=True)
    sought: tuple[int, ...] = eqx.field(static=True)

    def prepare(self) -> PreparedChain:
        """The same with what depends only on its numbers computed. In space it is a table, however short it is: its
        program is small, and compiles in seconds.
        """
        return PreparedChain(self.mechanism.prepare().as_table(), self.point, self.joints, self.sought)


def chain_of(mechanism: Mechanism, point: str, joints: Sequence[str] | None) -> Chain:
    """A chain: by default of all the coordinates between the ground and the point that a drive may prescribe; of a
    mechanism with ideal closures those of them, and of the loops, that have a drive.

    **Raises:** `ClearanceError` for unknown points and coordinates, and for a point that nothing moves.
    """
    ideal = mechanism.ideal()
    names = [one.name for one in ideal.points]
    if point not in names:
        raise ClearanceError(f"There is no point `{point}`. " + suggest(point, names))
    body = next(one.body for one in ideal.points if one.name == point)
    looped = _loop_joints(ideal)
    own = [joint for joint in ideal.joints if joint in _towards_ground(ideal, body) or joint.name in looped]
    known = drivable(ideal.joints)
    for name in joints or ():
        if name not in known:
            raise ClearanceError(f"There is no coordinate `{name}` to move. " + suggest(name, known))
    resting = [joint for joint in own if any(c.is_ball for c in joint.own_coordinates())]
    found = drivable([joint for joint in own if joint not in resting])
    # The spring of an elastic drive stays as it is: its motor moves the link.
    found = {name: c for name, c in found.items() if not gives_way(c.motion)}
    if joints is None:
        joints = [name for name, c in found.items() if not ideal.closures() or not c.motion.is_free]
    if not joints:
        raise _no_joint(point, found, bool(ideal.closures()))
    bodies = tuple(Body(one.name) for one in ideal.bodies)
    free = dataclasses.replace(ideal.without_drives(joints), bodies=bodies, springs=(), gravity=NO_GRAVITY)
    free = dataclasses.replace(free, wrenches=(), controllers=())
    passive = {c.name for joint in free.joints if joint.name in looped for c in joint.own_coordinates()}
    sought = [i for p in parts(free) if p.coordinate.name in {*joints, *passive} for i in range(p.v.start, p.v.stop)]
    return Chain(free, point, tuple(joints), tuple(sought))


def _no_joint(point: str, allowed: Iterable[str], looped: bool) -> ClearanceError:
    """Why no joint moves a point, and which may."""
    names = ", ".join(f"`{name}`" for name in allowed)
    if not names:
        return ClearanceError(f"No joint that a drive may prescribe moves point `{point}`.")
    if not looped:
        return ClearanceError(f"No joint is to move point `{point}`. Name some in `joints`: {names}.")
    return ClearanceError(
        f"The mechanism has closed loops, where joints with a drive move point `{point}` and the others follow, but "
        f"none has a drive. Name in `joints` as many as the mechanism can move independently, of these: {names}."
    )


def _towards_ground(mechanism: AbstractMechanism, body: str) -> list[AbstractJoint]:
    """The joints of the tree that carry a body, from it to the ground."""
    carriers, out = {joint.child: joint for joint in mechanism.joints}, []
    while body != GROUND:
        out.append(carriers[body])
        body = out[-1].parent
    return out


def _loop_joints(mechanism: Mechanism) -> set[str]:
    """The joints of the tree that are in a loop of an ideal closure: they carry one of its bodies, not both."""
    found: set[str] = set()
    for loop in mechanism.closures():
        sides = ({joint.name for joint in _towards_ground(mechanism, body)} for body in (loop.parent, loop.child))
        found |= set.symmetric_difference(*sides)
    return found


def start_of(mechanism: Mechanism, chain: Chain, time: Scalar) -> Float[Array, " positions"]:
    """The chain's positions at the mechanism's start: of a driven coordinate what its drive says."""
    given = initial_values(chain.mechanism)[: len(layout(chain.mechanism).positions)]
    for coordinate in mechanism.ideal().coordinates():
        if coordinate.motion.drive is not None and coordinate.name in chain.joints:
            value = coordinate.motion.drive(time)[0]
            given = given.at[chain.places([coordinate.name])[0]].set(value)
    return given


def look_at(chain: PreparedChain, aim: Aim | None, time: Scalar, q: Float[Array, " positions"]) -> Look:
    """A chain at positions, with nothing moving but what is driven; without an `aim` only closures count."""
    mechanism, size = chain.mechanism, chain.size
    plan = layout(mechanism)
    state = State(tuple(q), (0.0,) * plan.free, {})
    motion = frames(mechanism, time, state)
    gaps: list[Term] = []
    rows: list[Array] = []
    drifts: list[Term] = []
    if aim is not None:
        point, frame = chain.frame, motion[chain.frame.body]
        at = frame.point(point.at.vector)
        linear = motion.velocities(chain.frame.body, at).array
        flat = mechanism.is_plane
        for k in (0, 1) if flat else (0, 1, 2):
            gaps.append((at[k] - aim.place[k]) / size)
            rows.append(linear[:, k] / size)
            drifts.append(frame.velocity_at(at)[k] / size)
        if aim.rotation is not None:
            angular = motion.spins(chain.frame.body).array
            turned = frame.rotation if point.orientation is None else frame.rotate(point.orientation.rotation).rotation
            wanted = tuple((row[0], row[1], row[2]) for row in aim.rotation)
            off = rotation_between(IDENTITY.compose(wanted), IDENTITY.compose(turned.rows))  # pyright: ignore
            for k in (2,) if flat else (0, 1, 2):
                gaps.append(off[k])
                rows.append(angular[:, k])
                drifts.append(frame.spin[k])
    closed = jnp.asarray(True)
    for loop in mechanism.closures():
        for now in conditions(loop, motion):
            unit = size if absent(now.torque) else 1.0
            gaps.append(now.gap / unit)
            rows.append(now.row.array / unit)
            drifts.append(now.rate / unit)
        for cosine in wrong_way(loop, motion):
            closed &= jnp.asarray(cosine) > 0
    jacobian = jnp.stack(rows)[:, np.array(chain.sought)] * chain.units[None]
    return Look(as_array(gaps), jacobian, as_array(drifts), closed)
