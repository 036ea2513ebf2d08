"""Functions as metrics: their names and their arguments; and names as words."""

import inspect
import re
from collections.abc import Callable
from typing import Any

from clearance_jax.errors import ClearanceError


def in_words(name: str) -> str:
    """The name of a class or a function in words: "position error"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).replace("_", " ").strip().lower()


def function_name(function: Any) -> str:
    """What messages call a function."""
    return getattr(function, "__name__", type(function).__name__)


def arguments(function: Callable) -> int:
    """How many arguments a metric takes: 1, `f(solution)`, or 2, `f(mechanism, solution)`; else **raises**
    `ClearanceError`.
    """
    try:
        every = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        every = []
    placed = [p.name for p in every if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) and p.default is p.empty]
    demanded = [p.name for p in every if p.kind is p.KEYWORD_ONLY and p.default is p.empty]
    swapped = placed[:1] == ["solution"] and len(placed) == 2
    if len(placed) not in (1, 2) or demanded or swapped or isinstance(function, type):
        signature = f"`{function_name(function)}({', '.join([*placed, *demanded])})`"
        raise ClearanceError(
            f"A metric is one of `clearance_jax.metrics`, or a function `f(solution)` or `f(mechanism, solution)`; "
            f"{signature} is neither."
        )
    return len(placed)
