"""A chain: the coordinates that move a point of an ideal mechanism, and the exact Jacobian of the point by them.

Ideal closures add their conditions as further rows. So a parallel robot is a chain as well; its passive coordinates are
sought together with the joints.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.dynamics.conditions import conditions, wrong_way
from clearance_jax.dynamics.kinematics import frames
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import GROUND, Body, Limits, Point
from clearance_jax.mechanism.couplings import leaders_of
from clearance_jax.mechanism.mechanism import NO_GRAVITY, Mechanism
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.state import State, initial_values, layout, parts
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.mechanism.variants import drivable, gives_way, motor_of
from clearance_jax.spatial import IDENTITY, Term, absent, as_array, length_of, rotation_between

NO_LIMITS = Limits()


class Aim(NamedTuple):
    """The target of a frame: its place [m], and its rotation matrix (`None`: any rotation)."""

    place: Float[Array, "3"]
    rotation: Float[Array, "3 3"] | None


class PoseGap(NamedTuple):
    """Residual of a chain at some positions: the `gap` of the frame from its aim and of the closures (lengths divided
    by the chain's size), its `jacobian` by the sought velocities (slides in units of the size), its rate by prescribed
    motion (`drift`), and whether no axis of a closure points the wrong way (`closed`).
    """

    gap: Float[Array, " rows"]
    jacobian: Float[Array, "rows sought"]
    drift: Float[Array, " rows"]
    closed: Array


class AbstractChain(Module):
    """An ideal mechanism without masses whose `joints` (names of coordinates) are free, a named point of it, and
    `sought`: the indices of the free velocities that move the point, passive coordinates included.
    """

    mechanism: AbstractMechanism
    point: str = eqx.field(static=True)
    joints: tuple[str, ...] = eqx.field(static=True)
    sought: tuple[int, ...] = eqx.field(static=True)

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
        """The limits of the sought coordinates."""
        every = self.coordinates
        return [every[i].motion.limits or NO_LIMITS for i in self.sought]

    @property
    def size(self) -> Array:
        """The length of the chain, joint to joint [m]. Lengths divided by it are comparable with angles."""
        carried = _towards_ground(self.mechanism, self.frame.body)
        places = [at for joint in carried for at in (joint.at_parent, joint.at_child)]
        length = sum((length_of(at.vector) for at in (*places, self.frame.at)), jnp.zeros(()))
        return jax.lax.stop_gradient(jnp.where(length > 0, length, 1.0))

    @property
    def units(self) -> Array:
        """The unit of each sought velocity: the chain's size for a slide, 1 for a turn."""
        every, size = self.coordinates, self.size
        return jnp.stack([jnp.ones(()) if every[i].slides is None else size for i in self.sought])

    def places(self, names: Sequence[str]) -> np.ndarray:
        """Indices of named coordinates among the positions."""
        return np.array([layout(self.mechanism).positions.index(name) for name in names], int)


class PreparedChain(AbstractChain):
    """A chain of a prepared mechanism."""

    mechanism: PreparedMechanism


class Chain(AbstractChain):
    """A chain of a mechanism that is not prepared."""

    mechanism: Mechanism

    def prepare(self) -> PreparedChain:
        """The chain with its mechanism prepared; in space as a table, whose program compiles in seconds."""
        return PreparedChain(self.mechanism.prepare().as_table(), self.point, self.joints, self.sought)


def chain_of(mechanism: Mechanism, point: str, joints: Sequence[str] | None) -> Chain:
    """The chain that moves a point. By default its joints are all coordinates between the ground and the point that a
    drive may prescribe; with ideal closures, those of them and of the loops that have a drive.

    **Raises:** `ClearanceError` for unknown points and coordinates, and for a point that nothing moves.
    """
    ideal = mechanism.ideal()
    names = [p.name for p in ideal.points]
    if point not in names:
        raise unknown_name(f"There is no point `{point}`.", point, names)
    body = next(p.body for p in ideal.points if p.name == point)
    looped = _loop_joints(ideal)
    movers = [joint for joint in ideal.joints if joint in _towards_ground(ideal, body) or joint.name in looped]
    known = drivable(ideal.joints)
    for name in joints or ():
        if name not in known:
            raise unknown_name(f"There is no coordinate `{name}` to move.", name, known)
    resting = [joint for joint in movers if any(c.is_ball for c in joint.own_coordinates())]
    movable = drivable([joint for joint in movers if joint not in resting])
    # The spring of an elastic drive stays as it is: its motor moves the link.
    movable = {name: c for name, c in movable.items() if not gives_way(c.motion)}
    if joints is None:
        names = [name for name, c in movable.items() if not ideal.closures() or not c.motion.is_free]
        # A follower is moved by what it follows in the end; where that gives way, by its motor.
        roots = [root for name in names for root in sorted(leaders_of(name, ideal.firm_couplings))]
        joints = list(dict.fromkeys(motor_of(root) if gives_way(known[root].motion) else root for root in roots))
    if not joints:
        raise _no_joint(point, movable, bool(ideal.closures()))
    bodies = tuple(Body(b.name) for b in ideal.bodies)
    free = dataclasses.replace(ideal.without_drives(joints), bodies=bodies, springs=(), gravity=NO_GRAVITY)
    free = dataclasses.replace(free, wrenches=(), controllers=())
    passive = {c.name for joint in free.joints if joint.name in looped for c in joint.own_coordinates()}
    sought = [i for p in parts(free) if p.coordinate.name in {*joints, *passive} for i in range(p.v.start, p.v.stop)]
    return Chain(free, point, tuple(joints), tuple(sought))


def _no_joint(point: str, allowed: Iterable[str], looped: bool) -> ClearanceError:
    """The error for a point that no joint moves."""
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
    names: set[str] = set()
    for loop in mechanism.closures():
        sides = ({joint.name for joint in _towards_ground(mechanism, body)} for body in (loop.parent, loop.child))
        names |= set.symmetric_difference(*sides)
    return names


def start_of(mechanism: Mechanism, chain: Chain, time: Scalar) -> Float[Array, " positions"]:
    """The chain's positions at the mechanism's start; driven coordinates are where their drives put them."""
    given = initial_values(chain.mechanism)[: len(layout(chain.mechanism).positions)]
    for coordinate in mechanism.ideal().coordinates():
        if coordinate.motion.drive is not None and coordinate.name in chain.joints:
            value = coordinate.motion.drive(time)[0]
            given = given.at[chain.places([coordinate.name])[0]].set(value)
    return given


def look_at(chain: PreparedChain, aim: Aim | None, time: Scalar, q: Float[Array, " positions"]) -> PoseGap:
    """The residual of a chain at positions, where only drives move; without an `aim`, that of its closures."""
    mechanism, size = chain.mechanism, chain.size
    motion = frames(mechanism, time, State(tuple(q), (0.0,) * layout(mechanism).free, {}))
    # By row: gap, Jacobian, drift.
    rows: list[tuple[Term, Array, Term]] = []
    if aim is not None:
        point, frame = chain.frame, motion[chain.frame.body]
        at = frame.point(point.at.vector)
        linear, velocity = motion.velocities(chain.frame.body, at).array, frame.velocity_at(at)
        flat = mechanism.is_plane
        along = (0, 1) if flat else (0, 1, 2)
        rows += [((at[k] - aim.place[k]) / size, linear[:, k] / size, velocity[k] / size) for k in along]
        if aim.rotation is not None:
            angular = motion.spins(chain.frame.body).array
            turned = frame.rotation if point.orientation is None else frame.rotate(point.orientation.rotation).rotation
            wanted = tuple((row[0], row[1], row[2]) for row in aim.rotation)
            off = rotation_between(IDENTITY.compose(wanted), IDENTITY.compose(turned.rows))  # pyright: ignore
            rows += [(off[k], angular[:, k], frame.spin[k]) for k in ((2,) if flat else (0, 1, 2))]
    closed = jnp.asarray(True)
    for loop in mechanism.closures():
        for now in conditions(loop, motion):
            unit = size if absent(now.torque) else 1.0
            rows.append((now.gap / unit, now.row.array / unit, now.rate / unit))
        for cosine in wrong_way(loop, motion):
            closed &= jnp.asarray(cosine) > 0
    gaps, jacobian, drifts = zip(*rows, strict=True)
    jacobian = jnp.stack(jacobian)[:, np.array(chain.sought)] * chain.units[None]
    return PoseGap(as_array(gaps), jacobian, as_array(drifts), closed)
