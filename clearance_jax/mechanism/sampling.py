"""Digital control: measurement at whole multiples of a period, with commands held in between."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax._basis.types import Flag, Scalar
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.parameters import describe

# A step starts four round-offs past an instant, see `solve.control.past_break`.
_HAIR = 16 * float(np.finfo(np.float64).eps)


def period_key():
    """The field of a sampling period [s]."""
    about = {"help": "period at which it measures anew; it holds its force in between", "example": '"1 ms"'}
    about |= {"absent": "it acts all the time", "unit": "s", "above": 0.0}
    return eqx.field(static=True, default=None, metadata=about)


def names_key(help: str, absent: str):
    """A field that names coordinates; one name stands for a tuple of one."""

    def names(given: Any) -> tuple[str, ...]:
        return (given,) if isinstance(given, str) else tuple(given)

    return describe(help, '["motor", "link"]', absent, static=True, default=(), converter=names)


def check_period(period: Any, what: str) -> None:
    """Raise unless a period [s] is a plain number greater than zero."""
    if period is not None and not (isinstance(period, (int, float)) and 0 < period < math.inf):
        raise ClearanceError(
            f"{what} must have a `period` greater than zero, a number in s that nothing is differentiated by, but it "
            f"is {quote(period)}."
        )


def instants(period: float, time: Scalar) -> Array:
    """The sampling times around a time: the last one and the next two."""
    return (jnp.floor(time / period) + np.arange(3.0)) * period


def is_instant(period: float, time: Scalar) -> Flag:
    """Whether a step that starts at a time starts at a sampling instant."""
    return jnp.abs(time - period * jnp.round(time / period)) <= _HAIR * jnp.abs(time)
