"""Quantities with units, read by pint and returned in SI."""

import functools
import math
import re
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

from clearance_jax._compile.files import remember
from clearance_jax.errors import ClearanceError, quote, wrong_value

# The allowed forms of a quantity. pint's own reader is a calculator: it would work on "9**9**9 kg" for ever, and read
# "mm" as one millimetre. So pint reads the unit only, and only in these forms.
LONGEST = 100
_NUMBER = r"[+-]?(?:(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?|(?:nan|inf)(?=\s))"
_SYMBOL = r"(?:[^\W\d_²³¹⁰⁴⁵⁶⁷⁸⁹][^\W²³¹⁰⁴⁵⁶⁷⁸⁹]*|[%°])"
_POWER = r"(?:\s*(?:\^|\*\*)\s*(?:[+-]?\d{1,2}(?:\.\d+)?|\([+-]?\d{1,2}(?:\.\d+)?\))|⁻?[²³¹⁰⁴⁵⁶⁷⁸⁹])?"
_FACTOR = rf"{_SYMBOL}{_POWER}"
_PRODUCT = rf"{_FACTOR}(?:\s*[*/·\s]\s*{_FACTOR})*"
_GROUP = rf"(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\))"
_UNIT = rf"(?:1\s*/\s*)?{_GROUP}(?:\s*[*/·\s]\s*{_GROUP})*"
# A comma is ambiguous: some write 0,1 for a tenth, others 1,000 for a thousand.
_COMMA = re.compile(r"\s*([+-]?\d+,\d+(?:[eE][+-]?\d+)?)")
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*({_UNIT}|/\s*{_UNIT}|/\s*\(\s*{_NUMBER}\s*{_UNIT}\s*\))?\s*")

ANGLES = ("radian", "degree", "turn", "revolution", "arc", "grade", "cycle")
# What a coordinate's numbers are in: an angle's, and a slide's.
TURNING = {"coordinate": "rad", "effort": "N*m"}
SLIDING = {"coordinate": "m", "effort": "N"}


@functools.cache
def registry() -> Any:
    """The unit registry, built at first use because that takes a while."""
    import pint

    return pint.UnitRegistry()


_version = functools.cache(version)


def to_si(value: Any, unit: str, where: str) -> float:
    """`value` ("0.1 mm", or a bare number where no dimension is expected) in the SI `unit`.

    **Raises:** `ClearanceError` naming `where` for a missing unit, a wrong dimension, an unknown unit, or NaN.
    """
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if unit in ("", "1"):
        if is_number:
            return _float(value, where)
        if isinstance(value, str):
            check_comma(value, where)
        raise wrong_value(where, "a bare number", value)
    if not isinstance(value, str):
        shown, other = (quote(value), "") if is_number else ("2.5", f", not as {quote(value)}")
        raise _needs(where, value, f'a unit: write it as a string such as "{shown} {unit}"{other}')
    text = _check(value, unit, where)
    question = f"pint {_version('pint')}: {text[0]!r} {text[1]} in {unit}"
    return _finite(remember(question, lambda: _convert(value, text, unit, where)), where)


def _convert(value: str, text: tuple[float, str], unit: str, where: str) -> float:
    """A quantity, NUMBER and UNIT, in the SI `unit`, by pint. **Raises:** `ClearanceError` as `to_si`."""
    import pint

    try:
        # For pint a unit that is not proportional (degC) goes with a number, never in a product.
        quantity = registry().Quantity(*text) if unit == "K" else registry().Quantity(f"{text[0]!r} {text[1]}")
        magnitude = float(quantity.to(unit).magnitude)
    except pint.DimensionalityError as error:
        if not text[1]:
            raise _needs(where, value, f'a unit: write it as "{text[0]:g} {unit}"') from None
        message = f"{where} must be in {unit} or a unit of that dimension, but {quote(value)} is in {error.units1}."
        raise ClearanceError(message).about(where, value, unit) from None
    except Exception as error:  # pint's parser raises errors of many kinds
        raise _unread(value, unit, where, quote(str(error))) from None
    # For pint an angle is a bare number: "30" would pass for radians, hertz for rad/s.
    if unit in ("rad", "rad/s", "rad/s^2") and not any(word in str(quantity.units) for word in ANGLES):
        raise _needs(where, value, f'a unit of angle (deg, rad, rpm ...): write it as "1.5 {unit}"')
    return magnitude


def resolve_unit(unit: str, words: Mapping[str, str]) -> str:
    """A unit with words replaced by the units for which they stand."""
    for word, meant in words.items():
        unit = unit.replace(word, meant)
    return unit


def unit_in_words(unit: str) -> str:
    """A unit as messages show it. Of a coordinate whose kind is not known it is the angle's, and the slide's."""
    turning, sliding = (resolve_unit(unit, words) for words in (TURNING, SLIDING))
    return turning if turning == sliding else f"{turning} ({sliding} of a slide)"


@functools.cache
def time_power(unit: str) -> int:
    """The power of time in an SI unit: -1 in "rad/s", 0 in none."""
    if not unit:
        return 0
    whole = f"1{unit}" if unit.startswith("/") else unit
    return round(float(registry().Quantity(f"1 {whole}").dimensionality.get("[time]", 0)))


# By unit: below which value another one is shown, with its factor and name.
SHOWN = {"m": ((1e-3, 1e6, "um"), (1.0, 1e3, "mm")), "rad": ((0.03, 60 * math.degrees(1.0), "arcmin"),)}


def format_quantity(value: float, unit: str, digits: int = 6) -> str:
    """A quantity in SI for reading: lengths below a metre in mm or um, angles below 0.03 rad in arcmin."""
    factor, name = next(((by, word) for least, by, word in SHOWN.get(unit, ()) if abs(value) < least), (1.0, unit))
    return f"{factor * value:.{digits}g} {name}".rstrip()


def _check(value: str, unit: str, where: str) -> tuple[float, str]:
    """A quantity that pint may read, of the form NUMBER UNIT (or NUMBER / (NUMBER UNIT)): its number, and the rest."""
    if len(value) > LONGEST:
        raise _unread(value, unit, where, f"longer than {LONGEST} characters")
    check_comma(value, where)
    match = _QUANTITY.fullmatch(" ".join(value.split()))  # one space at a time, or the pattern would try them all
    if match is None:
        lacks = "it lacks a number" if not re.search(r"\d", value) else "it must read NUMBER UNIT"
        raise _unread(value, unit, where, lacks)
    # pint would read a long row of digits as a whole number of any size.
    number = _float(match[1].replace("_", ""), where)
    return number, (match[2] or "").replace("·", "*")


def check_comma(text: str, where: str) -> None:
    """Raise for a number with a comma at the beginning of a text."""
    match = _COMMA.match(text)
    if match is not None:
        raise ClearanceError(
            f"{where} has a comma in its number: {quote(text)}. Write a decimal point: {match[1].replace(',', '.')}."
        ).about(where, text)


def _needs(where: str, value: object, what: str) -> ClearanceError:
    return ClearanceError(f"{where} needs {what}.").about(where, value)


def _unread(value: str, unit: str, where: str, why: str) -> ClearanceError:
    text = f'{where} is not a quantity: {quote(value)} ({why}). Write it as "2.5 {unit}".'
    return ClearanceError(text).about(where, value)


def _float(value: Any, where: str) -> float:
    try:
        return _finite(float(value), where)
    except OverflowError:  # a whole number beyond all floats
        raise wrong_value(where, "finite", value) from None


def _finite(value: float, where: str) -> float:
    if not math.isfinite(value):
        raise wrong_value(where, "finite", value, shown=str(value))
    return value
