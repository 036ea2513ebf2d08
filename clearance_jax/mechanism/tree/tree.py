"""Joints of the tree and their kinematics: one sweep from the ground gives every body's pose and motion.

Each joint is a short list of elementary coordinates: slides along and turns about axes of its frame, and balls. A
prescribed coordinate contributes motion only. A free one also contributes columns, the velocity of the points beyond it
per unit of its rates, from which mass matrix, forces and constraints are built.

A joint between two bodies that are placed already closes a loop: it has no coordinates, and its `JointConstraint` is a
constraint.
"""

import abc
import dataclasses
from typing import Any

import equinox as eqx

from clearance_jax._basis.module import structural_property
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints import AbstractClearance, PlayCoordinate, PreparedClearance
from clearance_jax.joints.checks import check_start
from clearance_jax.mechanism.body import Motion, Motor
from clearance_jax.mechanism.placement import ORIGIN, Axis, Orientation, Position, PreparedOrientation
from clearance_jax.mechanism.tree.coordinate import (
    Coordinate,
    JointConstraint,
    axis_key,
    child_axes_key,
    orientation_key,
)
from clearance_jax.mechanism.tree.frame import Frame
from clearance_jax.parameters import Parametrised, describe, flatten, outside, physical
from clearance_jax.spatial import (
    IDENTITY,
    UNIT,
    Matrix,
    Rotation,
    Vector,
    X,
    Y,
    Z,
    absent,
    dot,
    is_zero,
    minus,
    transpose,
)
from clearance_jax.units import SLIDING, TURNING

PLACE = {"example": '["50 mm", "0 mm"]', "absent": "the frame's origin", "default": ORIGIN}
ANGLE = "angle of the joint's frame in the parent's, about z: a slide moves along its x axis; the child turns too"


class AbstractJoint(Parametrised):
    """A joint: it places the child's frame on the parent's, or closes a loop between two placed bodies."""

    name: str = eqx.field(static=True)
    """The joint's name."""
    parent: str = describe("the body that the joint is on (its sleeve), or `ground`", '"ground"', static=True)
    child: str = describe("the body that the joint carries (its pin)", '"crank"', static=True)
    at_parent: Position = describe("place of the joint in the parent's frame", **PLACE)
    at_child: Position = describe("place of the joint in the child's frame", **PLACE)
    angle: Scalar | None = physical("rad", ANGLE, '"90 deg"', "0 deg", default=None)
    orientation: eqx.AbstractVar[Orientation | PreparedOrientation | None]  # pyright: ignore[reportGeneralTypeIssues]
    child_orientation: eqx.AbstractVar[Orientation | PreparedOrientation | None]  # pyright: ignore[reportGeneralTypeIssues]

    def __check_init__(self):
        if self.angle is not None and self.orientation is not None:
            raise ClearanceError(f"Joint `{self.name}` has an `angle` and an `orientation`: give one of them.")

    @abc.abstractmethod
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The joint's elementary coordinates, in the order in which they act."""

    def own_coordinates(self) -> tuple[Coordinate, ...]:
        """The same coordinates with axes in the joint's own, which are structural constants."""
        return self.coordinates()

    @abc.abstractmethod
    def joint_constraint(self) -> JointConstraint:
        """Its conditions where it closes a loop."""

    def prepare(self) -> "AbstractJoint":
        """The joint with what depends only on its numbers computed (once a solve)."""
        changed = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            turned = isinstance(value, Orientation) and not value.is_plane
            if turned or isinstance(value, (Motion, AbstractClearance)):
                changed[field.name] = value.prepare()
        return dataclasses.replace(self, **changed) if changed else self

    @structural_property
    def is_plane(self) -> bool:
        """Whether its structure keeps what it carries in the plane z = 0."""
        turned = (self.orientation, self.child_orientation)
        slides = [c.slides for c in self.coordinates() if c.slides is not None]
        return (
            all(orientation is None or orientation.is_plane for orientation in turned)
            and all(is_zero(along[2]) for along in slides)
            and all(c.turns is not None and absent(c.turns[:2]) for c in self.coordinates() if c.slides is None)
        )

    def on_parent(self, frame: Frame) -> Frame:
        """The joint's frame on the parent, from the parent's frame."""
        frame = frame.move_origin(self.at_parent.vector)
        return frame.rotate(self.turned)

    def on_child(self, frame: Frame) -> Rotation:
        """The axes of the joint's frame on the child, from the child's frame."""
        return frame.rotate(_turn(self.child_orientation)).rotation

    @property
    def turned(self) -> Rotation:
        """The rotation of the joint's frame in the parent's."""
        return _turn(self.orientation) if self.angle is None else IDENTITY.turn(Z, self.angle)


def _turn(orientation: Orientation | PreparedOrientation | None) -> Rotation:
    return IDENTITY if orientation is None else orientation.rotation


def alignment(axis: Axis) -> tuple[tuple[Vector, Vector], ...]:
    """Pairs of axes that keep an axis of two frames parallel."""
    return tuple((axis.vector, across) for across in axis.across)


class AbstractPlayed(AbstractJoint):
    """A joint that may have play: ideal, or with clearance. The sleeve (socket, guide) is on the parent, the pin (ball,
    block) on the child.

    With clearance in the tree it has play coordinates. Where it closes a loop it has no coordinates: it is a force
    element (with clearance) or a constraint (ideal).
    """

    clearance: eqx.AbstractVar[AbstractClearance | PreparedClearance | None]  # pyright: ignore[reportGeneralTypeIssues]
    """The play of the joint; `None`: an ideal joint."""
    eccentricity: eqx.AbstractVar[Position]  # pyright: ignore[reportGeneralTypeIssues]
    """Where the pin starts in its sleeve [m], in the sleeve's axes; by default in the middle."""

    def __check_init__(self):
        if not isinstance(self.clearance, AbstractClearance):
            return
        moving = dataclasses.replace(self, clearance=None).own_coordinates()
        plays = outside(self.clearance).play()
        for play in plays:
            slides = play.slides is not None and any(play.slides == c.slides for c in moving)
            turns = play.turns is not None and any(c.is_ball or play.turns == c.turns for c in moving)
            if slides or turns:
                raise ClearanceError(
                    f"The clearance of joint `{self.name}`, a {type(self.clearance).__name__}, has the play "
                    f"`{play.suffix[1:]}`, but so the joint moves by itself. Give it one of its own kind."
                ).about(f"{self.name}.{play.suffix[1:]}")
        start, slides = self.eccentricity, [play.slides for play in plays if play.slides is not None]
        check_start(self.name, (start.x, start.y, start.z), slides)

    @property
    def sleeve(self) -> Matrix:
        """The rotation from the sleeve's axes (z is the joint's) to those of the joint's frame."""
        return UNIT

    @abc.abstractmethod
    def own_coordinates(self) -> tuple[Coordinate, ...]:
        """The joint's elementary coordinates, with axes in those of the sleeve."""

    def coordinates(self):
        sleeve, coordinates = self.sleeve, self.own_coordinates()
        if sleeve is UNIT:
            return coordinates

        def turned(axis: Vector | None) -> Any:
            return axis and tuple(dot(axis, row) for row in sleeve)

        return tuple(c._replace(slides=turned(c.slides), turns=turned(c.turns)) for c in coordinates)

    def play(self) -> tuple[PlayCoordinate, ...]:
        """The play coordinates that its clearance adds to the tree."""
        return () if self.clearance is None else self.clearance.play()

    def play_coordinates(self) -> tuple[Coordinate, ...]:
        """The play as coordinates. Slides start at `eccentricity`, tilts at zero."""
        start = self.eccentricity.vector
        return tuple(
            Coordinate(
                self.name + play.suffix,
                Motion(position=0.0 if play.slides is None else dot(start, play.slides)),
                play.slides,
                play.turns,
                play.scale,
                play.swings,
            )
            for play in self.play()
        )


class Revolute(AbstractPlayed):
    """A pin joint, ideal or with clearance: it turns about one axis, by default z.

    With a `RevoluteClearance` the pin has radial play, in the plane. With a `SleeveClearance` the pin also tilts, in
    space.
    """

    motion: Motion = flatten(default_factory=Motion)
    """How its angle moves: by a drive, or freely."""
    clearance: AbstractClearance | PreparedClearance | None = flatten(default=None)
    eccentricity: Position = describe(
        "where the centre of the pin (ball, block) starts in the sleeve (socket, guide), in the sleeve's axes",
        '["0 mm", "-0.1 mm"]',
        "the sleeve's centre",
        default=ORIGIN,
    )
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()
    axis: Axis = axis_key("z")
    motor: Motor | None = None
    """The motor of an elastic drive: the joint turns by the sum of the motor's angle and the spring's, `motion`."""

    def units(self):
        return TURNING

    def own_coordinates(self):
        return (*self.play_coordinates(), *(Coordinate(name, motion, turns=Z) for name, motion in _moving(self)))

    @property
    def sleeve(self):
        return along(self.axis)

    def joint_constraint(self):
        line = self.axis.vector
        return JointConstraint(None, alignment(self.axis), ((line, line),))


def _moving(joint: "Revolute | Prismatic") -> tuple[tuple[str, Motion], ...]:
    """Names and motions along or about a joint's axis: that of an elastic drive's motor, and the joint's own."""
    link = joint.name, joint.motion
    return (link,) if joint.motor is None else ((joint.motor.name, joint.motor), link)


def along(axis: Axis) -> Matrix:
    """The rotation from axes whose z is the given axis."""
    return UNIT if axis.letter == "z" else transpose((*axis.across, axis.vector))


class Prismatic(AbstractPlayed):
    """A slide along an axis of its frame, by default x: ideal, or with clearance (a block in a guide)."""

    motion: Motion = flatten(default_factory=Motion)
    """How its slide moves: by a drive, or freely."""
    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()
    axis: Axis = axis_key("x")
    clearance: AbstractClearance | PreparedClearance | None = flatten(default=None)
    eccentricity: Position = ORIGIN
    motor: Motor | None = None
    """As of a `Revolute`."""

    def units(self):
        return SLIDING

    def own_coordinates(self):
        # The play acts at the block's place, so the slide comes first.
        return (*(Coordinate(name, motion, slides=Z) for name, motion in _moving(self)), *self.play_coordinates())

    @property
    def sleeve(self):
        x, y, z = self.axis.vector
        if not is_zero(z):
            return along(self.axis)
        # With the axis in the plane z = 0 the walls stand across it in this plane, and the block tilts about z.
        return transpose(((minus(0.0, y), x, 0.0), Z, (x, y, 0.0)))

    def joint_constraint(self):
        line, (p, q) = self.axis.vector, self.axis.across
        return JointConstraint((p, q), (*alignment(self.axis), (p, q)), ((line, line), (p, p)))


class Fixed(AbstractJoint):
    """A rigid connection of two bodies."""

    orientation: Orientation | PreparedOrientation | None = orientation_key()
    child_orientation: Orientation | PreparedOrientation | None = child_axes_key()

    def coordinates(self):
        return ()

    def joint_constraint(self):
        return JointConstraint(None, ((X, Y), (Y, Z), (Z, X)), ((X, X), (Y, Y), (Z, Z)))


class Misalignment(Fixed):
    """How far a joint's frame is off its place (see `with_misalignment`). The ideal mechanism has none."""


def without_misalignment(joint: AbstractJoint) -> AbstractJoint:
    """The joint without misalignment."""
    if not isinstance(joint, Misalignment):
        return joint
    return Fixed(joint.name, joint.parent, joint.child)
