"""Errors of structure and values, which raise; failures inside a solve are result codes."""

from collections.abc import Iterator
from contextlib import contextmanager

# A message is one or two sentences; a longer one contains a long value or path from the input.
LONGEST = 600


class ClearanceError(ValueError):
    """An error in a scene, a mechanism or an argument. The `message` names the place and says what to do, in no more
    than `LONGEST` characters.
    """

    def __init__(self, message: object = ""):
        super().__init__(cut(str(message), LONGEST))


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
    import jax  # here, for the command's help speaks of errors too and must not wait for JAX

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
    near = difflib.get_close_matches(word, allowed, n=3, cutoff=0.5)
    hint = (
        f"Did you mean {' or '.join(f'`{name}`' for name in near[: None if len(allowed) > 12 else 1])}? "
        if near
        else ""
    )
    listed = ", ".join(allowed) if len(allowed) <= 12 else f"{', '.join(allowed[:12])}, ... ({len(allowed)} in all)"
    return f"{hint}Allowed: {listed}."
