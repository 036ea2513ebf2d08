"""The plane revolute clearance joint whose sleeve is worn: its bore is no circle (see `joints.bore`)."""

import dataclasses
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._numerics import safe_unit
from clearance_jax._types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance, AbstractElement, ContactPoint
from clearance_jax.joints.bore import FEWEST, Bore
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.joints.revolute import RevoluteClearance, round_geometry, round_play
from clearance_jax.joints.sleeve import SleeveClearance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Material
from clearance_jax.parameters import Demand, physical
from clearance_jax.spatial import Vector, dot, plus, scale, times


class WornRevoluteClearance(AbstractClearance):
    """Radial play of a round pin in a worn sleeve. Its profile is smooth in its values; a round sleeve that is to cost
    nothing more is a `RevoluteClearance`.

    **Arguments** as `RevoluteClearance`'s, and `depth`: by how much the sleeve is worn off [m], shape (sectors,), at
    least 16 of them: the first in the direction of the sleeve's x, then around it evenly. `modes` (count, sectors) [m]
    with `amounts` (count,), or neither: shapes that are worn off too, each so many times. What is looked for in a
    profile, a derivative say, is then a few numbers and not one a sector.

    **Raises:** `ClearanceError` for other shapes.
    """

    radial_clearance: Scalar = physical("m", above=0.0)
    pin_radius: Scalar = physical("m", above=0.0)
    normal: AbstractNormalLaw
    depth: Float[Array, "*batch sectors"] = physical("m", least=0.0)
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    length: Scalar | None = physical("m", above=0.0, default=None)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tolerance: Tolerance | None = None
    modes: Float[Array, "*batch count sectors"] | None = physical("m", default=None)
    amounts: Float[Array, "*batch count"] | None = physical("", default=None)
    tangents: ClassVar[int] = 1

    def __check_init__(self):
        if np.ndim(self.depth) != 1 or np.shape(self.depth)[-1] < FEWEST:
            shape = np.shape(self.depth)
            raise ClearanceError(f"`depth` must be one number a sector, at least {FEWEST}, but it has shape {shape}.")
        asked = () if self.amounts is None else (*np.shape(self.amounts), *np.shape(self.depth))
        if (() if self.modes is None else np.shape(self.modes)) != asked:
            raise ClearanceError("`modes` must be one number a sector for each of the `amounts`.")

    def demands(self):
        radius = self.pin_radius
        yield Demand("depth", (self.profile < radius).all(), lambda: f"must be below the pin's radius, {radius:g} m")

    @property
    def profile(self) -> Any:
        """By how much the sleeve is worn off in all [m], shape (sectors,)."""
        return self.depth if self.modes is None or self.amounts is None else self.depth + self.amounts @ self.modes

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance, as it was before it wore [m]."""
        return self.pin_radius + self.radial_clearance

    @property
    def bore(self) -> Bore:
        """The shape of its bore."""
        return Bore(self.radial_clearance, self.profile)

    def play(self):
        return round_play(self.radial_clearance)

    def geometry(self):
        return round_geometry(self)

    def points(self, at):
        depth = self.bore.depth_at(jnp.asarray(at.place[0], float), jnp.asarray(at.place[1], float))
        _, nx, ny = safe_unit(depth.x, depth.y)
        normal: Vector = (depth.x, depth.y, 0.0)
        tangent: Vector = (-ny, nx, 0.0)
        # From the pin's centre along the force: it has no moment about a round pin.
        reach = self.pin_radius - depth.value
        return ContactPoint(
            penetration=depth.value,
            penetration_rate=jnp.asarray(dot(normal, at.velocity)),
            slip=(jnp.asarray(plus(dot(tangent, at.velocity), times(reach, at.spin[2]))),),
            normal=normal,
            tangents=(tangent,),
            arm=scale(reach, (nx, ny, 0.0)),
        )

    def travel(self, along):
        x, y = (jnp.asarray(c, float) for c in along[:2])
        return self.bore.distance(x, y, jnp.zeros(()))

    def pressed(self, along, depth):
        return (*self.bore.seat(along, depth), 0.0)


def worn_sleeve(
    clearance: RevoluteClearance | WornRevoluteClearance | SleeveClearance, depth: Array
) -> WornRevoluteClearance | SleeveClearance:
    """The same joint with its sleeve worn off by so much [m] in all: shape (sectors,), of a `SleeveClearance`
    (stations, sectors), or (sectors,) for the same all along it.
    """
    if isinstance(clearance, SleeveClearance):
        depth = jnp.asarray(depth, float)
        if depth.ndim == 1:
            depth = jnp.tile(depth, (clearance.stations, 1))
        return dataclasses.replace(clearance, depth=depth)
    return WornRevoluteClearance(
        clearance.radial_clearance,
        clearance.pin_radius,
        clearance.normal,
        depth,
        clearance.friction,
        clearance.element,
        clearance.length,
        clearance.pin_material,
        clearance.sleeve_material,
        clearance.tolerance,
    )
