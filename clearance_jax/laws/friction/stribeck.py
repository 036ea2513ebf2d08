"""Friction with a Stribeck peak, without memory."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw, along_slip, outside
from clearance_jax.parameters import physical


class BrownMcPhee(AbstractFrictionLaw):
    """T = -N (mu_d tanh(4 x) + (mu_s - mu_d) x / (x^2/4 + 3/4)^2), x = v/v_t (Brown and McPhee 2016,
    doi 10.1007/s11044-015-9471-9). Smooth, with a peak near mu_s at v_t.

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d, `transition_speed` v_t [m/s].
    """

    static_coefficient: Scalar = physical("", least=0.0, help="coefficient mu_s at the peak", example="0.2")
    dynamic_coefficient: Scalar = physical("", least=0.0, help="coefficient mu_d at high slip", example="0.1")
    transition_speed: Scalar = physical("m/s", above=0.0, help="slip v_t of the peak", example='"10 mm/s"')
    smoothness: ClassVar[Smoothness] = "C2"

    def traction(self, constants, slip, normal_force, memory):
        def profile(v):
            x = v * (1.0 / self.transition_speed)
            bump = x / (0.25 * x * x + 0.75) ** 2
            stribeck = (self.static_coefficient - self.dynamic_coefficient) * bump
            return -normal_force * (self.dynamic_coefficient * jnp.tanh(4 * x) + stribeck)

        return along_slip(profile, slip)

    def event_functions(self, constants, slip, normal_force, memory):
        return (outside(slip, self.transition_speed),)
