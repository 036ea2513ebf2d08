"""Joints of several coordinates: a ball, and compositions of slides, turns and balls."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Rows, Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import AbstractClearance, PreparedClearance
from clearance_jax.mechanism.body import Motion
from clearance_jax.mechanism.placement import ORIGIN, Axis, Orientation, Position, PreparedOrientation, present
from clearance_jax.mechanism.tree.coordinate import (
    Coordinate,
    JointConstraint,
    axis_key,
    child_axes_key,
    orientation_key,
)
from clearance_jax.mechanism.tree.tree import AbstractJoint, AbstractPlayed, alignment, along
from clearance_jax.parameters import Parametrised, describe, flatten, physical
from clearance_jax.spatial import UNIT, Vector, X, Y, Z, quaternion_of
from clearance_jax.units import SLIDING, TURNING


class Slide(Motion, Parametrised):
    """The motion of a sliding coordinate of a joint that has several."""

    def units(self):
        return SLIDING


class Turn(Motion, Parametrised):
    """The motion of a turning coordinate of a joint that has several."""

    def units(self):
        return TURNING


def _as(cls: type):
    def convert(motion):
        if isinstance(motion, cls) or not isinstance(motion, Motion):
            return motion
        return cls(*(getattr(motion, field.name) for field in dataclasses.fields(motion)))

    return convert


def motion_key(kind: type, help: str):
    """A field that is the motion of a slide or of a turn, by its `kind`."""
    example = '{ position = "10 mm" }' if kind is Slide else '{ velocity = "10 rad/s" }'
    about = {"help": help, "example": example, "absent": "free, from zero"}
    return eqx.field(metadata=about, converter=_as(kind), default_factory=kind)


class Spin(Module):
    """Rates of turning about the axes of the child [rad/s]."""

    x: Scalar = physical("rad/s", default=0.0)
    y: Scalar = physical("rad/s", default=0.0)
    z: Scalar = physical("rad/s", default=0.0)


class Ball(Module):
    """The motion of a ball, which is always free. Its positions are a quaternion (w, x, y, z), its velocities the spin
    about the axes of the joint's frame on the child.

    **Arguments:** `start`: initial orientation of the child's joint frame in the parent's; `spin`: initial spin;
    `damping` [N m s/rad]: of the spin. The energy balance counts what it takes as a damping loss.
    """

    start: Orientation = describe(
        "initial roll, pitch and yaw of the child in the joint's frame",
        '["0 deg", "10 deg", "0 deg"]',
        "not turned",
        default=Orientation(),
    )
    spin: Spin = describe(
        "initial spin about the axes of the joint's frame on the child (`child_orientation` turns it)",
        '["0 rad/s", "0 rad/s", "100 rad/s"]',
        "at rest",
        default_factory=Spin,
    )
    damping: Scalar | None = physical(
        "N*m*s/rad", "damping of its spin", '"0.1 N*m*s/rad"', "none", least=0.0, default=None
    )
    drive: ClassVar[None] = None
    rotor_inertia: ClassVar[None] = None
    actuators: ClassVar[tuple] = ()
    limits: ClassVar[None] = None
    is_free: ClassVar[bool] = True

    def initial(self) -> tuple[Rows, Rows]:
        """Quaternion and spin at the start."""
        start = self.start
        quaternion = quaternion_of(present(start.roll), present(start.pitch), present(start.yaw))
        return tuple(jnp.asarray(term, float) for term in quaternion), (self.spin.x, self.spin.y, self.spin.z)


class Spherical(AbstractPlayed):
    """A ball in its socket, ideal or with clearance. Its coordinate is an orientation."""

    motion: Ball = flatten(default_factory=Ball)
    """The motion of the ball: always free."""
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()
    clearance: AbstractClearance | PreparedClearance | None = flatten(default=None)
    eccentricity: Position = ORIGIN

    def own_coordinates(self):
        return (*self.play_coordinates(), Coordinate(self.name, self.motion))

    def joint_constraint(self):
        return JointConstraint(None, ())


class Universal(AbstractJoint):
    """A universal (cardan) joint. It turns first about an axis of the parent, then about an axis of the child that is
    perpendicular to the first.
    """

    turn_1: Turn = motion_key(Turn, "motion of the turn about x of the joint's frame")
    turn_2: Turn = motion_key(Turn, "motion of the turn about y, after that")
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()

    def coordinates(self):
        return (
            Coordinate(f"{self.name}.turn_1", self.turn_1, turns=X),
            Coordinate(f"{self.name}.turn_2", self.turn_2, turns=Y),
        )

    def joint_constraint(self):
        return JointConstraint(None, ((X, Y),))


class Cylindrical(AbstractPlayed):
    """A pin that slides in its sleeve and turns in it, along and about one axis, by default z. It is ideal or has
    clearance: that of a sleeve without axial play.
    """

    slide: Slide = motion_key(Slide, "motion along the axis")
    turn: Turn = motion_key(Turn, "motion about the axis")
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()
    axis: Axis = axis_key("z")
    clearance: AbstractClearance | PreparedClearance | None = flatten(default=None)
    eccentricity: Position = ORIGIN

    @property
    def sleeve(self):
        return along(self.axis)

    def own_coordinates(self):
        return (
            *self.play_coordinates(),
            Coordinate(f"{self.name}.slide", self.slide, slides=Z),
            Coordinate(f"{self.name}.turn", self.turn, turns=Z),
        )

    def joint_constraint(self):
        line = self.axis.vector
        return JointConstraint(self.axis.across, alignment(self.axis), ((line, line),))


class Planar(AbstractJoint):
    """A contact of two planes, as a foot on a floor: two slides in a plane, and a turn about its normal (default z)."""

    slide_x: Slide = motion_key(Slide, "motion along the first axis")
    slide_y: Slide = motion_key(Slide, "motion along the second axis")
    turn: Turn = motion_key(Turn, "motion about the axis")
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()
    axis: Axis = axis_key("z")

    def coordinates(self):
        return self._about(*self.axis.across, self.axis.vector)

    def own_coordinates(self):
        return self._about(*UNIT)

    def _about(self, first: Vector, second: Vector, normal: Vector) -> tuple[Coordinate, ...]:
        return (
            Coordinate(f"{self.name}.slide_x", self.slide_x, slides=first),
            Coordinate(f"{self.name}.slide_y", self.slide_y, slides=second),
            Coordinate(f"{self.name}.turn", self.turn, turns=normal),
        )

    def joint_constraint(self):
        line = self.axis.vector
        return JointConstraint((line,), alignment(self.axis), ((line, line),))


class Free(AbstractJoint):
    """No connection: three slides along the axes of the joint's frame on the parent, and a ball."""

    slide_x: Slide = motion_key(Slide, "motion along the first axis")
    slide_y: Slide = motion_key(Slide, "motion along the second axis")
    slide_z: Slide = motion_key(Slide, "motion along the third axis")
    motion: Ball = flatten(default_factory=Ball)
    """The turning of the child: always free."""
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()

    def coordinates(self):
        slides = zip("xyz", (self.slide_x, self.slide_y, self.slide_z), UNIT, strict=True)
        return (
            *(Coordinate(f"{self.name}.slide_{k}", motion, slides=axis) for k, motion, axis in slides),
            Coordinate(self.name, self.motion),
        )

    def joint_constraint(self):
        raise ClearanceError(f"Joint `{self.name}` closes a loop and holds nothing: leave it out.")
