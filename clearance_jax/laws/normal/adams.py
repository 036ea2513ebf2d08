"""The IMPACT function of MSC ADAMS."""

import dataclasses
from typing import Any, ClassVar

from clearance_jax._basis.numerics import step3
from clearance_jax._basis.types import Scalar
from clearance_jax.laws._base import Smoothness
from clearance_jax.laws.free_impact import damping_for, needed
from clearance_jax.laws.normal._power import STIFFNESS, AbstractPowerLaw, power
from clearance_jax.parameters import physical


class AdamsImpact(AbstractPowerLaw):
    """F = max(0, K d^n + STEP(d, 0, 0, d_max, c_max) d') for d > 0: the IMPACT function of MSC ADAMS.

    The outer max(0, .) belongs to the definition (SolidWorks Motion and ADAMS function manuals; Qian et al. 2022,
    Eqs. 6 and 7, doi 10.3390/app122111041).

    **Arguments:** `stiffness` K [N/m^n], `damping` c_max [N s/m], `full_damping_depth` d_max [m] at which the damping
    is complete, `exponent` n (`None`: 3/2).
    """

    stiffness: Any = physical(STIFFNESS, above=0.0, help="stiffness K", example='"2.487e6 N/mm^1.5"')
    damping: Scalar = physical("N*s/m", least=0.0, help="damping c_max at full depth", example='"2000 N*s/m"')
    full_damping_depth: Scalar = physical(
        "m", above=0.0, help="penetration d_max from which on the damping is complete", example='"0.01 mm"'
    )
    exponent: Scalar | None = physical(
        "", least=1.0, default=None, help="exponent n of the penetration", example="1.5", absent="1.5"
    )
    smoothness: ClassVar[Smoothness] = "C0"

    def formula(self, constants, penetration, penetration_rate, memory):
        damping = self.damping * step3(penetration * (1.0 / self.full_damping_depth))
        return constants * power(penetration, self.exponent) + damping * penetration_rate

    def event_functions(self, constants, penetration, penetration_rate, memory):
        # The damping's curvature jumps at d_max, by 6 c_max / d_max^2: no error estimate sees it.
        return (penetration - self.full_damping_depth,)

    def for_restitution(self, restitution, speed=None, mass=None, geometry=None):
        """The law with the damping that delivers a `restitution`; of plain numbers, since impacts are simulated."""

        def damped(damping):
            return dataclasses.replace(self, damping=damping)

        speed, mass = needed(speed, "speed", self), needed(mass, "mass", self)
        guess = mass * speed / self.full_damping_depth
        return damped(damping_for(lambda c: damped(c).delivered_restitution(speed, mass, geometry), restitution, guess))
