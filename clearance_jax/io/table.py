"""Tables of scene and study files, read by the declarations of their keys. Unknown keys are errors."""

from collections.abc import Iterator, Mapping
from typing import Any

from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value
from clearance_jax.io.keys.declare import Keys
from clearance_jax.io.keys.kinds import Words, check_name

NO_WORDS: Words = {}


class TomlTable:
    """A TOML table: its `values` as read, `where` it stands in the file, for messages, the declarations of its `keys`,
    and `words`: units that depend on what else is given. **Raises** for what is no table, and for an unknown key.
    """

    def __init__(self, values: Any, where: str, keys: Keys, words: Words = NO_WORDS):
        self.values, self.where, self.words = check_table(values, where), where, words
        self._keys = {key.name: key for key in keys.keys}
        for name in self.values:
            check_renamed(name, self.where, keys)
            if name not in self._keys:
                raise unknown_name(f"{self.key(name)} is not a known key.", name[:200], self._keys, self.key(name))

    def key(self, name: str) -> str:
        """How a message names a key of this table."""
        return below(self.where, name)

    def has(self, name: str) -> bool:
        """Whether the key is there."""
        return self._keys[name].name in self.values

    def need(self, *names: str) -> None:
        """Raise if one of the keys is absent."""
        for name in names:
            if not self.has(name):
                raise ClearanceError(f"{self.where} lacks the key `{name}`. Add it.").about(self.key(name))

    def refuse(self, *names: str, why: str) -> None:
        """Raise if one of the keys is present."""
        for name in names:
            if name in self.values:
                raise ClearanceError(f"{self.key(name)} {why}").about(self.key(name))

    def get(self, name: str, words: Words = NO_WORDS) -> Any:
        """The key's value, or its default; `words`: further units by placeholder."""
        key = self._keys[name]
        if not self.has(name):
            if key.required:
                self.need(name)
            return key.default
        # A placeholder in `words` may contain one of the table, so it is replaced first.
        return key.read(self.values[name], self.key(name), {**words, **self.words})

    def arguments(self, *skip: str) -> dict[str, Any]:
        """Values by name of the keys that are present or required, without those to `skip`."""
        keys = (key for key in self._keys.values() if key.name not in skip)
        return {key.name: self.get(key.name) for key in keys if key.required or self.has(key.name)}

    def only(self, *names: str) -> dict[str, Any]:
        """Values by name of those keys that are present."""
        return {name: self.get(name) for name in names if self.has(name)}

    def table(self, name: str, keys: Keys, words: Words = NO_WORDS) -> "TomlTable":
        """The key's sub-table (empty where absent)."""
        return TomlTable(self.values[name] if self.has(name) else {}, self.key(name), keys, {**self.words, **words})

    def variant(self, name: str, tables: Mapping[str, Keys], words: Words = NO_WORDS) -> "Chosen":
        """The key's sub-table, one of several kinds, behind the word that chooses the kind."""
        return variant(self.values[name] if self.has(name) else {}, self.key(name), tables, {**self.words, **words})

    def entries(self, name: str) -> Iterator[tuple[str, Any, str]]:
        """The entries of the key's table, whose names the user chooses: (name, value, place in the file)."""
        return entries(self.values[name] if self.has(name) else {}, self.key(name))

    def parts(self, name: str) -> Iterator[tuple[str, Any, str]]:
        """As `entries`, with names checked as names of parts."""
        for inner, values, where in self.entries(name):
            yield check_name(inner, where), values, where

    def tables(self, name: str, keys: Keys, words: Words = NO_WORDS) -> Iterator[tuple[str, "TomlTable"]]:
        """As `parts`, of tables of one declaration: (name, table)."""
        for inner, values, where in self.parts(name):
            yield inner, TomlTable(values, where, keys, words)


Chosen = tuple[str, TomlTable]
"""The word that chooses one of several kinds of a table, and the table."""


def variant(values: Any, where: str, tables: Mapping[str, Keys], words: Words = NO_WORDS) -> Chosen:
    """The table of one of several kinds. The first declared key, or its default, chooses the kind."""
    first = next(iter(tables.values()))
    head, values = first.keys[0], check_table(values, where)
    if head.name not in values and head.default is None:
        for name in values:
            check_renamed(name, where, first)
        raise unknown_name(f"{where} lacks the key `{head.name}`. Add it.", "", tables, below(where, head.name))
    word = head.read(values.get(head.name, head.default), below(where, head.name), words)
    known = {name: {key.name for key in keys.keys} for name, keys in tables.items()}
    for key in values:
        having = [name for name, keys in known.items() if key in keys]
        if having and key not in known[word] and key not in tables[word].renamed:
            of = ", ".join(f"`{name}`" for name in having)
            what = f"{below(where, key)} is not a known key of the {head.name} `{word}`, but of {of}"
            text = f"{what}. Remove it, or {'change' if head.name in values else 'add'} the key `{head.name}`."
            raise ClearanceError(text).about(below(where, key), allowed=having)
    return word, TomlTable(values, where, tables[word], words)


def check_renamed(name: str, where: str, keys: Keys) -> None:
    """Raise for the former name of a key."""
    if name in keys.renamed:
        there = below(where, name)
        raise ClearanceError(f"{there} is called `{keys.renamed[name]}` now. Rename it.").about(there, name)


def entries(values: Any, where: str) -> Iterator[tuple[str, Any, str]]:
    """The entries of a table whose names the user chooses: (name, value, place in the file)."""
    for name, value in check_table(values, where).items():
        yield name, value, below(where, name)


def check_table(values: Any, where: str) -> dict[str, Any]:
    """The values, which must be a table."""
    if not isinstance(values, dict):
        raise wrong_value(where, "a table of keys", values)
    return values


def below(where: str, name: str) -> str:
    """How a message names a key of what stands at `where`."""
    name = name if len(name) <= 60 and name.isprintable() else quote(name)
    return f"{where}.{name}" if not where.endswith(":") else f"{where} {name}"
