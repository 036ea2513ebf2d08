"""Clearance of a pin in a bush from an ISO 286 fit, with warmth and a bush that is pressed into a housing."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax.core import Tracer

from clearance_jax._basis.module import Module
from clearance_jax._basis.numerics import positive_part
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints.checks import check_known, check_larger
from clearance_jax.joints.fits import fit as fit_of
from clearance_jax.parameters import check_values, describe, physical


class Solid(NamedTuple):
    """Young's modulus [Pa], Poisson's ratio, linear thermal expansion [1/K]."""

    modulus: float
    poisson_ratio: float
    expansion: float


# Handbook values: carbon steel, and tin bronze.
STEEL, BRONZE = Solid(207e9, 0.29, 11.5e-6), Solid(103e9, 0.34, 18e-6)
# Sizes on drawings are those at 20 degC (ISO 1).
REFERENCE_TEMPERATURE = 293.15


class Tolerance(Module):
    """The range of a radial clearance as made: `least` and `greatest` [m], below zero an interference."""

    least: Scalar = physical("m")
    greatest: Scalar = physical("m")


class PressFit(Module):
    r"""A bush pressed into its housing, which makes the bore of the bush smaller.

    The bush has the radii a (bore) and b (outside), the housing has the outside radius c. The diameter of the bore
    shrinks by this part of the interference:

        part = 2 a b / (E_b (b^2 - a^2) S)
        S = ((c^2 + b^2) / (c^2 - b^2) + nu_h) / E_h + ((b^2 + a^2) / (b^2 - a^2) - nu_b) / E_b

    with the moduli E and Poisson's ratios nu of bush (b) and housing (h) (Lamé's thick-walled cylinders in plane
    stress: Timoshenko, Strength of Materials, part II, article 41). It is a / b if both are of one material and the
    housing is large. If warmth makes the housing wider than the bush, the bore is that of a free bush.

    **Arguments:**

    - `fit`: bore of the housing and outside of the bush, "H7/p6"; `diameter`: their nominal one [m].
    - `housing_diameter`: outside of the housing [m]; `None`: large.
    - `bush_modulus`, `housing_modulus` [Pa], `bush_poisson`, `housing_poisson`: bronze and steel by default.
    - `housing_expansion` [1/K]: that of steel by default.
    """

    fit: str = describe("fit of the bush in its housing", '"H7/p6"', static=True)
    diameter: Scalar = physical("m", "outer diameter of the bush", '"26 mm"', above=0.0)
    housing_diameter: Scalar | None = physical(
        "m", "outer diameter of the housing", '"60 mm"', "large", above=0.0, default=None
    )
    bush_modulus: Scalar = physical("Pa", "Young's modulus of the bush", '"103 GPa"', above=0.0, default=BRONZE.modulus)
    bush_poisson: Scalar = physical(
        "", "Poisson's ratio of the bush", "0.34", least=0.0, below=0.5, default=BRONZE.poisson_ratio
    )
    housing_modulus: Scalar = physical(
        "Pa", "Young's modulus of the housing", '"207 GPa"', above=0.0, default=STEEL.modulus
    )
    housing_poisson: Scalar = physical(
        "", "Poisson's ratio of the housing", "0.29", least=0.0, below=0.5, default=STEEL.poisson_ratio
    )
    housing_expansion: Scalar = physical(
        "1/K", "linear thermal expansion of the housing", '"11.5e-6 1/K"', default=STEEL.expansion
    )

    def part(self, bore: Any) -> Scalar:
        """The part of the interference by which a `bore` [m] closes.

        **Raises:** `ClearanceError` for a bore that is not inside the bush, and a bush that is not inside its housing.
        """
        check_larger("diameter", self.diameter, "the bore of the bush", bore, "which is pressed into a housing")
        a, b = bore / 2, self.diameter / 2
        around = 1.0
        if self.housing_diameter is not None:
            check_larger(
                "housing_diameter", self.housing_diameter, "the bush", self.diameter, "which is pressed into it"
            )
            c = self.housing_diameter / 2
            around = (c**2 + b**2) / (c**2 - b**2)
        housing = (around + self.housing_poisson) / self.housing_modulus
        bush = ((b**2 + a**2) / (b**2 - a**2) - self.bush_poisson) / self.bush_modulus
        return 2 * a * b / (self.bush_modulus * (b**2 - a**2) * (housing + bush))

    def closes(self, bore: Any, warming: Any, expansion: Any) -> tuple[Scalar, Scalar, Scalar]:
        """By how much a `bore` [m] closes at its diameter [m] at least, with mean sizes, and at most."""
        seat, part = fit_of(self.diameter, self.fit), self.part(bore)
        loosest, tightest = (seat.hole[1], seat.shaft[0]), (seat.hole[0], seat.shaft[1])
        mean = sum(seat.hole) / 2, sum(seat.shaft) / 2

        def interference(housing, bush):
            grown = expansion * (self.diameter + bush) - self.housing_expansion * (self.diameter + housing)
            return part * positive_part(bush - housing + warming * grown)

        return interference(*loosest), interference(*mean), interference(*tightest)


class Fitting(Module):
    """An ISO 286 fit of a pin in its sleeve, at the temperature at which it runs.

    **Arguments:**

    - `fit`: hole and shaft, "H7/g6".
    - `temperature` of both [K], by default that of drawings, 20 degC.
    - `pin_expansion`, `sleeve_expansion`: linear thermal expansions [1/K], by default those of steel and of bronze.
    - `press`: if the sleeve is a bush that is pressed into a housing after its bore was made.
    """

    fit: str = describe(
        "ISO 286 fit of the pin, instead of a clearance, which is then that of mean sizes; `pin_radius` is half the "
        "nominal diameter",
        '"H7/g6"',
        static=True,
    )
    temperature: Scalar = physical(
        "K", "temperature at which the fit runs", '"80 degC"', above=0.0, default=REFERENCE_TEMPERATURE
    )
    pin_expansion: Scalar = physical(
        "1/K", "linear thermal expansion of the pin", '"11.5e-6 1/K"', default=STEEL.expansion
    )
    sleeve_expansion: Scalar = physical(
        "1/K", "linear thermal expansion of the sleeve", '"18e-6 1/K"', default=BRONZE.expansion
    )
    press: PressFit | None = None

    def radial_clearance(self, diameter: Any) -> tuple[Scalar, Tolerance]:
        """Radial clearance of mean sizes at a nominal `diameter` [m], and its range [m].

        **Raises:** `ClearanceError` for an unknown fit (see `fits.fit`), for one that leaves no play, for numbers out
        of bounds, and for a traced diameter.
        """
        check_values(self)
        check_known("diameter", diameter, "the tables of ISO 286 go by steps")
        running, warming = fit_of(diameter, self.fit), self.temperature - REFERENCE_TEMPERATURE
        closed: Any = (0.0, 0.0, 0.0)
        if self.press is not None:
            closed = self.press.closes(diameter, warming, self.sleeve_expansion)

        def clearance(hole, shaft, closed):
            grown = self.sleeve_expansion * (diameter + hole) - self.pin_expansion * (diameter + shaft)
            return jnp.asarray(hole - shaft + warming * grown - closed, float) / 2

        least = clearance(running.hole[0], running.shaft[1], closed[2])
        mean = clearance(sum(running.hole) / 2, sum(running.shaft) / 2, closed[1])
        greatest = clearance(running.hole[1], running.shaft[0], closed[0])
        if not isinstance(mean, Tracer) and not float(mean) > 0:
            raise ClearanceError(
                f"The `fit` {running.name} leaves no play: with mean sizes its radial clearance is {float(mean):g} m. "
                "Take a looser one."
            ).about("fit", running.name)
        return mean, Tolerance(least, greatest)
