"""The linear spring and damper."""

import dataclasses
from typing import Any, ClassVar

import jax.numpy as jnp

from clearance_jax._basis.numerics import positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness, stiffness_of
from clearance_jax.laws.free_impact import needed
from clearance_jax.laws.normal.oscillator import oscillator_ratio, oscillator_restitution
from clearance_jax.parameters import describe, physical


class LinearKelvinVoigt(AbstractNormalLaw):
    """F = max(0, k d + b d'). The force jumps to b v at touch (class C-1: it has no derivative that can be trusted; use
    `HuntCrossley`). Without damping it is a spring, of class C0.

    **Arguments:** `stiffness` k [N/m]; `damping` b [N s/m]; `clipped`: F is max(0, k d + b d'); otherwise it pulls
    before separation.
    """

    stiffness: Any = physical("N/m", above=0.0, help="stiffness k", example='"1e7 N/m"')
    damping: Scalar = physical("N*s/m", least=0.0, help="damping b", example='"500 N*s/m"')
    clipped: bool = describe("whether the force never pulls: max(0, k d + b d')", "false", static=True, default=True)
    smooth_alternative: ClassVar[str] = "`HuntCrossley` (class C1), or `damping` 0 that is not traced,"

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        try:
            return "C0" if float(self.damping) == 0 else "C-1"
        except TypeError:  # traced, or one for each lane
            return "C-1"

    @property
    def clips(self):
        return self.clipped

    def constants(self, geometry):
        return stiffness_of(self.stiffness, geometry, linear=True)

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants * penetration + self.damping * penetration_rate

    def energy(self, constants, penetration):
        return 0.5 * constants * positive_part(penetration) ** 2

    def _critical(self, mass: Any, geometry: Any) -> Any:
        """The damping above which an impact does not swing [N s/m]."""
        return 2 * jnp.sqrt(self.constants(geometry) * needed(mass, "mass", self))

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        return oscillator_restitution(self.damping / self._critical(mass, geometry), self.clipped)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        ratio = oscillator_ratio(jnp.asarray(restitution, float), self.clipped)
        return dataclasses.replace(self, damping=ratio * self._critical(mass, geometry))
