"""Friction with bristles that bend: the base of such laws, their smoothed form, LuGre's law and its relatives."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from clearance_jax._basis.numerics import corner, positive_part, step5
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Slip, Smoothness
from clearance_jax.laws._friction import AbstractFrictionLaw, AbstractModifiedFriction, speed_of
from clearance_jax.parameters import flatten, physical

STATIC = {"help": "coefficient mu_s at rest", "example": "0.2"}
KINETIC = {"help": "coefficient mu_k at high slip", "example": "0.1"}
STRIBECK = {"help": "slip v_s between the two", "example": '"1 mm/s"'}
STIFFNESS = {"help": "stiffness s0 of the bristles over the normal force", "example": '"1e5 1/m"'}
DAMPING = {"help": "damping s1 of the bristles", "example": '"10 s/m"'}
VISCOUS = {"help": "viscous friction s2", "example": '"0.1 s/m"'}


class AbstractBristles(AbstractFrictionLaw):
    """A law with z' = v - r z for the deflection z of its bristles, r >= 0 the rate at which they give way."""

    bristle_stiffness: eqx.AbstractVar[Scalar]
    smoothness: ClassVar[Smoothness] = "C0"
    bristles: ClassVar[tuple[str, ...]] = ("bristle",)

    @property
    @abc.abstractmethod
    def largest_coefficient(self) -> Scalar:
        """The coefficient at which the bristles give way at the latest."""

    @abc.abstractmethod
    def release(self, slip: Slip, bend: Slip, width: Scalar | None = None) -> Scalar:
        """The rate r [1/s] for a slip [m/s] and a deflection [m]; its corner is rounded over a `width` [m/s]."""

    def bend_rates(self, slip: Slip, bend: Slip, width: Scalar | None = None) -> Slip:
        """The rate z' of the deflection [m/s]."""
        give = self.release(slip, bend, width)
        return tuple(v - give * z for v, z in zip(slip, bend, strict=True))

    @abc.abstractmethod
    def bent(self, slip: Slip, normal_force: Scalar, bend: Slip, rates: Slip) -> Slip:
        """The traction [N] of bristles that are bent by `bend` [m], and bend at `rates` [m/s]."""

    def smoothed(self, width: Any = None, *, rtol: Any = 1e-6, speed: Any = 1e-3) -> "SmoothedBristles":
        """The law with |v| in the rate of its bristles rounded over the `width` [m/s] about zero slip. A pin under load
        creeps then, slower than the width; faster than the width the law is as it was.

        **Arguments:** `width`; by default `rtol` times the `speed` [m/s] of a usual slip.
        """
        return SmoothedBristles(self, rtol * speed if width is None else width)

    def traction(self, constants, slip, normal_force, memory):
        (bend,) = memory
        return self.bent(slip, normal_force, bend, self.bend_rates(slip, bend))

    def memory_rate(self, constants, slip, normal_force, memory):
        return (self.bend_rates(slip, memory[0]),)

    def latch(self, constants, memory, touch):
        # The bristle has bent by z' = v - r z from z = 0 since the touch: z = v (1 - exp(-r t)) / r. (A fast slip bends
        # it fully within a step. Then z hardly depends on the instant of the touch.)
        give = touch.elapsed * self.release(touch.slip, tuple(jnp.zeros_like(v) for v in touch.slip))
        decay = jnp.where(give > 0, -jnp.expm1(-give) / jnp.where(give > 0, give, 1.0), 1.0)
        free = touch.elapsed * decay
        bent = (jnp.where(touch.began, v * free, z) for v, z in zip(touch.slip, memory[0], strict=True))
        return (tuple(jnp.where(touch.ended, 0.0, z) for z in bent),)

    def memory_scale(self, constants):
        return (self.largest_coefficient / self.bristle_stiffness,)


class AbstractLuGre(AbstractBristles):
    """T = -N (s0 z + s1 z' + s2 v), with the curve g = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2) of a steady slip."""

    static_coefficient: Scalar = physical("", above=0.0, **STATIC)
    kinetic_coefficient: Scalar = physical("", above=0.0, **KINETIC)
    stribeck_speed: Scalar = physical("m/s", above=0.0, **STRIBECK)
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)
    bristle_damping: Scalar = physical("s/m", least=0.0, default=0.0, **DAMPING)
    viscous: Scalar = physical("s/m", least=0.0, default=0.0, **VISCOUS)

    @property
    def largest_coefficient(self):
        return self.static_coefficient

    def steady(self, speed: Scalar) -> Scalar:
        """The coefficient g of a steady slip [m/s]."""
        stribeck = (self.static_coefficient - self.kinetic_coefficient) * jnp.exp(-((speed / self.stribeck_speed) ** 2))
        return self.kinetic_coefficient + stribeck

    def bent(self, slip, normal_force, bend, rates):
        elastic = (self.bristle_stiffness * z + self.bristle_damping * r for z, r in zip(bend, rates, strict=True))
        return tuple(-normal_force * (h + self.viscous * v) for h, v in zip(elastic, slip, strict=True))


class SmoothedBristles(AbstractModifiedFriction):
    """A `law` whose bristles have r(v) = |v| + (w - |v|)^3 (3 w + |v|) / (8 w^3) in the place of |v| for |v| < w. Those
    of `ElastoPlastic` have (v_z + r(v_z)) / 2 in the place of max(0, v_z).

    **Arguments:** `law`; `width` w [m/s] > 0. `law.smoothed()` chooses one.
    """

    law: AbstractBristles = flatten()
    width: Scalar = physical("m/s", above=0.0)
    smoothness: ClassVar[Smoothness] = "C2"

    def traction(self, constants, slip, normal_force, memory):
        (bend,) = memory
        return self.law.bent(slip, normal_force, bend, self.law.bend_rates(slip, bend, self.width))

    def memory_rate(self, constants, slip, normal_force, memory):
        return (self.law.bend_rates(slip, memory[0], self.width),)


def rounded(size: Scalar, width: Scalar | None) -> Scalar:
    """The size |v| of a slip, its corner at zero rounded over a width."""
    return size if width is None else size + width * corner(size / width)


class Dahl(AbstractBristles):
    """T = -N s0 z, z' = v - s0 |v| z / mu (Dahl 1968, with the exponent 1): LuGre without Stribeck's peak and damping.

    **Arguments:** `coefficient` mu, `bristle_stiffness` s0 [1/m].
    """

    coefficient: Scalar = physical("", "coefficient of friction mu", "0.1", above=0.0)
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)

    @property
    def largest_coefficient(self):
        return self.coefficient

    def release(self, slip, bend, width=None):
        return self.bristle_stiffness * rounded(speed_of(slip), width) / self.coefficient

    def bent(self, slip, normal_force, bend, rates):
        return tuple(-normal_force * self.bristle_stiffness * z for z in bend)


class ElastoPlastic(AbstractLuGre):
    """LuGre's friction with z' = v - a s0 v_z z / g(v), v_z = max(0, v z/|z|), a = STEP5((s0 |z|/g(v) - b)/(1 - b)): a
    is 0 while |z| is below the share b of g/s0, and grows to 1 at g/s0; v_z is |v| where the slip bends the bristle
    along itself, and 0 where it unbends it (Dupont et al. 2002). So a pin does not drift under a small load that
    swings.

    The growth is STEP5 instead of the paper's sine.

    **Arguments:** those of `LuGre`; `breakaway_share` b in (0, 1).
    """

    breakaway_share: Scalar = physical(
        "", "share of the deflection that is elastic", "0.7", above=0.0, below=1.0, default=0.5
    )

    def release(self, slip, bend, width=None):
        ratio = self.bristle_stiffness / self.steady(speed_of(slip))
        plastic = step5((speed_of(bend) * ratio - self.breakaway_share) / (1 - self.breakaway_share))
        forward = _along(slip, bend)
        forward = positive_part(forward) if width is None else 0.5 * (forward + rounded(jnp.abs(forward), width))
        return plastic * ratio * forward


def _along(slip: Slip, bend: Slip) -> Scalar:
    """The slip in the direction of a deflection."""
    if len(slip) == 1:
        return slip[0] * jnp.sign(bend[0])
    size = speed_of(bend)
    return sum(v * z for v, z in zip(slip, bend, strict=True)) / jnp.where(size > 0, size, 1.0)


class LuGre(AbstractLuGre):
    """T = -N (s0 z + s1 z' + s2 v), z' = v - s0 |v| z / g(v), g = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2).

    Canudas de Wit et al. 1995 (doi 10.1109/9.376053), normalised by the normal force. |z| <= mu_s/s0 if it starts so.
    The bristle's time constant g/(s0 |v|) is short: an explicit solver takes many steps.

    **Arguments:** `static_coefficient`, `kinetic_coefficient`, `stribeck_speed` [m/s], `bristle_stiffness` s0 [1/m],
    `bristle_damping` s1 [s/m], `viscous` s2 [s/m].
    """

    def release(self, slip, bend, width=None):
        speed = speed_of(slip)
        return self.bristle_stiffness * rounded(speed, width) / self.steady(speed)
