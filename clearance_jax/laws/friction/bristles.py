"""Friction with bristles that bend, beside LuGre's."""

import jax.numpy as jnp

from clearance_jax._basis.numerics import positive_part, step5
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Slip
from clearance_jax.laws._friction import speed_of
from clearance_jax.laws.friction._bristles import (
    DAMPING,
    KINETIC,
    STATIC,
    STIFFNESS,
    STRIBECK,
    VISCOUS,
    AbstractBristles,
    AbstractLuGre,
    rounded,
)
from clearance_jax.parameters import physical


class Dahl(AbstractBristles):
    """T = -N s0 z, z' = v - s0 |v| z / mu (Dahl 1968, with the exponent 1): LuGre without Stribeck's peak and damping.

    **Arguments:** `coefficient` mu, `bristle_stiffness` s0 [1/m].
    """

    coefficient: Scalar = physical("", above=0.0, help="coefficient of friction mu", example="0.1")
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

    static_coefficient: Scalar = physical("", above=0.0, **STATIC)
    kinetic_coefficient: Scalar = physical("", above=0.0, **KINETIC)
    stribeck_speed: Scalar = physical("m/s", above=0.0, **STRIBECK)
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)
    bristle_damping: Scalar = physical("s/m", least=0.0, default=0.0, **DAMPING)
    viscous: Scalar = physical("s/m", least=0.0, default=0.0, **VISCOUS)
    breakaway_share: Scalar = physical(
        "", above=0.0, below=1.0, default=0.5, help="share of the deflection that is elastic", example="0.7"
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
