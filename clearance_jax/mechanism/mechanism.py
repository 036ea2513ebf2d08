"""The mechanism: bodies, the tree of joints, loops, springs, points, gravity."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any, Unpack

import equinox as eqx

from clearance_jax.joints import AbstractClearance
from clearance_jax.joints.presets import PlayNumbers
from clearance_jax.mechanism._base import AbstractMechanism
from clearance_jax.mechanism.body import Body, Point, Spring
from clearance_jax.mechanism.controllers import AbstractController
from clearance_jax.mechanism.driving import check_drives, with_drives, without_drives
from clearance_jax.mechanism.loads import Wrench
from clearance_jax.mechanism.placement import Gravity
from clearance_jax.mechanism.play import with_play
from clearance_jax.mechanism.prepared import PreparedMechanism
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
from clearance_jax.mechanism.tree import AbstractJoint

NO_GRAVITY = Gravity()


class Mechanism(AbstractMechanism):
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

    # Variants ------------------------------------------------------------------------------------------------------

    def with_clearance(
        self, name: str, clearance: AbstractClearance | None = None, **numbers: Unpack[PlayNumbers]
    ) -> "Mechanism":
        """The same mechanism with play in the joint `name`.

        **Arguments:** the whole `clearance`; or of an ideal joint a designer's numbers [m, K], with laws as usual (of
        a steel pin, ball or block in bronze):

        - of a revolute joint `radial_clearance` (or a `fit` such as "H7/g6", and the `temperature` at which it runs),
          `pin_radius`, `length`, and of the `kind` "sleeve" `axial_clearance` (see `joints.pin_clearance`); of a
          cylindrical one a sleeve's without `axial_clearance` (`joints.shaft`);
        - of a spherical one `radial_clearance` and `ball_radius` (`joints.socket`);
        - of a prismatic one `side_clearance`, `length`, `height`, `width` and `guide_length`
          (`joints.guide_clearance`);

        or, of a joint that has clearance, those of its numbers that are to be others.

        **Raises:** `ClearanceError` for a joint of a kind that has no play, for what is missing, and for numbers that
        make no joint.
        """
        return self.with_joint(with_play(self.joint(name), clearance, dict(numbers)))

    def with_drives(self, drives: Mapping[str, Any]) -> "Mechanism":
        """The same mechanism with other drives (`cj.drives.Trapezoid`, `cj.read_trajectory`, ...) of named coordinates.

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

    def without_drives(self, names: Collection[str]) -> "Mechanism":
        """The same mechanism with the named coordinates free: without their drives and actuators."""
        return self._with_joints(lambda joint: without_drives(joint, names))

    def _with_joints(self, change) -> "Mechanism":
        joints, loops = (tuple(change(joint) for joint in group) for group in (self.joints, self.loops))
        return dataclasses.replace(self, joints=joints, loops=loops)

    def prepare(self) -> PreparedMechanism:
        """What a solve makes of it once: see `PreparedMechanism`."""
        ready = PreparedMechanism(
            self.bodies,
            tuple(joint.prepare() for joint in self.joints),
            tuple(loop.prepare() for loop in self.loops),
            self.springs,
            self.points,
            self.gravity,
            self.assemble,
            tuple(wrench.prepare() for wrench in self.wrenches),
            tuple(c.prepare(self._model_of(c).prepare().without_sampling()) for c in self.controllers),
        )
        return ready.as_table() if self.form.is_table else ready

    def _model_of(self, controller: AbstractController) -> "Mechanism":
        """What a controller goes by, which is itself controlled by nobody."""
        model = self.ideal() if controller.model is None else controller.model.ideal()
        return dataclasses.replace(check_model(controller, model), controllers=())
