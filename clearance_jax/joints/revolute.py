"""The plane revolute clearance joint: a pin in a round sleeve.

The contact point lies on the sleeve's surface, P = R n with n = e/|e|; both wrenches act there, so momentum and power
balance exactly. (Formulas that use the pin's own radius as its arm differ from this by the penetration.)
"""

from typing import Any, ClassVar

import jax.numpy as jnp

from clearance_jax._numerics import safe_unit
from clearance_jax._types import Scalar
from clearance_jax.joints._base import AbstractClearance, AbstractElement, ContactPoint, PlayCoordinate
from clearance_jax.joints.checks import warn_of_pin
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import physical
from clearance_jax.spatial import Vector, X, Y, dot, plus, scale, times


def round_play(radial_clearance: Any) -> tuple[PlayCoordinate, PlayCoordinate]:
    """The eccentricity of a pin: two slides along the sleeve's axes, of the scale of the radial clearance [m], of
    whatever numbers these are.
    """
    return PlayCoordinate(".play_x", radial_clearance, slides=X), PlayCoordinate(".play_y", radial_clearance, slides=Y)


def round_geometry(clearance: Any) -> Geometry:
    """What laws may know of a round pin in a sleeve that was made round."""
    return Geometry(
        clearance.pin_radius,
        clearance.sleeve_radius,
        clearance.radial_clearance,
        clearance.length,
        clearance.pin_material,
        clearance.sleeve_material,
    )


class RevoluteClearance(AbstractClearance):
    """Radial play of a pin in a sleeve.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius`: [m], > 0.
    - `normal`: the normal law.
    - `friction`: the friction law, or `None`: then no friction code is compiled.
    - `element`: what acts without touch (a film), or `None`.
    - `length` of the contact [m], `pin_material`, `sleeve_material`: for laws that ask for them.
    - `tolerance`: between what the clearance lies as it is made, for who reads it.
    """

    radial_clearance: Scalar = physical(
        "m", above=0.0, help="sleeve radius minus pin radius; its presence makes the play", example='"0.1 mm"'
    )
    pin_radius: Scalar = physical("m", above=0.0, help="radius of the pin", example='"10 mm"')
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    length: Scalar | None = physical("m", above=0.0, default=None)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tolerance: Tolerance | None = None
    tangents: ClassVar[int] = 1

    def __check_init__(self):
        warn_of_pin(self.radial_clearance, self.pin_radius)

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance [m]."""
        return self.pin_radius + self.radial_clearance

    def play(self):
        return round_play(self.radial_clearance)

    def geometry(self):
        return round_geometry(self)

    def points(self, at):
        distance, nx, ny = safe_unit(jnp.asarray(at.place[0], float), jnp.asarray(at.place[1], float))
        normal: Vector = (nx, ny, 0.0)
        tangent: Vector = (-ny, nx, 0.0)
        reach = self.sleeve_radius - distance
        return ContactPoint(
            penetration=distance - self.radial_clearance,
            penetration_rate=jnp.asarray(dot(normal, at.velocity)),
            slip=(jnp.asarray(plus(dot(tangent, at.velocity), times(reach, at.spin[2]))),),
            normal=normal,
            tangents=(tangent,),
            arm=scale(reach, normal),
        )

    def travel(self, along):
        return self.radial_clearance
