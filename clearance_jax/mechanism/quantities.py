"""A mechanism's numbers as quantities: which unit each has."""

from collections.abc import Iterable

from clearance_jax._types import Leaf
from clearance_jax.mechanism.mechanism import Mechanism, parameters
from clearance_jax.mechanism.tree import Prismatic


def leaf_of(name: str, known: dict[str, Leaf]) -> Leaf | None:
    """The parameter of that name; of `name.i`, one entry of an array, the array."""
    return known.get(name) or known.get(name.rpartition(".")[0])


def unit_of(leaf: Leaf, known: dict[str, Leaf], mechanism: Mechanism) -> str:
    """The unit of a parameter, with that of its joint's coordinate and of its law's exponent put in."""
    owner = leaf.name.removeprefix("drive.").partition(".")[0]
    sliding = any(j.name == owner and isinstance(j, Prismatic) for j in mechanism.joints)
    unit = resolve_unit(leaf.metadata["unit"], "m" if sliding else "rad")
    exponent = known.get(f"{leaf.name.rpartition('.')[0]}.exponent")
    if exponent is not None and unit == "N/m^1.5":
        unit = f"N/m^{float(exponent.value):g}"
    return unit


def resolve_unit(unit: str, coordinate: str) -> str:
    """A field's unit with "coordinate" and "effort" replaced by those of a rotation or a slide."""
    effort = "N*m" if coordinate == "rad" else "N"
    return unit.replace("effort", effort).replace("coordinate", coordinate or "rad")


def units_of(mechanism: Mechanism, names: Iterable[str]) -> dict[str, str]:
    """Units by name, of parameters that are there."""
    known = parameters(mechanism)
    leaves = {name: leaf_of(name, known) for name in names}
    return {name: unit_of(leaf, known, mechanism) for name, leaf in leaves.items() if leaf is not None}
