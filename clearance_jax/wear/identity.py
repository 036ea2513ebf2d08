"""The identity of a life (see `clearance_jax.runs.identity`)."""

from typing import Any

from clearance_jax.runs.identity import numbers, settings, versions
from clearance_jax.wear.criteria import AbstractCriterion
from clearance_jax.wear.model import WearModel


def description(model: WearModel, until: AbstractCriterion | None, **rest: Any) -> dict[str, Any]:
    """A question by the names of its parts, each a number or a short text; `rest`: further arguments."""
    parts = {"law of wear": model.wear, "pressure": model.pressure, "until": until}
    question = versions() | numbers(model.mechanism)
    for what, part in parts.items():
        question |= {} if part is None else numbers(part, f" ({what})")
    return question | settings({"joint": model.joint, "cycle": float(model.cycle), **rest})
