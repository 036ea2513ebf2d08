"""Laws of a pin that touches its sleeve along a line: F = E* L f(d) (1 + a(e) d'/v0), for elastic relations f."""

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.numerics import positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws.geometry import Geometry, Material
from clearance_jax.laws.normal import ratios, relations
from clearance_jax.laws.normal.relations import ContactLine, Relation
from clearance_jax.laws.normal.restitution import RESTITUTION, SLOWEST, AbstractImpactLaw
from clearance_jax.parameters import physical


def line_of(geometry: Geometry, modulus: Scalar, name: str) -> ContactLine:
    """The line of contact of a joint. **Raises** `ClearanceError` for a joint that has none."""
    if geometry.kind == "flat" or geometry.length is None:
        raise ClearanceError(
            f"The law {name} is for a pin along a line of its sleeve: it needs a pin joint with a `length`. Give the "
            "joint its `length`, or choose a law with a stiffness, such as `hertz`."
        ).about("length")
    return ContactLine(geometry.radial_clearance, geometry.pin_radius, geometry.sleeve_radius, geometry.length, modulus)


class LineConstants(NamedTuple):
    """Constants of a law of line contact; without restitution there is no `damping_ratio`."""

    line: ContactLine
    damping_ratio: Scalar | None


class LineContact(AbstractImpactLaw):
    """F = E* L f(d) (1 + a(e) d'/v0), with 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2, the length L of the contact and
    the speed v0 of the last impact. Friction acts all over Hertz's patch, with the half angle of the elastic force.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa], `pin_poisson`, `sleeve_poisson`; `restitution` e (`None`:
    elastic); `minimum_impact_speed` [m/s]; `relation`: f, which tells the laws of this kind apart; `ratio`: a(e).
    """

    pin_modulus: Scalar = physical("Pa", "Young's modulus of the pin", '"207 GPa"', above=0.0)
    sleeve_modulus: Scalar = physical("Pa", "Young's modulus of the sleeve", '"100 GPa"', above=0.0)
    pin_poisson: Scalar = physical("", "Poisson's ratio of the pin", "0.29", least=0.0, below=0.5, default=0.3)
    sleeve_poisson: Scalar = physical("", "Poisson's ratio of the sleeve", "0.34", least=0.0, below=0.5, default=0.3)
    restitution: Scalar | None = physical("", RESTITUTION, "0.7", "elastic", above=0.0, below=1.0, default=None)
    minimum_impact_speed: Scalar = physical("m/s", SLOWEST, '"1 mm/s"', above=0.0, default=1e-3)
    relation: Relation = eqx.field(static=True, default=relations.JOHNSON)
    ratio: Callable = eqx.field(static=True, default=ratios.exact_ratio)
    smoothness: ClassVar[Smoothness] = "C1"

    def constants(self, geometry):
        pin, sleeve = Material(self.pin_modulus, self.pin_poisson), Material(self.sleeve_modulus, self.sleeve_poisson)
        line = line_of(geometry, 1 / (pin.compliance + sleeve.compliance), type(self).__name__)
        return LineConstants(line, self.damping_ratio)

    def elastic(self, constants, penetration):
        line = constants.line
        return line.modulus * line.length * self.relation.force(line, penetration)

    def energy(self, constants, penetration):
        line = constants.line
        return line.modulus * line.length * self.relation.work(line, penetration)

    def friction_lever(self, constants, penetration):
        line = constants.line
        return line.pin_radius * (relations.ellipse_spread(line, self.relation.force(line, penetration)) - 1)

    def event_functions(self, constants, penetration, penetration_rate, memory):
        return (penetration - self.relation.limit(constants.line),) if self.relation.bends else ()

    def validity(self, constants):
        limit = self.relation.limit(constants.line)
        return jnp.zeros_like(limit) if self.relation.comparison else limit

    @property
    def validity_reason(self):
        return self.relation.reason


def johnson(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """Johnson's line contact, d = F'/(pi E*) (ln(4 pi E* c / F') - 1) (from Johnson 1985, Eq. 5.57), for d up to
    0.49 c; beyond, it goes on along its tangent.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.JOHNSON, **options)


def radzimovsky(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """Radzimovsky's line contact, d = F'/(pi E*) (2/3 + ln(4 R_i/b) + ln(4 R_j/b)), with the full width of the
    contact b = 4 sqrt(F' R / (pi E*)), 1/R = 1/R_j - 1/R_i, for d up to 0.65 c.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.RADZIMOVSKY, **options)


def esdu(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """The line contact of ESDU 78035, d = F'/(pi E*) (ln(4 pi E* c / F') + 1).

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.ESDU, **options)


def liu(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """The conformal contact of Liu et al. (2007), F' = (pi/2) E* d sqrt(d / (2 (c + d))).

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.LIU, **options)


def bai_zhao(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """The hybrid law of Bai and Zhao (2013) with n = 1: F' = K d, K = (pi/8) E* sqrt(2 d (3 c + 2 d)^2 / (c + d)^3),
    the slope of the law of Liu; a(e) = 3 (1 - e^2) exp(2 (1 - e)) / 4.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    damped = {"ratio": ratios.zhiying_qishao_ratio} | options
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.BAI_ZHAO, **damped)


def pereira(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """The fit of Pereira et al. (2015) to Johnson's line contact inside a sleeve, F' = (0.965 c + 0.0965) E*/c d^n in
    mm and N, n = Y c^-0.005, for radial clearances c from 0.005 to 10 mm; a(e) = 3 (1 - e^2)/4.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    damped = {"ratio": ratios.lankarani_nikravesh_ratio} | options
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.PEREIRA, **damped)


def goldsmith(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """Goldsmith's line contact, d = F'/(pi E*) (ln(pi E* c / (F' R_i R_j)) + 1) in mm and N. For comparison only: its
    logarithm has a dimension, so that its force depends on the units.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.GOLDSMITH, **options)


def dubowsky_freudenstein(pin_modulus, sleeve_modulus, **options) -> LineContact:
    """The line contact of Dubowsky and Freudenstein, d = F'/(pi E*) (ln(pi E* L^2 c / (F' R_i R_j)) + 1). For
    comparison only: its logarithm depends on the length of the line, which is wrong.

    **Arguments:** `pin_modulus`, `sleeve_modulus` [Pa] and the others of `LineContact`, without `relation`.
    """
    return LineContact(pin_modulus, sleeve_modulus, relation=relations.DUBOWSKY_FREUDENSTEIN, **options)


class Winkler(AbstractImpactLaw):
    """F = k L R e (t - sin t cos t) (1 + a(e) d'/v0), cos t = c/e, e = c + d: an elastic layer in the sleeve, each
    piece of which is a spring, p = k u. Friction acts all over the layer: its moment about the pin's axis is mu times
    the radius and the sum of the pressures.

    **Arguments:** `stiffness` k [Pa/m], (1 - nu) E / ((1 + nu)(1 - 2 nu) h) for a thin layer h on a rigid base (see
    `cj.wear.foundation`); `restitution` e (`None`: elastic); `minimum_impact_speed` [m/s]; `ratio`: a(e).
    """

    stiffness: Scalar = physical("Pa/m", "stiffness k of a layer", '"2e13 Pa/m"', above=0.0)
    restitution: Scalar | None = physical("", RESTITUTION, "0.7", "elastic", above=0.0, below=1.0, default=None)
    minimum_impact_speed: Scalar = physical("m/s", SLOWEST, '"1 mm/s"', above=0.0, default=1e-3)
    ratio: Callable = eqx.field(static=True, default=ratios.exact_ratio)
    smoothness: ClassVar[Smoothness] = "C1"
    has_radii: ClassVar[bool] = False
    """Whether the stiffness may be computed from the radii (`InternalHertz`). That of a layer is a number."""

    def constants(self, geometry):
        return LineConstants(line_of(geometry, self.stiffness, "Winkler"), self.damping_ratio)  # `modulus`: k [Pa/m]

    def elastic(self, constants, penetration):
        line = constants.line
        return line.modulus * line.length * line.sleeve_radius * relations.foundation(line, penetration)

    def energy(self, constants, penetration):
        line = constants.line
        return line.modulus * line.length * line.sleeve_radius * relations.foundation_work(line, penetration)

    def friction_lever(self, constants, penetration):
        # Each piece of the layer rubs on the pin's surface; the contact point lies on the sleeve's, d deeper.
        radius, further = constants.line.pin_radius, relations.foundation_spread(constants.line, penetration) - 1
        return radius * further + positive_part(penetration)
