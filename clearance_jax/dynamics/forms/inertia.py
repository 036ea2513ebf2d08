"""The inertia and the motion of a body, and the inertia of a body with all that hangs on it."""

from collections.abc import Callable
from typing import NamedTuple

from clearance_jax._basis.symmetric import NOTHING, Symmetric, of_point, rotate, shift
from clearance_jax.dynamics.forms.frames import SpatialForce
from clearance_jax.mechanism.body import Body, needs_six
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.mechanism.tree.frame import Frame, JacobianColumn
from clearance_jax.spatial import (
    Matrix,
    Term,
    Vector,
    Z,
    absent,
    add,
    cross,
    dot,
    is_zero,
    minus,
    plus,
    same_line,
    scale,
    subtract,
    times,
)


class Composite(NamedTuple):
    """A body with all that hangs on it as one: mass, mass times the arm of its centre, and inertia, about its pivot;
    `central`: the inertia about its centre, if it is known.
    """

    mass: Term
    moment: Vector
    inertia: Symmetric
    central: Symmetric | None = None

    def move(self, by: Vector) -> "Composite":
        """The same about another pivot, from which `by` leads to its own."""
        if absent(by):
            return self
        moment = add(self.moment, scale(self.mass, by))
        return Composite(self.mass, moment, shift(self.inertia, by, self.moment, moment))

    def __add__(self, other) -> "Composite":
        # What has no mass resists turning alike about every point.
        central = self.central + other.inertia if self.central is not None and is_zero(other.mass) else None
        mass, moment = plus(self.mass, other.mass), add(self.moment, other.moment)
        return Composite(mass, moment, self.inertia + other.inertia, central)

    def map(self, function: Callable) -> "Composite":
        """The same with a function of every number."""
        mass, moment = function((self.mass, self.moment))
        central = None if self.central is None else self.central.map(function)
        return Composite(mass, moment, self.inertia.map(function), central)

    def about_centre(self, inverse: Term) -> Symmetric:
        """The inertia about the centre; `inverse` of the mass."""
        if self.central is not None:
            return self.central
        away = of_point(self.mass, scale(inverse, self.moment), self.moment)
        return Symmetric(lambda i, j: minus(self.inertia.entry(i, j), away.entry(i, j)))

    def momentum(self, column: JacobianColumn, pivot: Vector) -> SpatialForce:
        """Momentum and angular momentum (about its pivot) per unit rate of a column that moves all of it."""
        velocity, spin = column.velocity_at(pivot), column.spin
        return SpatialForce(
            add(scale(self.mass, velocity), cross(spin, self.moment)),
            add(self.inertia.apply(spin), cross(self.moment, velocity)),
        )


class BodyMotion(NamedTuple):
    """A body alone as it moves now (without the accelerations of the free coordinates), in the world's axes: its mass,
    the arm from its pivot to its centre, its inertia about its centre by rows; of the centre velocity and acceleration;
    `turning`: the inertia times the spin rate; `gyroscopic`: the rest of the rate of the angular momentum.
    """

    mass: Term
    arm: Vector
    inertia: Matrix
    velocity: Vector
    acceleration: Vector
    turning: Vector
    gyroscopic: Vector

    @property
    def about_centre(self) -> Symmetric:
        """The inertia about the centre."""
        return Symmetric(lambda i, j: self.inertia[i][j])

    @property
    def composite(self) -> Composite:
        """Its inertia about its pivot."""
        moment, central = scale(self.mass, self.arm), self.about_centre
        return Composite(self.mass, moment, central + of_point(self.mass, self.arm, moment), central)

    def kinetic_energy(self, spin: Vector) -> Term:
        """Its kinetic energy [J]."""
        sliding = times(self.mass, dot(self.velocity, self.velocity))
        return times(0.5, plus(sliding, dot(self.about_centre.apply(spin), spin)))

    def deficit(self, gravity: Vector, extra: tuple[Vector, Vector] | None) -> SpatialForce:
        """Weight minus inertia forces, about its pivot; `extra`: what free accelerations add to the acceleration of the
        centre, and to the inertia times the spin rate.
        """
        acceleration, turning = self.acceleration, add(self.turning, self.gyroscopic)
        if extra is not None:
            acceleration, turning = add(acceleration, extra[0]), add(turning, extra[1])
        # M (g - a); without gravity one change of sign serves all components.
        if absent(gravity):
            force = scale(minus(0.0, self.mass), acceleration)
        else:
            force = scale(self.mass, subtract(gravity, acceleration))
        return SpatialForce(force, subtract(cross(self.arm, force), turning))

    def powers(self, spin: Vector, extra: tuple[Vector, Vector]) -> tuple[Term, ...]:
        """Rates of its kinetic energy along and about each axis of the world [W]."""
        acceleration, turning = add(self.acceleration, extra[0]), add(self.turning, extra[1])
        along = (times(self.mass, times(a, v)) for a, v in zip(acceleration, self.velocity, strict=True))
        return (*along, *(times(t, w) for t, w in zip(turning, spin, strict=True)))


def motion_of_body(body: Body, frame: Frame) -> BodyMotion:
    """A body's motion, from that of its frame."""
    inertia, centre = inertia_of(body, frame), frame.point(body.center_of_mass.vector)
    rows = tuple(tuple(inertia.entry(i, j) for j in range(3)) for i in range(3))
    gyroscopic = cross(frame.spin, inertia.apply(frame.spin))
    return BodyMotion(
        0.0 if body.mass is None else body.mass,
        subtract(centre, frame.pivot),
        rows,
        frame.velocity_at(centre),
        frame.acceleration_at(centre),
        inertia.apply(frame.spin_rate),
        gyroscopic,
    )


def inertia_of(body: Body, frame: Frame) -> Symmetric:
    """A body's inertia about its centre of mass, in the world's axes."""
    if body.inertia is None:
        return NOTHING
    if isinstance(body.inertia, Inertia):
        return rotate(body.inertia.symmetric, frame.rotation)
    about_z = body.inertia
    if same_line(frame.rotation.rows[2], Z) <= 0:
        raise needs_six(body)
    return Symmetric(lambda i, j: about_z if i == j == 2 else 0.0)
