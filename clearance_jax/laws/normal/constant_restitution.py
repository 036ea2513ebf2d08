"""Laws whose restitution is the same at every impact speed, without memory: F = K d^n + c d^((n-1)/2) d'.

With u ~ d^((n+1)/2) an impact of a mass m is that of a linear oscillator of the damping ratio b = -ln e /
sqrt(pi^2 + ln(e)^2), for which c = b sqrt(2 (n + 1) m K). So they need the effective mass of the impact,
m1 m2/(m1 + m2) of two free bodies.
"""

import dataclasses
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from clearance_jax._basis.numerics import greater, within
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness, stiffness_of
from clearance_jax.laws.normal.power_laws import power, power_energy
from clearance_jax.laws.normal.ratios import oscillator_ratio, oscillator_restitution
from clearance_jax.laws.normal.restitution import Damped
from clearance_jax.parameters import describe, physical

MASS = "effective mass of the impact, m1 m2/(m1 + m2) of two free bodies"
CLIPPED = "whether the force never pulls: max(0, F)"


# The depth of the onset is that of an impact at the speed SLOW [m/s]: this changes the restitution at a speed v by
# SLOW / (3 v). It is at least the part SHALLOW of the clearance: less is hidden by the round-off of a place.
SLOW, SHALLOW = 1e-9, 1e-10


class Gradual(NamedTuple):
    """Constants of `Tsuji`: those of a damped law, and the depth of its onset [m]."""

    stiffness: Scalar
    damping: Scalar
    onset: Scalar


def fourth_root(penetration: Scalar, onset: Scalar) -> Scalar:
    """d^(1/4), but w^(1/4) P(d/w) for d < w. The polynomial P continues it with two continuous derivatives, and its
    slope at first touch is zero. (Derivatives of a motion with an infinite slope there cannot be resolved in time.)
    """
    s = within(penetration / onset, 0.0, 1.0)
    return jnp.sqrt(jnp.sqrt(greater(penetration, onset))) * s * s * (165 + s * (77 * s - 210)) / 32


def damping_of(stiffness: Scalar, restitution: Scalar, mass: Scalar, exponent: float) -> Scalar:
    """The coefficient b sqrt(2 (n + 1) m K) of d^((n-1)/2) d'."""
    return oscillator_ratio(restitution, False) * jnp.sqrt(2 * (exponent + 1) * mass * stiffness)


class AbstractOscillator(AbstractNormalLaw):
    """A law with the same restitution at every speed."""

    stiffness: eqx.AbstractVar[Any]
    restitution: eqx.AbstractVar[Scalar]
    effective_mass: eqx.AbstractVar[Scalar]
    clipped: eqx.AbstractVar[bool]

    @property
    def clips(self):
        return self.clipped

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        """The restitution that a free impact really has; without `mass`, that of the effective mass."""
        ratio = oscillator_ratio(self.restitution, False)
        # The damping was chosen for `effective_mass` and is the same for another mass, so the ratio changes.
        light = 1.0 if mass is None else jnp.sqrt(self.effective_mass / mass)
        return oscillator_restitution(ratio * light, self.clipped)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        """The law with the numbers that deliver a `restitution` for the `mass`, by default its own."""
        mass = self.effective_mass if mass is None else jnp.asarray(mass, float)
        ratio = oscillator_ratio(jnp.asarray(restitution, float), self.clipped)
        if not isinstance(ratio, Tracer) and not np.all(ratio < 1):
            raise ClearanceError(
                f"`restitution` must be above 0.1353 for `{type(self).__name__}` with `clipped`, which has no more "
                "damping. Choose `exact_restitution`."
            ).about("restitution", restitution, 0.1353)
        return dataclasses.replace(self, restitution=oscillator_restitution(ratio, False), effective_mass=mass)


class Tsuji(AbstractOscillator):
    """F = K d^(3/2) + sqrt(5) b sqrt(m K) d^(1/4) d', with b = -ln e / sqrt(pi^2 + ln(e)^2) (Tsuji et al. 1992). It
    delivers e at every speed if it may pull before separation, as it does by default. The slope of d^(1/4) would be
    infinite at first touch: it starts with slope zero, over the depth of an impact at 1e-9 m/s or 1e-10 clearances.

    **Arguments:** `stiffness` K [N/m^1.5]; `restitution` e in (0, 1); `effective_mass` m [kg]; `clipped`: F is never
    below zero: it delivers 0.902, 0.718, 0.550, 0.397 for 0.9, 0.7, 0.5, 0.3 then.
    """

    stiffness: Any = physical("N/m^1.5", "stiffness K", '"2.487e6 N/mm^1.5"', above=0.0)
    restitution: Scalar = physical("", "coefficient of restitution e", "0.7", above=0.0, below=1.0)
    effective_mass: Scalar = physical("kg", MASS, '"2 kg"', above=0.0)
    clipped: bool = describe(CLIPPED, "true", static=True, default=False)
    smoothness: ClassVar[Smoothness] = "C0"

    def constants(self, geometry):
        stiffness, mass = stiffness_of(self.stiffness, geometry), self.effective_mass
        onset = greater((1.25 * mass * SLOW**2 / stiffness) ** 0.4, SHALLOW * geometry.radial_clearance)
        return Gradual(stiffness, damping_of(stiffness, self.restitution, mass, 1.5), onset)

    def formula(self, constants, penetration, penetration_rate, memory):
        damping = constants.damping * fourth_root(penetration, constants.onset)
        return constants.stiffness * power(penetration, None) + damping * penetration_rate

    def energy(self, constants, penetration):
        return power_energy(constants.stiffness, penetration, None)


class Anagnostopoulos(AbstractOscillator):
    """F = K d + 2 b sqrt(m K) d', with b = -ln e / sqrt(pi^2 + ln(e)^2) (Anagnostopoulos 1988). It delivers e at every
    speed if it may pull before separation, as it does by default. The force jumps at first touch (class C-1).

    **Arguments:** `stiffness` K [N/m]; `restitution` e in (0, 1); `effective_mass` m [kg]; `clipped`: F is never below
    zero.
    """

    stiffness: Any = physical("N/m", "stiffness k", '"1e7 N/m"', above=0.0)
    restitution: Scalar = physical("", "coefficient of restitution e", "0.7", above=0.0, below=1.0)
    effective_mass: Scalar = physical("kg", MASS, '"2 kg"', above=0.0)
    clipped: bool = describe(CLIPPED, "true", static=True, default=False)
    smoothness: ClassVar[Smoothness] = "C-1"
    smooth_alternative: ClassVar[str] = "`exact_restitution` (class C1)"

    def constants(self, geometry):
        stiffness = stiffness_of(self.stiffness, geometry, linear=True)
        return Damped(stiffness, damping_of(stiffness, self.restitution, self.effective_mass, 1.0))

    def formula(self, constants, penetration, penetration_rate, memory):
        return constants.stiffness * penetration + constants.damping_ratio * penetration_rate

    def energy(self, constants, penetration):
        return 0.5 * constants.stiffness * jnp.where(penetration > 0, penetration, 0.0) ** 2
