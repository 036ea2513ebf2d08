"""The family that remembers its impact speed: F = K d^n (1 + a(e) d'/v0).

v0 is the approach speed at the last touch, an event state: it is latched when contact begins. Members differ only in
the damping ratio a(e) for a coefficient of restitution e; a member is a function and a catalogue line.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.numerics import greater, lesser
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import AbstractNormalLaw, Smoothness, stiffness_of
from clearance_jax.laws.normal import ratios
from clearance_jax.laws.normal.power_laws import EXPONENT, STIFF, STIFFNESS, power, power_energy, stiffness_unit
from clearance_jax.parameters import physical

RESTITUTION = "coefficient of restitution e"
SLOWEST = "slower impacts are damped as if they had this speed"


class AbstractImpactLaw(AbstractNormalLaw):
    """A law with an elastic force F_e, and a damping that remembers the speed v0 of the last impact; without
    `restitution` it is elastic. Its constants have a `damping_ratio`.
    """

    restitution: eqx.AbstractVar[Scalar | None]
    ratio: eqx.AbstractVar[Callable]
    minimum_impact_speed: eqx.AbstractVar[Scalar]

    @property
    def remembers(self):  # type: ignore[override]
        return () if self.restitution is None else ("impact_speed",)

    @property
    def clips(self):
        return self.restitution is not None

    @property
    def damping_ratio(self) -> Scalar | None:
        """a(e); `None`: elastic."""
        return None if self.restitution is None else self.ratio(self.restitution)

    def delivered_restitution(self, speed=None, mass=None, geometry=None):
        """The restitution that a free impact really has: without `speed`, of one faster than `minimum_impact_speed`."""
        ratio = self.damping_ratio
        if ratio is None:
            return jnp.ones(())
        slow = 1.0 if speed is None else lesser(speed / self.minimum_impact_speed, 1.0)
        return ratios.delivered_restitution(ratio * slow)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        """The law with the `restitution` as its own, and the ratio a(e) that delivers it."""
        numbers = {"restitution": jnp.asarray(restitution, float), "ratio": ratios.exact_ratio}
        return dataclasses.replace(self, **numbers)

    @abc.abstractmethod
    def elastic(self, constants: Any, penetration: Scalar) -> Scalar:
        """The elastic force F_e [N]."""

    def formula(self, constants, penetration, penetration_rate, memory):
        elastic = self.elastic(constants, penetration)
        if constants.damping_ratio is None:
            return elastic
        speed = greater(memory[0], self.minimum_impact_speed)
        return elastic * (1 + constants.damping_ratio * penetration_rate / speed)

    def latch(self, constants, memory, touch):
        if not memory:
            return memory
        speed = jnp.where(touch.began, greater(touch.penetration_rate, self.minimum_impact_speed), memory[0])
        return (jnp.where(touch.ended, 0.0, speed),)


class Damped(NamedTuple):
    """Constants of a `RestitutionLaw`."""

    stiffness: Scalar
    damping_ratio: Scalar


class RestitutionLaw(AbstractImpactLaw):
    """F = max(0, K d^n (1 + a d'/v0)), with a = ratio(e) and v0 the speed of the last impact.

    **Arguments:** `stiffness` K [N/m^n]; `restitution` e in (0, 1); `ratio`: the function a(e), which tells the laws of
    this kind apart; `exponent` n (`None`: 3/2); `minimum_impact_speed` [m/s]: v0 is never less, because a/v0 grows
    without bound for a pin that comes to rest. Laws by their authors' names (`flores`) take the same, without `ratio`.
    """

    stiffness: Any = physical(STIFFNESS, **STIFF)
    restitution: Scalar = physical("", RESTITUTION, "0.7", above=0.0, below=1.0)
    ratio: Callable = eqx.field(static=True, default=ratios.exact_ratio)
    exponent: Scalar | None = physical("", **EXPONENT)
    minimum_impact_speed: Scalar = physical("m/s", SLOWEST, '"1 mm/s"', above=0.0, default=1e-3)
    smoothness: ClassVar[Smoothness] = "C1"

    def units(self):
        return stiffness_unit(self.exponent)

    def constants(self, geometry):
        return Damped(stiffness_of(self.stiffness, geometry), self.ratio(self.restitution))

    def elastic(self, constants, penetration):
        return constants.stiffness * power(penetration, self.exponent)

    def energy(self, constants, penetration):
        return power_energy(constants.stiffness, penetration, self.exponent)


def exact_restitution(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law that delivers the `restitution` that you give, for every `stiffness`, exponent, mass and
    speed.
    """
    return RestitutionLaw(stiffness, restitution, ratios.exact_ratio, **options)


def lankarani_nikravesh(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Lankarani and Nikravesh (1990, doi 10.1115/1.2912617): e =
    0.69 for 0.4, 0.91 for 0.9.
    """
    return RestitutionLaw(stiffness, restitution, ratios.lankarani_nikravesh_ratio, **options)


def flores(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Flores et al. (2011, doi 10.1007/s11044-010-9237-4)."""
    return RestitutionLaw(stiffness, restitution, ratios.flores_ratio, **options)


def hunt_crossley(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Hunt and Crossley (1975, doi 10.1115/1.3423596) with the
    speed of the last impact; `HuntCrossley` has a fixed factor. It delivers e = 0.66 for 0.5 and 0.91 for 0.9.
    """
    return RestitutionLaw(stiffness, restitution, ratios.hunt_crossley_ratio, **options)


def herbert_mcwhannell(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Herbert and McWhannell (1977): e = 0.59 for 0.5,
    0.90 for 0.9.
    """
    return RestitutionLaw(stiffness, restitution, ratios.herbert_mcwhannell_ratio, **options)


def lee_wang(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Lee and Wang (1983): e = 0.80 for 0.5, 0.95 for 0.9."""
    return RestitutionLaw(stiffness, restitution, ratios.lee_wang_ratio, **options)


def gonthier(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Gonthier et al. (2004): e = 0.49 for 0.5, 0.88 for 0.9."""
    return RestitutionLaw(stiffness, restitution, ratios.gonthier_ratio, **options)


def zhiying_qishao(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Zhiying, Qishao (2006): e = 0.48 for 0.5, 0.90 for 0.9."""
    return RestitutionLaw(stiffness, restitution, ratios.zhiying_qishao_ratio, **options)


def hu_guo(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Hu and Guo (2015): e = 0.49 for 0.5, 0.90 for 0.9."""
    return RestitutionLaw(stiffness, restitution, ratios.hu_guo_ratio, **options)


def gharib_hurmuzlu(stiffness, restitution, **options) -> RestitutionLaw:
    """The `RestitutionLaw` (`stiffness`, `restitution`) of Gharib and Hurmuzlu (2012), for small ones: it delivers e =
    0.41 for 0.5 and 0.57 for 0.9.
    """
    return RestitutionLaw(stiffness, restitution, ratios.gharib_hurmuzlu_ratio, **options)
