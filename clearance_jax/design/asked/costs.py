"""Cost functions of a clearance from the tolerancing literature; costs fall as the clearance grows.

Lengths in metres, costs in any currency; so are the constants. Sources: reciprocal (Chase and Greenwood 1988), its
square (Spotts 1973), a power (Sutherland and Roth 1975), exponential (Speckhart 1972), exponential with reciprocal
power (Michael and Siddall 1981).
"""

import abc
import itertools
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float
from scipy.interpolate import PchipInterpolator

from clearance_jax._basis.module import Module
from clearance_jax._basis.types import Scalar
from clearance_jax.errors import ClearanceError
from clearance_jax.parameters import PARAMETER, physical

# The unit of the factor of factor / clearance^power: metres to that power.
POWER = f"{PARAMETER} to the power"


_FACTOR: Any = {"above": 0.0, "help": "factor of the clearance-dependent part"}
_RATE: Any = {"above": 0.0, "help": "rate at which the cost falls", "example": '"1 / (10 um)"'}
_POWER: Any = {"above": 0.0, "default": 1.0, "help": "power of the clearance", "example": "2"}
_FIXED: Any = {"default": 0.0, "help": "cost that no clearance saves", "example": "1.0"}


class AbstractCost(Module):
    """The cost of one clearance."""

    @abc.abstractmethod
    def __call__(self, clearance: Scalar) -> Scalar:
        """The cost of a clearance [m]."""


class Reciprocal(AbstractCost):
    """`fixed + factor / clearance^power`; power 1 and 2 are the classical ones."""

    factor: Scalar = physical(POWER, **_FACTOR, example='"0.04 mm^2"')
    power: Scalar = physical("", **_POWER)
    fixed: Scalar = physical("", **_FIXED)

    def __call__(self, clearance):
        return self.fixed + self.factor / clearance**self.power


class Exponential(AbstractCost):
    """`fixed + factor exp(-rate clearance)`, rate in 1/m."""

    factor: Scalar = physical("", **_FACTOR, example="3.0")
    rate: Scalar = physical(f"1/{PARAMETER}", **_RATE)
    fixed: Scalar = physical("", **_FIXED)

    def __call__(self, clearance):
        return self.fixed + self.factor * jnp.exp(-self.rate * clearance)


class ExponentialReciprocal(AbstractCost):
    """`fixed + factor exp(-rate clearance) / clearance^power`."""

    factor: Scalar = physical(POWER, **_FACTOR, example='"0.04 mm^2"')
    rate: Scalar = physical(f"1/{PARAMETER}", **_RATE)
    power: Scalar = physical("", **_POWER)
    fixed: Scalar = physical("", **_FIXED)

    def __call__(self, clearance):
        return self.fixed + self.factor * jnp.exp(-self.rate * clearance) / clearance**self.power


class CostTable(AbstractCost):
    """Costs that were quoted for some clearances, and a curve between them that does not overshoot (PCHIP). Below the
    first clearance the cost goes on along a straight line; beyond the last one it is constant.

    **Arguments:** `clearances` [m], increasing, and `costs`, both of shape (n,).
    """

    clearances: Float[Array, " n"]
    coefficients: Float[Array, "4 n-1"]

    def __init__(self, clearances, costs):
        x, y = ([float(v) for v in values] for values in (clearances, costs))
        if len(x) != len(y) or len(x) < 2 or any(b <= a for a, b in itertools.pairwise(x)):
            raise ClearanceError("A cost table wants at least two clearances, increasing, and a cost for each.")
        self.clearances = jnp.asarray(x)
        self.coefficients = jnp.asarray(PchipInterpolator(x, y).c)

    def __call__(self, clearance):
        x = jnp.clip(clearance, self.clearances[0], self.clearances[-1])
        i = jnp.clip(jnp.searchsorted(self.clearances, x, side="right") - 1, 0, self.clearances.shape[0] - 2)
        slope_at_first = self.coefficients[2, 0]
        straight = slope_at_first * jnp.minimum(clearance - self.clearances[0], 0.0)
        return jnp.polyval(self.coefficients[:, i], x - self.clearances[i]) + straight


COSTS: dict[str, type[AbstractCost]] = {
    "reciprocal": Reciprocal,
    "exponential": Exponential,
    "exponential-reciprocal": ExponentialReciprocal,
    "table": CostTable,
}
"""Cost functions by their names in a study."""
