"""Friction with bristles that bend."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._numerics import safe_norm
from clearance_jax._types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw
from clearance_jax.parameters import physical


class LuGre(AbstractFrictionLaw):
    """T = -N (s0 z + s1 z' + s2 v), z' = v - s0 |v| z / g(v), g = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2).

    Canudas de Wit et al. 1995 (doi 10.1109/9.376053), normalised by the normal force. |z| <= mu_s/s0 if it starts so.
    The bristle's time constant g/(s0 |v|) is short: an explicit solver takes many steps.

    **Arguments:** `static_coefficient`, `kinetic_coefficient`, `stribeck_speed` [m/s], `bristle_stiffness` s0 [1/m],
    `bristle_damping` s1 [s/m], `viscous` s2 [s/m].
    """

    static_coefficient: Scalar = physical("", above=0.0, help="coefficient mu_s at rest", example="0.2")
    kinetic_coefficient: Scalar = physical("", above=0.0, help="coefficient mu_k at high slip", example="0.1")
    stribeck_speed: Scalar = physical("m/s", above=0.0, help="slip v_s between the two", example='"1 mm/s"')
    bristle_stiffness: Scalar = physical(
        "1/m", above=0.0, help="stiffness s0 of the bristles over the normal force", example='"1e5 1/m"'
    )
    bristle_damping: Scalar = physical(
        "s/m", least=0.0, default=0.0, help="damping s1 of the bristles", example='"10 s/m"'
    )
    viscous: Scalar = physical("s/m", least=0.0, default=0.0, help="viscous friction s2", example='"0.1 s/m"')
    smoothness: ClassVar[Smoothness] = "C0"
    bristles: ClassVar[tuple[str, ...]] = ("bristle",)

    def traction(self, constants, slip, normal_force, memory):
        (bend,) = memory
        rates = self._bend_rates(slip, bend)
        held = (self.bristle_stiffness * z + self.bristle_damping * r for z, r in zip(bend, rates, strict=True))
        return tuple(-normal_force * (h + self.viscous * v) for h, v in zip(held, slip, strict=True))

    def memory_rate(self, constants, slip, normal_force, memory):
        return (self._bend_rates(slip, memory[0]),)

    def latch(self, constants, memory, touch):
        # The straight bristle has been bending with the slip since the touch.
        bent = (jnp.where(touch.began, v * touch.elapsed, z) for v, z in zip(touch.slip, memory[0], strict=True))
        return (tuple(jnp.where(touch.ended, 0.0, z) for z in bent),)

    def memory_scale(self, constants):
        return (self.static_coefficient / self.bristle_stiffness,)

    def _bend_rates(self, slip, bend):
        speed = jnp.abs(slip[0]) if len(slip) == 1 else safe_norm(*slip)
        stribeck = (self.static_coefficient - self.kinetic_coefficient) * jnp.exp(-((speed / self.stribeck_speed) ** 2))
        give = self.bristle_stiffness * speed / (self.kinetic_coefficient + stribeck)
        return tuple(v - give * z for v, z in zip(slip, bend, strict=True))
