"""Normal laws without memory: the force is a function of penetration and penetration rate only."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import Real, positive_part, step3
from clearance_jax._types import Number, physical
from clearance_jax.laws._base import (
    APART,
    CONTACT,
    AbstractNormalLaw,
    AbstractStiffness,
    Memory,
    Regime,
    Smoothness,
    number,
)
from clearance_jax.laws._elastic import elastic_energy, elastic_force


class LinearKelvinVoigt(AbstractNormalLaw):
    """A spring beside a dashpot.

    F = k d + b d_dot for d > 0, clipped at 0 if `clipped`

    Source: FACTS.md 1.1 and 4.3. The force jumps by b v0 at first touch, and without the clip it pulls just before
    separation: with zeta = b / (2 sqrt(k m)) a free impact returns e = exp(-pi zeta / sqrt(1 - zeta^2)) of its speed.

    **Arguments:**

    - `stiffness`: k [N/m].
    - `damping`: b [N s/m].
    - `clipped`: whether the contact can only push. A structural choice, not a number.
    """

    smoothness: ClassVar[Smoothness] = "C-1"
    stiffness: Number | AbstractStiffness = physical("N/m", above=0.0)
    damping: Number = physical("N*s/m", least=0.0)
    clipped: bool = eqx.field(static=True, default=True)

    def __call__(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        force = self.unclipped(penetration, penetration_rate, memory)
        return positive_part(force) if self.clipped else force

    def unclipped(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        force = number(self.stiffness) * penetration + self.damping * penetration_rate
        return jnp.where(penetration > 0, force, 0.0)

    def energy(self, penetration: Real) -> Real:
        overlap = positive_part(penetration)
        return 0.5 * number(self.stiffness) * overlap * overlap

    def regime(self, penetration: Array, penetration_rate: Array, memory: Memory) -> Regime:
        # A force that is allowed to pull has no edge where its sign changes.
        if self.clipped:
            return AbstractNormalLaw.regime(self, penetration, penetration_rate, memory)
        return jnp.where(penetration > 0, CONTACT, APART)


class Hertz(AbstractNormalLaw):
    """Elastic point contact, no loss.

    F = K d^n for d > 0

    Source: Hertz (n = 3/2); FACTS.md 1.1. A free impact of a mass m at v0 has d_max^(n+1) = (n+1) m v0^2 / (2 K).

    **Arguments:**

    - `stiffness`: K [N/m^n], or a stiffness computed from the geometry.
    - `exponent`: n [1], above 1; `None` means 3/2.
    """

    smoothness: ClassVar[Smoothness] = "C1"
    stiffness: Number | AbstractStiffness = physical("N/m**1.5", above=0.0)
    exponent: Number | None = physical("1", above=1.0, default=None)

    def __call__(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        return elastic_force(self.stiffness, self.exponent, penetration)

    def energy(self, penetration: Real) -> Real:
        return elastic_energy(self.stiffness, self.exponent, penetration)


class AdamsImpact(AbstractNormalLaw):
    """The IMPACT function of MSC Adams: an elastic power law and a dashpot that fades in with depth.

    F = max(0, K d^n + c(d) d_dot) for d > 0,  c(d) = c_max STEP(d / d_max),  STEP(s) = s^2 (3 - 2 s) on [0, 1]

    Source: the Adams IMPACT and STEP manual pages (FACTS.md 1.3; the max is part of the definition); Qian et al.,
    Appl. Sci. 2022, 12(21), 11041, Eqs. 6 and 7 (whose last branch must read c_max for d >= d_max).

    The delivered restitution depends on mass and speed and has no closed form. The paper's values are overdamped for
    a heavy body: 300 kg at 20 mm/s rebounds with 4.5 % of its speed.

    **Arguments:**

    - `stiffness`: K [N/m^n], or a stiffness computed from the geometry.
    - `damping`: c_max [N s/m], the damping at full depth. The manual advises 1 % of K, in mm units.
    - `full_damping_depth`: d_max [m], the penetration from which the damping is full; 0.01 mm in the manual.
    - `exponent`: n [1], above 1; `None` means 3/2.
    """

    smoothness: ClassVar[Smoothness] = "C1"
    stiffness: Number | AbstractStiffness = physical("N/m**1.5", above=0.0)
    damping: Number = physical("N*s/m", least=0.0)
    full_damping_depth: Number = physical("m", above=0.0)
    exponent: Number | None = physical("1", above=1.0, default=None)

    def __call__(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        return positive_part(self.unclipped(penetration, penetration_rate, memory))

    def unclipped(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        damping = self.damping * step3(penetration / self.full_damping_depth)
        return elastic_force(self.stiffness, self.exponent, penetration) + damping * penetration_rate

    def energy(self, penetration: Real) -> Real:
        return elastic_energy(self.stiffness, self.exponent, penetration)


class HuntCrossley(AbstractNormalLaw):
    """Hunt and Crossley's law with a fixed dissipation: no memory, a restitution that falls with speed.

    F = max(0, K d^n (1 + lambda d_dot))

    Source: Hunt and Crossley (1975) as used by Marhefka and Orin (FACTS.md 1.2). A free impact at v0 is that of
    `Hysteresis` with a = lambda v0: e = 1 - 2/3 lambda v0 + 4/9 (lambda v0)^2 - ... for small lambda v0. Without a
    latched speed the force is smooth in the state, which makes derivatives through many impacts tame.

    **Arguments:**

    - `stiffness`: K [N/m^n], or a stiffness computed from the geometry.
    - `dissipation`: lambda [s/m].
    - `exponent`: n [1], above 1; `None` means 3/2.
    """

    smoothness: ClassVar[Smoothness] = "C1"
    stiffness: Number | AbstractStiffness = physical("N/m**1.5", above=0.0)
    dissipation: Number = physical("s/m", least=0.0)
    exponent: Number | None = physical("1", above=1.0, default=None)

    def __call__(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        return positive_part(self.unclipped(penetration, penetration_rate, memory))

    def unclipped(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        elastic = elastic_force(self.stiffness, self.exponent, penetration)
        return elastic * (1 + self.dissipation * penetration_rate)

    def energy(self, penetration: Real) -> Real:
        return elastic_energy(self.stiffness, self.exponent, penetration)
