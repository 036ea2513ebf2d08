"""Checks of the numbers of a play, with messages."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.core import Tracer

from clearance_jax.errors import ClearanceError, quote, wrong_value
from clearance_jax.spatial import Vector
from clearance_jax.units import format_quantity

GRIPS = (
    "Parts that grip each other have no play. Leave the clearance out: the joint is ideal then, and the actuator "
    "`JointFriction` is its friction. If the grip gives way under a load, give the positive clearance at which the "
    "parts bear hard, and the element `PreloadedBearing`."
)
"""What to use instead of a clearance that is zero or negative."""


class ImplausibleWarning(UserWarning):
    """A mechanism has sizes that are hardly meant."""


def above_pin(radial: Any, pin: Any) -> str:
    """A text about a radial clearance as large as its pin's radius [m] or larger; empty if not, or traced."""
    if isinstance(radial, Tracer) or isinstance(pin, Tracer):
        return ""
    try:
        large = np.asarray(radial, float) >= np.asarray(pin, float)
    except (TypeError, ValueError):  # no numbers: another check says so
        return ""
    if not np.any(large):
        return ""
    radial, pin = np.broadcast_arrays(radial, pin)
    first = np.unravel_index(np.argmax(large), large.shape)
    than = "above" if radial[first] > pin[first] else "as large as"
    size, radius = (format_quantity(float(length[first]), "m") for length in (radial, pin))
    return f"radial_clearance = {size} is {than} the pin's radius {radius}"


def warn_of_pin(radial: Any, pin: Any) -> None:
    """Warn of a radial clearance that is as large as its pin's radius [m] or larger."""
    reason = above_pin(radial, pin)
    if reason:
        text = f"This size is hardly meant: {reason}. Check its unit; it is half the difference of the diameters."
        warnings.warn(text, ImplausibleWarning, stacklevel=4)


def check_sizes(unit: str = "m", **sizes: Any) -> None:
    """Raise, naming it, for a number that is invalid, not finite, or not above zero. `None` and tracers pass."""
    for name, size in sizes.items():
        if size is None or isinstance(size, Tracer):
            continue
        try:
            value = np.asarray(size, float)
        except (TypeError, ValueError):
            raise wrong_value(f"`{name}`", f"a number in {unit}", size) from None
        if not np.all(np.isfinite(value)):
            raise wrong_value(f"`{name}`", "finite", value.tolist())
        if not np.all(value > 0):
            grips = GRIPS * name.endswith("_clearance")
            raise wrong_value(f"`{name}`", f"greater than 0 {unit}", value.tolist(), f"{_plain(value)} {unit}", grips)


def _plain(value: np.ndarray) -> str:
    """A number, or several, without the last digits that a change of units leaves (-3e-05 for -30 um)."""
    return quote(np.array([float(f"{number:.12g}") for number in value.ravel()]).reshape(value.shape).tolist())


def check_larger(name: str, size: Any, than: str, other: Any, why: str) -> None:
    """Raise, naming both, unless one length [m] is larger than another. Tracers pass."""
    if isinstance(size, Tracer) or isinstance(other, Tracer) or np.all(np.asarray(size) > np.asarray(other)):
        return
    given, least = np.asarray(size, float), _plain(np.asarray(other, float))
    raise wrong_value(f"`{name}`", f"greater than {than}, {least} m, {why}", given.tolist(), f"{_plain(given)} m")


def check_known(name: str, size: Any, why: str) -> None:
    """Raise, naming it, for a number that is traced."""
    if isinstance(size, Tracer):
        raise ClearanceError(f"`{name}` must be a plain number, not one to be differentiated or batched: {why}.")


def check_start(joint: str, place: tuple[Any, ...], slides: Sequence[Vector]) -> None:
    """Raise for components of an `eccentricity` without play; absent, zero and traced ones pass."""
    for k, (letter, part) in enumerate(zip("xyz", place, strict=True)):
        absent = part is None or isinstance(part, Tracer) or not np.any(np.asarray(part))
        if not absent and not any(slide[k] for slide in slides):
            raise ClearanceError(
                f"The `eccentricity` of joint `{joint}` along {letter} of its sleeve has no effect: there is no play "
                "that way. Leave it out."
            ).about(f"{joint}.eccentricity", letter)
