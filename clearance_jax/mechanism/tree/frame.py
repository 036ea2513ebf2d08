"""Moving frames: pose, spin, acceleration, and the columns of the coordinates that move them."""

from typing import Any, NamedTuple

from clearance_jax.spatial import (
    IDENTITY,
    UNIT,
    ZERO,
    Matrix,
    Rotation,
    Term,
    Vector,
    Z,
    absent,
    add,
    centripetal,
    cross,
    scale,
    subtract,
)


class JacobianColumn(NamedTuple):
    """The motion by a coordinate (`index` -1: prescribed): a unit slide along `axis`, or spin about it at a `pivot`."""

    index: int
    axis: Vector
    pivot: Vector | None

    def velocity_at(self, point: Vector) -> Vector:
        """Velocity of the point of a moved body that is at `point`, per unit rate."""
        return self.axis if self.pivot is None else cross(self.axis, subtract(point, self.pivot))

    @property
    def spin(self) -> Vector:
        """Spin of a moved body per unit rate."""
        return ZERO if self.pivot is None else self.axis


class Frame(NamedTuple):
    """Pose and motion of a body's frame; accelerations are those without the free coordinates' accelerations.

    `pivot`: the place of the joint that carries the body, about which moments are taken; `free` and `prescribed`: the
    columns of the coordinates that move it, from the ground on (prescribed ones with their rates); those of
    a table have none (`TabledFrames.columns`).
    """

    rotation: Rotation = IDENTITY
    position: Vector = ZERO
    spin: Vector = ZERO
    velocity: Vector = ZERO
    spin_rate: Vector = ZERO
    acceleration: Vector = ZERO
    pivot: Vector = ZERO
    free: Any = ()
    prescribed: tuple[tuple[JacobianColumn, Term], ...] = ()

    @property
    def angle(self) -> Term:
        """The angle about z of a frame that turns about z only."""
        return self.rotation.angle

    def point(self, at: Vector) -> Vector:
        """World position of the point that is at `at` in the body's frame."""
        return add(self.position, self.rotation.apply(at))

    def velocity_at(self, point: Vector) -> Vector:
        """Velocity of the body's material point that is at `point`."""
        return add(self.velocity, cross(self.spin, subtract(point, self.position)))

    def acceleration_at(self, point: Vector) -> Vector:
        """Acceleration of the body's material point at `point` (without the free coordinates' accelerations)."""
        arm = subtract(point, self.position)
        return add(self.acceleration, add(cross(self.spin_rate, arm), centripetal(self.spin, arm)))

    def move_origin(self, at: Vector) -> "Frame":
        """The frame of the same body with its origin at `at`."""
        return self if absent(at) else self.slid(at)

    def rotate(self, rotation: Rotation) -> "Frame":
        """The frame of the same body with other axes."""
        if rotation.rows is UNIT:
            return self
        if rotation.is_plane:
            return self._replace(rotation=self.rotation.turn(Z, rotation.angle))
        return self._replace(rotation=self.rotation.compose(rotation.rows))

    def turn(self, axis: Vector, angle: Term, rate: Term, acceleration: Term) -> "Frame":
        """The frame after a turn about its origin and an axis of its own."""
        spin = scale(rate, self.rotation.apply(axis))
        return self._replace(
            rotation=self.rotation.turn(axis, angle),
            spin=add(self.spin, spin),
            spin_rate=add(add(self.spin_rate, cross(self.spin, spin)), scale(acceleration, self.rotation.apply(axis))),
        )

    def swivel(self, rows: Matrix, spin: Vector, spin_rate: Vector = ZERO) -> "Frame":
        """The frame after a rotation about its origin, with a spin and its rate in the rotated axes."""
        rotation = self.rotation.compose(rows)
        spin, faster = rotation.apply(spin), rotation.apply(spin_rate)
        return self._replace(
            rotation=rotation,
            spin=add(self.spin, spin),
            spin_rate=add(add(self.spin_rate, cross(self.spin, spin)), faster),
        )

    def slid(self, by: Vector, rate: Vector = ZERO, acceleration: Vector = ZERO) -> "Frame":
        """The frame after a slide by a vector, with its rate and its acceleration, in the frame's axes."""
        arm, moved, faster = (self.rotation.apply(vector) for vector in (by, rate, acceleration))
        swept = cross(self.spin, arm)
        turning = add(cross(self.spin_rate, arm), cross(self.spin, add(swept, scale(2.0, moved))))
        return self._replace(
            position=add(self.position, arm),
            velocity=add(self.velocity, add(swept, moved)),
            acceleration=add(self.acceleration, add(turning, faster)),
        )

    def add_motion(self, column: JacobianColumn, rate: Term) -> "Frame":
        """The frame with one more coordinate that moves it."""
        if column.index < 0:
            return self._replace(prescribed=(*self.prescribed, (column, rate)))
        return self._replace(free=(*self.free, column))
