"""A law with its onset smoothed, so that it has derivatives that can be trusted."""

from typing import Any, ClassVar

import jax.numpy as jnp

from clearance_jax._numerics import step5
from clearance_jax._types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness
from clearance_jax.parameters import flatten, physical


class SmoothedOnset(AbstractNormalLaw):
    """F = F_e(d) + STEP5(d / w) (F - F_e): a law whose damping grows over the depth w from nothing at first touch,
    instead of being there at once. F_e is the elastic force of the law, that is, its force at rest.

    So a law of class C-1 (a linear damper) becomes one of class C0, whose derivatives can be trusted. The elastic
    energy is that of the law.

    **Arguments:** `law`, without memory; `width` w [m] > 0: much larger than the round-off of d, and small against the
    penetration.
    """

    law: AbstractNormalLaw = flatten()
    width: Scalar = physical("m", above=0.0)
    smoothness: ClassVar[Smoothness] = "C0"

    @property
    def clips(self):
        return self.law.clips

    def units(self):
        return self.law.units()

    def constants(self, geometry) -> Any:
        return self.law.constants(geometry)

    def formula(self, constants, penetration, penetration_rate, memory):
        elastic = self.law.formula(constants, penetration, jnp.zeros_like(penetration_rate), memory)
        whole = self.law.formula(constants, penetration, penetration_rate, memory)
        return elastic + step5(penetration / self.width) * (whole - elastic)

    def event_functions(self, constants, penetration, penetration_rate, memory):
        return (penetration - self.width, *self.law.event_functions(constants, penetration, penetration_rate, memory))

    def energy(self, constants, penetration):
        return self.law.energy(constants, penetration)

    def __check_init__(self):
        if self.law.remembers:
            raise ValueError("Only a law without memory can have its onset smoothed.")
