"""The mechanism: bodies, the tree of joints, loops, springs, points, gravity."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any, Unpack

import equinox as eqx

from clearance_jax.joints import AbstractClearance
from clearance_jax.joints.presets import PlayNumbers
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import Body, Point, Spring, Wrench
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.couplings import Coupling, leaders_of, without_backlash
from clearance_jax.mechanism.followers import mark_followers, with_followed_drives
from clearance_jax.mechanism.gaps import gaps_of
from clearance_jax.mechanism.placement import Gravity
from clearance_jax.mechanism.prepared import PreparedMechanism
from clearance_jax.mechanism.structure import check_encoders, check_model, check_structure
from clearance_jax.mechanism.tree.tree import AbstractJoint
from clearance_jax.mechanism.variants import check_drives, check_freed, with_drives, with_play, without_actuators

NO_GRAVITY = Gravity()


class Mechanism(AbstractMechanism):
    """A mechanism, in the plane or in space.

    Names, topology and the choice of laws are fixed in the compiled program. Every number is an array leaf: you can
    change it without a new compilation, and differentiate by it.

    **Arguments:**

    - `bodies`: every body but the ground.
    - `joints`: the tree. Each joint places a body that no earlier joint has placed, parents first.
    - `loops`: joints between bodies that the tree has placed already. An ideal one is a constraint. One with clearance
      only exerts the forces of its contacts.
    - `springs`, `points`, `wrenches` (external loads), `controllers`, `couplings` (gears and the like): further parts,
      as their classes say.
    - `gravity`: acceleration of free fall [m/s^2].
    - `name`: what reports call the mechanism.
    - `notes`: what is to be known of it, for instance what in its file was not read; in sentences.
    - `assemble`: whether a solve first closes the loops. If not, it starts from exactly the given initial values.

    **Raises:** `ClearanceError` if two names are the same, if a name refers to nothing, and for a loop joint with
    clearance in space that has neither play nor motion in some direction.
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
    notes: tuple[str, ...] = eqx.field(static=True, default=())
    couplings: tuple[Coupling, ...] = ()

    def __post_init__(self):
        self.joints = mark_followers(self)

    def __check_init__(self):
        check_structure(self)

    def _without_gaps(self):
        firm = without_backlash(self.couplings)
        return dataclasses.replace(self, joints=mark_followers(self, firm), couplings=firm)

    @property
    def gaps(self):
        return gaps_of(self.joints, self.couplings)

    # Variants ------------------------------------------------------------------------------------------------------

    def with_clearance(
        self, name: str, clearance: AbstractClearance | None = None, **numbers: Unpack[PlayNumbers]
    ) -> "Mechanism":
        """The same mechanism with play in the joint `name`.

        **Arguments:** either the whole `clearance`, or numbers of a design. An ideal joint then gets the usual laws of
        a steel pin, ball or block in bronze:

        - A revolute joint takes `radial_clearance` [m] (or a `fit` such as "H7/g6", and the `temperature` [K] at which
          it runs), `pin_radius` and `length` [m]. Of the `kind` "sleeve" it also takes `axial_clearance` [m] (see
          `joints.pin_clearance`).
        - A cylindrical joint takes the same as a sleeve, without `axial_clearance` (see `joints.shaft`).
        - A spherical joint takes `radial_clearance` and `ball_radius` [m] (see `joints.socket`).
        - A prismatic joint takes `side_clearance`, `length`, `height`, `width` and `guide_length` [m] (see
          `joints.guide_clearance`).
        - A joint takes a clearance of your own, too: its class is the `kind`, and the numbers are its `sizes`.

        For a joint that already has clearance, give those of its numbers that you want to change.

        **Raises:** `ClearanceError` for a kind of joint that has no play, for numbers that are missing, and for numbers
        that do not make a joint.
        """
        return self.with_joint(with_play(self.joint(name), clearance, dict(numbers)))

    def with_drives(self, drives: Mapping[str, Any]) -> "Mechanism":
        """The same mechanism with other drives (such as `cj.drives.Trapezoid`) of the named coordinates.

        A coordinate that was free is then no state any more, and loses its actuators, as does one that follows it by a
        coupling. Its limits are kept, and its stops for a drive that is made to give way.

        **Arguments:** `drives`: drives by the name of a coordinate of the tree. If a joint has one coordinate only,
        this is the name of the joint.

        **Raises:** `ClearanceError` for an unknown coordinate, for a coordinate of play, for a joint that closes a
        loop, and for one whose drive gives way: drive its motor.
        """
        check_drives(self.joints, drives)
        driven = {c.name for c in self.coordinates() if c.motion.drive is not None} | drives.keys()
        couplings = self.firm_couplings
        led = {c.follower for c in couplings if leaders_of(c.follower, couplings) <= driven}
        return self._with_joints(lambda joint: with_drives(without_actuators(joint, led), drives))

    def with_controllers(self, *controllers: AbstractController) -> "Mechanism":
        """The same mechanism under other controllers. Its actuators stay, and act too.

        **Raises:** `ClearanceError` for an unknown coordinate, and for one that a drive prescribes.
        """
        return dataclasses.replace(self, controllers=controllers)

    def with_joint(self, joint: AbstractJoint) -> "Mechanism":
        """The same mechanism with another joint in place of the joint that has the same name."""
        return self._with_joints(lambda old: joint if old.name == joint.name else old)

    def without_drives(self, names: Collection[str]) -> "Mechanism":
        """The same mechanism with the named coordinates free: without their drives and actuators.

        **Raises:** `ClearanceError` for an unknown coordinate, for one whose drive gives way (free its motor), and for
        one that follows another (free that one).
        """
        check_freed(self.all_joints(), names, {coupling.follower for coupling in self.firm_couplings})
        return self._with_joints(lambda joint: with_drives(joint, dict.fromkeys(names)))

    def prepare(self) -> PreparedMechanism:
        """The mechanism as a solve uses it: a `PreparedMechanism`, with everything that depends on its numbers only."""
        check_encoders(tuple(self.coordinates()))
        ready = PreparedMechanism(
            self.bodies,
            tuple(joint.prepare() for joint in with_followed_drives(self)),
            tuple(loop.prepare() for loop in self.loops),
            self.springs,
            self.points,
            self.gravity,
            self.assemble,
            tuple(wrench.prepare() for wrench in self.wrenches),
            tuple(c.prepare(self._model_of(c).prepare().without_sampling()) for c in self.controllers),
            self.couplings,
            gaps=tuple(gap.prepare() for gap in self.gaps),
        )
        return ready.as_table() if self.form.is_table else ready

    def _model_of(self, controller: AbstractController) -> "Mechanism":
        """The model of a controller, which itself has no controllers."""
        model = self.ideal() if controller.model is None else controller.model.ideal()
        return dataclasses.replace(check_model(controller, model), controllers=())
