"""The base of both kinds of mechanism, the user's and the one prepared for a solve: structure, and times of breaks."""

import abc
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.module import structural_property
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import unknown_name
from clearance_jax.mechanism.actuators import instants
from clearance_jax.mechanism.body import Body, Point, Spring, Wrench
from clearance_jax.mechanism.controllers import AbstractController, Reference
from clearance_jax.mechanism.couplings import Coupling, without_backlash
from clearance_jax.mechanism.form import Columns, EquationForm, columns_of, is_less_by_blocks
from clearance_jax.mechanism.gaps import CoordinateGap
from clearance_jax.mechanism.placement import Gravity, Inertia
from clearance_jax.mechanism.tree.coordinate import Coordinate
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed, without_misalignment
from clearance_jax.mechanism.variants import gives_way, rigid, without_gaps, without_play
from clearance_jax.parameters import Parametrised
from clearance_jax.spatial import Term
from clearance_jax.units import SLIDING, TURNING

Kind = TypeVar("Kind", bound="AbstractMechanism")


class ClearanceJoint(NamedTuple):
    """A joint with its clearance; `in_tree`: whether its play adds coordinates to the tree (else it closes a loop)."""

    joint: AbstractPlayed
    clearance: Any
    in_tree: bool

    @property
    def name(self) -> str:
        """The joint's name."""
        return self.joint.name

    @property
    def parent(self) -> str:
        """The body that the sleeve is on."""
        return self.joint.parent

    @property
    def child(self) -> str:
        """The body that the pin is on."""
        return self.joint.child

    @property
    def laws(self) -> tuple[Any, ...]:
        """Its contact laws, as the user gave them."""
        return self.clearance.laws

    @property
    def has_points(self) -> bool:
        """Whether it can touch at several points."""
        return self.clearance.joint.count > 1

    @property
    def size(self) -> Array:
        """Its largest clearance [m]."""
        return jnp.max(jnp.stack([play.scale for play in self.joint.play() if play.slides is not None]))


class AbstractMechanism(Parametrised):
    """Bodies, the tree of joints, loops and what acts on them (see `Mechanism`), and what follows from structure."""

    bodies: eqx.AbstractVar[tuple[Body, ...]]
    joints: eqx.AbstractVar[tuple[AbstractJoint, ...]]
    loops: eqx.AbstractVar[tuple[AbstractJoint, ...]]
    springs: eqx.AbstractVar[tuple[Spring, ...]]
    points: eqx.AbstractVar[tuple[Point, ...]]
    gravity: eqx.AbstractVar[Gravity]
    assemble: eqx.AbstractVar[bool]
    wrenches: eqx.AbstractVar[tuple[Wrench, ...]]
    controllers: eqx.AbstractVar[tuple[AbstractController, ...]]
    couplings: eqx.AbstractVar[tuple[Coupling, ...]]

    def units_within(self, member):
        if isinstance(member, Reference):
            return next(TURNING if c.slides is None else SLIDING for c in self.coordinates() if c.name == member.name)
        if not isinstance(member, Coupling):
            return {}
        return member.units_by({c.name: "rad" if c.slides is None else "m" for c in self.coordinates()})

    def coordinates(self) -> Iterator[Coordinate]:
        """Every elementary coordinate of the tree, in order; axes in those of its joint's sleeve."""
        for joint in self.joints:
            yield from joint.own_coordinates()

    def free_coordinates(self) -> tuple[Coordinate, ...]:
        """The free coordinates that follow no other, which are states."""
        followers = {coupling.follower for coupling in self.firm_couplings}
        return tuple(c for c in self.moved_coordinates() if c.name not in followers)

    def moved_coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates that no drive prescribes: states, and what follows them."""
        return tuple(c for c in self.coordinates() if c.motion.is_free)

    def clearance_joints(self) -> tuple[ClearanceJoint, ...]:
        """Every joint with clearance, those of the tree first."""
        return tuple(
            ClearanceJoint(joint, joint.clearance, group is self.joints)
            for group in (self.joints, self.loops)
            for joint in group
            if isinstance(joint, AbstractPlayed) and joint.clearance is not None
        )

    friction_in_motions: ClassVar[bool] = True
    """Whether friction on the link's side of drives is that of their motions, and not records of gaps."""

    @property
    @abc.abstractmethod
    def gaps(self) -> tuple[CoordinateGap, ...]:
        """The gaps of coordinates: backlash and stops."""

    def contacts(self) -> tuple[ClearanceJoint | CoordinateGap, ...]:
        """Everything that touches and comes off: clearance joints, then gaps of coordinates."""
        return (*self.clearance_joints(), *self.gaps)

    def open_gaps(self) -> tuple[CoordinateGap, ...]:
        """The gaps of backlash and stops."""
        return tuple(gap for gap in self.gaps if gap.what in ("backlash", "stops", "teeth"))

    @property
    def has_play(self) -> bool:
        """Whether it has clearances or backlash."""
        return bool(self.clearance_joints()) or any(gap.is_play or gap.what == "teeth" for gap in self.gaps)

    @property
    def firm_couplings(self) -> tuple[Coupling, ...]:
        """The couplings without backlash, whose followers are no states."""
        return tuple(coupling for coupling in self.couplings if coupling.backlash is None)

    def closures(self) -> tuple[AbstractJoint, ...]:
        """The loops without clearance: ideal constraints."""
        return tuple(loop for loop in self.loops if getattr(loop, "clearance", None) is None)

    # It depends on structure only, and tracing a solve asks for it some hundred times.
    @structural_property
    def is_plane(self) -> bool:
        """Whether its structure keeps everything in the plane z = 0."""
        places = [part.center_of_mass for part in self.bodies] + [point.at for point in self.points]
        places += [at for joint in self.all_joints() for at in (joint.at_parent, joint.at_child)]
        places += [at for spring in self.springs for at in (spring.at_a, spring.at_b)]
        return (
            all(place.z is None for place in (*places, self.gravity))
            and all(point.orientation is None or point.orientation.is_plane for point in self.points)
            and not any(isinstance(body.inertia, Inertia) for body in self.bodies)
            and all(wrench.is_plane for wrench in self.wrenches)
            and all(joint.is_plane for joint in self.all_joints())
        )

    @property
    def may_repeat(self) -> bool:
        """Whether conditions of its closures may follow from others, as in loops in space."""
        return bool(self.closures()) and not self.is_plane

    @property
    def has_payloads(self) -> bool:
        """Whether a body is picked up or put down."""
        return not all(body.is_always_there for body in self.bodies)

    @property
    def has_manifold(self) -> bool:
        """Whether states lie on a manifold to which steps are projected: closed loops, unit quaternions."""
        return bool(self.closures()) or any(coordinate.is_ball for coordinate in self.free_coordinates())

    def beyond(self, body: str) -> set[str]:
        """A body and every body that hangs on it."""
        carried = {body}
        for joint in self.joints:
            if joint.parent in carried:
                carried.add(joint.child)
        return carried

    def joint(self, name: str) -> AbstractJoint:
        """The joint of that name. **Raises** `ClearanceError` for an unknown one."""
        for joint in self.all_joints():
            if joint.name == name:
                return joint
        raise unknown_name(f"There is no joint `{name}`.", name, [j.name for j in self.all_joints()])

    def all_joints(self) -> tuple[AbstractJoint, ...]:
        """Joints of the tree, then loops."""
        return (*self.joints, *self.loops)

    @property
    def columns(self) -> dict[str, Columns]:
        """The free coordinates of the tree's joints, by joint."""
        return columns_of(self.joints, self.is_plane)

    @property
    def form(self) -> EquationForm:
        """The form of its equations of motion."""
        free = sum(len(coordinate.velocities) for coordinate in self.moved_coordinates())
        conditions = sum(loop.joint_constraint().count for loop in self.closures())
        every = len(list(self.coordinates()))
        columns = self.columns.values()
        loose = sum(each.count for each in columns if each.is_loose)
        played, by_blocks = bool(self.contacts()), is_less_by_blocks(columns, self.is_plane)
        return EquationForm(free, conditions, every, played, self.is_plane, loose, by_blocks)

    def ideal(self: Kind) -> Kind:
        """The same mechanism without clearances, backlash, stops and misalignments."""
        return self.hold_pins({})._with_joints(without_misalignment)

    def intended(self: Kind, play: Mapping[str, Sequence[Term]] = MappingProxyType({})) -> Kind:
        """The mechanism as it is meant to move, to which errors refer: the ideal one, with drives that do not give way.

        **Arguments:** `play`: by joint, values of its play coordinates [m or rad] at which its pin is held; by gap of a
        drive or a coupling the place in it (default: in the middle).
        """
        firm = self.hold_pins(play)._with_joints(without_misalignment)
        at = {name: places[0] for name, places in play.items()}
        if any(gives_way(c.motion) for c in firm.moved_coordinates()):
            firm = firm._with_joints(lambda joint: rigid(joint, at, self.friction_in_motions))
        meshes = [c for c in self.couplings if c.backlash is not None and c.name in at]
        if not meshes:
            return firm
        shifted = {c.name: dataclasses.replace(c, offset=c.offset + at[c.name]) for c in without_backlash(meshes)}
        return dataclasses.replace(firm, couplings=tuple(shifted.get(c.name, c) for c in firm.couplings))

    def hold_pins(self: Kind, play: Mapping[str, Sequence[Term]]) -> Kind:
        """The ideal mechanism with pins held at values of their `play` by joint [m or rad] (default: in the middle)."""
        fixed = self._with_joints(lambda joint: without_gaps(without_play(joint, play.get(joint.name))))
        return fixed._without_gaps() if self.gaps else fixed

    def _without_gaps(self: Kind) -> Kind:
        """The same mechanism, whose joints have no gaps any more, with couplings without backlash."""
        return dataclasses.replace(self, couplings=without_backlash(self.couplings))

    def _with_joints(self: Kind, change: Callable[[AbstractJoint], AbstractJoint]) -> Kind:
        """The same mechanism with every joint changed."""
        joints, loops = (tuple(change(joint) for joint in group) for group in (self.joints, self.loops))
        return dataclasses.replace(self, joints=joints, loops=loops)


def drive_breaks(mechanism: AbstractMechanism) -> Array:
    """Times [s] at which a drive, an actuator, a controller's target or a load breaks, or a payload comes or goes, in
    the mechanism and in the models of its controllers.
    """
    motions = [coordinate.motion for coordinate in mechanism.coordinates()]
    laws: list[Any] = [motion.drive for motion in motions if motion.drive is not None]
    laws += [actuator for motion in motions for actuator in motion.actuators]
    laws += [reference.target for controller in mechanism.controllers for reference in controller.references]
    handed = [time for body in mechanism.bodies for time in (body.picked_up, body.put_down) if time is not None]
    handed = [jnp.asarray(time, float)[None] for time in handed]
    in_models = [drive_breaks(c.model) for c in mechanism.controllers if c.model is not None]
    breaks = [law.breaks() for law in (*laws, *mechanism.wrenches)]
    return jnp.concatenate([jnp.zeros(0), *breaks, *handed, *in_models])


def sampling_periods(mechanism: AbstractMechanism) -> tuple[float, ...]:
    """The sampling periods [s]."""
    periods = [actuator.sampling_period() for c in mechanism.moved_coordinates() for actuator in c.motion.actuators]
    periods += [controller.period for controller in mechanism.controllers]
    return tuple(sorted({period for period in periods if period is not None}))


def breaks_near(mechanism: AbstractMechanism, time: Scalar) -> Array:
    """`drive_breaks`, and the sampling instants near a time."""
    sampled = [instants(period, time) for period in sampling_periods(mechanism)]
    return jnp.concatenate([drive_breaks(mechanism), *sampled])
