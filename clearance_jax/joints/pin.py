"""Joints with a pin in a sleeve: their base (radii, wear, sections in which the pin bears), and the plane one.

The contact point lies on the sleeve's surface, P = R n with n = e/|e|; both wrenches act there, so momentum and power
balance exactly. (Formulas with the pin's own radius as arm differ from this by the penetration.) For the bore of a worn
sleeve see `joints.bore`.
"""

import abc
import dataclasses
from collections.abc import Iterator
from typing import Any, ClassVar, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from clearance_jax._basis.numerics import safe_unit
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance, AbstractElement
from clearance_jax.joints.bore import FEWEST, Bore, Modes, finer
from clearance_jax.joints.checks import GRIPS, warn_of_pin
from clearance_jax.joints.contact import ContactPoint, JointOutline, PlayCoordinate, Relative
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.laws import AbstractFrictionLaw, AbstractNormalLaw, Geometry, Material
from clearance_jax.parameters import Demand, physical
from clearance_jax.spatial import Vector, X, Y, dot, plus, scale, times


class Sections(NamedTuple):
    """The sections in which a pin bears: the whole's `geometry`; by section the `heights` along the axis and `lengths`
    [m].
    """

    geometry: Geometry
    heights: Float[Array, " sections"]
    lengths: Float[Array, " sections"]


class AbstractPin(AbstractClearance):
    """A pin in a sleeve, which may be worn."""

    radial_clearance: eqx.AbstractVar[Scalar]
    pin_radius: eqx.AbstractVar[Scalar]
    pin_material: eqx.AbstractVar[Material | None]
    sleeve_material: eqx.AbstractVar[Material | None]
    tolerance: eqx.AbstractVar[Tolerance | None]
    depth: eqx.AbstractVar[Array | None]
    """By how much the sleeve is worn off [m]; `None`: it is round, which costs nothing more."""
    length: eqx.AbstractVar[Scalar | None]
    contact: eqx.AbstractClassVar[Literal["point", "line"]]

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance, as it was before it wore [m]."""
        return self.pin_radius + self.radial_clearance

    @property
    def profile(self) -> Any:
        """The total wear of the sleeve [m], of the shape of `depth`; `None`: it is round."""
        return self.depth

    def geometry(self):
        sizes = self.pin_radius, self.sleeve_radius, self.radial_clearance, self.length
        return Geometry(*sizes, self.pin_material, self.sleeve_material, self.contact, self.profile)

    def across(self) -> tuple[PlayCoordinate, ...]:
        """The eccentricity of the pin: two slides along the sleeve's axes."""
        radial = self.radial_clearance
        return PlayCoordinate(".play_x", radial, slides=X), PlayCoordinate(".play_y", radial, slides=Y)

    def ready(self):
        """The same joint with its refined profile."""
        return self if self.depth is None else self.worn(finer(self.profile))

    @property
    def section_count(self) -> int:
        """The number of sections. Their contact points are the first ones."""
        return 1

    def sections(self) -> Sections:
        """Its sections. **Raises:** `ClearanceError` if the length of the contact is not known."""
        geometry = self.geometry()
        if geometry.length is None:
            raise ClearanceError("The depth of wear depends on the length of the contact: give the joint its `length`.")
        return Sections(geometry, jnp.zeros(1), jnp.reshape(geometry.length, (1,)))

    def centres(self, at: Relative) -> Float[Array, "sections 2"]:
        """The place of the pin's centre in every section [m]."""
        return jnp.stack([jnp.asarray(c, float) for c in at.place[:2]])[None]

    def by_section(self, numbers: Any) -> Any:
        """From a tree of numbers of all contact points, those of the sections, (sections,) each."""
        return jax.tree.map(lambda each: jnp.ravel(jnp.asarray(each, float))[: self.section_count], numbers)

    @abc.abstractmethod
    def worn(self, depth: Any) -> "AbstractPin":
        """The same joint with a total wear [m] of the shape of `depth`, or of shape (sectors,) for all sections.
        **Raises:** `ClearanceError` for other shapes.
        """


def depth_demand(pin: AbstractPin) -> Iterator[Demand]:
    """The demand that the wear stays below the pin's radius, up to which it is computed right."""
    radius = pin.pin_radius
    if pin.depth is not None:
        yield Demand("depth", (pin.profile < radius).all(), lambda: f"must be below the pin's radius, {radius:g} m")


class RevoluteClearance(AbstractPin):
    """The radial play of a pin in a sleeve.

    **Arguments:**

    - `radial_clearance`: sleeve radius minus pin radius [m], > 0.
    - `pin_radius` [m], > 0.
    - `normal`: the normal law.
    - `friction`: the friction law, or `None`: then no friction is compiled.
    - `element`: what acts without touch (a film), or `None`.
    - `length` [m] of the contact, over which wear and line contacts spread their force; `pin_material`,
      `sleeve_material`: for laws that need them.
    - `tolerance`: between which values the clearance lies as it is made, for information.
    - `depth` [m]: the wear of the sleeve, shape (sectors,), at least 16 of them: the first in the direction of the
      sleeve's x, the others evenly around it. `None`: the sleeve is round, and the program has nothing for wear.
    - `modes`: further wear, by few numbers.

    **Raises:** `ClearanceError` for depths or modes of other shapes.
    """

    radial_clearance: Scalar = physical(
        "m", "sleeve radius minus pin radius; its presence makes the play", '"0.1 mm"', above=0.0, instead=GRIPS
    )
    pin_radius: Scalar = physical("m", "radius of the pin", '"10 mm"', above=0.0)
    normal: AbstractNormalLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFrictionLaw | None = None
    element: AbstractElement | None = None
    length: Scalar | None = physical("m", above=0.0, default=None)
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    tolerance: Tolerance | None = None
    depth: Float[Array, "*batch sectors"] | None = physical("m", least=0.0, default=None)
    modes: Modes | None = None
    kind: ClassVar[str] = "pin"
    tangents: ClassVar[int] = 1
    contact: ClassVar[Literal["point", "line"]] = "point"

    def __check_init__(self):
        if self.depth is None:
            warn_of_pin(self.radial_clearance, self.pin_radius)
        shape = () if self.depth is None else np.shape(self.depth)
        if self.depth is not None and (len(shape) != 1 or shape[-1] < FEWEST):
            raise ClearanceError(f"`depth` must be one number a sector, at least {FEWEST}, but it has shape {shape}.")
        if self.modes is not None and np.shape(self.modes.shapes) != (*np.shape(self.modes.amounts), *shape):
            raise ClearanceError("`modes` must have one number a sector of `depth` for each of their amounts.")

    def demands(self):
        return depth_demand(self)

    @property
    def profile(self):
        if self.depth is None or self.modes is None:
            return self.depth
        return self.depth + self.modes.amounts @ self.modes.shapes

    def play(self):
        return self.across()

    def points(self, at):
        x, y = (jnp.asarray(c, float) for c in at.place[:2])
        if self.depth is None:
            distance, nx, ny = safe_unit(x, y)
            depth, normal = distance - self.radial_clearance, (nx, ny, 0.0)
            reach = self.sleeve_radius - distance
        else:
            depth, gx, gy = self._bore.depth_at(x, y)
            _, nx, ny = safe_unit(gx, gy)
            normal = (gx, gy, 0.0)
            # The arm is along the force, from the pin's centre: a force has no moment about a round pin.
            reach = self.pin_radius - depth
        tangent: Vector = (-ny, nx, 0.0)
        return ContactPoint(
            penetration=depth,
            penetration_rate=jnp.asarray(dot(normal, at.velocity)),
            slip=(jnp.asarray(plus(dot(tangent, at.velocity), times(reach, at.spin[2]))),),
            normal=normal,
            tangents=(tangent,),
            arm=scale(reach, (nx, ny, 0.0)),
        )

    def travel(self, along):
        if self.depth is None:
            return self.radial_clearance
        x, y = (jnp.asarray(c, float) for c in along[:2])
        return self._bore.distance(x, y, jnp.zeros(()))

    def press(self, along, depth):
        if self.depth is None:
            return scale(self.radial_clearance + depth, along)
        return (*self._bore.seat(along, depth), 0.0)

    def outline(self):
        return JointOutline(self.pin_radius, self.radial_clearance, self.profile)

    @property
    def _bore(self) -> Bore:
        return Bore(self.radial_clearance, finer(self.profile))

    def worn(self, depth: Any) -> "RevoluteClearance":
        return dataclasses.replace(self, depth=jnp.asarray(depth, float), modes=None)
