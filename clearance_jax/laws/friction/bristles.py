"""Friction with bristles that bend, beside LuGre's."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._numerics import safe_norm, step5
from clearance_jax._types import Scalar
from clearance_jax.laws._base import Slip, Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw
from clearance_jax.parameters import physical

STIFFNESS = {"help": "stiffness s0 of the bristles over the normal force", "example": '"1e5 1/m"'}


def _norm(slip: Slip) -> Scalar:
    return jnp.abs(slip[0]) if len(slip) == 1 else safe_norm(*slip)


def _latch(memory, touch):
    """A straight bristle, which has been bending with the slip since the touch."""
    bent = (jnp.where(touch.began, v * touch.elapsed, z) for v, z in zip(touch.slip, memory[0], strict=True))
    return (tuple(jnp.where(touch.ended, 0.0, z) for z in bent),)


class Dahl(AbstractFrictionLaw):
    """T = -N s0 z, z' = v - s0 |v| z / mu (Dahl 1968, with the exponent 1): LuGre without Stribeck's peak and damping.

    **Arguments:** `coefficient` mu, `bristle_stiffness` s0 [1/m].
    """

    coefficient: Scalar = physical("", above=0.0, help="coefficient of friction mu", example="0.1")
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)
    smoothness: ClassVar[Smoothness] = "C0"
    bristles: ClassVar[tuple[str, ...]] = ("bristle",)

    def traction(self, constants, slip, normal_force, memory):
        return tuple(-normal_force * self.bristle_stiffness * z for z in memory[0])

    def memory_rate(self, constants, slip, normal_force, memory):
        give = self.bristle_stiffness * _norm(slip) / self.coefficient
        return (tuple(v - give * z for v, z in zip(slip, memory[0], strict=True)),)

    def latch(self, constants, memory, touch):
        return _latch(memory, touch)

    def memory_scale(self, constants):
        return (self.coefficient / self.bristle_stiffness,)


class ElastoPlastic(AbstractFrictionLaw):
    """LuGre's friction with z' = v - a s0 |v| z / g(v): a is 0 while |z| is below the share b of g/s0, or the slip
    unbends the bristle, and grows to 1 at g/s0 (Dupont et al. 2002). So a pin does not drift under a small
    load that swings.

    The growth is STEP5 instead of the paper's sine.

    **Arguments:** those of `LuGre`; `breakaway_share` b in (0, 1).
    """

    static_coefficient: Scalar = physical("", above=0.0, help="coefficient mu_s at rest", example="0.2")
    kinetic_coefficient: Scalar = physical("", above=0.0, help="coefficient mu_k at high slip", example="0.1")
    stribeck_speed: Scalar = physical("m/s", above=0.0, help="slip v_s between the two", example='"1 mm/s"')
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)
    bristle_damping: Scalar = physical(
        "s/m", least=0.0, default=0.0, help="damping s1 of the bristles", example='"10 s/m"'
    )
    viscous: Scalar = physical("s/m", least=0.0, default=0.0, help="viscous friction s2", example='"0.1 s/m"')
    breakaway_share: Scalar = physical(
        "", above=0.0, below=1.0, default=0.5, help="share of the deflection that is elastic", example="0.7"
    )
    smoothness: ClassVar[Smoothness] = "C0"
    bristles: ClassVar[tuple[str, ...]] = ("bristle",)

    def traction(self, constants, slip, normal_force, memory):
        (bend,) = memory
        held = (
            self.bristle_stiffness * z + self.bristle_damping * rate
            for z, rate in zip(bend, self._bend_rates(slip, bend), strict=True)
        )
        return tuple(-normal_force * (h + self.viscous * v) for h, v in zip(held, slip, strict=True))

    def memory_rate(self, constants, slip, normal_force, memory):
        return (self._bend_rates(slip, memory[0]),)

    def latch(self, constants, memory, touch):
        return _latch(memory, touch)

    def memory_scale(self, constants):
        return (self.static_coefficient / self.bristle_stiffness,)

    def _bend_rates(self, slip, bend):
        speed = _norm(slip)
        stribeck = (self.static_coefficient - self.kinetic_coefficient) * jnp.exp(-((speed / self.stribeck_speed) ** 2))
        ratio = self.bristle_stiffness / (self.kinetic_coefficient + stribeck)
        plastic = step5((_norm(bend) * ratio - self.breakaway_share) / (1 - self.breakaway_share))
        bends = sum(v * z for v, z in zip(slip, bend, strict=True)) > 0
        give = jnp.where(bends, plastic, 0.0) * ratio * speed
        return tuple(v - give * z for v, z in zip(slip, bend, strict=True))
