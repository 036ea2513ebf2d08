"""The inertia of a body, and of a body with all that hangs on it."""

from collections.abc import Callable
from typing import NamedTuple

from clearance_jax._basis.symmetric import NOTHING, Symmetric, of_point, rotate, shift
from clearance_jax.dynamics.forms.frames import SpatialForce
from clearance_jax.mechanism.body import Body, needs_six
from clearance_jax.mechanism.placement import Inertia
from clearance_jax.mechanism.tree.frame import Frame, JacobianColumn
from clearance_jax.spatial import Term, Vector, Z, absent, add, cross, plus, same_line, scale, subtract


class Composite(NamedTuple):
    """A body with all that hangs on it as one: mass, mass times the arm of its centre, and inertia, about its pivot."""

    mass: Term
    moment: Vector
    inertia: Symmetric

    def move(self, by: Vector) -> "Composite":
        """The same about another pivot, from which `by` leads to its own."""
        if absent(by):
            return self
        moment = add(self.moment, scale(self.mass, by))
        return Composite(self.mass, moment, shift(self.inertia, by, self.moment, moment))

    def __add__(self, other) -> "Composite":
        return Composite(plus(self.mass, other.mass), add(self.moment, other.moment), self.inertia + other.inertia)

    def map(self, function: Callable) -> "Composite":
        """The same with a function of every number."""
        mass, moment = function((self.mass, self.moment))
        return Composite(mass, moment, self.inertia.map(function))

    def momentum(self, column: JacobianColumn, pivot: Vector) -> SpatialForce:
        """Momentum and angular momentum (about its pivot) per unit rate of a column that moves all of it."""
        velocity, spin = column.velocity_at(pivot), column.spin
        return SpatialForce(
            add(scale(self.mass, velocity), cross(spin, self.moment)),
            add(self.inertia.apply(spin), cross(self.moment, velocity)),
        )


def composite_of(body: Body, frame: Frame) -> Composite:
    """A body alone, about its pivot."""
    mass = 0.0 if body.mass is None else body.mass
    arm = subtract(frame.point(body.center_of_mass.vector), frame.pivot)
    moment = scale(mass, arm)
    return Composite(mass, moment, inertia_of(body, frame) + of_point(mass, arm, moment))


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
