"""The reference of every key that scenes and studies may have, as plain data: what the docs are made
of.

It is made from the declarations by which the readers read, which know no other key.
"""

import math
from typing import Any, Literal, NamedTuple

from clearance_jax.io.kinds import Key
from clearance_jax.io.scene_keys import SCENE_TABLES
from clearance_jax.io.study_keys import STUDY_TABLES
from clearance_jax.io.table import Keys
from clearance_jax.mechanism.tree import SLIDING, TURNING
from clearance_jax.parameters import BOUNDS, resolve_unit

File = Literal["scene", "study"]
FILES: dict[File, tuple[Keys, ...]] = {
    "scene": SCENE_TABLES,
    "study": STUDY_TABLES,
}


class KeyReference(NamedTuple):
    """A key: its `name`; the SI `unit` of its dimension, empty for what has none ("rad or m" where the kind of joint
    decides); what its value is (`kind`: "quantity", "axis", "one of ..."); `default` in words or in TOML, empty where
    it is `required`; an `example` value in TOML; one line of `help`, with the bounds of its values.
    """

    name: str
    unit: str
    kind: str
    default: str
    required: bool
    example: str
    help: str


class TableReference(NamedTuple):
    """A table of a `file` ("scene", "study"): its `name` in the file (`body.NAME`; the file's for the
    top), the `choice` among tables of that name, if any (`law = "hertz"`), a `title`, a `help` and its keys.
    """

    file: File
    name: str
    choice: str
    title: str
    help: str
    keys: list[KeyReference]


def reference() -> list[TableReference]:
    """Every table that the readers know, scenes first, each with every key. Kinds that have the same keys are one."""
    return [_table(file, several) for file, tables in FILES.items() for several in _alike(tables)]


def _alike(tables: tuple[Keys, ...]) -> list[list[Keys]]:
    """Tables that differ by the word that chooses them alone, together."""
    found: dict[Any, list[Keys]] = {}
    for i, table in enumerate(tables):
        first, *others = map(_key, table.keys)
        same = table.choice and (table.name, first.name, tuple(others))
        found.setdefault(same or i, []).append(table)
    return list(found.values())


def _table(file: File, several: list[Keys]) -> TableReference:
    first, *others = several
    keys = [_key(key) for key in first.keys]
    if not others:
        return TableReference(file, first.name, first.choice, first.title, first.help, keys)
    titles = [table.title.partition("`") for table in several]
    words = [f"`{words.rstrip('`')}`" for _, _, words in titles]
    help = " ".join(f"{word}: {table.help}" for word, table in zip(words, several, strict=True))
    choice = first.choice + "".join(f" or {table.choice.partition(' = ')[2]}" for table in others)
    return TableReference(file, first.name, choice, titles[0][0] + ", ".join(words), help, keys)


def example(table: Keys, *skip: str) -> dict[str, str]:
    """Of each key of a table, but for those to `skip`, its example in TOML."""
    return {key.name: key.example for key in table.keys if key.name not in skip}


def _key(key: Key) -> KeyReference:
    bounds = getattr(key, "bounds", None) or {}
    said = [f"{words} {bounds[bound]:g}" for bound, _, words in BOUNDS if bounds.get(bound) is not None]
    help = key.help + (f" ({', '.join(said)})" if said else "")
    return KeyReference(key.name, _unit(key.unit), key.kind, _default(key), key.required, key.example, help)


def _unit(unit: str) -> str:
    """A unit with the words that a joint resolves put in, for both kinds of joints."""
    both = [resolve_unit(unit, words) for words in (TURNING, SLIDING)]
    return unit if both[0] == unit else " or ".join(both)


def _default(key: Key) -> str:
    if key.required:
        return ""
    if key.absent or key.default is None:
        return key.absent or "none"
    return _show(key.default, key.unit)


def _show(value: Any, unit: str) -> str:
    """A default as TOML has it, or zero where its unit depends on the joint."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:g}" if not unit or "coordinate" in unit else f'"{value:g} {unit}"'
    return "none" if value == (None, None) else str(value)
