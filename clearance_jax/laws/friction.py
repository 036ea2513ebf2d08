"""Friction laws of one contact point; a joint without friction has none of them."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._types import Scalar, physical
from clearance_jax.laws._base import AbstractFrictionLaw, Smoothness


class CubicCoulomb(AbstractFrictionLaw):
    """T = -mu N (3 x - x^3)/2, x = v/v_c, for |x| <= 1 and Coulomb beyond.

    Qian et al. 2022, Eq. 8 (doi 10.3390/app122111041), whose first branch must read -mu. It creeps under load.

    **Arguments:** `coefficient` mu, `transition_speed` v_c [m/s] (the paper does not give it).
    """

    coefficient: Scalar = physical("", least=0.0)
    transition_speed: Scalar = physical("m/s", above=0.0)
    smoothness: ClassVar[Smoothness] = "C1"

    def __call__(self, slip_velocity, normal_force, memory):
        x = jnp.clip(slip_velocity / self.transition_speed, -1.0, 1.0)
        return -0.5 * self.coefficient * normal_force * x * (3 - x * x)

    def regime(self, slip_velocity):
        return zone(slip_velocity, self.transition_speed)


def zone(slip_velocity, edge):
    """1 above `edge`, -1 below its negative, 0 between."""
    return jnp.where(slip_velocity > edge, 1, jnp.where(slip_velocity < -edge, -1, 0))


class TanhCoulomb(AbstractFrictionLaw):
    """T = -mu N tanh(v/v_t). **Arguments:** `coefficient` mu, `transition_speed` v_t [m/s]."""

    coefficient: Scalar = physical("", least=0.0)
    transition_speed: Scalar = physical("m/s", above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def __call__(self, slip_velocity, normal_force, memory):
        return -self.coefficient * normal_force * jnp.tanh(slip_velocity / self.transition_speed)

    def regime(self, slip_velocity):
        # A step across the whole layer may sample it so that its error estimate cancels by accident (measured: a solve
        # 1000 times worse than its tolerance). Edges at 2, 3, 4 and 6 v_t were tried on a ladder of tolerances.
        return zone(slip_velocity, 2 * self.transition_speed)


class BrownMcPhee(AbstractFrictionLaw):
    """T = -N (mu_d tanh(4 x) + (mu_s - mu_d) x / (x^2/4 + 3/4)^2), x = v/v_t (Brown and McPhee 2016,
    doi 10.1007/s11044-015-9471-9). Smooth, with a peak near mu_s at x = 1.

    **Arguments:** `static_coefficient` mu_s, `dynamic_coefficient` mu_d, `transition_speed` v_t [m/s].
    """

    static_coefficient: Scalar = physical("", least=0.0)
    dynamic_coefficient: Scalar = physical("", least=0.0)
    transition_speed: Scalar = physical("m/s", above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def __call__(self, slip_velocity, normal_force, memory):
        x = slip_velocity / self.transition_speed
        bump = x / (0.25 * x * x + 0.75) ** 2
        stribeck = (self.static_coefficient - self.dynamic_coefficient) * bump
        return -normal_force * (self.dynamic_coefficient * jnp.tanh(4 * x) + stribeck)

    def regime(self, slip_velocity):
        return zone(slip_velocity, self.transition_speed)


class LuGre(AbstractFrictionLaw):
    """T = -N (s0 z + s1 z' + s2 v), z' = v - s0 |v| z / g(v), g = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2).

    Canudas de Wit et al. 1995 (doi 10.1109/9.376053), normalised by the normal force. |z| <= mu_s/s0 if it starts so.
    The bristle's time constant g/(s0 |v|) is short: an explicit solver takes many steps.

    **Arguments:** `static_coefficient`, `kinetic_coefficient`, `stribeck_speed` [m/s], `bristle_stiffness` s0 [1/m],
    `bristle_damping` s1 [s/m], `viscous` s2 [s/m].
    """

    static_coefficient: Scalar = physical("", above=0.0)
    kinetic_coefficient: Scalar = physical("", above=0.0)
    stribeck_speed: Scalar = physical("m/s", above=0.0)
    bristle_stiffness: Scalar = physical("1/m", above=0.0)
    bristle_damping: Scalar = physical("s/m", least=0.0, default=0.0)
    viscous: Scalar = physical("s/m", least=0.0, default=0.0)
    smoothness: ClassVar[Smoothness] = "C0"
    remembers: ClassVar[tuple[str, ...]] = ("bristle",)

    def __call__(self, slip_velocity, normal_force, memory):
        bend_rate = self._bend_rate(slip_velocity, memory[0])
        bend = self.bristle_stiffness * memory[0] + self.bristle_damping * bend_rate
        return -normal_force * (bend + self.viscous * slip_velocity)

    def memory_rate(self, slip_velocity, normal_force, memory):
        return self._bend_rate(slip_velocity, memory[0])[None]

    def latch(self, memory, touch):
        # The straight bristle has been bending with the slip since the touch.
        bend = jnp.where(touch.began, touch.slip_velocity * touch.elapsed, memory)
        return jnp.where(touch.ended, jnp.zeros_like(memory), bend)

    def memory_scale(self):
        return (self.static_coefficient / self.bristle_stiffness)[None]

    def _bend_rate(self, v, bend):
        stribeck = (self.static_coefficient - self.kinetic_coefficient) * jnp.exp(-((v / self.stribeck_speed) ** 2))
        limit = self.kinetic_coefficient + stribeck
        return v - self.bristle_stiffness * jnp.abs(v) * bend / limit
