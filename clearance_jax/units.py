"""Quantities with units, read by pint and returned in SI."""

import functools
import math
from typing import Any

from clearance_jax.errors import ClearanceError

ANGLES = ("radian", "degree", "turn", "revolution", "arc", "grade", "cycle")


@functools.cache
def registry() -> Any:
    """The unit registry (built at first use: it takes a while)."""
    import pint

    return pint.UnitRegistry()


def to_si(value: Any, unit: str, where: str) -> float:
    """`value` ("0.1 mm", or a bare number where no dimension is expected) in the SI `unit`.

    **Raises:** `ClearanceError` naming `where` for a missing unit, a wrong dimension, an unknown unit, or NaN.
    """
    if unit in ("", "1"):
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ClearanceError(f"{where} must be a bare number, but it is {value!r}.")
        return _finite(float(value), where)
    if isinstance(value, bool) or not isinstance(value, str):
        raise ClearanceError(f'{where} needs a unit: write it as a string such as "{value} {unit}".')
    import pint

    try:
        quantity = registry().Quantity(value)
        magnitude = float(quantity.to(unit).magnitude)
    except pint.DimensionalityError as error:
        raise ClearanceError(
            f"{where} must be in {unit} or a unit of that dimension, but {value!r} is in {error.units1}."
        ) from None
    except (pint.UndefinedUnitError, pint.PintError, ValueError, TypeError, AttributeError, SyntaxError) as error:
        raise ClearanceError(f'{where} is not a quantity: {value!r} ({error}). Write it as "2.5 {unit}".') from None
    except Exception as error:  # pint's parser raises tokenizer errors of several kinds
        raise ClearanceError(f'{where} is not a quantity: {value!r} ({error}). Write it as "2.5 {unit}".') from None
    # To pint an angle is a bare number: "30" would pass for radians, and hertz for rad/s.
    if unit in ("rad", "rad/s") and not any(word in str(quantity.units) for word in ANGLES):
        raise ClearanceError(f'{where} needs a unit of angle (deg, rad, rpm ...): write it as "1.5 {unit}".')
    return _finite(magnitude, where)


def shown(value: float, unit: str, digits: int = 6) -> str:
    """A quantity in SI as it is read in a workshop: lengths below a millimetre in um, below a metre in mm."""
    if unit == "m" and abs(value) < 1:
        small = abs(value) < 1e-3
        return f"{value * (1e6 if small else 1e3):.{digits}g} {'um' if small else 'mm'}"
    return f"{value:.{digits}g} {unit}".rstrip()


def _finite(value: float, where: str) -> float:
    if not math.isfinite(value):
        raise ClearanceError(f"{where} must be finite, but it is {value}.")
    return value
