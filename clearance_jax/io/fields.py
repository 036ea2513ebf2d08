"""Keys made from the fields of a class: name, unit, bounds, default and help (see `parameters.physical`)."""

import dataclasses
import inspect
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Literal, get_args, get_origin

from clearance_jax.io.kinds import (
    Direction,
    Flag,
    Key,
    Moments,
    Names,
    Quantities,
    QuantityKey,
    Sub,
    Text,
    Triple,
    VectorKey,
    Whole,
    Word,
)
from clearance_jax.io.table import Keys
from clearance_jax.mechanism.compounds import Slide, Spin, Turn
from clearance_jax.mechanism.loads import Force, Torque
from clearance_jax.mechanism.placement import Axis, Inertia, Orientation, Position

NO_MORE: Mapping[str, Iterable[Key]] = MappingProxyType({})


def keys_of(cls: type, *names: str) -> tuple[Key, ...]:
    """Keys of the named fields of a class, or of all fields with a help text."""
    fields = {field.name: field for field in dataclasses.fields(cls)}
    chosen = names or tuple(name for name, field in fields.items() if field.metadata.get("help"))
    return tuple(_key(fields[name]) for name in chosen)


def _key(field: dataclasses.Field) -> Key:
    about = field.metadata
    required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    common: dict[str, Any] = {"absent": about["absent"], "required": required}
    words = field.name, about["help"], about["example"]
    kinds = set(get_args(field.type)) | {field.type}
    if Position in kinds:
        return VectorKey(*words, unit="m", **common)
    if Axis in kinds:
        return Direction(*words, default=field.default, **common)
    if Orientation in kinds:
        return Triple(*words, unit="rad", **common)
    if Force in kinds:
        return VectorKey(*words, unit="N", **common)
    if Torque in kinds:
        return Triple(*words, unit="N*m", **common)
    if Spin in kinds:
        return Triple(*words, unit="rad/s", **common)
    if Inertia in kinds:
        return Moments(*words, unit=about["unit"], bounds=about, **common)
    if kinds & {Slide, Turn}:
        return Sub(*words, **common)
    if "unit" in about:
        common |= {"unit": about["unit"], "default": None if required else field.default}
        # A table of numbers has a dimension in its annotation, one number none; either may be optional.
        many = any(getattr(kind, "dim_str", "").strip() for kind in (field.type, *get_args(field.type)))
        return Quantities(*words, **common) if many else QuantityKey(*words, bounds=about, **common)
    common |= {"default": None if required else field.default}
    if field.type == tuple[str, ...]:
        return Names(*words, **common)
    if field.type in (int, int | None):
        return Whole(*words, least=about["least"], most=about["most"], **common)
    if get_origin(field.type) is Mapping:
        return Sub(*words, form="values by name", **common)
    if get_origin(field.type) is Literal:
        return Word(*words, allowed=get_args(field.type), **common)
    return (Flag if field.type is bool else Text)(*words, **common)


def summary(part: Any) -> str:
    """First paragraph of the docstring of a class or function."""
    return " ".join((part.__doc__ or "").split("\n\n")[0].split()).split("**Arguments:**")[0].strip()


def kind_of(name: str, title: str, head: Word, word: str, help: str, *keys: Key) -> Keys:
    """The table of one kind, which `head = "word"` chooses."""
    return Keys(name, title, help, (dataclasses.replace(head, example=f'"{word}"'), *keys), f'{head.name} = "{word}"')


def kinds_of(
    name: str, title: str, head: Word, members: Mapping[str, Any], more: Mapping[str, Iterable[Key]] = NO_MORE
) -> dict[str, Keys]:
    """Tables by word: the keys of each member's class, and those in `more`, which replace keys of the same name."""
    tables = {}
    for word, member in members.items():
        keys = {key.name: key for key in (*keys_of(_class(member)), *more.get(word, ()))}
        tables[word] = kind_of(name, title, head, word, summary(member), *keys.values())
    return tables


def _class(member: Any) -> type:
    """The class of a family member; of a function the class that it returns."""
    return member if inspect.isclass(member) else inspect.signature(member, eval_str=True).return_annotation
