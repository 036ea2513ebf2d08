"""Kinds of values of keys. Each reads and checks its values, and describes them for the reference."""

import abc
import dataclasses
import itertools
from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar

import numpy as np

from clearance_jax.errors import naming, quote, wrong_value, wrong_word
from clearance_jax.mechanism.placement import as_axis, as_inertia
from clearance_jax.parameters import check_bounds
from clearance_jax.units import resolve_unit, to_si

# Most characters of a name, and of a path.
LONGEST, LONGEST_PATH = 200, 4096
Words = Mapping[str, str]
"""Units by placeholder, where they depend on other values of the file."""
Shape = Mapping[str, Any]
_NUMBER = {"type": ["string", "number"]}
_NUMBERS = {"type": "array", "items": _NUMBER}


@dataclasses.dataclass(frozen=True)
class Key(abc.ABC):
    """A key of a table, declared once for the reader and the reference. Its `name` is that under which it is declared.

    - `help`: what it is; `example`: its value in TOML.
    - `default`: its value where it is absent; `absent`: what its absence means, where no value says that.
    - `required`: whether it must be there.
    - `unit` of its numbers, which may have placeholders; `bounds`: as of `parameters.physical`.
    """

    help: str
    example: str
    absent: str = ""
    _: dataclasses.KW_ONLY
    name: str = ""
    default: Any = None
    required: bool = False
    unit: str = ""
    bounds: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    kind: ClassVar[str]
    """What its values are, in words."""
    shape: ClassVar[Shape]
    """What its values are, in JSON Schema."""

    @abc.abstractmethod
    def read(self, value: Any, where: str, words: Words) -> Any:
        """The value checked, numbers in SI. **Raises** `ClearanceError` naming `where` it stands."""

    def _number(self, value: Any, where: str, words: Words) -> float:
        unit = resolve_unit(self.unit, words)
        number = to_si(value, unit, where)
        check_bounds(number, self.bounds, where, unit, value)
        return number

    def _numbers(self, values: list[Any], where: str, words: Words) -> list[float]:
        unit = resolve_unit(self.unit, words)
        return [to_si(value, unit, f"{where}[{i}]") for i, value in enumerate(values)]


class QuantityKey(Key):
    """One number: a string with a unit, or bare if it has no unit."""

    shape: ClassVar[Shape] = _NUMBER

    @property
    def kind(self) -> str:
        return "quantity" if self.unit else "number"

    def read(self, value, where, words):
        if isinstance(value, list):
            raise wrong_value(where, "one quantity", value, f"the list {quote(value)}")
        return self._number(value, where, words)


def quantity(
    help: str, example: str, unit: str = "", absent: str = "", *, default=None, required=False, **bounds
) -> Key:
    """A key of one number; `bounds`: as of `parameters.physical`."""
    return QuantityKey(help, example, absent, unit=unit, default=default, required=required, bounds=bounds)


class OneOrSeveral(QuantityKey):
    """One number, or a list of several."""

    shape: ClassVar[Shape] = {"anyOf": [_NUMBER, _NUMBERS | {"minItems": 1}]}

    @property
    def kind(self) -> str:
        return f"{super().kind}, or a list of them"

    def read(self, value, where, words):
        if not isinstance(value, list):
            return super().read(value, where, words)
        if not value:
            raise wrong_value(where, f"one number or several such as {self.example}", value)
        return np.array([self._number(each, f"{where}[{i}]", words) for i, each in enumerate(value)])


class Quantities(Key):
    """A list of at least one number."""

    shape: ClassVar[Shape] = _NUMBERS | {"minItems": 1}

    @property
    def kind(self) -> str:
        return "list of quantities" if self.unit else "list of numbers"

    def read(self, value, where, words):
        if not isinstance(value, list) or not value:
            raise wrong_value(where, f"a list such as {self.example}", value)
        return self._numbers(value, where, words)


@dataclasses.dataclass(frozen=True, kw_only=True)
class AbstractComponents(Key):
    """Components, of which zeros are left out of the program. `record`: what is made of them, by default a tuple."""

    record: Callable[..., Any] = lambda *numbers: numbers
    form: ClassVar[str]

    def read(self, value, where, words):
        if not isinstance(value, list) or not self.shape["minItems"] <= len(value) <= self.shape["maxItems"]:
            raise wrong_value(where, f"{self.form} such as {self.example}", value)
        return self.record(*(number or None for number in self._numbers(value, where, words)))


@dataclasses.dataclass(frozen=True)
class VectorKey(AbstractComponents):
    """A vector: a pair in the plane, a triple in space."""

    default: Any = dataclasses.field(default=(None, None), kw_only=True)
    kind: ClassVar[str] = "pair or triple of quantities"
    form: ClassVar[str] = "a pair (or in space a triple)"
    shape: ClassVar[Shape] = _NUMBERS | {"minItems": 2, "maxItems": 3}


class Triple(AbstractComponents):
    """Three angles or rates."""

    kind: ClassVar[str] = "triple of quantities"
    form: ClassVar[str] = "a triple"
    shape: ClassVar[Shape] = _NUMBERS | {"minItems": 3, "maxItems": 3}


class Direction(Key):
    """An axis of a frame: a letter, or three numbers of any length."""

    kind: ClassVar[str] = "axis"
    shape: ClassVar[Shape] = {"type": ["string", "array"]}

    def read(self, value, where, words):
        if not isinstance(value, (str, list)):
            raise wrong_value(where, f"an axis such as {self.example}", value)
        with naming(where):
            return as_axis(self._numbers(value, where, words) if isinstance(value, list) else value)


class Moments(Key):
    """A moment of inertia (about z), or three or six of them."""

    kind: ClassVar[str] = "quantity, or list of three or six"
    shape: ClassVar[Shape] = {"type": ["string", "number", "array"]}

    def read(self, value, where, words):
        if not isinstance(value, list):
            return self._number(value, where, words)
        if len(value) not in (3, 6):
            raise wrong_value(where, "one quantity, three (xx, yy, zz) or six (and xy, xz, yz)", value)
        with naming(where):
            return as_inertia(self._numbers(value, where, words))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Whole(Key):
    """A whole number from `least` to `most`."""

    least: int = 0
    most: int = 10**9
    kind: ClassVar[str] = "whole number"

    @property
    def shape(self) -> Shape:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}

    def read(self, value, where, words):
        if isinstance(value, bool) or not isinstance(value, int) or value < self.least:
            raise wrong_value(where, f"a whole number of at least {self.least}", value)
        if value > self.most:
            raise wrong_value(where, f"a whole number of at most {self.most}", value)
        return value


class Wholes(Key):
    """A list of increasing whole numbers, at least 0."""

    kind: ClassVar[str] = "list of whole numbers"
    shape: ClassVar[Shape] = {"type": "array", "items": {"type": "integer"}}

    def read(self, value, where, words):
        whole = isinstance(value, list) and value and all(isinstance(n, int) and not isinstance(n, bool) for n in value)
        if not whole or value[0] < 0 or any(a >= b for a, b in itertools.pairwise(value)):
            raise wrong_value(where, f"a list of whole numbers that grow, such as {self.example}", value)
        return tuple(value)


class Flag(Key):
    """True or false."""

    kind: ClassVar[str] = "true or false"
    shape: ClassVar[Shape] = {"type": "boolean"}

    def read(self, value, where, words):
        if not isinstance(value, bool):
            raise wrong_value(where, "true or false", value)
        return value


@dataclasses.dataclass(frozen=True)
class Text(Key):
    """A name, a title or a path."""

    longest: int = dataclasses.field(default=LONGEST, kw_only=True)
    kind: ClassVar[str] = "text"
    shape: ClassVar[Shape] = {"type": "string"}

    def read(self, value, where, words):
        if not isinstance(value, str):
            raise wrong_value(where, "a text in quotes", value)
        return check_text(value, where, self.longest)


def path(help: str, example: str, absent: str = "", *, required: bool = False) -> Key:
    """A key of the path of a file."""
    return Text(help, example, absent, required=required, longest=LONGEST_PATH)


class Names(Key):
    """A list of names."""

    kind: ClassVar[str] = "list of names"
    shape: ClassVar[Shape] = {"type": "array", "items": {"type": "string"}}

    def read(self, value, where, words):
        if not isinstance(value, list) or not value:
            raise wrong_value(where, f"a list such as {self.example}", value)
        for i, name in enumerate(value):
            if not isinstance(name, str):
                raise wrong_value(f"{where}[{i}]", "a name in quotes", name)
        return tuple(check_text(name, f"{where}[{i}]") for i, name in enumerate(value))


@dataclasses.dataclass(frozen=True)
class Word(Key):
    """One of the `allowed` words."""

    allowed: Collection[str] = dataclasses.field(default=(), kw_only=True)

    @property
    def kind(self) -> str:
        return "one of " + ", ".join(f"`{word}`" for word in self.allowed)

    @property
    def shape(self) -> Shape:
        return {"enum": list(self.allowed)}

    def read(self, value, where, words):
        if not isinstance(value, str) or value not in self.allowed:
            raise wrong_word(where, value, self.allowed)
        return value


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sub(Key):
    """A sub-table, or one of several kinds; `kind`: what it is in words."""

    kind: str = "table"
    shape: ClassVar[Shape] = {}

    def read(self, value, where, words):
        return value


def tables(help: str, example: str, absent: str = "", *, required: bool = False) -> Key:
    """A key of sub-tables, whose names the user chooses."""
    return Sub(help, example, absent, required=required, kind="tables by name")


def check_text(value: str, where: str, longest: int = LONGEST) -> str:
    """A text of one line. **Raises** `ClearanceError` if it is empty, too long or unprintable."""
    if not value.strip() or len(value) > longest or not value.isprintable():
        raise wrong_value(where, f"a text of 1 to {longest} printable characters", value)
    return value


def check_name(value: str, where: str) -> str:
    """A name of a part, without `.` and `=`. **Raises** `ClearanceError` for another text."""
    if "." in value or "=" in value:
        raise wrong_value(where, "named without `.` and `=`, which separate names and values", value)
    return check_text(value, f"{where}, a name,")
