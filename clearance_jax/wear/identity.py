"""What makes one life another, by names (see `clearance_jax.runs.identity`)."""

from typing import Any

from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.runs.identity import numbers, settings, versions
from clearance_jax.wear.criteria import AbstractCriterion
from clearance_jax.wear.laws import AbstractWearLaw
from clearance_jax.wear.pressure import AbstractPressure


def description(
    mechanism: Mechanism,
    law: AbstractWearLaw,
    pressure: AbstractPressure,
    until: AbstractCriterion | None,
    **rest: Any,
) -> dict[str, Any]:
    """A question by the names of its parts, each a number or a short text; `rest`: its other arguments."""
    models = {"law of wear": law, "pressure": pressure, "until": until}
    own = [numbers(model, f" ({what})") for what, model in models.items() if model is not None]
    return {**versions(), **numbers(mechanism), **{k: v for one in own for k, v in one.items()}, **settings(rest)}
