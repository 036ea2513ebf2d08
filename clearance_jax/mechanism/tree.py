"""Joints of the tree and its kinematics: one forward sweep from the ground gives every body's pose and motion.

Each joint is a short list of elementary coordinates (slides along and turns about the axes of its frame). A prescribed
coordinate contributes motion only; a free one also contributes a column, the velocity of the points beyond it per unit
of its rate, from which mass matrix, forces and constraints are built.
"""

import abc
import dataclasses
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array

from clearance_jax._types import Scalar
from clearance_jax.joints import AbstractClearance, PlayCoordinate, PreparedClearance
from clearance_jax.mechanism.body import ORIGIN, Motion, Position
from clearance_jax.parameters import Parametrised, described, flattened, physical
from clearance_jax.spatial import (
    IDENTITY,
    ZERO,
    Rotation,
    Term,
    Vector,
    add,
    is_zero,
    minus,
    plus,
    rotation_of,
    scale,
    spin_cross,
    subtract,
    times,
)


class Column(NamedTuple):
    """What one coordinate moves: a unit slide along `axis`, or (`axis` is None) a unit spin about `pivot`."""

    index: int
    axis: Vector | None
    pivot: Vector

    def velocity_at(self, point: Vector) -> Vector:
        """Velocity of the point of a moved body that is at `point`, per unit rate."""
        return spin_cross(1.0, subtract(point, self.pivot)) if self.axis is None else self.axis

    @property
    def spin(self) -> float:
        """Spin of a moved body per unit rate."""
        return 1.0 if self.axis is None else 0.0


class Frame(NamedTuple):
    """Pose and motion of a body's frame; accelerations are those with every free coordinate's acceleration left out."""

    angle: Term = 0.0
    rotation: Rotation = IDENTITY
    position: Vector = ZERO
    spin: Term = 0.0
    velocity: Vector = ZERO
    spin_rate: Term = 0.0
    acceleration: Vector = ZERO
    free: tuple[Column, ...] = ()
    prescribed: tuple[tuple[Column, Term], ...] = ()

    def point(self, at: Vector) -> Vector:
        """World position of the point that is at `at` in the body's frame."""
        return add(self.position, self.rotation.apply(at))

    def velocity_at(self, point: Vector) -> Vector:
        """Velocity of the body's material point that is at `point`."""
        return add(self.velocity, spin_cross(self.spin, subtract(point, self.position)))

    def acceleration_at(self, point: Vector) -> Vector:
        """Acceleration of the body's material point at `point` (without the free coordinates' accelerations)."""
        arm = subtract(point, self.position)
        centripetal = scale(minus(0.0, times(self.spin, self.spin)), arm)
        return add(self.acceleration, add(spin_cross(self.spin_rate, arm), centripetal))

    def moved_to(self, at: Vector) -> "Frame":
        """The frame of the same body with its origin at `at`."""
        if is_zero(at[0]) and is_zero(at[1]):
            return self
        point = self.point(at)
        return self._replace(position=point, velocity=self.velocity_at(point), acceleration=self.acceleration_at(point))

    def turned(self, angle: Term, spin: Term = 0.0, spin_rate: Term = 0.0) -> "Frame":
        """The frame after a turn about its origin."""
        turned = plus(self.angle, angle)
        return self._replace(
            angle=turned,
            rotation=rotation_of(turned),
            spin=plus(self.spin, spin),
            spin_rate=plus(self.spin_rate, spin_rate),
        )

    def slid(self, by: Vector, rate: Vector, acceleration: Vector) -> "Frame":
        """The frame after a slide along its own axes."""
        step, rate = self.rotation.apply(by), self.rotation.apply(rate)
        point = add(self.position, step)
        coriolis = spin_cross(times(2.0, self.spin), rate)
        return self._replace(
            position=point,
            velocity=add(self.velocity_at(point), rate),
            acceleration=add(add(self.acceleration_at(point), coriolis), self.rotation.apply(acceleration)),
        )


class Coordinate(NamedTuple):
    """One elementary coordinate of a joint: its name, how it moves, the axis it slides along (None: it turns), and of a
    play coordinate its magnitude.
    """

    name: str
    motion: Motion
    slides: Vector | None
    play: Scalar | None = None


TURNING = {"coordinate": "rad", "effort": "N*m"}
SLIDING = {"coordinate": "m", "effort": "N"}


def _body(help: str, example: str):
    return described(help, example, static=True)


def _place(help: str):
    return described(help, '["50 mm", "0 mm"]', "the frame's origin", default=ORIGIN)


def _turn():
    help = "angle of the joint's frame in the parent's: a slide moves along its x axis; the child turns too"
    return physical("rad", default=None, help=help, example='"90 deg"', absent="0 deg")


class AbstractJoint(Parametrised):
    """A joint of the tree: places the child's frame on the parent's."""

    name: eqx.AbstractVar[str]
    parent: eqx.AbstractVar[str]
    child: eqx.AbstractVar[str]
    at_parent: eqx.AbstractVar[Position]
    at_child: eqx.AbstractVar[Position]
    angle: eqx.AbstractVar[Scalar | None]

    @abc.abstractmethod
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The joint's elementary coordinates, in the order in which they act."""

    def prepared(self) -> "AbstractJoint":
        """The joint with what depends only on its numbers computed (once a solve)."""
        return self


class Revolute(AbstractJoint):
    """A pin joint, ideal or with clearance.

    With clearance in the tree its play coordinates (the eccentricity in the sleeve's frame) come before its rotation.
    Where it closes a loop it has no coordinates: it is a force element (with clearance) or a constraint (ideal). The
    sleeve is on the parent, the pin on the child.
    """

    name: str = eqx.field(static=True)
    parent: str = _body("the body that the joint is on (its sleeve), or `ground`", '"ground"')
    child: str = _body("the body that the joint carries (its pin)", '"crank"')
    at_parent: Position = _place("place of the joint in the parent's frame")
    at_child: Position = _place("place of the joint in the child's frame")
    angle: Scalar | None = _turn()
    motion: Motion = flattened(default_factory=Motion)
    clearance: AbstractClearance | PreparedClearance | None = flattened(default=None)
    eccentricity: Position = described(
        "where the pin's centre starts in the sleeve, in the sleeve's axes; of a joint of the tree",
        '["0 mm", "-0.1 mm"]',
        "the sleeve's centre",
        default=ORIGIN,
    )

    def units(self):
        return TURNING

    def coordinates(self):
        turn = Coordinate(self.name, self.motion, None)
        if self.clearance is None:
            return (turn,)
        # Play starts where `eccentricity` says; further coordinates (a tilt) start at zero.
        start = [*self.eccentricity.vector]
        slides = [play for play in self.play() if play.slides is not None]
        places = dict(zip((play.suffix for play in slides), start, strict=False))
        return (
            *(
                Coordinate(
                    self.name + play.suffix, Motion(position=places.get(play.suffix, 0.0)), play.slides, play.scale
                )
                for play in self.play()
            ),
            turn,
        )

    def play(self) -> tuple[PlayCoordinate, ...]:
        """What its clearance adds to the tree."""
        clearance = self.clearance.joint if isinstance(self.clearance, PreparedClearance) else self.clearance
        return () if clearance is None else clearance.play()

    def prepared(self):
        clearance = self.clearance.prepared() if isinstance(self.clearance, AbstractClearance) else self.clearance
        return dataclasses.replace(self, motion=self.motion.prepared(), clearance=clearance)


class Prismatic(AbstractJoint):
    """A sliding joint along the x axis of the joint frame (the parent's, turned by `angle`)."""

    name: str = eqx.field(static=True)
    parent: str = _body("the body that the joint is on (its sleeve), or `ground`", '"ground"')
    child: str = _body("the body that the joint carries (its pin)", '"crank"')
    at_parent: Position = _place("place of the joint in the parent's frame")
    at_child: Position = _place("place of the joint in the child's frame")
    angle: Scalar | None = _turn()
    motion: Motion = flattened(default_factory=Motion)

    def units(self):
        return SLIDING

    def coordinates(self):
        return (Coordinate(self.name, self.motion, (1.0, 0.0)),)

    def prepared(self):
        return dataclasses.replace(self, motion=self.motion.prepared())


class Fixed(AbstractJoint):
    """A rigid connection."""

    name: str = eqx.field(static=True)
    parent: str = _body("the body that the joint is on (its sleeve), or `ground`", '"ground"')
    child: str = _body("the body that the joint carries (its pin)", '"crank"')
    at_parent: Position = _place("place of the joint in the parent's frame")
    at_child: Position = _place("place of the joint in the child's frame")
    angle: Scalar | None = _turn()

    def coordinates(self):
        return ()


def place(joint: AbstractJoint, parent: Frame, time: Scalar, values: dict[str, tuple[int, Array, Array]]) -> Frame:
    """The child's frame. `values[name]` is the (index, position, velocity) of each free coordinate."""
    frame = parent.moved_to(joint.at_parent.vector)
    if joint.angle is not None:
        frame = frame.turned(joint.angle)
    for name, motion, slides, _ in joint.coordinates():
        if motion.drive is None:
            index, q, v = values[name]
            a: Term = 0.0
        else:
            index = -1
            q, v, a = motion.drive(time)  # a tuple, any of which may be the constant 0.0
        if slides is None:
            column = Column(index, None, frame.position)
            frame = frame.turned(q, v, a)
        else:
            column = Column(index, frame.rotation.apply(slides), ZERO)
            frame = frame.slid(scale(q, slides), scale(v, slides), scale(a, slides))
        if motion.drive is None:
            frame = frame._replace(free=(*frame.free, column))
        else:
            frame = frame._replace(prescribed=(*frame.prescribed, (column, v)))
    return frame.moved_to(subtract(ZERO, joint.at_child.vector))
