"""A JSON Schema of scene and study files, by which editors complete keys and check values.

It is made from the readers' declarations: all keys, their values and meanings. Only the reader checks which keys may
stand together.
"""

from typing import Any

from clearance_jax.io.keys import FILES, File
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
    Wholes,
    Word,
)

DRAFT = "https://json-schema.org/draft/2020-12/schema"
_NUMBER = {"type": ["string", "number"]}
_SEVERAL = {"type": "array", "items": _NUMBER}
# Schema words that restrict a value.
_SHAPE = ("type", "items", "minItems", "maxItems", "enum", "minimum", "maximum")
# Schemas of values by kind of key. Sub-tables are added where they are declared.
_VALUES: dict[type[Key], dict[str, Any]] = {
    QuantityKey: _NUMBER,
    Quantities: _SEVERAL | {"minItems": 1},
    VectorKey: _SEVERAL | {"minItems": 2, "maxItems": 3},
    Triple: _SEVERAL | {"minItems": 3, "maxItems": 3},
    Direction: {"type": ["string", "array"]},
    Moments: {"type": ["string", "number", "array"]},
    Wholes: {"type": "array", "items": {"type": "integer"}},
    Flag: {"type": "boolean"},
    Text: {"type": "string"},
    Names: {"type": "array", "items": {"type": "string"}},
    Sub: {},
}


def schema(file: File) -> dict[str, Any]:
    """The JSON schema of scene or study files."""
    root: dict[str, Any] = {"$schema": DRAFT, "title": f"clearance_jax {file}", "type": "object"}
    for table in FILES[file]:
        for path in _paths(table.name, file):
            at = _table(root, path)
            for key in table.keys:
                _merge(at["properties"], key)
    return root


def _paths(name: str, file: File) -> list[list[str]]:
    """The paths of a table in the file, as lists of keys; `NAME` stands for a user's name."""
    if name == file:
        return [[]]
    first, *others = name.replace('"', "").split(", ")
    head = first.split(".")
    return [head, *([*head[:-1], part.lstrip(".")] for part in others if part != "...")]


def _table(root: dict[str, Any], path: list[str]) -> dict[str, Any]:
    """The schema of the table at a path, added if it is absent."""
    at = root
    for name in path:
        if name == "NAME":
            at = at.setdefault("additionalProperties", {})
        else:
            # The same key may hold a table or a value.
            inside = at.setdefault("properties", {})
            inside[name] = at = _unshape(inside.get(name, {}))
    at.setdefault("properties", {})
    if "additionalProperties" not in at:
        at["additionalProperties"] = False
    return at


def _merge(properties: dict[str, Any], key: Key) -> None:
    """Add a key to the properties of a table. If another kind of the table has it too, both forms are allowed."""
    new, old = _of(key), properties.get(key.name)
    if old is None or "description" not in old:  # nothing, or what stands in a table of that name
        properties[key.name] = {**(_unshape(new) if old else new), **(old or {})}
    elif "enum" in new and "enum" in old:
        old["enum"] += [word for word in new["enum"] if word not in old["enum"]]
    elif any(new.get(name) != old.get(name) for name in _SHAPE):
        properties[key.name] = _unshape(old)  # the reader knows which it is


def _unshape(given: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in given.items() if name not in _SHAPE}


def _of(key: Key) -> dict[str, Any]:
    default = "" if key.required or not key.absent else f" Without it: {key.absent}."
    description = {"description": f"{key.help[:1].upper()}{key.help[1:]}.{default}"}
    if isinstance(key, Word):
        return {"enum": list(key.allowed)} | description
    if isinstance(key, Whole):
        return {"type": "integer", "minimum": key.least, "maximum": key.most} | description
    return dict(_VALUES[type(key)]) | description
