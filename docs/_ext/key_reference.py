"""The reference of all keys, from their declarations: plain data for the docs, and a JSON Schema for editors."""

import math
from typing import Any, Literal, NamedTuple

from clearance_jax.io.keys import coupling, design, metric, play, scene, study, wear
from clearance_jax.io.keys.declare import Keys
from clearance_jax.io.keys.kinds import Key
from clearance_jax.mechanism.placement import ORIGIN
from clearance_jax.parameters import BOUNDS
from clearance_jax.units import SLIDING, TURNING, resolve_unit

File = Literal["scene", "study"]
DRAFT = "https://json-schema.org/draft/2020-12/schema"
# Words of JSON Schema that restrict a value.
_SHAPE = ("type", "items", "minItems", "maxItems", "enum", "minimum", "maximum")
# Every table, in the order of the reference.
_PLAY = (play.PIN, play.SHAFT, play.BALL, play.GUIDE, play.IN_A_SLEEVE, play.CONTACT, play.PRESS)
_PLAY += (*play.BEARINGS.values(), play.WORN, *play.ELEMENT_TABLES.values())
_SCENE = (
    *(scene.SCENE, scene.SOLVE, scene.SOLVING, scene.BODY, *scene.JOINT_TABLES.values(), scene.JOINT, scene.MOTION),
    *(*_PLAY, scene.STOPS, scene.COMPLIANCE, *scene.DRIVE_TABLES.values(), scene.SPLINE_FILE),
    *(*scene.ACTUATOR_TABLES.values(), *play.NORMAL_TABLES.values(), play.STIFFNESS, *play.FRICTION_TABLES.values()),
    *(scene.SPRING, scene.POINT, scene.WRENCH, *coupling.COUPLING_TABLES.values(), scene.CONTROLLER, scene.ROBOT),
    scene.PAYLOAD,
)
_DESIGN = (design.DESIGN, design.VARIABLE, design.GEARS, *design.COST_TABLES.values(), design.PAYLOAD, design.LIMIT)
_DESIGN += (*design.MANUFACTURE_TABLES.values(), design.VERIFY, design.TRADEOFF)
_WEAR = (wear.WEAR, *wear.LAW_TABLES.values(), wear.GRADED, wear.RUNNING_IN, *wear.PRESSURE_TABLES.values())
_WEAR += (wear.MATERIAL, *wear.UNTIL_TABLES.values())
_STUDY = (
    *(study.STUDY, study.SOLVE, *metric.METRIC_KINDS.values(), study.SCATTER, study.SWEEP, study.AGAIN),
    *(*study.AXIS_TABLES.values(), study.CORRELATION, *_DESIGN, *_WEAR),
    *(study.CALIBRATE, study.PARAMETER_TABLE, study.SIGNAL_TABLE),
)
FILES: dict[File, tuple[Keys, ...]] = {"scene": _SCENE, "study": _STUDY}


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
    """A kind of a table: the `word` that chooses it (TOML), its own keys, and the titles of tables that it shares."""

    word: str
    help: str
    keys: list[str]
    shared: list[str]


class TableReference(NamedTuple):
    """A table of a `file` ("scene", "study"): its `name` in the file (`body.NAME`), the `choice` that selects it among
    tables of that name (`type = "revolute"`), a `title`, a `help`, its own keys, and the titles of tables whose keys it
    shares (`shared`). A table of several `kinds` lists a key that they have in common once; `head`: the key that
    chooses the kind.
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


def unshared(table: Keys) -> tuple[Key, ...]:
    """The keys of a table that no table has which it shares."""
    others = {key.name for shared in table.shared for key in shared.keys}
    return tuple(key for key in table.keys if key.name not in others)


def reference() -> list[TableReference]:
    """All tables of scenes and studies, each with its keys. Kinds of one family are one table."""
    families: dict[tuple[File, str, str], list[Keys]] = {}
    for file, tables in FILES.items():
        for table in tables:
            families.setdefault((file, table.name, table.title), []).append(table)
    return [_table(file, several) for (file, *_), several in families.items()]


def _table(file: File, several: list[Keys]) -> TableReference:
    first, *others = several
    titles = [[shared.title for shared in table.shared] for table in several]
    if not others:
        keys = [_key(key) for key in unshared(first)]
        return TableReference(file, first.name, first.choice, first.title, first.help, keys, titles[0], "", [])
    head, kinds = first.choice.partition(" = ")[0], []
    for table, shared in zip(several, titles, strict=True):
        own_keys = [key.name for key in unshared(table) if key.name != head]
        kinds.append(KindReference(table.choice.partition(" = ")[2], table.help, own_keys, shared))
    help = f"Its key `{head}` says of which kind it is."
    return TableReference(file, first.name, "", first.title, help, _told_once(several), [], head, kinds)


def _told_once(several: list[Keys]) -> list[KeyReference]:
    """The keys of several kinds, merged where name, help, unit and kind agree; keys of one name are adjacent."""
    by_name: dict[str, dict[Any, list[tuple[str, KeyReference]]]] = {}
    for table in several:
        for key in map(_key, unshared(table)):
            uses = by_name.setdefault(key.name, {})
            word = table.choice.partition(" = ")[2]
            uses.setdefault((key.help, key.unit, key.kind), []).append((f"`{word}`", key))
    return [_common(uses, len(meanings) > 1) for meanings in by_name.values() for uses in meanings.values()]


def _common(uses: list[tuple[str, KeyReference]], is_apart: bool) -> KeyReference:
    """A key merged from several kinds, with defaults by kind if they differ. If it `is_apart`, another key has the same
    name, and the help names the kinds.
    """
    key, defaults = uses[0][1], {}
    for word, use in uses:
        defaults.setdefault(use.default or "required", []).append(word)
    if len(defaults) > 1:
        text = "; ".join(f"{default} ({', '.join(words)})" for default, words in defaults.items())
        key = key._replace(default=text, required=False)
    return key._replace(help=f"of {', '.join(word for word, _ in uses)}: {key.help}") if is_apart else key


def example(table: Keys, *skip: str) -> dict[str, str]:
    """Examples in TOML of a table's keys, without those to `skip`."""
    return {key.name: key.example for key in table.keys if key.name not in skip}


def _key(key: Key) -> KeyReference:
    limits = [f"{words} {key.bounds[bound]:g}" for bound, _, words in BOUNDS if key.bounds.get(bound) is not None]
    help = key.help + (f" ({', '.join(limits)})" if limits else "")
    # A unit that the kind of joint decides is said for turning and for sliding.
    both = [resolve_unit(key.unit, words) for words in (TURNING, SLIDING)]
    unit = key.unit if both[0] == key.unit else " or ".join(both)
    return KeyReference(key.name, unit, key.kind, _default(key), key.required, key.example, help)


def _default(key: Key) -> str:
    """A default in words or in TOML, without unit if the joint decides it."""
    if key.required:
        return ""
    value, unit = key.default, key.unit
    if key.absent or value is None:
        return key.absent or "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:g}" if not unit or "coordinate" in unit else f'"{value:g} {unit}"'
    return "none" if value in ((None, None), ORIGIN) else str(value)


def schema(file: File) -> dict[str, Any]:
    """The JSON Schema of scene or study files. Only the reader checks which keys may stand together."""
    root: dict[str, Any] = {"$schema": DRAFT, "title": f"clearance_jax {file}", "type": "object"}
    for table in FILES[file]:
        for path in _paths(table.name, file):
            properties = _inside(root, path)["properties"]
            for key in table.keys:
                _merge(properties, key)
    return root


def _paths(name: str, file: File) -> list[list[str]]:
    """The paths of a table in the file, as lists of keys; `NAME` stands for a user's name."""
    if name == file:
        return [[]]
    first, *others = name.replace('"', "").split(", ")
    head = first.split(".")
    return [head, *([*head[:-1], part.lstrip(".")] for part in others if part != "...")]


def _inside(root: dict[str, Any], path: list[str]) -> dict[str, Any]:
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
    at.setdefault("additionalProperties", False)
    return at


def _merge(properties: dict[str, Any], key: Key) -> None:
    """Add a key to the properties of a table. If another kind of the table has it too, both forms are allowed."""
    default = "" if key.required or not key.absent else f" Without it: {key.absent}."
    new = {**key.shape, "description": f"{key.help[:1].upper()}{key.help[1:]}.{default}"}
    old = properties.get(key.name)
    if old is None or "description" not in old:  # nothing, or what stands in a table of that name
        properties[key.name] = {**(_unshape(new) if old else new), **(old or {})}
    elif "enum" in new and "enum" in old:
        old["enum"] += [word for word in new["enum"] if word not in old["enum"]]
    elif any(new.get(name) != old.get(name) for name in _SHAPE):
        properties[key.name] = _unshape(old)  # the reader knows which it is


def _unshape(shape: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in shape.items() if name not in _SHAPE}
