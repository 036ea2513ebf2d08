"""Array aliases and the field type of every physical number.

A number of the model (a mass, a clearance, a stiffness) is always an array leaf, never a Python float: a float field
would be a compile-time constant (a new compilation for every value, and no derivative).
"""

import dataclasses
from collections.abc import Iterator
from typing import Any, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from clearance_jax.errors import require_float64

Scalar: TypeAlias = Float[Array, ""]
Number: TypeAlias = Float[Array, "..."] | float
Flag: TypeAlias = Bool[Array, ""]
Code: TypeAlias = Int[Array, ""]


def as_leaf(value: Any) -> Any:
    """`value` as a float64 array leaf; `None` (the quantity is absent from the model) stays `None`."""
    if value is None or isinstance(value, eqx.Module):
        return value
    if isinstance(value, (int, float, np.ndarray, np.generic, list, tuple)):
        require_float64()
        return jnp.asarray(value, dtype=float)
    return value


def physical(unit: str, *, above: float | None = None, least: float | None = None, below: float | None = None, **field):
    """A dataclass field that holds one physical number (or `None` where the quantity may be absent).

    **Arguments:**

    - `unit`: the SI unit, as pint spells it.
    - `above`, `least`, `below`: open lower, closed lower and open upper bound of valid values, checked at the door of
      `simulate` and by the scene reader.
    - `field`: passed on to `dataclasses.field` (for instance `default`).
    """
    metadata = {"unit": unit, "above": above, "least": least, "below": below}
    return eqx.field(converter=as_leaf, metadata=metadata, **field)


def flattened(**field):
    """A field whose own name is left out of dotted parameter names: its members appear as its owner's."""
    return eqx.field(metadata={"flattened": True}, **field)


def physical_leaves(module: eqx.Module, path: tuple[str, ...] = (), prefix: str = "") -> Iterator["Leaf"]:
    """Every number of `module`, with its dotted name and how to reach it."""
    for field in dataclasses.fields(module):
        if field.metadata.get("static", False):
            continue
        value = getattr(module, field.name)
        name = prefix if field.metadata.get("flattened") else f"{prefix}{field.name}."
        if "unit" in field.metadata and not isinstance(value, eqx.Module):
            if value is not None:
                yield Leaf(name[:-1], (*path, field.name), value, field.metadata)
        elif isinstance(value, eqx.Module):
            yield from physical_leaves(value, (*path, field.name), name)
        elif isinstance(value, tuple):
            for index, member in enumerate(value):
                yield from physical_leaves(member, (*path, field.name, str(index)), f"{name}{index}.")


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One number of a model: dotted name, the attribute path to it, its value and its field's metadata."""

    name: str
    path: tuple[str, ...]
    value: Any
    metadata: Any


def follow(module: Any, path: tuple[str, ...]) -> Any:
    """The member of `module` at an attribute path (digits index tuples)."""
    for step in path:
        module = module[int(step)] if step.isdigit() else getattr(module, step)
    return module
