"""Laws without memory whose elastic part is a power K d^n: linear, of Hertz, of Hunt and Crossley, of ADAMS."""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.numerics import positive_part, positive_power, power_three_halves, step3
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness, stiffness_of
from clearance_jax.laws.free_impact import damping_for, needed
from clearance_jax.laws.geometry import Geometry
from clearance_jax.laws.normal import ratios
from clearance_jax.laws.normal.ratios import oscillator_ratio, oscillator_restitution
from clearance_jax.parameters import describe, physical

STIFFNESS = "N/m^n"
STIFF = {"above": 0.0, "help": "stiffness K", "example": '"2.487e6 N/mm^1.5"'}
EXPONENT = {"least": 1.0, "default": None, "help": "exponent n of the penetration", "example": "1.5", "absent": "1.5"}


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


class LinearKelvinVoigt(AbstractNormalLaw):
    """F = max(0, k d + b d'). The force jumps to b v at touch (class C-1: it has no derivative that can be trusted; use
    `HuntCrossley`). Without damping it is a spring, of class C0.

    **Arguments:** `stiffness` k [N/m]; `damping` b [N s/m]; `clipped`: F is max(0, k d + b d'); otherwise it pulls
    before separation.
    """

    stiffness: Any = physical("N/m", "stiffness k", '"1e7 N/m"', above=0.0)
    damping: Scalar = physical("N*s/m", "damping b", '"500 N*s/m"', least=0.0)
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


class Hertz(AbstractPowerLaw):
    """F = K d^n, elastic. **Arguments:** `stiffness` K [N/m^n], `exponent` n >= 1 (`None`: 3/2)."""

    stiffness: Any = physical(STIFFNESS, **STIFF)
    exponent: Scalar | None = physical("", **EXPONENT)
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

    stiffness: Any = physical(STIFFNESS, **STIFF)
    damping_factor: Scalar = physical("s/m", "damping factor lambda", '"20 s/m"', least=0.0)
    exponent: Scalar | None = physical("", **EXPONENT)
    smoothness: ClassVar[Smoothness] = "C1"

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants * power(penetration, self.exponent) * (1 + self.damping_factor * penetration_rate)

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        return ratios.delivered_restitution(self.damping_factor * needed(speed, "speed", self))

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        ratio = ratios.exact_ratio(jnp.asarray(restitution, float))
        return dataclasses.replace(self, damping_factor=ratio / needed(speed, "speed", self))


class AdamsImpact(AbstractPowerLaw):
    """F = max(0, K d^n + STEP(d, 0, 0, d_max, c_max) d') for d > 0: the IMPACT function of MSC ADAMS.

    The outer max(0, .) belongs to the definition (SolidWorks Motion and ADAMS function manuals; Qian et al. 2022,
    Eqs. 6 and 7, doi 10.3390/app122111041).

    **Arguments:** `stiffness` K [N/m^n], `damping` c_max [N s/m], `full_damping_depth` d_max [m] at which the damping
    is complete, `exponent` n (`None`: 3/2).
    """

    stiffness: Any = physical(STIFFNESS, **STIFF)
    damping: Scalar = physical("N*s/m", "damping c_max at full depth", '"2000 N*s/m"', least=0.0)
    full_damping_depth: Scalar = physical(
        "m", "penetration d_max from which on the damping is complete", '"0.01 mm"', above=0.0
    )
    exponent: Scalar | None = physical("", **EXPONENT)
    smoothness: ClassVar[Smoothness] = "C0"

    def formula(self, constants, penetration, penetration_rate, memory):
        damping = self.damping * step3(penetration * (1.0 / self.full_damping_depth))
        return constants * power(penetration, self.exponent) + damping * penetration_rate

    def event_functions(self, constants, penetration, penetration_rate, memory):
        # The damping's curvature jumps at d_max, by 6 c_max / d_max^2: no error estimate sees it.
        return (penetration - self.full_damping_depth,)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        """The law with the damping that delivers a `restitution`; of plain numbers, since impacts are simulated."""

        def damped(damping):
            return dataclasses.replace(self, damping=damping)

        speed, mass = needed(speed, "speed", self), needed(mass, "mass", self)
        guess = mass * speed / self.full_damping_depth
        return damped(damping_for(lambda c: damped(c).delivered_restitution(speed, mass, geometry), restitution, guess))
