"""Contact laws, each for one contact point. Adding one: its class or function, an export here, a catalogue line."""

from clearance_jax.laws._base import AbstractFrictionLaw, AbstractNormalLaw, AbstractStiffness
from clearance_jax.laws.friction import BrownMcPhee, CubicCoulomb, LuGre, TanhCoulomb
from clearance_jax.laws.normal import AdamsImpact, Hertz, HuntCrossley, LinearKelvinVoigt
from clearance_jax.laws.restitution import RestitutionLaw, exact_restitution, flores, lankarani_nikravesh
from clearance_jax.laws.stiffness import InternalHertz

NORMAL_LAWS = {
    "kelvin-voigt": LinearKelvinVoigt,
    "hertz": Hertz,
    "adams-impact": AdamsImpact,
    "hunt-crossley": HuntCrossley,
    "exact-restitution": exact_restitution,
    "lankarani-nikravesh": lankarani_nikravesh,
    "flores": flores,
}
"""Normal laws by the name a scene file gives them."""

FRICTION_LAWS = {"cubic": CubicCoulomb, "tanh": TanhCoulomb, "brown-mcphee": BrownMcPhee, "lugre": LuGre}
"""Friction laws by the name a scene file gives them."""

__all__ = [
    "FRICTION_LAWS",
    "NORMAL_LAWS",
    "AbstractFrictionLaw",
    "AbstractNormalLaw",
    "AbstractStiffness",
    "AdamsImpact",
    "BrownMcPhee",
    "CubicCoulomb",
    "Hertz",
    "HuntCrossley",
    "InternalHertz",
    "LinearKelvinVoigt",
    "LuGre",
    "RestitutionLaw",
    "TanhCoulomb",
    "exact_restitution",
    "flores",
    "lankarani_nikravesh",
]
