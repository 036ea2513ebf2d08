"""Friction laws; a joint without friction has none of them. Adding one: its class, a line here, a catalogue line in the
tests.
"""

from clearance_jax.laws.friction.coulomb import CubicCoulomb, TanhCoulomb
from clearance_jax.laws.friction.lugre import LuGre
from clearance_jax.laws.friction.stribeck import BrownMcPhee

FRICTION_LAWS = {"cubic": CubicCoulomb, "tanh": TanhCoulomb, "brown-mcphee": BrownMcPhee, "lugre": LuGre}
"""Friction laws by the name a scene file gives them."""

__all__ = ["FRICTION_LAWS", "BrownMcPhee", "CubicCoulomb", "LuGre", "TanhCoulomb"]
