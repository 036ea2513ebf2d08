"""Array aliases."""

from typing import TypeAlias

from jaxtyping import Array, Bool, Float, Int

Scalar: TypeAlias = Float[Array, ""]
Number: TypeAlias = Float[Array, "..."] | float
Flag: TypeAlias = Bool[Array, ""]
Code: TypeAlias = Int[Array, ""]
Each: TypeAlias = Float[Array, "*lanes"]
"""One number, or one for every lane of a batch: lanes are the last axis of whatever they are of."""
EachFlag: TypeAlias = Bool[Array, "*lanes"]
Rows: TypeAlias = tuple[Float[Array, "..."], ...]
"""A state or its rate, one array for each component: a number, or a number and its derivatives along one axis."""
