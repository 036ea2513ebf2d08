"""The family that remembers its impact speed: F = K d^n (1 + a(e) d'/v0).

v0 is the approach speed at the last touch, an event state: it is latched when contact begins. Members differ only in
the damping ratio a(e) for a coefficient of restitution e; a member is a function and a catalogue line.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from clearance_jax._types import Scalar
from clearance_jax.laws._base import Smoothness, stiffness_of
from clearance_jax.laws.normal._power import STIFFNESS, AbstractPowerLaw, power, power_energy
from clearance_jax.parameters import physical


def lankarani_nikravesh_ratio(restitution):
    """A = 3 (1 - e^2) / 4 (Lankarani and Nikravesh 1990, doi 10.1115/1.2912617)."""
    return 0.75 * (1 - restitution**2)


def flores_ratio(restitution):
    """A = 8 (1 - e) / (5 e) (Flores et al. 2011, doi 10.1007/s11044-010-9237-4)."""
    return 1.6 * (1 - restitution) / restitution


def exact_ratio(restitution):
    """The root of a (1 + e) = ln((1 + a)/(1 - a e)): delivers e exactly for every n, K, mass and speed.

    Derived from the phase-plane integral of the impact. Newton from a fit that is good to 0.002 in e; the last of the
    iterations is the implicit derivative, the ones before it are hidden from differentiation.
    """
    e = restitution
    # Newton for w = ln(1 - a e): near a = 1/e (small e) the logarithm's pole is gone, and for e -> 1 the fit starts on
    # the right side of the trivial root a = 0.
    fit = (1 - e) / e * (1.5 - 0.5 * (1 - e) ** 2.85)
    start = jnp.where(e < 0.3, jnp.log1p(1 / e) - (1 + e) / e, jnp.log1p(-e * jnp.where(e < 0.3, 0.0, fit)))

    def newton(w, e):
        a = -jnp.expm1(w) / e
        slope = 1 - jnp.exp(w) / e * ((1 + e) - 1 / (1 + a))
        return w - (w - jnp.log1p(a) + a * (1 + e)) / slope

    fixed = jax.lax.stop_gradient(e)
    w = jax.lax.fori_loop(0, 12, lambda _, w: newton(w, fixed), jax.lax.stop_gradient(start))
    return -jnp.expm1(newton(jax.lax.stop_gradient(w), e)) / e


class Damped(NamedTuple):
    """Constants of a `RestitutionLaw`."""

    stiffness: Scalar
    damping_ratio: Scalar


class RestitutionLaw(AbstractPowerLaw):
    """F = max(0, K d^n (1 + a d'/v0)), with a = ratio(e) and v0 the speed of the last impact.

    **Arguments:** `stiffness` K [N/m^n]; `restitution` e in (0, 1); `ratio`: the function a(e), which tells the laws of
    this kind apart; `exponent` n (`None`: 3/2); `minimum_impact_speed` [m/s]: v0 is never less, because a/v0 grows
    without bound for a pin that comes to rest.
    """

    stiffness: Any = physical(STIFFNESS, above=0.0, help="stiffness K", example='"2.487e6 N/mm^1.5"')
    restitution: Scalar = physical("", above=0.0, below=1.0, help="coefficient of restitution e", example="0.7")
    ratio: Callable = eqx.field(static=True, default=exact_ratio)
    exponent: Scalar | None = physical(
        "", least=1.0, default=None, help="exponent n of the penetration", example="1.5", absent="1.5"
    )
    minimum_impact_speed: Scalar = physical(
        "m/s", above=0.0, default=1e-3, help="the least impact speed that it reckons with", example='"1 mm/s"'
    )
    smoothness: ClassVar[Smoothness] = "C1"
    remembers: ClassVar[tuple[str, ...]] = ("impact_speed",)

    def constants(self, geometry):
        return Damped(stiffness_of(self.stiffness, geometry), self.ratio(self.restitution))

    def formula(self, constants, penetration, penetration_rate, memory):
        speed = jnp.maximum(memory[0], self.minimum_impact_speed)
        elastic = constants.stiffness * power(penetration, self.exponent)
        return elastic * (1 + constants.damping_ratio * penetration_rate / speed)

    def energy(self, constants, penetration):
        return power_energy(constants.stiffness, penetration, self.exponent)

    def latch(self, constants, memory, touch):
        speed = jnp.where(touch.began, jnp.maximum(touch.penetration_rate, self.minimum_impact_speed), memory[0])
        return (jnp.where(touch.ended, 0.0, speed),)


def exact_restitution(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law that delivers the `restitution` that you give, for every `stiffness`, exponent, mass and
    speed.

    **Arguments:** as those of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, exact_ratio, **options)


def lankarani_nikravesh(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Lankarani and Nikravesh (1990, doi 10.1115/1.2912617). It delivers e = 0.69 for 0.4 and
    0.91 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, lankarani_nikravesh_ratio, **options)


def flores(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Flores et al. (2011, doi 10.1007/s11044-010-9237-4).

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, flores_ratio, **options)
