"""Stiffnesses that are computed from materials and geometry."""

import jax.numpy as jnp

from clearance_jax._types import Number, Scalar, physical
from clearance_jax.laws._base import AbstractStiffness


class InternalHertz(AbstractStiffness):
    """Hertz stiffness of a pin (radius R_j) inside a sleeve (radius R_i = R_j + c), sphere in spherical socket.

    K = 4/3 E* sqrt(R_i R_j / (R_i - R_j)),  1/E* = (1 - nu_j^2)/E_j + (1 - nu_i^2)/E_i  [N/m^1.5]

    Source: Hertz contact in the form of Lankarani and Nikravesh (1990), with the minus sign of an internal contact
    (FACTS.md 1.1; the plus sign belongs to two balls and makes the contact of the paper's joint 32 times too soft).

    Two modes. With `reference_clearance` the stiffness is that of this clearance whatever the joint's clearance is
    now: use it where the clearance is a design variable or wears. Without, the stiffness follows the joint's
    clearance, dK/dc = -K/(2c) for c << R_j, which is unphysical as c -> 0: the conformal limit breaks Hertz's
    half-space, while the formula grows without bound and would reward a vanishing clearance.

    Valid for a contact radius much smaller than R_j, elastic, frictionless, a sphere-like contact. For a cylindrical
    pin of some length the form is only a fit (5 to 12 times softer than line contact for the paper's geometry).

    **Arguments:**

    - `pin_modulus`, `sleeve_modulus`: Young's moduli E_j, E_i [Pa].
    - `pin_poisson`, `sleeve_poisson`: Poisson's ratios nu_j, nu_i [1].
    - `reference_clearance`: radial clearance c [m] at which the stiffness is fixed, or `None` to follow the joint.
    """

    pin_modulus: Number = physical("Pa", above=0.0)
    sleeve_modulus: Number = physical("Pa", above=0.0)
    pin_poisson: Number = physical("1", above=-1.0, below=0.5)
    sleeve_poisson: Number = physical("1", above=-1.0, below=0.5)
    reference_clearance: Number | None = physical("m", above=0.0, default=None)

    def effective_modulus(self) -> Number:
        """The modulus E* [Pa] of the pair."""
        pin = (1 - self.pin_poisson * self.pin_poisson) / self.pin_modulus
        sleeve = (1 - self.sleeve_poisson * self.sleeve_poisson) / self.sleeve_modulus
        return 1 / (pin + sleeve)

    def value(self, pin_radius: Scalar, radial_clearance: Scalar) -> Number:
        clearance = radial_clearance if self.reference_clearance is None else self.reference_clearance
        effective_radius = (pin_radius + clearance) * pin_radius / clearance
        return 4 / 3 * self.effective_modulus() * jnp.sqrt(effective_radius)
