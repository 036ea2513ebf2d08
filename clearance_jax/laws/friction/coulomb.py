"""Coulomb friction with the jump at zero slip made steep instead."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw, Kink, along_slip, outside
from clearance_jax.parameters import physical


class CubicCoulomb(AbstractFrictionLaw):
    """T = -mu N (3 x - x^3)/2 with x = min(1, v/v_c): Coulomb friction from v_c on. A pin creeps under load.

    Source: Qian et al. 2022, Eq. 8 (doi 10.3390/app122111041), whose first branch must read -mu.

    **Arguments:** `coefficient` mu; `transition_speed` v_c [m/s] (the paper does not give it).
    """

    coefficient: Scalar = physical("", least=0.0, help="coefficient of friction mu", example="0.1")
    transition_speed: Scalar = physical(
        "m/s", above=0.0, help="slip at which the friction is all but complete", example='"10 mm/s"'
    )
    smoothness: ClassVar[Smoothness] = "C1"

    def traction(self, constants, slip, normal_force, memory):
        def profile(v):
            x = jnp.clip(v * (1.0 / self.transition_speed), -1.0, 1.0)
            return -0.5 * self.coefficient * normal_force * x * (3 - x * x)

        return along_slip(profile, slip)

    def kinks(self):
        mu, fast = self.coefficient, self.transition_speed
        return (Kink(fast, mu, 0.0, 3 * mu / fast**2),)

    def event_functions(self, constants, slip, normal_force, memory):
        return (outside(slip, self.transition_speed),)


class TanhCoulomb(AbstractFrictionLaw):
    """T = -mu N tanh(v/v_t). **Arguments:** `coefficient` mu, `transition_speed` v_t [m/s]."""

    coefficient: Scalar = physical("", least=0.0, help="coefficient of friction mu", example="0.1")
    transition_speed: Scalar = physical(
        "m/s", above=0.0, help="slip at which the friction is all but complete", example='"10 mm/s"'
    )
    smoothness: ClassVar[Smoothness] = "C2"

    def traction(self, constants, slip, normal_force, memory):
        return along_slip(
            lambda v: -self.coefficient * normal_force * jnp.tanh(v * (1.0 / self.transition_speed)), slip
        )

    def event_functions(self, constants, slip, normal_force, memory):
        # A step across the whole layer may sample it so that its error estimate cancels by accident: an edge cuts it.
        return (outside(slip, 2 * self.transition_speed),)
