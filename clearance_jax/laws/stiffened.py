"""A normal law with its elastic part so many times stiffer: to tell play from elasticity."""

from typing import ClassVar

from clearance_jax._types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness
from clearance_jax.parameters import physical


class Stiffened(AbstractNormalLaw):
    """`factor` times the force and the energy of a `law`."""

    law: AbstractNormalLaw
    factor: Scalar = physical("", above=0.0, help="by how much it is stiffer", example="1e6")
    smoothness: ClassVar[Smoothness] = "C0"

    @property
    def clips(self):
        return self.law.clips

    @property
    def remembers(self):  # type: ignore[override]
        return self.law.remembers

    def constants(self, geometry):
        return self.law.constants(geometry)

    def localise(self, constants, local):
        return self.law.localise(constants, local)

    def validity(self, constants):
        return self.law.validity(constants)

    @property
    def validity_reason(self):
        return self.law.validity_reason

    def formula(self, constants, penetration, penetration_rate, memory):
        return self.factor * self.law.formula(constants, penetration, penetration_rate, memory)

    def energy(self, constants, penetration):
        return self.factor * self.law.energy(constants, penetration)

    def event_functions(self, constants, penetration, penetration_rate, memory):
        return self.law.event_functions(constants, penetration, penetration_rate, memory)

    def memory_rate(self, constants, penetration, penetration_rate, memory):
        return self.law.memory_rate(constants, penetration, penetration_rate, memory)

    def latch(self, constants, memory, touch):
        return self.law.latch(constants, memory, touch)

    def memory_scale(self, constants):
        return self.law.memory_scale(constants)
