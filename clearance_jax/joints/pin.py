"""The base of joints with a pin in a sleeve: radii, a profile of wear, and the sections in which the pin bears."""

import abc
from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.joints._base import AbstractClearance
from clearance_jax.joints.bore import finer
from clearance_jax.joints.contact import Relative
from clearance_jax.joints.fitting import Tolerance
from clearance_jax.laws import Geometry, Material
from clearance_jax.parameters import Demand


class Sections(NamedTuple):
    """The sections of a sleeve in which its pin bears: the `geometry` of the whole, and by section its height along the
    sleeve's axis and its length [m], `heights` and `lengths` (sections,).
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

    @property
    def sleeve_radius(self) -> Scalar:
        """Pin radius plus radial clearance, as it was before it wore [m]."""
        return self.pin_radius + self.radial_clearance

    @property
    def profile(self) -> Any:
        """The total wear of the sleeve [m], of the shape of `depth`; `None`: it is round."""
        return self.depth

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
