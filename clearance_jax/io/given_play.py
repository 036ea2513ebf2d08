"""Play by the command line: `--clearance JOINT:radial_clearance=0.1mm,kind=sleeve,length=40mm,pin_radius=10mm`."""

from collections.abc import Iterable
from typing import Any

from clearance_jax.errors import ClearanceError, quote
from clearance_jax.io.table import naming
from clearance_jax.joints.presets import Preset
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.play import PRESETS, no_play_reason
from clearance_jax.units import to_si


def with_play(mechanism: Mechanism, texts: Iterable[str]) -> Mechanism:
    """The mechanism with the play that the texts give to its joints. **Raises:** `ClearanceError` naming the text, for
    an unknown joint, number or unit, and for numbers that contradict each other.
    """
    given: set[str] = set()
    for text in texts:
        where = f"`--clearance {quote(text)[1:-1]}`"
        name, colon, rest = text.partition(":")
        name = name.strip()
        if not colon:
            raise ClearanceError(f"{where} must read JOINT:radial_clearance=0.1mm, with more numbers after commas.")
        if name in given:
            raise ClearanceError(f"{where} gives joint `{name}` play a second time. Give it once.")
        given.add(name)
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
