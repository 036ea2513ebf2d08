"""Geometry and materials of a contact, as laws see them."""

from typing import Any, Literal, NamedTuple

from jaxtyping import Array

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.parameters import physical


class Material(Module):
    """An elastic material: Young's `modulus` E [Pa], `poisson_ratio` nu."""

    modulus: Scalar = physical("Pa", "Young's modulus", '"206 GPa"', above=0.0)
    poisson_ratio: Scalar = physical("", "Poisson's ratio", "0.28", least=0.0, below=0.5, default=0.3)

    @property
    def compliance(self) -> Scalar:
        """(1 - nu^2) / E [1/Pa], its share of 1 / E*."""
        return (1 - self.poisson_ratio**2) / self.modulus


class Geometry(NamedTuple):
    """The geometry of a joint as laws see it: a pin in a sleeve.

    - `pin_radius`, `sleeve_radius`, `radial_clearance` [m]; `length` of the contact [m]; `pin_material`,
      `sleeve_material`. Length and materials are `None` if they are not known.
    - `kind`: a "point" contact, a "line" contact along the sleeve, or "flat" walls, which have no radii.
    - `depth`: the wear of the sleeve [m], shape (sectors,) or (sections, sectors); `None`: it is round. Radii and
      clearance are those of the round one.
    """

    pin_radius: Scalar
    sleeve_radius: Scalar
    radial_clearance: Scalar
    length: Scalar | None = None
    pin_material: Material | None = None
    sleeve_material: Material | None = None
    kind: Literal["point", "line", "flat"] = "point"
    depth: Array | None = None


# Data of one contact point of a joint (the curvature of a worn wall, for example), defined by the law; `None` for a
# round sleeve.
Local = Any
