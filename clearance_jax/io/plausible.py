"""Sizes that a solve would take as they are, and that nobody can have meant."""

from collections.abc import Iterator

import numpy as np

from clearance_jax.joints import RevoluteClearance
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.units import shown

# From a speck of dust to a ship. Outside, a unit or an exponent has slipped.
LEAST_MASS, GREATEST_MASS = 1e-12, 1e9
# The diameter of an atom [m].
LEAST_CLEARANCE = 1e-10
# So many are named in a warning.
NAMED = 4


class ImplausibleWarning(UserWarning):
    """A mechanism has sizes that nobody can have meant."""


def implausible(mechanism: Mechanism) -> str:
    """One sentence with the sizes that are not to be believed; empty where there are none."""
    found = [*_clearances(mechanism), *_masses(mechanism)]
    if not found:
        return ""
    more = f"; and {len(found) - NAMED} more" if len(found) > NAMED else ""
    return f"These sizes are hardly meant: {'; '.join(found[:NAMED])}{more}. Check their units."


def _clearances(mechanism: Mechanism) -> Iterator[str]:
    for joint in mechanism.clearance_joints():
        # By Python's numbers: a scene may be loaded while a function is traced.
        size = max(float(play.scale) for play in joint.joint.play() if play.slides is not None)
        if size < LEAST_CLEARANCE:
            yield f"the clearance of {joint.name}, {size:g} m, is less than an atom"
        elif isinstance(joint.clearance, RevoluteClearance):
            radial, pin = float(joint.clearance.radial_clearance), float(joint.clearance.pin_radius)
            if radial > pin:
                above = f"is above the pin's radius {shown(pin, 'm')}"
                yield f"{joint.name}.radial_clearance = {shown(radial, 'm')} {above}"


def _masses(mechanism: Mechanism) -> Iterator[str]:
    for body in mechanism.bodies:
        mass = np.nan if body.mass is None else float(body.mass)
        if mass < LEAST_MASS or mass > GREATEST_MASS:
            yield f"{body.name}.mass = {mass:g} kg"
