"""Normal laws. Adding one: its class or function, a line here, a catalogue line in the tests."""

from clearance_jax.laws.normal.adams import AdamsImpact
from clearance_jax.laws.normal.hertz import Hertz, HuntCrossley
from clearance_jax.laws.normal.linear import LinearKelvinVoigt
from clearance_jax.laws.normal.restitution import RestitutionLaw, exact_restitution, flores, lankarani_nikravesh

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

__all__ = [
    "NORMAL_LAWS",
    "AdamsImpact",
    "Hertz",
    "HuntCrossley",
    "LinearKelvinVoigt",
    "RestitutionLaw",
    "exact_restitution",
    "flores",
    "lankarani_nikravesh",
]
