"""Friction laws; a joint without friction has none of them. Adding one: its class, a line here, a catalogue line in the
tests.
"""

from clearance_jax.laws.friction.bristles import Dahl, ElastoPlastic, LuGre
from clearance_jax.laws.friction.bristles import SmoothedBristles as SmoothedBristles
from clearance_jax.laws.friction.velocity import (
    AdamsFriction,
    Ambrosio,
    BengisuAkay,
    BrownMcPhee,
    CubicCoulomb,
    Stribeck,
    TanhCoulomb,
    Threlfall,
)

FRICTION_LAWS = {
    "cubic": CubicCoulomb,
    "tanh": TanhCoulomb,
    "brown-mcphee": BrownMcPhee,
    "lugre": LuGre,
    "adams": AdamsFriction,
    "threlfall": Threlfall,
    "ambrosio": Ambrosio,
    "bengisu-akay": BengisuAkay,
    "stribeck": Stribeck,
    "dahl": Dahl,
    "elasto-plastic": ElastoPlastic,
}
"""Friction laws by the name a scene file gives them."""
