"""The mechanism: bodies, the tree of joints, loops, springs, points, gravity."""

import dataclasses
import functools
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Unpack

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.errors import ClearanceError, suggest
from clearance_jax.joints import AbstractClearance, PlayNumbers, PreparedClearance, posed
from clearance_jax.mechanism.body import Body, Point, Spring
from clearance_jax.mechanism.controllers import AbstractController, Reference
from clearance_jax.mechanism.driving import acting_always, check_drives, released, with_drives
from clearance_jax.mechanism.form import Form
from clearance_jax.mechanism.links import ONCE, Links, links_of
from clearance_jax.mechanism.loads import Wrench
from clearance_jax.mechanism.placement import Gravity, Inertia, Position, as_prepared
from clearance_jax.mechanism.play import played
from clearance_jax.mechanism.sampling import instants
from clearance_jax.mechanism.structure import (
    check_attached,
    check_control,
    check_loose,
    check_model,
    check_names,
    check_payloads,
    check_tilting,
    check_tree,
)
from clearance_jax.mechanism.tree import SLIDING, TURNING, AbstractJoint, AbstractPlayed, Coordinate
from clearance_jax.parameters import Parametrised
from clearance_jax.spatial import IDENTITY, UNIT, Term, add, is_zero, product, transpose

NO_GRAVITY = Gravity()


class ClearanceJoint(NamedTuple):
    """A joint whose clearance is there; `in_tree`: whether play is coordinates of it (else it closes a loop)."""

    joint: AbstractPlayed
    clearance: Any
    in_tree: bool

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

    @property
    def laws(self) -> tuple[Any, ...]:
        """Its contact laws, as the user gave them."""
        joint = self.clearance.joint if isinstance(self.clearance, PreparedClearance) else self.clearance
        return (joint.normal,) if joint.friction is None else (joint.normal, joint.friction)

    @property
    def size(self) -> Array:
        """Its largest clearance [m]."""
        return jnp.max(jnp.stack([play.scale for play in self.joint.play() if play.slides is not None]))


class Mechanism(Parametrised):
    """A mechanism, in the plane or in space. Names, topology and law choices are static; every number is an array leaf.

    **Arguments:**

    - `bodies`: every body but the ground.
    - `joints`: the tree: each joint places a body that no earlier joint has placed, parents first.
    - `loops`: joints between bodies that the tree has placed already: ideal constraints; with clearance force elements,
      which hold nothing but what their contacts hold.
    - `springs`, `points`, `gravity`, `wrenches` (loads from outside), `controllers`: as they say.
    - `assemble`: whether a solve starts by closing the loops (off: from exactly the given initial values).

    **Raises:** `ClearanceError` where names clash or dangle, and for a loop in space with clearance that leaves a
    direction neither play nor motion.
    """

    bodies: tuple[Body, ...]
    joints: tuple[AbstractJoint, ...]
    loops: tuple[AbstractJoint, ...] = ()
    springs: tuple[Spring, ...] = ()
    points: tuple[Point, ...] = ()
    gravity: Gravity = NO_GRAVITY
    name: str = eqx.field(static=True, default="mechanism")
    assemble: bool = eqx.field(static=True, default=True)
    wrenches: tuple[Wrench, ...] = ()
    controllers: tuple[AbstractController, ...] = ()
    chosen: Array | None = None
    """Of a mechanism that is being solved, which conditions of its closures a step asks for (`constraint.choice`)."""
    links: Links | None = None
    """Of a prepared mechanism that is large, its table."""

    def __check_init__(self):
        parts = (*self.bodies, *self.joints, *self.loops, *self.springs, *self.points, *self.wrenches)
        check_names((*parts, *self.controllers))
        check_tree(self.bodies, self.joints, self.loops)
        check_attached(self.bodies, self.springs, (*self.points, *self.wrenches))
        check_payloads(self.bodies, self.joints)
        check_control(self.controllers, tuple(self.coordinates()))
        if not self.is_plane:
            check_tilting(self.bodies, self.joints)
            check_loose(self.loops)

    def units_within(self, member):
        if not isinstance(member, Reference):
            return {}
        return next(TURNING if c.slides is None else SLIDING for c in self.coordinates() if c.name == member.name)

    # Structure -----------------------------------------------------------------------------------------------------

    def coordinates(self) -> Iterator[Coordinate]:
        """Every elementary coordinate of the tree, in order, with axes of its joint's own."""
        for joint in self.joints:
            yield from joint.own_coordinates()

    def free_coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates that are states."""
        return tuple(c for c in self.coordinates() if c.motion.is_free)

    def clearance_joints(self) -> tuple[ClearanceJoint, ...]:
        """Every joint with clearance, those of the tree first."""
        return tuple(
            ClearanceJoint(joint, joint.clearance, group is self.joints)
            for group in (self.joints, self.loops)
            for joint in group
            if isinstance(joint, AbstractPlayed) and joint.clearance is not None
        )

    def closures(self) -> tuple[AbstractJoint, ...]:
        """The loops without clearance: ideal constraints."""
        return tuple(loop for loop in self.loops if getattr(loop, "clearance", None) is None)

    # By structure alone, and asked some hundred times while a solve is traced.
    @functools.cached_property
    def is_plane(self) -> bool:
        """Whether nothing in it leaves the plane z = 0, by its structure."""
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
        """Whether conditions of its closures may follow from others, as those of loops in space do."""
        return bool(self.closures()) and not self.is_plane

    @property
    def has_payloads(self) -> bool:
        """Whether a body comes or goes."""
        return not all(body.is_always_there for body in self.bodies)

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

    def held(self, play: Mapping[str, Sequence[Term]]) -> "Mechanism":
        """The ideal mechanism whose pins are held in their sleeves, by the name of each joint at given values of its
        play coordinates [m or rad] (one that is not named: in the middle).
        """
        return self._with_joints(lambda joint: _without_clearance(joint, play.get(joint.name)))

    def with_clearance(
        self, name: str, clearance: AbstractClearance | None = None, **numbers: Unpack[PlayNumbers]
    ) -> "Mechanism":
        """The same mechanism with play in the joint `name`.

        **Arguments:** the whole `clearance`; or of an ideal joint a designer's numbers [m, K], with laws as usual (of
        a steel pin, ball or block in bronze):

        - of a revolute joint `radial_clearance` (or a `fit` such as "H7/g6", and the `temperature` at which it runs),
          `pin_radius`, `length`, and of the `kind` "sleeve" `axial_clearance` (see `joints.fitted`); of a cylindrical
          one a sleeve's without `axial_clearance` (`joints.shaft`);
        - of a spherical one `radial_clearance` and `ball_radius` (`joints.socket`);
        - of a prismatic one `side_clearance`, `length`, `height`, `width` and `guide_length` (`joints.guided`);

        or, of a joint that has clearance, those of its numbers that are to be others.

        **Raises:** `ClearanceError` for a joint of a kind that has no play, for what is missing, and for numbers that
        make no joint.
        """
        return self.with_joint(played(self.joint(name), clearance, dict(numbers)))

    def driven(self, drives: Mapping[str, Any]) -> "Mechanism":
        """The same mechanism with other drives (`cj.Trapezoid`, `cj.read_trajectory`, ...) of the named coordinates.

        A coordinate that was free is no state any more, and loses its actuators; limits are kept.

        **Arguments:** `drives`: motion laws by the name of a coordinate of the tree (its joint's, if it has but one).

        **Raises:** `ClearanceError` for an unknown coordinate, for play, and for a joint that closes a loop.
        """
        check_drives(self.joints, drives)
        return self._with_joints(lambda joint: with_drives(joint, drives))

    def with_controllers(self, *controllers: AbstractController) -> "Mechanism":
        """The same mechanism under other controllers. (Its actuators stay, and act beside them.)

        **Raises:** `ClearanceError` for a coordinate that there is not, or that a drive prescribes.
        """
        return dataclasses.replace(self, controllers=controllers)

    def with_joint(self, joint: AbstractJoint) -> "Mechanism":
        """The same mechanism with another joint in the place of the one of that name."""
        return self._with_joints(lambda own: joint if own.name == joint.name else own)

    def released(self, names: Collection[str]) -> "Mechanism":
        """The same mechanism with the named coordinates free: without their drives and actuators."""
        return self._with_joints(lambda joint: released(joint, names))

    def _with_joints(self, change) -> "Mechanism":
        joints, loops = (tuple(change(joint) for joint in group) for group in (self.joints, self.loops))
        return dataclasses.replace(self, joints=joints, loops=loops, chosen=None, links=None)

    def unsampled(self) -> "Mechanism":
        """The same mechanism with everything digital acting all the time."""
        if not sampling_periods(self):
            return self
        controllers = tuple(dataclasses.replace(controller, period=None) for controller in self.controllers)
        return dataclasses.replace(self._with_joints(acting_always), controllers=controllers)

    def at(self, time: Scalar) -> "Mechanism":
        """The mechanism with the payloads that it has at a time."""
        if not self.has_payloads:
            return self
        links = self.links
        if links is not None:
            there = jnp.stack([body.presence(time) for body in self.bodies])
            links = dataclasses.replace(links, mass=there * links.mass, inertia=there[:, None, None] * links.inertia)
        return dataclasses.replace(self, bodies=tuple(body.at(time) for body in self.bodies), links=links)

    def prepared(self) -> "Mechanism":
        """The mechanism with everything that depends only on its numbers computed (once a solve, not once a step): its
        drives, actuators, controllers and clearances are then of the types that a step evaluates.
        """
        ready = self._with_joints(lambda joint: joint.prepared())
        wrenches = tuple(wrench.prepared() for wrench in self.wrenches)
        controllers = tuple(c.prepared(self._believed(c).prepared()) for c in self.controllers)
        ready = dataclasses.replace(ready, wrenches=wrenches, controllers=controllers)
        return dataclasses.replace(ready, links=links_of(ready.bodies, ready.joints)) if ready.is_tabled else ready

    def as_small_program(self) -> "Mechanism":
        """The same prepared mechanism for what is computed once: in space, unless small, a table compiles sooner."""
        # A body that stays in its plane may have one moment of inertia: a table asks for six.
        whole = all(body.inertia is None or isinstance(body.inertia, Inertia) for body in self.bodies)
        if self.is_plane or not whole or len(list(self.coordinates())) <= ONCE:
            return self
        return dataclasses.replace(self, links=self.links or links_of(self.bodies, self.joints))

    def _believed(self, controller: AbstractController) -> "Mechanism":
        """What a controller goes by, which is itself controlled by nobody."""
        model = self.ideal() if controller.model is None else controller.model.ideal()
        return dataclasses.replace(check_model(controller, model), controllers=()).unsampled()

    @property
    def form(self) -> Form:
        """Which form its equations of motion have, and why."""
        free = sum(len(coordinate.velocities) for coordinate in self.free_coordinates())
        conditions = sum(loop.hold().count for loop in self.closures())
        return Form(free, conditions, len(list(self.coordinates())), bool(self.clearance_joints()), self.is_plane)

    @property
    def is_tabled(self) -> bool:
        """Whether it is so large that its dynamics is a loop over a table of its links."""
        return self.links is not None or self.form.is_table


def _without_clearance(joint: AbstractJoint, values: Sequence[Term] | None) -> AbstractJoint:
    if not isinstance(joint, AbstractPlayed) or joint.clearance is None:
        return joint
    ideal = eqx.tree_at(lambda j: j.clearance, joint, None)
    if values is None:
        return ideal
    pose = posed(joint.play(), values)
    # The sleeve's axes are the parent's, turned by the joint's own angle.
    turned = joint.turned if joint.sleeve is UNIT else joint.turned.followed(joint.sleeve)
    x, y, z = add(joint.at_parent.vector, turned.apply(pose.place))
    changed: dict[str, Any] = {"at_parent": Position(x, y, joint.at_parent.z if is_zero(z) else z)}
    if pose.rotation.rows is not UNIT:
        tilt = product(joint.sleeve, product(pose.rotation.rows, transpose(joint.sleeve)))
        if joint.own_coordinates()[0].play is None:  # it slides before it has play
            own = IDENTITY if joint.child_orientation is None else joint.child_orientation.rotation
            changed["child_orientation"] = as_prepared(product(own.rows, transpose(tilt)))
        else:
            changed |= {"angle": None, "orientation": as_prepared(product(joint.turned.rows, tilt))}
    return dataclasses.replace(ideal, **changed)


def drive_breaks(mechanism: Mechanism) -> Array:
    """Times at which a drive, an actuator, a controller's reference or a load breaks, or a payload comes or goes; in
    what a controller believes too.
    """
    motions = [coordinate.motion for coordinate in mechanism.coordinates()]
    laws: list[Any] = [motion.drive for motion in motions if motion.drive is not None]
    laws += [actuator for motion in motions for actuator in motion.actuators]
    laws += [reference.target for controller in mechanism.controllers for reference in controller.references]
    handed = [time for body in mechanism.bodies for time in (body.picked_up, body.put_down) if time is not None]
    handed = [jnp.asarray(time, float)[None] for time in handed]
    believed = [drive_breaks(c.model) for c in mechanism.controllers if c.model is not None]
    breaks = [law.breaks() for law in (*laws, *mechanism.wrenches)]
    return jnp.concatenate([jnp.zeros(0), *breaks, *handed, *believed])


def sampling_periods(mechanism: Mechanism) -> tuple[float, ...]:
    """The periods at which something is sampled [s]."""
    periods = [actuator.sampled_every() for c in mechanism.free_coordinates() for actuator in c.motion.actuators]
    periods += [controller.period for controller in mechanism.controllers]
    return tuple(sorted({period for period in periods if period is not None}))


def breaks_near(mechanism: Mechanism, time: Scalar) -> Array:
    """`drive_breaks`, and what comes periodically as far as it lies about a time."""
    sampled = [instants(period, time) for period in sampling_periods(mechanism)]
    return jnp.concatenate([drive_breaks(mechanism), *sampled])
