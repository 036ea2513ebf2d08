"""Checks for implausible masses and clearances, which are likely errors of units."""

from collections.abc import Iterator

import numpy as np

from clearance_jax.joints import AbstractClearance
from clearance_jax.joints.checks import ImplausibleWarning, above_pin
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import outside

# From a speck of dust to a ship. Outside, a unit or an exponent has slipped.
LEAST_MASS, GREATEST_MASS = 1e-12, 1e9
# The diameter of an atom [m].
LEAST_CLEARANCE = 1e-10
__all__ = ["ImplausibleWarning", "implausible"]
# Most sizes in a warning.
NAMED = 4


def implausible(mechanism: Mechanism) -> str:
    """A sentence that names implausible sizes; empty if there are none."""
    faults = [*_clearances(mechanism), *_masses(mechanism)]
    if not faults:
        return ""
    more = f"; and {len(faults) - NAMED} more" if len(faults) > NAMED else ""
    return f"These sizes are hardly meant: {'; '.join(faults[:NAMED])}{more}. Check their units."


def _clearances(mechanism: Mechanism) -> Iterator[str]:
    for joint in mechanism.clearance_joints():
        # By Python's numbers: a scene may be loaded while a function is traced.
        size = max(float(play.scale) for play in outside(joint.clearance).play() if play.slides is not None)
        if size < LEAST_CLEARANCE:
            yield f"the clearance of {joint.name}, {size:g} m, is less than an atom"
            continue
        if fault := _above_pin(joint.clearance):
            yield f"{joint.name}.{fault}"


def _above_pin(clearance: AbstractClearance) -> str:
    """A message if the radial clearance exceeds the pin's radius, which plane joints accept; else empty."""
    radial, pin = (getattr(clearance, name, None) for name in ("radial_clearance", "pin_radius"))
    return "" if radial is None or pin is None else above_pin(radial, pin)


def _masses(mechanism: Mechanism) -> Iterator[str]:
    for body in mechanism.bodies:
        mass = np.nan if body.mass is None else float(body.mass)
        if mass < LEAST_MASS or mass > GREATEST_MASS:
            yield f"{body.name}.mass = {mass:g} kg"
