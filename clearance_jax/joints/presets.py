"""Joints with play as a designer first thinks of them: a clearance, a length, a diameter; the rest as is usual."""

from typing import Any

from clearance_jax.errors import ClearanceError
from clearance_jax.joints.revolute import RevoluteClearance
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, HuntCrossley, InternalHertz

# A steel pin in a bronze bush: moduli [Pa] and Poisson's ratios, as handbooks have them.
STEEL, BRONZE = (207e9, 0.29), (103e9, 0.34)
# Assumed damping factor of Hunt and Crossley's law [s/m]: at 0.1 m/s an impact loses some 2 % of its speed. Give a law
# where damping matters.
DAMPING = 0.3


def fitted(
    radial: Any,
    *,
    axial: Any = None,
    length: Any = None,
    diameter: Any = None,
    normal: AbstractNormalLaw | None = None,
    friction: AbstractFrictionLaw | None = None,
) -> RevoluteClearance | SleeveClearance:
    """The play of a pin.

    **Arguments:**

    - `radial` clearance [m]; `axial` [m]: to either side, by default none.
    - `length` of the sleeve [m]: with it the pin may tilt. `diameter` of the pin [m]: as long as the sleeve by default.
    - `normal`: by default Hunt and Crossley's law for a steel pin in a bronze bush, with the stiffness that Hertz has
      for this clearance; `friction`: by default none.

    **Raises:** `ClearanceError` where neither length nor diameter is given, and for axial play without a length.
    """
    if diameter is None and length is None:
        raise ClearanceError("Play needs the `diameter` of its pin, or the `length` of its sleeve. Give one of them.")
    if axial is not None and length is None:
        raise ClearanceError("Axial play needs the `length` of its sleeve too. Give it.")
    radius = (length if diameter is None else diameter) / 2
    if normal is None:
        stiffness = InternalHertz(STEEL[0], BRONZE[0], STEEL[1], BRONZE[1], reference_clearance=radial)
        normal = HuntCrossley(stiffness, DAMPING)
    if length is None:
        return RevoluteClearance(radial, radius, normal, friction)
    return SleeveClearance(radial, radius, length, normal, friction, axial)
