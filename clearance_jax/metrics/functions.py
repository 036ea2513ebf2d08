"""What metrics are given: functions with their arguments, and names, of parts of the mechanism and as words."""

import inspect
import re
from collections.abc import Callable
from typing import Any

from clearance_jax.dynamics.quantities import quantities
from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.mechanism._base import AbstractMechanism


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


def index_of(kind: str, name: str, names: list[str]) -> int:
    """The index of a name among the known ones. **Raises** `ClearanceError` for an unknown one."""
    if name not in names:
        raise unknown_name(f"There is no {kind} `{name}`.", name, names)
    return names.index(name)


def clearance_index(mechanism: AbstractMechanism, name: str) -> int:
    """The index of a joint among those with clearance."""
    refuse_gap(mechanism, name)
    return index_of("clearance joint", name, [joint.name for joint in mechanism.clearance_joints()])


def contact_index(mechanism: AbstractMechanism, name: str) -> int:
    """The index of a joint with clearance, or of a gap of a coordinate, among all contacts."""
    refuse_closed(mechanism, name)
    index_of("joint with clearance or gap", name, contact_names(mechanism))
    return [contact.name for contact in mechanism.contacts()].index(name)


def contact_names(mechanism: AbstractMechanism) -> list[str]:
    """The names of all that touches and comes off: joints with clearance, backlash, stops."""
    return [contact.name for contact in (*mechanism.clearance_joints(), *mechanism.open_gaps())]


def refuse_closed(mechanism: AbstractMechanism, name: str) -> None:
    """Raise `ClearanceError` for the name of a spring without backlash or of friction: no contact to ask for."""
    if name in (gap.name for gap in mechanism.gaps) and name not in contact_names(mechanism):
        raise ClearanceError(f"`{name}` has no gap, so nothing touches in it. Ask for an effort, or for energy.").about(
            name
        )


def refuse_gap(mechanism: AbstractMechanism, name: str) -> None:
    """Raise `ClearanceError` for the name of a gap, where a joint is asked for."""
    if name in (gap.name for gap in mechanism.gaps):
        text = (
            f"`{name}` is the gap of a coordinate, and not a joint: it has no pin, and bears no force between bodies."
        )
        raise ClearanceError(f"{text} Ask for its contact force or its impacts.").about(name)


def named_point(mechanism: AbstractMechanism, name: str):
    """The point of a name. **Raises** `ClearanceError` for an unknown one."""
    return mechanism.points[index_of("point", name, [point.name for point in mechanism.points])]


def numbers_of(mechanism: AbstractMechanism) -> list[str]:
    """Names of the scalar quantities of a state."""
    known = quantities(mechanism, energy_balance=False)
    vectors = {name.rpartition(".")[0] for name in known if name.endswith((".x", ".y", ".z"))}
    return [name for name in known if name not in vectors]
