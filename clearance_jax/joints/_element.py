"""Elements that fill a joint's play: their input and their base class."""

import abc
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.laws import Geometry
from clearance_jax.parameters import Parametrised
from clearance_jax.spatial import Term, Vector


class Offset(NamedTuple):
    """The part of a pin's motion that is play, in the sleeve's axes. Other components are absent.

    - `place` [m] and `velocity` [m/s] of the pin's centre; `spin` [rad/s].
    - `roll` [rad/s]: how fast the pin turns about the sleeve's axis, which is no play.
    - `sine`: the sine of the tilt, along the axis about which the pin is tilted; `cosine`: the cosine of the tilt.
    """

    place: Vector
    velocity: Vector
    sine: Vector
    cosine: Term
    spin: Vector
    roll: Term = 0.0


class AbstractElement(Parametrised):
    """A filling of a joint's play that acts without touch: grease, a seal, a film, preloaded rolling elements."""

    stiff: ClassVar[bool] = False
    """Whether it holds its pin, so that the pin rests where the element and the wall bear the load together."""
    has_static_force: ClassVar[bool] = True
    """Whether it bears loads by its place, and not by the motion of the pin alone."""

    @abc.abstractmethod
    def wrench(self, offset: Offset, geometry: Geometry) -> tuple[Vector, Vector]:
        """Force on the pin [N] and torque about its centre [N m], in the sleeve's axes."""

    def energy(self, offset: Offset, geometry: Geometry) -> Scalar:
        """The elastic energy that it stores [J], zero by default; the rest of the work done on it is lost."""
        return jnp.zeros(())
