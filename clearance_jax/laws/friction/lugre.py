"""Friction with bristles that bend: LuGre's."""

from clearance_jax._basis.types import Scalar
from clearance_jax.laws._friction import speed_of
from clearance_jax.laws.friction._bristles import (
    DAMPING,
    KINETIC,
    STATIC,
    STIFFNESS,
    STRIBECK,
    VISCOUS,
    AbstractLuGre,
    rounded,
)
from clearance_jax.parameters import physical


class LuGre(AbstractLuGre):
    """T = -N (s0 z + s1 z' + s2 v), z' = v - s0 |v| z / g(v), g = mu_k + (mu_s - mu_k) exp(-(v/v_s)^2).

    Canudas de Wit et al. 1995 (doi 10.1109/9.376053), normalised by the normal force. |z| <= mu_s/s0 if it starts so.
    The bristle's time constant g/(s0 |v|) is short: an explicit solver takes many steps.

    **Arguments:** `static_coefficient`, `kinetic_coefficient`, `stribeck_speed` [m/s], `bristle_stiffness` s0 [1/m],
    `bristle_damping` s1 [s/m], `viscous` s2 [s/m].
    """

    static_coefficient: Scalar = physical("", above=0.0, **STATIC)
    kinetic_coefficient: Scalar = physical("", above=0.0, **KINETIC)
    stribeck_speed: Scalar = physical("m/s", above=0.0, **STRIBECK)
    bristle_stiffness: Scalar = physical("1/m", above=0.0, **STIFFNESS)
    bristle_damping: Scalar = physical("s/m", least=0.0, default=0.0, **DAMPING)
    viscous: Scalar = physical("s/m", least=0.0, default=0.0, **VISCOUS)

    def release(self, slip, bend, width=None):
        speed = speed_of(slip)
        return self.bristle_stiffness * rounded(speed, width) / self.steady(speed)
