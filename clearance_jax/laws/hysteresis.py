"""The hysteresis family: elastic force times a loss that is measured by the speed of the last impact."""

from typing import ClassVar

import jax.numpy as jnp

from clearance_jax._numerics import Real, positive_part
from clearance_jax._types import Flag, Number, Scalar, physical
from clearance_jax.laws._base import AbstractNormalLaw, AbstractStiffness, Memory, Smoothness, number
from clearance_jax.laws._elastic import elastic_energy, elastic_force
from clearance_jax.laws.damping_factor import AbstractDampingFactor


class Hysteresis(AbstractNormalLaw):
    """Elastic force with hysteresis damping scaled by the impact speed.

    F = max(0, K d^n (1 + a d_dot / v0))

    Source: FACTS.md 1.2. The members of the family (`Exact`, `LankaraniNikravesh`, `Flores`, ...) differ only in the
    damping factor a(e). Whatever a, n, K, m and v0 are, a free impact delivers the restitution e that solves
    a (1 + e) = ln[(1 + a) / (1 - a e)] (FACTS.md 4.2), and the force of a free impact never pulls.

    v0 is the penetration rate at the last first touch: an event state, latched when contact begins and cleared when
    it ends. In a joint that stays loaded it is the speed of an impact long past; the clip is for that case.

    **Arguments:**

    - `stiffness`: K [N/m^n], or a stiffness computed from the geometry.
    - `damping_factor`: a [1], a number or a member of the family (`prepared` computes its number).
    - `exponent`: n [1], above 1; `None` means 3/2.
    - `minimum_impact_speed`: lower bound of v0 [m/s]. Without it a/v0 has no bound as the touch becomes gentle; 1 mm/s
      is well below the impact speeds of a joint with clearance. It also serves a contact that has not been latched
      (one that exists when the simulation starts).
    """

    smoothness: ClassVar[Smoothness] = "C1"
    remembers: ClassVar[tuple[str, ...]] = ("impact_speed",)
    stiffness: Number | AbstractStiffness = physical("N/m**1.5", above=0.0)
    damping_factor: Number | AbstractDampingFactor = physical("1", least=0.0)
    exponent: Number | None = physical("1", above=1.0, default=None)
    minimum_impact_speed: Number = physical("m/s", above=0.0, default=1e-3)

    def __call__(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        return positive_part(self.unclipped(penetration, penetration_rate, memory))

    def unclipped(self, penetration: Real, penetration_rate: Real, memory: Memory) -> Real:
        elastic = elastic_force(self.stiffness, self.exponent, penetration)
        impact_speed = self._at_least_minimum(memory[0])
        return elastic * (1 + number(self.damping_factor) * penetration_rate / impact_speed)

    def energy(self, penetration: Real) -> Real:
        return elastic_energy(self.stiffness, self.exponent, penetration)

    def latch(self, memory: Memory, began: Flag, ended: Flag, penetration_rate: Scalar) -> Memory:
        speed = self._at_least_minimum(penetration_rate)
        return jnp.where(began, speed, jnp.where(ended, 0.0, memory))

    def _at_least_minimum(self, speed):
        # Written with `where`: at a tie `maximum` would split the derivative between a state and a constant.
        return jnp.where(speed > self.minimum_impact_speed, speed, self.minimum_impact_speed)
