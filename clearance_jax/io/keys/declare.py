"""Declares tables of keys: by hand, or from the fields of a class (see `parameters.physical`)."""

import dataclasses
import inspect
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args, get_origin

from clearance_jax.io.keys import kinds as values
from clearance_jax.io.keys.kinds import Key, Word
from clearance_jax.mechanism.body import Force, Torque
from clearance_jax.mechanism.placement import Axis, Inertia, Orientation, Position
from clearance_jax.mechanism.tree.compounds import Slide, Spin, Turn

NOTHING: Mapping[str, Any] = MappingProxyType({})
# Kinds of keys by the part that a field holds, and their units.
_OF_PARTS: dict[type, tuple[Any, dict[str, Any]]] = {Slide: (values.Sub, {}), Turn: (values.Sub, {})}
_OF_PARTS |= {Axis: (values.Direction, {}), Spin: (values.Triple, {"unit": "rad/s"})}
_RECORDS: dict[type, Any] = {Position: (values.VectorKey, "m"), Orientation: (values.Triple, "rad")}
_RECORDS |= {Force: (values.VectorKey, "N"), Torque: (values.Triple, "N*m")}
_OF_PARTS |= {record: (kind, {"unit": unit, "record": record}) for record, (kind, unit) in _RECORDS.items()}


class Keys(NamedTuple):
    """The declaration of a table: its `name` in the file, `title` and `help` for the reference, and its `keys`.
    `choice`: what selects it among tables of that name (`law = "hertz"`); `renamed`: present names of renamed keys;
    `shared`: tables whose keys it includes. Tables of one name and title are kinds of one family.
    """

    name: str
    title: str
    help: str
    keys: tuple[Key, ...]
    choice: str = ""
    renamed: Mapping[str, str] = NOTHING
    shared: tuple["Keys", ...] = ()

    def __add__(self, other: "Keys") -> "Keys":  # pyright: ignore[reportIncompatibleMethodOverride]
        """The same table with the keys of a shared one."""
        return self._replace(keys=(*self.keys, *other.keys), shared=(*self.shared, other))


def table(
    name: str, title: str, help: str, /, *shared: Keys, choice="", renamed: Mapping[str, str] = NOTHING, **keys: Key
) -> Keys:
    """A table with keys by their names, and after them those of `shared` tables."""
    named = tuple(dataclasses.replace(key, name=word) for word, key in keys.items())
    return sum(shared, start=Keys(name, title, help, named, choice, renamed))


def kind(help: str, /, *shared: Keys, renamed: Mapping[str, str] = NOTHING, **keys: Key) -> Keys:
    """A table of one kind, for a `family`."""
    return table("", "", help, *shared, renamed=renamed, **keys)


def kinds(members: Mapping[str, Any], more: Mapping[str, Mapping[str, Key]] = NOTHING) -> dict[str, Keys]:
    """Tables by word: the keys of each member's class, and those in `more`, which replace keys of the same name."""
    out = {}
    for word, member in members.items():  # of a function the class that it returns
        cls = member if inspect.isclass(member) else inspect.signature(member, eval_str=True).return_annotation
        out[word] = kind(summary(member), **keys_of(cls) | dict(more.get(word, {})))
    return out


def family(
    name: str, title: str, head: str, help: str, kinds: Mapping[str, Keys], default: str | None = None
) -> dict[str, Keys]:
    """The `kinds` as tables of one name, of which the key `head` chooses one by its word."""
    tables = {}
    for word, member in kinds.items():
        choosing = Word(help, f'"{word}"', name=head, allowed=tuple(kinds), default=default, required=default is None)
        keys = (choosing, *member.keys)
        tables[word] = member._replace(name=name, title=title, keys=keys, choice=f'{head} = "{word}"')
    return tables


def keys_of(cls: type, *names: str) -> dict[str, Key]:
    """Keys by the named fields of a class, or by all fields with a help text."""
    fields = {field.name: field for field in dataclasses.fields(cls)}
    chosen = names or tuple(name for name, field in fields.items() if field.metadata.get("help"))
    return {name: _key(fields[name]) for name in chosen}


def optional(keys: Mapping[str, Key], **absent: str) -> dict[str, Key]:
    """The keys, made optional; `absent`: what their absence means, by name."""
    return {n: dataclasses.replace(key, required=False, absent=absent.get(n, key.absent)) for n, key in keys.items()}


def _key(field: dataclasses.Field) -> Key:
    about, missing = field.metadata, dataclasses.MISSING
    words = about["help"], about["example"], about["absent"]
    common: dict[str, Any] = {"required": field.default is missing and field.default_factory is missing}
    common |= {"default": None if field.default is missing else field.default}
    types = field.type, *get_args(field.type)
    for part in _OF_PARTS.keys() & types:
        make, how = _OF_PARTS[part]
        return make(*words, **how, **common)
    if "unit" in about:
        # A table of numbers has a dimension in its annotation, one number none; either may be optional.
        if any(getattr(kind, "dim_str", "").strip() for kind in types):
            return values.Quantities(*words, unit=about["unit"], **common)
        make = values.Moments if Inertia in types else values.QuantityKey
        return make(*words, unit=about["unit"], bounds=about, **common)
    if field.type == tuple[str, ...]:
        return values.Names(*words, **common)
    if field.type in (int, int | None):
        return values.Whole(*words, least=about["least"], most=about["most"], **common)
    if get_origin(field.type) is Mapping:
        return values.Sub(*words, kind="values by name", **common)
    if get_origin(field.type) is Literal:
        return Word(*words, allowed=get_args(field.type), **common)
    return (values.Flag if field.type is bool else values.Text)(*words, **common)


def summary(part: Any) -> str:
    """First paragraph of the docstring of a class or function."""
    return " ".join((part.__doc__ or "").split("\n\n")[0].split()).split("**Arguments:**")[0].strip()
