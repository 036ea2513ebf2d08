"""A normal law with a stiffer elastic part, to separate the effect of play from that of elasticity."""

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractModifiedLaw, AbstractNormalLaw, Smoothness
from clearance_jax.parameters import physical


class Stiffened(AbstractModifiedLaw):
    """`factor` times the force and the energy of a `law`."""

    law: AbstractNormalLaw
    factor: Scalar = physical("", above=0.0, help="by how much it is stiffer", example="1e6")

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        return self.law.smoothness

    def formula(self, constants, penetration, penetration_rate, memory):
        return self.factor * self.law.formula(constants, penetration, penetration_rate, memory)

    def energy(self, constants, penetration):
        return self.factor * self.law.energy(constants, penetration)
