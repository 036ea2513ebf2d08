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


class KindReference(NamedTuple):
    """One of the kinds that a table may be of: the `word` that chooses it, in TOML, a `help`, its keys and the
    titles of the tables whose keys it has too.
    """

    word: str
    help: str
    keys: list[str]
    shared: list[str]


class TableReference(NamedTuple):
    """A table of a `file` ("scene", "study"): its `name` in the file (`body.NAME`; the file's for the
    top), the `choice` among tables of that name, if any (`type = "revolute"`), a `title`, a `help` and its own keys;
    the titles of the tables whose keys it has too (`shared`), which are told there; the `kinds` that it may be of, with
    the key that chooses among them (`head`), if there are several. A key that several kinds have is told once.
    """

    file: File
    name: str
    choice: str
    title: str
    help: str
    keys: list[KeyReference]
    shared: list[str]
    head: str
    kinds: list[KindReference]


def reference() -> list[TableReference]:
    """Every table that the readers know, scenes first, each with every key; kinds of one family are one table."""
    return [_table(file, several) for file, tables in FILES.items() for several in _families(tables)]


def _families(tables: tuple[Keys, ...]) -> list[list[Keys]]:
    """Tables of one name and title together."""
    families: dict[tuple[str, str], list[Keys]] = {}
    for table in tables:
        families.setdefault((table.name, table.title), []).append(table)
    return list(families.values())


def _table(file: File, several: list[Keys]) -> TableReference:
    first, *others = several
    if not others:
        keys = [_key(key) for key in first.own]
        return TableReference(file, first.name, first.choice, first.title, first.help, keys, _titles(first), "", [])
    head = first.choice.partition(" = ")[0]
    kinds = [
        KindReference(_word(table), table.help, [key.name for key in table.own if key.name != head], _titles(table))
        for table in several
    ]
    help = f"Its key `{head}` says of which kind it is."
    return TableReference(file, first.name, "", first.title, help, _told_once(several), [], head, kinds)


def _titles(table: Keys) -> list[str]:
    return [shared.title for shared in table.shared]


def _word(table: Keys) -> str:
    """What chooses a kind: the value of its key in TOML."""
    return table.choice.partition(" = ")[2]


def _told_once(several: list[Keys]) -> list[KeyReference]:
    """The keys of kinds, each once that means the same in all of them; keys of one name stand together."""
    by_name: dict[str, dict[Any, list[tuple[str, KeyReference]]]] = {}
    for table in several:
        for key in map(_key, table.own):
            uses = by_name.setdefault(key.name, {})
            uses.setdefault((key.help, key.unit, key.kind), []).append((f"`{_word(table)}`", key))
    return [_common(uses, len(meanings) > 1) for meanings in by_name.values() for uses in meanings.values()]


def _common(uses: list[tuple[str, KeyReference]], is_apart: bool) -> KeyReference:
    """A key of several kinds, with its defaults by kinds where they differ; of which kinds, if its name `is_apart` from
    the same one of others.
    """
    key, defaults = uses[0][1], {}
    for word, use in uses:
        defaults.setdefault(use.default or "required", []).append(word)
    if len(defaults) > 1:
        text = "; ".join(f"{default} ({', '.join(words)})" for default, words in defaults.items())
        key = key._replace(default=text, required=False)
    return key._replace(help=f"of {', '.join(word for word, _ in uses)}: {key.help}") if is_apart else key


def example(table: Keys, *skip: str) -> dict[str, str]:
    """Of each key of a table, but for those to `skip`, its example in TOML."""
    return {key.name: key.example for key in table.keys if key.name not in skip}


def _key(key: Key) -> KeyReference:
    bounds = getattr(key, "bounds", None) or {}
    limits = [f"{words} {bounds[bound]:g}" for bound, _, words in BOUNDS if bounds.get(bound) is not None]
    help = key.help + (f" ({', '.join(limits)})" if limits else "")
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
