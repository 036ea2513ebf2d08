"""Friction laws. A joint without friction has no law (`friction=None`): nothing is computed for it.

Every traction is proportional to max(N, 0), so that a normal law that pulls cannot turn friction into a motor.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from clearance_jax._numerics import Real, positive_part
from clearance_jax._types import Flag, Number, Scalar, physical
from clearance_jax.laws._base import AbstractFrictionLaw, Memory, Regime, Smoothness


class CubicCoulomb(AbstractFrictionLaw):
    """Coulomb friction with a cubic transition through zero slip.

    T = -mu N (3 x - x^3) / 2,  x = v / v_c held within [-1, 1]

    Source: Qian et al., Appl. Sci. 2022, 12(21), 11041, Eq. 8 (first branch corrected to -mu_max, FACTS.md 2); the
    inner STEP of the Adams contact friction. Bound: |T| <= mu N. It creeps under load, it never sticks.

    **Arguments:**

    - `friction_coefficient`: mu [1].
    - `transition_velocity`: v_c [m/s], the slip at which friction is full. The slope at zero slip is 1.5 mu N / v_c: a
      small value costs small steps, a large one lets a loaded contact creep. 1e-4 to 1e-2 m/s is usual.
    """

    smoothness: ClassVar[Smoothness] = "C1"
    friction_coefficient: Number = physical("1", least=0.0)
    transition_velocity: Number = physical("m/s", above=0.0)

    def __call__(self, slip_velocity: Real, normal_force: Real, memory: Memory) -> Real:
        x = jnp.clip(slip_velocity / self.transition_velocity, -1.0, 1.0)
        return -0.5 * self.friction_coefficient * positive_part(normal_force) * x * (3 - x * x)

    def regime(self, slip_velocity: Array) -> Regime:
        """-1, 0 or 1: slipping backward, in the transition, slipping forward."""
        beyond = jnp.abs(slip_velocity) >= self.transition_velocity
        return jnp.where(beyond, jnp.where(slip_velocity > 0, 1, -1), 0)


class TanhCoulomb(AbstractFrictionLaw):
    """Coulomb friction with a transition of every order of smoothness.

    T = -mu N tanh(v / v_t)

    Source: FACTS.md 2. Bound: |T| <= mu N. It creeps under load, it never sticks.

    **Arguments:**

    - `friction_coefficient`: mu [1].
    - `transition_velocity`: v_t [m/s], the slip at which friction has 76 % of its full value.
    """

    smoothness: ClassVar[Smoothness] = "C2"
    friction_coefficient: Number = physical("1", least=0.0)
    transition_velocity: Number = physical("m/s", above=0.0)

    def __call__(self, slip_velocity: Real, normal_force: Real, memory: Memory) -> Real:
        share = jnp.tanh(slip_velocity / self.transition_velocity)
        return -self.friction_coefficient * positive_part(normal_force) * share


class BrownMcPhee(AbstractFrictionLaw):
    """Brown and McPhee's smooth Stribeck curve, without its viscous part.

    T = -N [mu_d tanh(4 x) + (mu_s - mu_d) x / (x^2/4 + 3/4)^2],  x = v / v_t

    Source: FACTS.md 2. Its peak lies next to x = 1, below mu_s. Bound, for mu_s >= mu_d: |T| <= mu_s N. It creeps under
    load, it never sticks.

    **Arguments:**

    - `static_coefficient`: mu_s [1], at least mu_d.
    - `kinetic_coefficient`: mu_d [1], the friction at large slip.
    - `transition_velocity`: v_t [m/s], the slip of the peak.
    """

    smoothness: ClassVar[Smoothness] = "C2"
    static_coefficient: Number = physical("1", least=0.0)
    kinetic_coefficient: Number = physical("1", least=0.0)
    transition_velocity: Number = physical("m/s", above=0.0)

    def __call__(self, slip_velocity: Real, normal_force: Real, memory: Memory) -> Real:
        x = slip_velocity / self.transition_velocity
        width = x * x / 4 + 0.75
        excess = (self.static_coefficient - self.kinetic_coefficient) * x / (width * width)
        return -positive_part(normal_force) * (self.kinetic_coefficient * jnp.tanh(4 * x) + excess)


class LuGre(AbstractFrictionLaw):
    """The LuGre bristle model, normalised by the normal force: it truly sticks.

    T = -N (sigma0 z + sigma1 z_dot + sigma2 v),  z_dot = v - sigma0 |v| z / g(v),
    g(v) = mu_k + (mu_s - mu_k) exp(-(v / v_s)^2)

    Source: Canudas de Wit et al. in the normalised form of FACTS.md 2. If |z| <= max(mu_s, mu_k) / sigma0 once, it is
    so always. At constant slip |T| = N (g + sigma2 |v|). Passive (with N sigma0 z^2 / 2 as its stored energy, N
    constant) where sigma1^2 |v| <= 4 g(v) (sigma1 + sigma2). The bristle relaxes within g / (sigma0 |v|): stiff.

    **Arguments:**

    - `static_coefficient`, `kinetic_coefficient`: mu_s, mu_k [1].
    - `stribeck_velocity`: v_s [m/s].
    - `bristle_stiffness`: sigma0 [1/m]; 1e4 to 1e6 is usual.
    - `bristle_damping`: sigma1 [s/m].
    - `viscous`: sigma2 [s/m].
    """

    smoothness: ClassVar[Smoothness] = "C0"
    remembers: ClassVar[tuple[str, ...]] = ("bristle",)
    static_coefficient: Number = physical("1", above=0.0)
    kinetic_coefficient: Number = physical("1", above=0.0)
    stribeck_velocity: Number = physical("m/s", above=0.0)
    bristle_stiffness: Number = physical("1/m", above=0.0)
    bristle_damping: Number = physical("s/m", least=0.0, default=0.0)
    viscous: Number = physical("s/m", least=0.0, default=0.0)

    def __call__(self, slip_velocity: Real, normal_force: Real, memory: Memory) -> Real:
        rate = self._bristle_rate(slip_velocity, memory[0])
        share = self.bristle_stiffness * memory[0] + self.bristle_damping * rate + self.viscous * slip_velocity
        return -positive_part(normal_force) * share

    def memory_rate(self, slip_velocity: Scalar, normal_force: Scalar, memory: Memory) -> Memory:
        # Without a normal force there is nothing to bend the bristle; it is straightened by `latch`.
        rate = jnp.where(normal_force > 0, self._bristle_rate(slip_velocity, memory[0]), 0.0)
        return jnp.stack([rate])

    def latch(self, memory: Memory, began: Flag, ended: Flag, penetration_rate: Scalar) -> Memory:
        return jnp.where(ended, 0.0, memory)

    def steady_share(self, slip_velocity: Real) -> Real:
        """g(v) [1]: the traction over the normal force at a constant slip, viscous part apart."""
        x = slip_velocity / self.stribeck_velocity
        return self.kinetic_coefficient + (self.static_coefficient - self.kinetic_coefficient) * jnp.exp(-x * x)

    def _bristle_rate(self, slip_velocity, bristle):
        relaxation = self.bristle_stiffness * jnp.abs(slip_velocity) / self.steady_share(slip_velocity)
        return slip_velocity - relaxation * bristle
