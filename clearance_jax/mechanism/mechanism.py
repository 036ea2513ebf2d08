"""The mechanism: bodies, the tree of joints, loops, springs, points, gravity; and its parameters by name."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._types import Leaf, Scalar, follow, physical_leaves
from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints import RevoluteClearance
from clearance_jax.mechanism.body import GROUND, Body, Gravity, Point, Spring
from clearance_jax.mechanism.tree import AbstractJoint, Coordinate, Frame, Prismatic, Revolute, place

NO_GRAVITY = Gravity()


class Mechanism(eqx.Module):
    """A planar mechanism. Names, topology and law choices are static; every number is an array leaf.

    **Arguments:**

    - `bodies`: every body but the ground.
    - `joints`: the tree: each joint places a body that no earlier joint has placed, parents first.
    - `loops`: revolute joints between bodies that the tree has placed already; with clearance they are force elements,
      without they are ideal constraints.
    - `springs`, `points`, `gravity`: as they say.
    - `assemble`: whether a solve starts by closing the loops (off: from exactly the given initial values).

    **Raises:** `ClearanceError` where names clash or dangle.
    """

    bodies: tuple[Body, ...]
    joints: tuple[AbstractJoint, ...]
    loops: tuple[Revolute, ...] = ()
    springs: tuple[Spring, ...] = ()
    points: tuple[Point, ...] = ()
    gravity: Gravity = NO_GRAVITY
    name: str = eqx.field(static=True, default="mechanism")
    assemble: bool = eqx.field(static=True, default=True)

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
        for spring in self.springs:
            self._known(spring.name, "body_a", spring.body_a, placed)
            self._known(spring.name, "body_b", spring.body_b, placed)
        for point in self.points:
            self._known(point.name, "body", point.body, placed)

    @staticmethod
    def _known(owner: str, key: str, word: str, allowed: set[str]) -> None:
        if word not in allowed:
            raise ClearanceError(
                f"`{owner}.{key}` must name a body, but `{word}` is not one that fits. " + suggest(word, allowed)
            )

    # Structure -----------------------------------------------------------------------------------------------------

    def coordinates(self) -> Iterator[Coordinate]:
        """Every elementary coordinate of the tree, in order."""
        for joint in self.joints:
            yield from joint.coordinates()

    def free_coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates that are states."""
        return tuple(c for c in self.coordinates() if c.motion.is_free)

    def clearance_joints(self) -> tuple[Revolute, ...]:
        """Every joint with clearance, those of the tree first."""
        candidates = (*(j for j in self.joints if isinstance(j, Revolute)), *self.loops)
        return tuple(joint for joint in candidates if joint.clearance is not None)

    def closures(self) -> tuple[Revolute, ...]:
        """The loops without clearance: ideal constraints."""
        return tuple(loop for loop in self.loops if loop.clearance is None)

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
        return self._with_joints(lambda joint: _without_clearance(joint))

    def with_clearance(self, name: str, clearance: RevoluteClearance | None = None, *, radial: Any = None):
        """The same mechanism with clearance in joint `name`.

        Give the whole `clearance`, or only `radial` [m] for a joint that has clearance already.
        """
        joint = self.joint(name)
        if not isinstance(joint, Revolute):
            raise ClearanceError(f"Joint `{name}` must be revolute to have a radial clearance, but it is not.")
        if clearance is None:
            if joint.clearance is None:
                raise ClearanceError(
                    f"Joint `{name}` is ideal: give its pin radius and laws, "
                    "`with_clearance(name, RevoluteClearance(...))`."
                )
            clearance = joint.clearance
        if radial is not None:
            clearance = RevoluteClearance(radial, clearance.pin_radius, clearance.normal, clearance.friction)
        new = eqx.tree_at(lambda j: j.clearance, joint, clearance, is_leaf=lambda x: x is None)
        return self._with_joints(lambda j: new if j.name == name else j)

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
        """The mechanism with everything that depends only on its numbers computed (once a solve, not once a step)."""
        return self._with_joints(_prepared)


def _without_clearance(joint: AbstractJoint) -> AbstractJoint:
    if isinstance(joint, Revolute) and joint.clearance is not None:
        return eqx.tree_at(lambda j: j.clearance, joint, None)
    return joint


def _prepared(joint: AbstractJoint) -> AbstractJoint:
    if isinstance(joint, Revolute) and joint.clearance is not None:
        joint = eqx.tree_at(lambda j: j.clearance, joint, joint.clearance.prepared())
    if isinstance(joint, Revolute | Prismatic) and joint.motion.drive is not None:
        joint = eqx.tree_at(lambda j: j.motion.drive, joint, joint.motion.drive.prepared())
    if isinstance(joint, Revolute | Prismatic) and joint.motion.actuators:
        actuators = tuple(actuator.prepared() for actuator in joint.motion.actuators)
        joint = eqx.tree_at(lambda j: j.motion.actuators, joint, actuators)
    return joint


# Kinematics --------------------------------------------------------------------------------------------------------


class Layout(NamedTuple):
    """Where each quantity lives in the flat state vector `[q, v, memory]`, which books may follow (static)."""

    names: tuple[str, ...]
    memories: tuple[tuple[str, int], ...]

    @property
    def free(self) -> int:
        """Number of free coordinates."""
        return len(self.names)

    @property
    def remembered(self) -> int:
        """Number of memory variables."""
        return sum(n for _, n in self.memories)

    @property
    def size(self) -> int:
        """Length of the state vector without books."""
        return 2 * self.free + self.remembered

    def memory_of(self, y: Array) -> dict[str, Array]:
        """Memory of each clearance joint."""
        out, start = {}, 2 * self.free
        for name, n in self.memories:
            out[name] = y[start : start + n]
            start += n
        return out


def layout(mechanism: Mechanism) -> Layout:
    """The state layout of a mechanism."""
    memories = tuple((j.name, len(j.clearance.remembers)) for j in mechanism.clearance_joints() if j.clearance)
    return Layout(tuple(c.name for c in mechanism.free_coordinates()), memories)


def frames(mechanism: Mechanism, time: Scalar, y: Array) -> dict[str, Frame]:
    """Pose and motion of every body: one sweep from the ground."""
    names = [c.name for c in mechanism.free_coordinates()]
    n = len(names)
    values = {name: (i, y[i], y[n + i]) for i, name in enumerate(names)}
    out = {GROUND: Frame()}
    for joint in mechanism.joints:
        out[joint.child] = place(joint, out[joint.parent], time, values)
    return out


def drive_breaks(mechanism: Mechanism) -> Array:
    """Break times of every drive and actuator."""
    motions = [coordinate.motion for coordinate in mechanism.coordinates()]
    drives = [motion.drive.breaks() for motion in motions if motion.drive is not None]
    actuators = [actuator.breaks() for motion in motions for actuator in motion.actuators]
    return jnp.concatenate([jnp.zeros(0), *drives, *actuators])


# Parameters by name ------------------------------------------------------------------------------------------------


def _leaves(mechanism: Mechanism) -> Iterator[Leaf]:
    for group in ("bodies", "joints", "loops", "springs", "points"):
        for index, part in enumerate(getattr(mechanism, group)):
            for leaf in physical_leaves(part, (group, str(index)), f"{part.name}."):
                # A drive's numbers are the drive's: `drive.crank.speed`, not `crank.drive.speed`.
                name = leaf.name.replace(f"{part.name}.drive.", f"drive.{part.name}.", 1)
                yield Leaf(name, leaf.path, leaf.value, leaf.metadata)
    yield from physical_leaves(mechanism.gravity, ("gravity",), "gravity.")


def parameters(mechanism: Mechanism) -> dict[str, Leaf]:
    """Every number of the mechanism by its one dotted name, with value, unit and bounds (`.metadata`)."""
    return {leaf.name: leaf for leaf in _leaves(mechanism)}


def replace(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """A new mechanism with some numbers replaced.

    **Arguments:**

    - `values`: dotted name to number or array (SI; tracers welcome). A name may end in `.i` for one entry of an array.

    **Raises:** `ClearanceError` for an unknown name.
    """
    known = parameters(mechanism)
    for name, value in values.items():
        leaf, index = known.get(name), None
        if leaf is None and name.rpartition(".")[2].isdigit():
            head, _, tail = name.rpartition(".")
            leaf, index = known.get(head), int(tail)
        if leaf is None:
            raise ClearanceError(f"There is no parameter `{name}`. " + suggest(name, known))
        path, old = leaf.path, follow(mechanism, leaf.path)
        if index is not None and not (np.ndim(old) == 1 and index < np.shape(old)[0]):
            raise ClearanceError(f"`{leaf.name}` has shape {np.shape(old)}: there is no entry {index}.")
        new = jnp.asarray(value, dtype=float) if index is None else jnp.asarray(old).at[index].set(value)
        if np.ndim(new) < np.ndim(old):
            raise ClearanceError(
                f"`{name}` must have shape {np.shape(old)}, but a value of shape {np.shape(new)} was "
                f"given. Name one entry as `{name}.0`."
            )
        mechanism = eqx.tree_at(lambda m, path=path: follow(m, path), mechanism, new)
    return mechanism
