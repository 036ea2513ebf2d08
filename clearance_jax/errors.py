"""Errors of structure and values, which raise; failures inside a solve are result codes."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Set
from contextlib import contextmanager
from typing import Any

# A message is one or two sentences; a longer one contains a long value or path from the input.
LONGEST = 600
# The subject of a message: the name in backticks in its first clause.
SUBJECT = re.compile(r"[\w -]*`([^`]+)`")


class ClearanceError(ValueError):
    """An error in a scene, a mechanism or an argument. The `message` names the place and says what to do, in no more
    than `LONGEST` characters. Its fields are for programs (`None`: not known): the `name` of the key, number or part
    that is wrong, as a user writes it (`hip.radial_clearance`), by default the message's subject; the `value` that was
    given; what is `allowed`: words, a bound, or a part of the sentence. Other objects are kept as messages show them.
    """

    value: Any = None
    allowed: Any = None

    def __init__(self, message: object = ""):
        super().__init__(cut(str(message), LONGEST))
        subject = SUBJECT.match(str(self))
        self.name = None if subject is None else subject[1]

    def about(self, name: object = None, value: object = None, allowed: object = None) -> "ClearanceError":
        """The error itself, with its fields."""
        self.name = self.name if name is None else _last(str(name))
        # Another object may hold a trace, and not every one can be sent to another process.
        self.value = _plain(value)
        several = isinstance(allowed, tuple | list | Mapping | Set)
        self.allowed = tuple(map(str, allowed)) if several else _plain(allowed)
        return self

    def at(self, where: str) -> "ClearanceError":
        """The error with a place (a file, a key) before its message."""
        return ClearanceError(f"{where}: {self}").about(self.name or where, self.value, self.allowed)


class WearFailure(ClearanceError):
    """A part whose wear cannot be followed: a number out of its bounds, depths that grow without bound, pressures that
    miss the force. For a scattered part it is a failure, for a design a mistake in the input.
    """


class WornThrough(WearFailure):
    """A part that does not reach the asked life; not a mistake in the input where parts scatter."""


@contextmanager
def naming(where: str) -> Iterator[None]:
    """A context in which messages of `ClearanceError` begin with a place (a file or a key)."""
    try:
        yield
    except ClearanceError as error:
        if where in str(error):
            raise
        raise error.at(where) from None


def cut(text: str, longest: int) -> str:
    """A text of no more than `longest` characters; a longer one is reduced to its begin and its end."""
    if len(text) <= longest:
        return text
    end = (longest - 5) // 3
    return f"{text[: longest - 5 - end]} ... {text[len(text) - end :]}"


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, str | int | float) else quote(value)


def _last(place: str) -> str:
    """The name in a place of a message: what stands last in backticks, or else after the file."""
    parts = place.split("`")
    return parts[-2] if len(parts) > 2 else place.rpartition(": ")[2]


def wrong_value(where: str, allowed: str, value: Any, shown: str = "", fix: str = "", name: str = "") -> ClearanceError:
    """An error of a `value`; `shown`: as the message has it; `fix`: its last sentence; `name`: if `where` has none."""
    text = f"{where} must be {allowed}, but it is {shown or quote(value)}." + f" {fix}" * bool(fix)
    return ClearanceError(text).about(name or where, value, allowed)


def wrong_word(where: str, value: object, allowed: Collection[str]) -> ClearanceError:
    """An error of a `value` that is none of the allowed words."""
    text = f"{where} must be one of the allowed words, but it is {quote(value)}."
    word = value if isinstance(value, str) else ""
    return unknown_name(text, word, allowed).about(where, value, tuple(allowed))


def unknown_name(message: str, word: str, allowed: Iterable[str], name: str | None = None) -> ClearanceError:
    """An error of an unknown `word`: the `message`, then the nearest allowed words; `name`: of the key."""
    allowed = tuple(allowed)
    return ClearanceError(f"{message} {suggest(word, allowed)}").about(name or word, word or None, allowed)


def quote(value: object) -> str:
    """A value as a message shows it: as Python writes it, shortened."""
    import reprlib

    short = reprlib.Repr()
    short.maxstring = short.maxother = short.maxlong = 80
    try:
        return cut(short.repr(value), 120)
    except ValueError:  # Python writes no whole number of more than some thousand digits
        return f"{type(value).__name__} of more digits than can be shown"


def require_float64() -> None:
    """Raise unless 64-bit floats are on: float32 cannot represent a penetration of 1e-8 m on a 1 m arm."""
    import jax  # only here: the command's help imports this module too, and must not wait for JAX

    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise ClearanceError(
            "clearance_jax needs 64-bit floats, but they are off in JAX. Call `clearance_jax.configure()` before "
            "anything else, or set the environment variable JAX_ENABLE_X64=1."
        )


def suggest(word: str, allowed) -> str:
    """A sentence with the nearest of the allowed words, and all of them if they are few."""
    import difflib

    word, allowed = word[:100], sorted(allowed)
    if not allowed:
        return "There are none here."
    is_long = len(allowed) > 12
    near = difflib.get_close_matches(word, allowed, n=3 if is_long else 1, cutoff=0.5)
    hint = f"Did you mean {' or '.join(f'`{name}`' for name in near)}? " if near else ""
    return f"{hint}Allowed: {', '.join(allowed[:12])}{f', ... ({len(allowed)} in all)' if is_long else ''}."
