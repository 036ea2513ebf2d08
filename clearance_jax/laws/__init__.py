"""Contact laws, each for one contact point."""

from clearance_jax.laws._base import AbstractFrictionLaw, AbstractNormalLaw, AbstractStiffness, Touch
from clearance_jax.laws.friction import FRICTION_LAWS, BrownMcPhee, CubicCoulomb, LuGre, TanhCoulomb
from clearance_jax.laws.geometry import Geometry, Material
from clearance_jax.laws.normal import (
    NORMAL_LAWS,
    AdamsImpact,
    Hertz,
    HuntCrossley,
    LinearKelvinVoigt,
    RestitutionLaw,
    exact_restitution,
    flores,
    lankarani_nikravesh,
)
from clearance_jax.laws.smoothing import SmoothedOnset
from clearance_jax.laws.stiffness import InternalHertz

__all__ = [
    "FRICTION_LAWS",
    "NORMAL_LAWS",
    "AbstractFrictionLaw",
    "AbstractNormalLaw",
    "AbstractStiffness",
    "AdamsImpact",
    "BrownMcPhee",
    "CubicCoulomb",
    "Geometry",
    "Hertz",
    "HuntCrossley",
    "InternalHertz",
    "LinearKelvinVoigt",
    "LuGre",
    "Material",
    "RestitutionLaw",
    "SmoothedOnset",
    "TanhCoulomb",
    "Touch",
    "exact_restitution",
    "flores",
    "lankarani_nikravesh",
]
