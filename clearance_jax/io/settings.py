"""Numbers by name from quantities: of the command line, and of the tables of a study.

The command line has `--set NAME=VALUE` and `--clearance JOINT:radial_clearance=0.1mm,kind=sleeve,length=40mm`.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from clearance_jax.errors import ClearanceError, naming, quote
from clearance_jax.joints.presets import Preset
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.variants import PRESETS, no_play_reason
from clearance_jax.parameters import Leaf, check_bounds, find, parameters
from clearance_jax.units import to_si


def parse_settings(texts: Iterable[str], mechanism: Mechanism) -> dict[str, float]:
    """`NAME=VALUE` of the command line, in SI, checked against the parameters of a mechanism."""
    known, numbers = parameters(mechanism), {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        where = f"`--set {quote(text)[1:-1]}`"
        if not equals:
            raise ClearanceError(f"{where} must read NAME=VALUE, for instance `joint5.radial_clearance=0.2mm`.")
        if name in numbers:
            raise ClearanceError(f"{where} gives `{name}` a second time. Give it once.")
        numbers[name] = _setting(known, name, value, where)
    return numbers


def values_by_name(entries: Iterable[tuple[str, Any, str]], model: Any) -> dict[str, float]:
    """Numbers in SI by parameter name, from a table's entries: (name, quantity, place in the file)."""
    known = parameters(model)
    return {name: _setting(known, name, value, where) for name, value, where in entries}


def _setting(known: Mapping[str, Leaf], name: str, value: Any, where: str) -> float:
    with naming(where):
        leaf, _ = find(known, name)
    if leaf.unit == "" and isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            raise ClearanceError(f"{where}: `{name}` is a bare number, but {quote(value)} is not.") from None
    number = to_si(value, leaf.unit, where)
    check_bounds(number, leaf.metadata, where, leaf.unit, value)
    return number


def with_play(mechanism: Mechanism, texts: Iterable[str]) -> Mechanism:
    """The mechanism with the play that the texts give to its joints. **Raises** `ClearanceError` naming the text."""
    joints: set[str] = set()
    for text in texts:
        where = f"`--clearance {quote(text)[1:-1]}`"
        name, colon, rest = text.partition(":")
        name = name.strip()
        if not colon:
            raise ClearanceError(f"{where} must read JOINT:radial_clearance=0.1mm, with more numbers after commas.")
        if name in joints:
            raise ClearanceError(f"{where} gives joint `{name}` play a second time. Give it once.")
        joints.add(name)
        with naming(where):
            joint = mechanism.joint(name)
            if type(joint) not in PRESETS:
                raise no_play_reason(joint)
            mechanism = mechanism.with_clearance(name, **_numbers(rest, PRESETS[type(joint)], where))
    return mechanism


def _numbers(text: str, preset: Preset, where: str) -> Any:
    numbers: dict[str, float | str] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in preset.numbers:
            raise ClearanceError(f"{where}: {quote(part)} is no NUMBER=VALUE. " + preset.instead(key))
        if key in numbers:
            raise ClearanceError(f"{where} gives `{key}` twice. Give it once.")
        unit = {"fit": "", "kind": "", "temperature": "K"}.get(key, "m")
        numbers[key] = to_si(value, unit, f"{where}, {key}") if unit else value
    return numbers
