"""Loads from outside: a force and a torque on a body, as a function of time."""

from typing import Literal, get_args

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.mechanism.body import GROUND
from clearance_jax.mechanism.motion_laws import AbstractMotionLaw, Values
from clearance_jax.mechanism.placement import ORIGIN, Components, Position
from clearance_jax.parameters import Parametrised, describe, physical
from clearance_jax.spatial import Term, Vector, scale

Axes = Literal["world", "body"]


class Force(Components):
    """A force by its components [N]. One that you leave out is zero, and absent from the compiled program."""

    x: Scalar | None = physical("N", default=None)
    y: Scalar | None = physical("N", default=None)
    z: Scalar | None = physical("N", default=None)


class Torque(Components):
    """A torque by its components [N m]. One that you leave out is zero, and absent from the compiled program."""

    x: Scalar | None = physical("N*m", default=None)
    y: Scalar | None = physical("N*m", default=None)
    z: Scalar | None = physical("N*m", default=None)


class Wrench(Parametrised):
    """A load from outside the mechanism: a force on a point of a body, and a torque on the body. The energy balance
    counts its work as that of the drives.

    **Arguments:**

    - `name`: the load's name; `body`: the body that it acts on; `at` [m]: the point, in the body's frame.
    - `force` [N], `torque` [N m].
    - `course`: a factor on both as a function of time, given as a drive without unit. With
      `cj.drives.StepSum([0.1], [0.2], [1.0])` the load is zero at first, and complete after 0.2 s. `None`: the load is
      constant.
    - `axes`: in which axes force and torque are: "world", or "body" (a thrust, which turns with its body).
    """

    name: str = eqx.field(static=True)
    body: str = describe("the body that it acts on", '"slider"', static=True)
    at: Position = describe(
        "the point that it acts on, in the body's frame", '["80 mm", "0 mm"]', "the origin", default=ORIGIN
    )
    force: Force = describe("the force", '["-100 N", "0 N"]', "none", default=Force())
    torque: Torque = describe("the torque", '["0 N*m", "0 N*m", "2 N*m"]', "none", default=Torque())
    course: AbstractMotionLaw | None = None
    axes: Axes = describe("whose axes force and torque are in", '"body"', static=True, default="world")

    def __check_init__(self):
        if self.axes not in get_args(Axes):
            raise ClearanceError(
                f"The axes of load `{self.name}` must be `world` or `body`, but they are {quote(self.axes)}."
            )
        if self.body == GROUND:
            raise ClearanceError(f"Load `{self.name}` acts on the ground, which nothing moves: name another body.")

    def units(self):
        return {"coordinate": ""}

    @property
    def is_plane(self) -> bool:
        """Whether it keeps its body in the plane z = 0, by its structure."""
        return self.at.z is None and self.force.z is None and self.torque.x is None and self.torque.y is None

    def prepare(self) -> "Wrench":
        """The wrench with what depends only on its numbers computed (once a solve)."""
        course = None if self.course is None else self.course.prepare()
        return Wrench(self.name, self.body, self.at, self.force, self.torque, course, self.axes)

    def now(self, time: Scalar) -> tuple[Vector, Vector]:
        """Force and torque at a time, in its own axes."""
        if self.course is None:
            return self.force.vector, self.torque.vector
        factor: Term = self.course(time)[0]
        return scale(factor, self.force.vector), scale(factor, self.torque.vector)

    def breaks(self) -> Values:
        """Times at which its course breaks."""
        return jnp.zeros(0) if self.course is None else self.course.breaks()
