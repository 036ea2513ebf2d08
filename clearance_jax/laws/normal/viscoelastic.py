"""A sleeve that relaxes: rubber, a polymer bush."""

from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp

from clearance_jax._basis.numerics import greater, positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness, stiffness_of
from clearance_jax.laws.normal.power_laws import STIFFNESS, power, power_energy, stiffness_unit
from clearance_jax.parameters import physical

# A usual penetration for the error control, over the clearance.
USUAL = 1e-2


class Relaxing(NamedTuple):
    """Constants of a `StandardLinearSolid`."""

    stiffness: Scalar
    memory_scale: Scalar


class StandardLinearSolid(AbstractNormalLaw):
    """F = max(0, K (s - g z)) with s = max(0, d)^n and z' = (max(s, g z) - z)/T: a spring beside a spring and damper in
    series. Under a constant penetration the share g of the force relaxes with the time T.

    Where the pin is apart, or leaves a wall that is slower than itself, s < g z: the wall recovers free of force.
    The elastic energy is that of the spring that does not relax; what the other one holds counts as lost until it comes
    back.

    **Arguments:** `stiffness` K [N/m^n] at an instant; `relaxing_share` g in (0, 1); `relaxation_time` T [s];
    `exponent` n (`None`: 1; 3/2 for a contact of spheres, where it holds while the contact grows).
    """

    stiffness: Any = physical(STIFFNESS, "stiffness K", '"2.487e6 N/mm^1.5"', above=0.0)
    relaxing_share: Scalar = physical("", "share of the force that relaxes", "0.4", above=0.0, below=1.0)
    relaxation_time: Scalar = physical("s", "time of the relaxation", '"5 ms"', above=0.0)
    exponent: Scalar | None = physical(
        "", "exponent n of the penetration of a standard linear solid", "1.5", "1", least=1.0, default=None
    )
    smoothness: ClassVar[Smoothness] = "C0"
    remembers: ClassVar[tuple[str, ...]] = ("flow",)
    acts_apart: ClassVar[bool] = True
    has_static_force: ClassVar[bool] = False

    def units(self):
        return stiffness_unit(self.exponent, absent=1.0)

    def constants(self, geometry):
        usual = self._stretch(USUAL * geometry.radial_clearance)
        return Relaxing(stiffness_of(self.stiffness, geometry, self.exponent is None), usual)

    def _stretch(self, penetration):
        return (
            jnp.where(penetration > 0, penetration, 0.0) if self.exponent is None else power(penetration, self.exponent)
        )

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants.stiffness * (self._stretch(penetration) - self.relaxing_share * memory[0])

    def memory_rate(self, constants, penetration, penetration_rate, memory):
        wall = greater(self._stretch(penetration), self.relaxing_share * memory[0])
        return ((wall - memory[0]) / self.relaxation_time,)

    def memory_scale(self, constants):
        return (constants.memory_scale,)

    def energy(self, constants, penetration):
        lasting = (1 - self.relaxing_share) * constants.stiffness
        if self.exponent is None:
            return 0.5 * lasting * positive_part(penetration) ** 2
        return power_energy(lasting, penetration, self.exponent)
