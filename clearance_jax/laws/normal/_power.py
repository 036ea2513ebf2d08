"""The power law that most normal laws share: K d^n, its energy, and the unit of its stiffness."""

from typing import Any

import equinox as eqx

from clearance_jax._basis.numerics import positive_part, positive_power, power_three_halves
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, stiffness_of
from clearance_jax.laws.geometry import Geometry

STIFFNESS = "N/m^n"


def power(penetration: Scalar, exponent: Scalar | None) -> Scalar:
    """max(d, 0)^n; n = `None` means 3/2, computed as d sqrt(d)."""
    return power_three_halves(penetration) if exponent is None else positive_power(penetration, exponent)


def stiffness_unit(exponent: Scalar | None, absent: float = 1.5) -> dict[str, str]:
    """The unit of a stiffness of a power law; an exponent `None` stands for `absent`."""
    # A traced exponent has no value to show.
    try:
        n = absent if exponent is None else float(exponent)
    except TypeError:
        return {}
    return {STIFFNESS: f"N/m^{n:g}"}


class AbstractPowerLaw(AbstractNormalLaw):
    """A law whose elastic part is K d^n (n = `None`: 3/2)."""

    stiffness: eqx.AbstractVar[Any]
    exponent: eqx.AbstractVar[Scalar | None]

    def units(self):
        return stiffness_unit(self.exponent)

    def constants(self, geometry: Geometry) -> Any:
        return stiffness_of(self.stiffness, geometry)

    def energy(self, constants, penetration):
        return power_energy(constants, penetration, self.exponent)


def power_energy(stiffness: Scalar, penetration: Scalar, exponent: Scalar | None) -> Scalar:
    """K d^(n+1) / (n+1) for d > 0."""
    n = 1.5 if exponent is None else exponent
    return stiffness * positive_part(penetration) * power(penetration, exponent) / (n + 1)
