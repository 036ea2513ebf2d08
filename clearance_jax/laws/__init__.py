"""Contact laws of one contact point: normal force, friction, and the stiffnesses and damping factors they take."""

from clearance_jax.laws._base import (
    APART,
    CLIPPED,
    CONTACT,
    AbstractFrictionLaw,
    AbstractLaw,
    AbstractNormalLaw,
    AbstractParameter,
    AbstractStiffness,
)
from clearance_jax.laws.damping_factor import (
    AbstractDampingFactor,
    Exact,
    Flores,
    LankaraniNikravesh,
    exact_damping_factor,
)
from clearance_jax.laws.friction import BrownMcPhee, CubicCoulomb, LuGre, TanhCoulomb
from clearance_jax.laws.hysteresis import Hysteresis
from clearance_jax.laws.normal import AdamsImpact, Hertz, HuntCrossley, LinearKelvinVoigt
from clearance_jax.laws.stiffness import InternalHertz

__all__ = [
    "APART",
    "CLIPPED",
    "CONTACT",
    "AbstractDampingFactor",
    "AbstractFrictionLaw",
    "AbstractLaw",
    "AbstractNormalLaw",
    "AbstractParameter",
    "AbstractStiffness",
    "AdamsImpact",
    "BrownMcPhee",
    "CubicCoulomb",
    "Exact",
    "Flores",
    "Hertz",
    "HuntCrossley",
    "Hysteresis",
    "InternalHertz",
    "LankaraniNikravesh",
    "LinearKelvinVoigt",
    "LuGre",
    "TanhCoulomb",
    "exact_damping_factor",
]
