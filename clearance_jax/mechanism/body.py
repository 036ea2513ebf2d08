"""Rigid bodies, points on them, springs between them, loads on them, and the motion of joint coordinates."""

import dataclasses
from typing import Literal, NamedTuple, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Rows, Scalar
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.joints.gap import Gap
from clearance_jax.laws import AbstractNormalLaw
from clearance_jax.mechanism.actuators import AbstractActuator
from clearance_jax.mechanism.motion.motion_laws import AbstractMotionLaw, Values
from clearance_jax.mechanism.placement import ORIGIN, Components, Inertia, Orientation, Position, as_inertia
from clearance_jax.parameters import Demand, Parametrised, describe, flatten, lead, physical
from clearance_jax.spatial import Term, Vector, scale

GROUND = "ground"


class Body(Module):
    """A rigid body.

    **Arguments:**

    - `name`: its name, which other parts refer to.
    - `mass` [kg]; `None`: a massless link.
    - `inertia` [kg m^2] about the centre of mass: one number for a body that turns about z only; for a body that turns
      in space an `Inertia`, or three or six numbers (xx, yy, zz, xy, xz, yz) in the body's axes; `None`: a point mass.
    - `center_of_mass` [m]: in the body's frame.
    - `picked_up`, `put_down` [s]: of a payload, which is on a fixed joint. It has mass from the one time to the other.
      It always has the velocity of the body that carries it, so the velocity does not jump when the mass appears.
    """

    name: str = eqx.field(static=True)
    mass: Scalar | None = physical("kg", "mass", '"0.14 kg"', "a massless link", above=0.0, default=None)
    inertia: Scalar | Inertia | None = physical(
        "kg*m^2",
        "moment of inertia about the centre of mass",
        '"2.5e-4 kg*m^2"',
        "a point mass",
        above=0.0,
        default=None,
        converter=as_inertia,
    )
    center_of_mass: Position = describe(
        "centre of mass in the body's frame", '["60 mm", "0 mm"]', "the frame's origin", default=ORIGIN
    )
    picked_up: Scalar | None = physical(
        "s", "when a payload, on a fixed joint, is picked up", '"0.5 s"', "it is there from the start", default=None
    )
    put_down: Scalar | None = physical("s", "when it is put down", '"1.5 s"', "it stays", default=None)

    @property
    def is_always_there(self) -> bool:
        """Whether it has its mass all the time."""
        return self.picked_up is None and self.put_down is None

    def presence(self, time: Scalar) -> Array:
        """1 while it has its mass, 0 before it is picked up and after it is put down."""
        there = jnp.asarray(True)
        if self.picked_up is not None:
            there &= time >= self.picked_up
        if self.put_down is not None:
            there &= time < self.put_down
        return jnp.where(there, 1.0, 0.0)

    def at(self, time: Scalar) -> "Body":
        """The body with the mass that it has at a time."""
        if self.is_always_there:
            return self
        there = self.presence(time)
        mass, inertia = jax.tree.map(lambda number: there * number, (self.mass, self.inertia))
        return Body(self.name, mass, inertia, self.center_of_mass)


def needs_six(body: Body) -> ClearanceError:
    """The error of a body that turns out of the plane and has only one moment of inertia."""
    return ClearanceError(
        f"Body `{body.name}` may turn out of the plane, but its inertia is one number (about z): give three or six, "
        "`Inertia(xx, yy, zz, xy, xz, yz)`."
    )


class Point(Module):
    """A named point of a body, whose motion is reported. With an `orientation` (in the body's frame) it is a frame."""

    name: str = eqx.field(static=True)
    """The point's name."""
    body: str = describe("the body that it is a point of", '"slider"', static=True)
    """The name of the body that it is on."""
    at: Position = describe("its place in the body's frame", '["80 mm", "0 mm"]', "the frame's origin", default=ORIGIN)
    orientation: Orientation | None = describe(
        "roll, pitch and yaw of its frame in the body's", '["90 deg", "0 deg", "0 deg"]', "not turned", default=None
    )


class Spring(Module):
    """A spring and a damper between points of two bodies at the distance l: their tension is k (l - l0) + b l'."""

    name: str = eqx.field(static=True)
    """The spring's name."""
    body_a: str = describe("the body at its one end, or `ground`", '"ground"', static=True)
    body_b: str = describe("the body at its other end", '"slider"', static=True)
    stiffness: Scalar = physical("N/m", "stiffness k", '"4530 N/m"', least=0.0)
    damping: Scalar = physical("N*s/m", "damping b", '"2 N*s/m"', least=0.0, default=0.0)
    free_length: Scalar = physical("m", "length l0 at which it is relaxed", '"77.85 mm"', least=0.0, default=0.0)
    at_a: Position = describe("its end in the frame of `body_a`", '["14 mm", "72 mm"]', "the origin", default=ORIGIN)
    at_b: Position = describe("its end in the frame of `body_b`", '["20 mm", "-18 mm"]', "the origin", default=ORIGIN)


class Limits(NamedTuple):
    """Limits of a coordinate, as a data sheet says. `None`: there is no such limit.

    **Arguments:** `lower`, `upper`: least and greatest value [rad or m]; `velocity`: largest rate [rad/s or m/s];
    `effort`: largest torque [N m] or force [N].
    """

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None


class Stops(Parametrised):
    """The stops of a free coordinate, which its link meets at the ends of its range: contacts by the law of a `flank`.

    **Arguments:** `lower`, `upper` [rad or m]: where they are; `None`: there is none on this side; `flank`: their law,
    with efforts [N m] of angles, [N] of lengths.

    **Raises:** `ClearanceError` without any of the two.
    """

    lower: Scalar | None = physical("coordinate", "the lower stop", '"-170 deg"', "none", default=None)
    upper: Scalar | None = physical("coordinate", "the upper stop", '"170 deg"', "none", default=None)
    flank: AbstractNormalLaw = flatten(kw_only=True)

    def __check_init__(self):
        if self.lower is None and self.upper is None:
            raise ClearanceError("Stops need `lower`, `upper` or both.").about("upper")

    def demands(self):
        if self.lower is not None and self.upper is not None:
            yield Demand("upper", self.upper > self.lower, lambda: "must be greater than `lower`")

    @property
    def offset(self) -> Scalar:
        """The place that the gap is counted from: the middle, or the only stop [rad or m]."""
        if self.lower is None or self.upper is None:
            return self.upper if self.lower is None else self.lower  # pyright: ignore[reportReturnType]
        return 0.5 * (self.lower + self.upper)

    def gap(self) -> Gap:
        """The gap between them."""
        if self.lower is None or self.upper is None:
            return Gap(0.0, self.flank, "upper" if self.lower is None else "lower")
        return Gap(self.upper - self.lower, self.flank)


class Motion(Module):
    """How one coordinate of a joint moves: prescribed by a drive, or free, under any number of actuators.

    **Arguments:**

    - `drive`: prescribes the coordinate, which is then no state.
    - `position`, `velocity`: initial values of a free coordinate [rad, rad/s] or [m, m/s]. If a loop must be closed,
      they are first guesses.
    - `actuators`: forces along a free coordinate.
    - `limits`: what its drive can do, as a data sheet says. A motion is held within them by `stops` only.
    - `stops`: of a free coordinate: what it hits at the ends of its range.
    - `rotor_inertia` [kg m^2], or [kg] of a slide: that of the motor of a free coordinate, times the square of the gear
      ratio. It resists the motion of this coordinate only. Its weight, and its resistance when the whole motor is
      moved, are left out.
    """

    drive: AbstractMotionLaw | None = lead(default=None)
    position: Scalar = physical(
        "coordinate",
        "initial value of a free coordinate (a first guess where a loop must close)",
        '"30 deg"',
        default=0.0,
    )
    velocity: Scalar = physical(
        "coordinate/s",
        "initial rate of a free coordinate (a first guess where a loop must close)",
        '"10 rad/s"',
        default=0.0,
    )
    actuators: tuple[AbstractActuator, ...] = flatten("actuator", default=())
    limits: Limits | None = eqx.field(static=True, default=None)
    rotor_inertia: Scalar | None = physical(
        "effort*s^2/coordinate",
        "inertia of a free coordinate's motor, seen through its gears",
        '"1.5 kg*m^2"',
        "none",
        above=0.0,
        default=None,
    )
    stops: Stops | None = None

    def __check_init__(self):
        names = [actuator.name for actuator in self.actuators if actuator.name is not None]
        if len({*names}) < len(names):
            raise ClearanceError(f"Actuators of one coordinate must have names of their own, but these have: {names}.")

    @property
    def is_free(self) -> bool:
        """Whether the coordinate is a state."""
        return self.drive is None

    def prepare(self) -> "Motion":
        """The motion with what depends only on its numbers computed (once a solve)."""
        drive = None if self.drive is None else self.drive.prepare()
        return dataclasses.replace(self, drive=drive, actuators=tuple(a.prepare() for a in self.actuators))

    def initial(self) -> tuple[Rows, Rows]:
        """Position and velocity at the start, of a free coordinate."""
        return (self.position,), (self.velocity,)


class Motor(Motion):
    """The motion of an elastic drive's motor, a coordinate of its joint beside its own (see `with_compliance`)."""

    name: str = eqx.field(static=True, kw_only=True)
    """The coordinate's name."""


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
            text = f"The axes of load `{self.name}` must be `world` or `body`, but they are {quote(self.axes)}."
            raise ClearanceError(text)
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
