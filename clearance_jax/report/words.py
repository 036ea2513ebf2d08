"""Template filters that format numbers and texts."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from clearance_jax.report.panels import SHORT
from clearance_jax.units import format_quantity


def quantity(value: float | None, unit: str, digits: int = 6) -> str:
    """A quantity in a unit of the workshop; empty for `None`."""
    return "" if value is None else format_quantity(value, unit, digits).replace(" um", " µm")


def percent(share: float, digits: int = 1) -> str:
    """A share in percent."""
    return f"{100 * share:.{digits}f} %"


def instant(time: float | None) -> str:
    """A time [s], in ms or s as the time axes have it."""
    if time is None:
        return ""
    return f"{1e3 * time:.5g} ms" if abs(time) < SHORT else f"{time:.5g} s"


def pressure(value: float | None) -> str:
    """A pressure [Pa], in MPa."""
    return "" if value is None else f"{1e-6 * value:.4g} MPa"


def span(ends: tuple[float, float]) -> str:
    """A least and a greatest length [m], in µm."""
    return f"{1e6 * ends[0]:g} to {1e6 * ends[1]:g} µm"


def deviations(ends: tuple[float, float]) -> str:
    """Of a size, as on a drawing: the upper over the lower one [m], in µm."""
    upper, lower = (f"{1e6 * end:+g}" if end else "0" for end in ends[::-1])
    return f"{upper} / {lower} µm".replace("-", "−")


def settings(values: Mapping[str, Any]) -> str:
    """Values by name."""
    return ", ".join(f"{name} = {np.asarray(value).tolist()}" for name, value in values.items())


def breakable(text: Any) -> Markup:
    """A text whose long names may break after a dot or an underline: a phone is narrow."""
    return Markup(re.sub(r"(?<=[A-Za-z0-9])([._])(?=[A-Za-z])", r"\1<wbr>", str(escape(text))))
