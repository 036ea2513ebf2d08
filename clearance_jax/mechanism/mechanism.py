"""The mechanism: bodies, the tree of joints, loops, springs, points, gravity."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints import AbstractClearance, PreparedClearance
from clearance_jax.mechanism.body import GROUND, Body, Point, Spring
from clearance_jax.mechanism.driving import check_drives, released, with_drives
from clearance_jax.mechanism.links import UNROLLED, Links, links_of
from clearance_jax.mechanism.placement import Gravity, Inertia, Position
from clearance_jax.mechanism.tree import AbstractJoint, Coordinate, Revolute
from clearance_jax.parameters import replace
from clearance_jax.spatial import Pair, absent, add, scale

NO_GRAVITY = Gravity()


class ClearanceJoint(NamedTuple):
    """A joint whose clearance is there; `play`: where its play coordinates begin among the free ones (`None`: it closes
    a loop and has none).
    """

    joint: Revolute
    clearance: Any
    play: int | None

    @property
    def name(self) -> str:
        """The joint's."""
        return self.joint.name

    @property
    def parent(self) -> str:
        """The body that the sleeve is on."""
        return self.joint.parent

    @property
    def child(self) -> str:
        """The body that the pin is on."""
        return self.joint.child

    def slid(self, values: Sequence[Any]) -> Pair:
        """What the play coordinates that slide add up to, in the sleeve's axes, of one value a free coordinate."""
        assert self.play is not None
        out: Pair = (0.0, 0.0)
        for value, play in zip(values[self.play :], self.joint.play(), strict=False):
            if play.slides is not None:
                out = add(out, scale(value, play.slides))
        return out

    @property
    def laws(self) -> tuple[Any, ...]:
        """Its contact laws, as the user gave them."""
        joint = self.clearance.joint if isinstance(self.clearance, PreparedClearance) else self.clearance
        return (joint.normal,) if joint.friction is None else (joint.normal, joint.friction)

    @property
    def size(self) -> Array:
        """Its largest clearance [m]."""
        return jnp.max(jnp.stack([play.scale for play in self.joint.play() if play.slides is not None]))


class Mechanism(eqx.Module):
    """A mechanism, in the plane or in space. Names, topology and law choices are static; every number is an array leaf.

    **Arguments:**

    - `bodies`: every body but the ground.
    - `joints`: the tree: each joint places a body that no earlier joint has placed, parents first.
    - `loops`: joints between bodies that the tree has placed already: ideal constraints; a revolute one with clearance
      is a force element.
    - `springs`, `points`, `gravity`: as they say.
    - `assemble`: whether a solve starts by closing the loops (off: from exactly the given initial values).

    **Raises:** `ClearanceError` where names clash or dangle.
    """

    bodies: tuple[Body, ...]
    joints: tuple[AbstractJoint, ...]
    loops: tuple[AbstractJoint, ...] = ()
    springs: tuple[Spring, ...] = ()
    points: tuple[Point, ...] = ()
    gravity: Gravity = NO_GRAVITY
    name: str = eqx.field(static=True, default="mechanism")
    assemble: bool = eqx.field(static=True, default=True)
    chosen: Array | None = None
    """Of a mechanism that is being solved, which conditions of its closures a step asks for (`constraint.choice`)."""
    links: Links | None = None
    """Of a prepared mechanism that is large, its table."""

    def __check_init__(self):
        parts = (*self.bodies, *self.joints, *self.loops, *self.springs, *self.points)
        if not self.bodies:
            raise ClearanceError("A mechanism needs at least one body (in a scene file a table `[body.NAME]`).")
        seen: set[str] = set()
        for part in parts:
            if part.name in seen or part.name in (GROUND, "gravity", "drive"):
                raise ClearanceError(f"The name `{part.name}` is used twice or reserved. Rename one of the parts.")
            seen.add(part.name)
        bodies = {body.name for body in self.bodies}
        placed = {GROUND}
        for joint in self.joints:
            self._known(joint.name, "parent", joint.parent, placed)
            self._known(joint.name, "child", joint.child, bodies - placed)
            placed.add(joint.child)
        loose = bodies - placed
        if loose:
            raise ClearanceError(f"No joint connects body `{min(loose)}` to the ground. Add a joint with it as child.")
        for loop in self.loops:
            self._known(loop.name, "parent", loop.parent, placed)
            self._known(loop.name, "child", loop.child, placed)
            self._distinct(loop.name, "parent", "child", loop.parent, loop.child)
        for spring in self.springs:
            self._known(spring.name, "body_a", spring.body_a, placed)
            self._known(spring.name, "body_b", spring.body_b, placed)
            self._distinct(spring.name, "body_a", "body_b", spring.body_a, spring.body_b)
        for point in self.points:
            self._known(point.name, "body", point.body, placed)
        loose = self.clearance_joints()
        if loose and not self.is_plane:
            raise ClearanceError(
                f"Joint `{loose[0].name}` has clearance in a mechanism that leaves the plane: play is for plane "
                "mechanisms so far. Take the clearance away, or leave out what leaves the plane (z components, "
                "orientations, axes other than z, inertias of three or six numbers)."
            )

    @staticmethod
    def _known(owner: str, key: str, word: str, allowed: set[str]) -> None:
        if word not in allowed:
            raise ClearanceError(
                f"`{owner}.{key}` must name a body, but `{word}` is not one that fits. " + suggest(word, allowed)
            )

    @staticmethod
    def _distinct(owner: str, one: str, other: str, first: str, second: str) -> None:
        if first == second:
            raise ClearanceError(
                f"`{owner}.{one}` and `{owner}.{other}` must name two bodies, but both name `{first}`. Change one."
            )

    # Structure -----------------------------------------------------------------------------------------------------

    def coordinates(self) -> Iterator[Coordinate]:
        """Every elementary coordinate of the tree, in order."""
        for joint in self.joints:
            yield from joint.coordinates()

    def free_coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates that are states."""
        return tuple(c for c in self.coordinates() if c.motion.is_free)

    def clearance_joints(self) -> tuple[ClearanceJoint, ...]:
        """Every joint with clearance, those of the tree first."""
        names = [c.name for c in self.free_coordinates()]
        out = []
        for joint in (*self.joints, *self.loops):
            if isinstance(joint, Revolute) and joint.clearance is not None:
                first = joint.name + joint.play()[0].suffix
                out.append(ClearanceJoint(joint, joint.clearance, names.index(first) if first in names else None))
        return tuple(out)

    def closures(self) -> tuple[AbstractJoint, ...]:
        """The loops without clearance: ideal constraints."""
        return tuple(loop for loop in self.loops if getattr(loop, "clearance", None) is None)

    @property
    def is_plane(self) -> bool:
        """Whether nothing in it leaves the plane z = 0, by its structure."""
        places = [part.center_of_mass for part in self.bodies] + [point.at for point in self.points]
        places += [at for joint in self.all_joints() for at in (joint.at_parent, joint.at_child)]
        places += [at for spring in self.springs for at in (spring.at_a, spring.at_b)]
        return (
            all(place.z is None for place in (*places, self.gravity))
            and all(point.orientation is None or point.orientation.is_plane for point in self.points)
            and not any(isinstance(body.inertia, Inertia) for body in self.bodies)
            and all(joint.is_plane for joint in self.all_joints())
        )

    @property
    def may_repeat(self) -> bool:
        """Whether conditions of its closures may follow from others, as those of loops in space do."""
        return bool(self.closures()) and not self.is_plane

    @property
    def has_manifold(self) -> bool:
        """Whether states lie on a manifold that steps are projected to: loops closed, quaternions of unit length."""
        return bool(self.closures()) or any(coordinate.is_ball for coordinate in self.free_coordinates())

    def beyond(self, body: str) -> set[str]:
        """A body and every body that hangs on it."""
        found = {body}
        for joint in self.joints:
            if joint.parent in found:
                found.add(joint.child)
        return found

    def joint(self, name: str) -> AbstractJoint:
        """The joint of that name. **Raises** `ClearanceError` for an unknown one."""
        for joint in (*self.joints, *self.loops):
            if joint.name == name:
                return joint
        raise ClearanceError(f"There is no joint `{name}`. " + suggest(name, [j.name for j in self.all_joints()]))

    def all_joints(self) -> tuple[AbstractJoint, ...]:
        """Joints of the tree, then loops."""
        return (*self.joints, *self.loops)

    # Variants ------------------------------------------------------------------------------------------------------

    def ideal(self) -> "Mechanism":
        """The same mechanism with every clearance taken away."""
        return self.held({})

    def held(self, places: Mapping[str, Pair]) -> "Mechanism":
        """The ideal mechanism whose pins are held at the given places of their sleeves [m], in the sleeves' axes (one
        that is not named: in the middle).
        """
        return self._with_joints(lambda joint: _without_clearance(joint, places.get(joint.name, (0.0, 0.0))))

    def with_clearance(self, name: str, clearance: AbstractClearance | None = None, *, radial: Any = None):
        """The same mechanism with clearance in joint `name`.

        Give the whole `clearance`, or only `radial` [m] for a joint that has clearance already.
        """
        joint = self.joint(name)
        if not isinstance(joint, Revolute):
            raise ClearanceError(f"Joint `{name}` must be revolute to have a radial clearance, but it is not.")
        if clearance is None and joint.clearance is None:
            raise ClearanceError(
                f"Joint `{name}` is ideal: give its pin radius and laws, "
                "`with_clearance(name, RevoluteClearance(...))`."
            )
        new = joint
        if clearance is not None:
            new = eqx.tree_at(lambda j: j.clearance, joint, clearance, is_leaf=lambda x: x is None)
        changed = self._with_joints(lambda j: new if j.name == name else j)
        return changed if radial is None else replace(changed, {f"{name}.radial_clearance": radial})

    def driven(self, drives: Mapping[str, Any]) -> "Mechanism":
        """The same mechanism with other drives (`cj.Trapezoid`, `cj.read_trajectory`, ...) of the named coordinates.

        A coordinate that was free is no state any more, and loses its actuators; limits are kept.

        **Arguments:** `drives`: motion laws by the name of a coordinate of the tree (its joint's, if it has but one).

        **Raises:** `ClearanceError` for an unknown coordinate, for play, and for a joint that closes a loop.
        """
        check_drives(self.joints, drives)
        return self._with_joints(lambda joint: with_drives(joint, drives))

    def released(self, names: Iterable[str]) -> "Mechanism":
        """The same mechanism with the named coordinates free: without their drives and actuators."""
        return self._with_joints(lambda joint: released(joint, names))

    def _with_joints(self, change) -> "Mechanism":
        return Mechanism(
            self.bodies,
            tuple(change(j) for j in self.joints),
            tuple(change(j) for j in self.loops),
            self.springs,
            self.points,
            self.gravity,
            self.name,
            self.assemble,
        )

    def prepared(self) -> "Mechanism":
        """The mechanism with everything that depends only on its numbers computed (once a solve, not once a step): its
        drives, actuators and clearances are then of the types that a step evaluates.
        """
        ready = self._with_joints(lambda joint: joint.prepared())
        if not ready.is_tabled:
            return ready
        return dataclasses.replace(ready, links=links_of(ready.bodies, ready.joints))

    @property
    def is_tabled(self) -> bool:
        """Whether it is so large that its dynamics is a loop over a table of its links."""
        return len(list(self.coordinates())) > UNROLLED and not self.is_plane


def _without_clearance(joint: AbstractJoint, place: Pair) -> AbstractJoint:
    if not isinstance(joint, Revolute) or joint.clearance is None:
        return joint
    ideal = eqx.tree_at(lambda j: j.clearance, joint, None)
    if absent(place):
        return ideal
    # The sleeve's axes are the parent's, turned by the joint's own angle.
    offset = joint.turned.apply((*place, 0.0))
    x, y, _ = (jnp.asarray(term) for term in add(joint.at_parent.vector, offset))
    return dataclasses.replace(ideal, at_parent=Position(x, y, joint.at_parent.z))


def drive_breaks(mechanism: Mechanism) -> Array:
    """Break times of every drive and actuator."""
    motions = [coordinate.motion for coordinate in mechanism.coordinates()]
    drives = [motion.drive.breaks() for motion in motions if motion.drive is not None]
    actuators = [actuator.breaks() for motion in motions for actuator in motion.actuators]
    return jnp.concatenate([jnp.zeros(0), *drives, *actuators])
