"""The family that remembers its impact speed: F = K d^n (1 + a(e) d'/v0).

v0 is the approach speed at the last touch, an event state: it is latched when contact begins. Members differ only in
the damping ratio a(e) for a coefficient of restitution e; a member is a function and a catalogue line.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness, stiffness_of
from clearance_jax.laws.normal import ratios
from clearance_jax.laws.normal._impact import RESTITUTION, SLOWEST, AbstractImpactLaw
from clearance_jax.laws.normal._power import STIFFNESS, power, power_energy, stiffness_unit
from clearance_jax.parameters import physical


class Damped(NamedTuple):
    """Constants of a `RestitutionLaw`."""

    stiffness: Scalar
    damping_ratio: Scalar


class RestitutionLaw(AbstractImpactLaw):
    """F = max(0, K d^n (1 + a d'/v0)), with a = ratio(e) and v0 the speed of the last impact.

    **Arguments:** `stiffness` K [N/m^n]; `restitution` e in (0, 1); `ratio`: the function a(e), which tells the laws of
    this kind apart; `exponent` n (`None`: 3/2); `minimum_impact_speed` [m/s]: v0 is never less, because a/v0 grows
    without bound for a pin that comes to rest.
    """

    stiffness: Any = physical(STIFFNESS, above=0.0, help="stiffness K", example='"2.487e6 N/mm^1.5"')
    restitution: Scalar = physical("", above=0.0, below=1.0, help=RESTITUTION, example="0.7")
    ratio: Callable = eqx.field(static=True, default=ratios.exact_ratio)
    exponent: Scalar | None = physical(
        "", least=1.0, default=None, help="exponent n of the penetration", example="1.5", absent="1.5"
    )
    minimum_impact_speed: Scalar = physical("m/s", above=0.0, default=1e-3, help=SLOWEST, example='"1 mm/s"')
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

    **Arguments:** as those of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.exact_ratio, **options)


def lankarani_nikravesh(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Lankarani and Nikravesh (1990, doi 10.1115/1.2912617). It delivers e = 0.69 for 0.4 and
    0.91 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.lankarani_nikravesh_ratio, **options)


def flores(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Flores et al. (2011, doi 10.1007/s11044-010-9237-4).

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.flores_ratio, **options)


def hunt_crossley(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Hunt and Crossley (1975, doi 10.1115/1.3423596) with the speed of the
    last impact; `HuntCrossley` has a fixed factor. It delivers e = 0.66 for 0.5 and 0.91 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.hunt_crossley_ratio, **options)


def herbert_mcwhannell(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Herbert and McWhannell (1977). It delivers e = 0.59 for 0.5 and 0.90 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.herbert_mcwhannell_ratio, **options)


def lee_wang(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Lee and Wang (1983). It delivers e = 0.80 for 0.5 and 0.95 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.lee_wang_ratio, **options)


def gonthier(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Gonthier et al. (2004). It delivers e = 0.49 for 0.5 and 0.88 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.gonthier_ratio, **options)


def zhiying_qishao(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Zhiying and Qishao (2006). It delivers e = 0.48 for 0.5 and 0.90 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.zhiying_qishao_ratio, **options)


def hu_guo(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Hu and Guo (2015). It delivers e = 0.49 for 0.5 and 0.90 for 0.9.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.hu_guo_ratio, **options)


def gharib_hurmuzlu(stiffness, restitution, **options) -> RestitutionLaw:
    """The restitution law of Gharib and Hurmuzlu (2012). It delivers e = 0.41 for 0.5 and 0.57 for 0.9: it is for
    small ones.

    **Arguments:** `stiffness`, `restitution` and the others of `RestitutionLaw`, without `ratio`.
    """
    return RestitutionLaw(stiffness, restitution, ratios.gharib_hurmuzlu_ratio, **options)
