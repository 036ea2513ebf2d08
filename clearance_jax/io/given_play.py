"""Play by the command line: `--clearance JOINT:radial=0.1mm,axial=0.1mm,length=40mm,diameter=20mm`."""

from collections.abc import Iterable

from clearance_jax.errors import ClearanceError, quoted, suggest
from clearance_jax.io.table import naming
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.mechanism.tree import Revolute
from clearance_jax.units import to_si

NUMBERS = ("radial", "axial", "length", "diameter")


def with_play(mechanism: Mechanism, texts: Iterable[str]) -> Mechanism:
    """The mechanism with the play that the texts give to its joints.

    **Raises:** `ClearanceError` naming the text, for what is no such joint, number or unit.
    """
    given: set[str] = set()
    for text in texts:
        where = f"`--clearance {quoted(text)[1:-1]}`"
        name, colon, rest = text.partition(":")
        name = name.strip()
        if not colon:
            raise ClearanceError(f"{where} must read JOINT:radial=0.1mm, with `axial`, `length`, `diameter` if wanted.")
        if name in given:
            raise ClearanceError(f"{where} gives joint `{name}` play a second time. Give it once.")
        given.add(name)
        revolute = [joint.name for joint in mechanism.all_joints() if isinstance(joint, Revolute)]
        if name not in revolute:
            raise ClearanceError(f"{where}: there is no revolute joint `{name}`. " + suggest(name, revolute))
        with naming(where):
            mechanism = mechanism.with_clearance(name, **_numbers(rest, where))
    return mechanism


def _numbers(text: str, where: str) -> dict[str, float]:
    numbers: dict[str, float] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or key not in NUMBERS:
            raise ClearanceError(f"{where}: {quoted(part)} is no NUMBER=VALUE. " + suggest(key, NUMBERS))
        if key in numbers:
            raise ClearanceError(f"{where} gives `{key}` twice. Give it once.")
        numbers[key] = to_si(value, "m", f"{where}, {key}")
        if not numbers[key] > 0:
            raise ClearanceError(f"{where}: `{key}` must be greater than 0 m, but it is {numbers[key]:g} m.")
    return numbers
