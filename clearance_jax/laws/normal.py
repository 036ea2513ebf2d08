"""Normal laws without memory: linear Kelvin-Voigt, Hertz, ADAMS IMPACT, Hunt-Crossley with a fixed factor."""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._numerics import positive_part, positive_power, power_three_halves, step3
from clearance_jax._types import Scalar, physical
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness


def hertz_power(penetration, exponent):
    """max(d, 0)^n; n = `None` means 3/2, computed as d sqrt(d)."""
    return power_three_halves(penetration) if exponent is None else positive_power(penetration, exponent)


def hertz_energy(stiffness, penetration, exponent):
    """K d^(n+1) / (n+1) for d > 0."""
    n = 1.5 if exponent is None else exponent
    return stiffness * positive_part(penetration) * hertz_power(penetration, exponent) / (n + 1)


class LinearKelvinVoigt(AbstractNormalLaw):
    """F = k d + b d'. The force jumps to b v at touch (class C-1: no trustworthy derivative; use `HuntCrossley`).

    Unclipped, it pulls before separation; clipped, F = max(0, k d + b d').

    **Arguments:** `stiffness` k [N/m], `damping` b [N s/m], `clipped`.
    """

    stiffness: Any = physical("N/m", above=0.0)
    damping: Scalar = physical("N*s/m", least=0.0)
    clipped: bool = eqx.field(static=True, default=True)
    smoothness: ClassVar[Smoothness] = "C-1"
    smooth_alternative: ClassVar[str] = "`HuntCrossley` (class C1)"

    def unclipped(self, penetration, penetration_rate, memory):
        force = self.stiffness * penetration + self.damping * penetration_rate
        return jnp.where(penetration > 0, force, 0.0)

    def __call__(self, penetration, penetration_rate, memory):
        force = self.unclipped(penetration, penetration_rate, memory)
        return positive_part(force) if self.clipped else force

    def energy(self, penetration):
        return 0.5 * self.stiffness * positive_part(penetration) ** 2

    def regime(self, penetration, penetration_rate, memory):
        if self.clipped:
            return super().regime(penetration, penetration_rate, memory)
        return jnp.where(penetration > 0, 2, 0)


class Hertz(AbstractNormalLaw):
    """F = K d^n, elastic. **Arguments:** `stiffness` K [N/m^n], `exponent` n >= 1 (`None`: 3/2)."""

    stiffness: Any = physical("N/m^1.5", above=0.0)
    exponent: Scalar | None = physical("", least=1.0, default=None)
    smoothness: ClassVar[Smoothness] = "C1"

    def __call__(self, penetration, penetration_rate, memory):
        return self.stiffness * hertz_power(penetration, self.exponent)

    def energy(self, penetration):
        return hertz_energy(self.stiffness, penetration, self.exponent)


class AdamsImpact(AbstractNormalLaw):
    """F = max(0, K d^n + STEP(d, 0, 0, d_max, c_max) d') for d > 0: the IMPACT function of MSC ADAMS.

    The outer max(0, .) belongs to the definition (SolidWorks Motion and ADAMS function manuals; Qian et al. 2022,
    Eqs. 6 and 7, doi 10.3390/app122111041).

    **Arguments:** `stiffness` K [N/m^n], `damping` c_max [N s/m], `full_damping_depth` d_max [m] at which the damping
    is complete, `exponent` n (`None`: 3/2).
    """

    stiffness: Any = physical("N/m^1.5", above=0.0)
    damping: Scalar = physical("N*s/m", least=0.0)
    full_damping_depth: Scalar = physical("m", above=0.0)
    exponent: Scalar | None = physical("", least=1.0, default=None)
    smoothness: ClassVar[Smoothness] = "C0"

    def unclipped(self, penetration, penetration_rate, memory):
        damping = self.damping * step3(penetration / self.full_damping_depth)
        return self.stiffness * hertz_power(penetration, self.exponent) + damping * penetration_rate

    def __call__(self, penetration, penetration_rate, memory):
        return positive_part(self.unclipped(penetration, penetration_rate, memory))

    def piece(self, penetration):
        # The damping's curvature jumps at d_max, by 6 c_max / d_max^2: no error estimate sees it.
        return jnp.where(penetration > self.full_damping_depth, 1, 0)

    def energy(self, penetration):
        return hertz_energy(self.stiffness, penetration, self.exponent)


class HuntCrossley(AbstractNormalLaw):
    """F = max(0, K d^n (1 + lambda d')) with a fixed factor: no memory, so restitution falls with impact speed,
    e = 1 - (2/3) lambda v + (4/9)(lambda v)^2 - ... (Hunt and Crossley 1975, doi 10.1115/1.3423596).

    **Arguments:** `stiffness` K [N/m^n], `damping_factor` lambda [s/m], `exponent` n (`None`: 3/2).
    """

    stiffness: Any = physical("N/m^1.5", above=0.0)
    damping_factor: Scalar = physical("s/m", least=0.0)
    exponent: Scalar | None = physical("", least=1.0, default=None)
    smoothness: ClassVar[Smoothness] = "C1"

    def unclipped(self, penetration, penetration_rate, memory):
        return self.stiffness * hertz_power(penetration, self.exponent) * (1 + self.damping_factor * penetration_rate)

    def __call__(self, penetration, penetration_rate, memory):
        return positive_part(self.unclipped(penetration, penetration_rate, memory))

    def energy(self, penetration):
        return hertz_energy(self.stiffness, penetration, self.exponent)
