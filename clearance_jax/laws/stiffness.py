"""Contact stiffness: from geometry and materials, and larger than it is, to tell the effect of play from elasticity."""

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.laws._base import AbstractModifiedLaw, AbstractNormalLaw, AbstractStiffness, Smoothness
from clearance_jax.laws.geometry import Geometry, Material
from clearance_jax.parameters import physical


class InternalHertz(AbstractStiffness):
    r"""Hertz stiffness of a pin in a sleeve (internal contact of spheres).

    K = (4/3) E* sqrt(R_i R_j / (R_i - R_j)), R_i = R_j + c, 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2
    (Lankarani and Nikravesh 1990). Valid while the contact radius is small against the pin's.

    **Arguments:**

    - `pin_modulus`, `sleeve_modulus`: Young's moduli [Pa].
    - `pin_poisson`, `sleeve_poisson`: Poisson's ratios.
    - `reference_clearance` [m]: K is computed for this clearance and stays there when the joint's clearance changes.
      `None`: K follows the clearance, dK/dc = -K/(2c), which grows without bound (and without physical meaning: the
      contact becomes conformal) as c goes to 0.
    """

    pin_modulus: Scalar = physical("Pa", "Young's modulus of the pin", '"207 GPa"', above=0.0)
    sleeve_modulus: Scalar = physical("Pa", "Young's modulus of the sleeve", '"100 GPa"', above=0.0)
    pin_poisson: Scalar = physical("", "Poisson's ratio of the pin", "0.29", least=0.0, below=0.5, default=0.3)
    sleeve_poisson: Scalar = physical("", "Poisson's ratio of the sleeve", "0.34", least=0.0, below=0.5, default=0.3)
    reference_clearance: Scalar | None = physical(
        "m",
        "the clearance for which the stiffness is computed",
        '"0.1 mm"',
        "the joint's own: the stiffness changes with it",
        above=0.0,
        default=None,
    )

    def value(self, geometry: Geometry) -> Scalar:
        if geometry.kind == "flat":
            message = "The stiffness of corners on flat walls does not follow from radii: give the normal law a number."
            raise ClearanceError(message).about("stiffness")
        clearance = geometry.radial_clearance if self.reference_clearance is None else self.reference_clearance
        pin, sleeve = Material(self.pin_modulus, self.pin_poisson), Material(self.sleeve_modulus, self.sleeve_poisson)
        radius = geometry.pin_radius
        compliance = pin.compliance + sleeve.compliance
        return 4 / (3 * compliance) * jnp.sqrt(radius * (radius + clearance) / clearance)


class Stiffened(AbstractModifiedLaw):
    """`factor` times the force and the energy of a `law`."""

    law: AbstractNormalLaw
    factor: Scalar = physical("", "by how much it is stiffer", "1e6", above=0.0)

    @property
    def smoothness(self) -> Smoothness:  # type: ignore[override]
        return self.law.smoothness

    def formula(self, constants, penetration, penetration_rate, memory):
        return self.factor * self.law.formula(constants, penetration, penetration_rate, memory)

    def energy(self, constants, penetration):
        return self.factor * self.law.energy(constants, penetration)
