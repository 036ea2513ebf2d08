"""Hertz's elastic contact, and Hunt and Crossley's damping of it."""

import dataclasses
from typing import Any, ClassVar

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws.free_impact import needed
from clearance_jax.laws.normal import ratios
from clearance_jax.laws.normal._power import STIFFNESS, AbstractPowerLaw, power
from clearance_jax.parameters import physical


class Hertz(AbstractPowerLaw):
    """F = K d^n, elastic. **Arguments:** `stiffness` K [N/m^n], `exponent` n >= 1 (`None`: 3/2)."""

    stiffness: Any = physical(STIFFNESS, above=0.0, help="stiffness K", example='"2.487e6 N/mm^1.5"')
    exponent: Scalar | None = physical(
        "", least=1.0, default=None, help="exponent n of the penetration", example="1.5", absent="1.5"
    )
    smoothness: ClassVar[Smoothness] = "C1"

    @property
    def clips(self):
        return False

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants * power(penetration, self.exponent)

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        return jnp.ones(())


class HuntCrossley(AbstractPowerLaw):
    """F = max(0, K d^n (1 + lambda d')) with a fixed factor: no memory, so restitution falls with impact speed,
    e = 1 - (2/3) lambda v + (4/9)(lambda v)^2 - ... (Hunt and Crossley 1975, doi 10.1115/1.3423596).

    **Arguments:** `stiffness` K [N/m^n], `damping_factor` lambda [s/m], `exponent` n (`None`: 3/2).
    """

    stiffness: Any = physical(STIFFNESS, above=0.0, help="stiffness K", example='"2.487e6 N/mm^1.5"')
    damping_factor: Scalar = physical("s/m", least=0.0, help="damping factor lambda", example='"20 s/m"')
    exponent: Scalar | None = physical(
        "", least=1.0, default=None, help="exponent n of the penetration", example="1.5", absent="1.5"
    )
    smoothness: ClassVar[Smoothness] = "C1"

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants * power(penetration, self.exponent) * (1 + self.damping_factor * penetration_rate)

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        return ratios.delivered_restitution(self.damping_factor * needed(speed, "speed", self))

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        ratio = ratios.exact_ratio(jnp.asarray(restitution, float))
        return dataclasses.replace(self, damping_factor=ratio / needed(speed, "speed", self))
