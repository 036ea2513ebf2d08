"""Limits that hold over a life: numbers of wear stand beside the mechanism's, and a limit's motion is that of its
metric.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from clearance_jax.analysis.measure import AbstractMetric, as_metric
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import find, parameters, replace
from clearance_jax.wear import AfterWear

OF_WEAR = ("wear.", "pressure.")


def as_limited(given: Any) -> AbstractMetric | AfterWear:
    """What may be limited: a metric, or a metric after wear."""
    return given if isinstance(given, AfterWear) else as_metric(given)


def plain(metric: AbstractMetric | AfterWear) -> AbstractMetric:
    """The metric of one motion."""
    return metric.metric if isinstance(metric, AfterWear) else metric


def own(mechanism: Mechanism, values: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the values that are not of wear."""
    known = parameters(mechanism)
    return {n: v for n, v in values.items() if n in known or not n.startswith(OF_WEAR)}


def moved(mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
    """The mechanism with values of its own replaced."""
    return replace(mechanism, own(mechanism, values))


def worth(mechanism: Mechanism, metrics: Iterable[Any], name: str) -> Any:
    """The value of a number of the mechanism, or of wear.

    **Raises:** `ClearanceError` for an unknown name, and where limits do not agree about it.
    """
    if own(mechanism, {name: None}):
        leaf, index = find(parameters(mechanism), name)
        return leaf.value if index is None else leaf.value[index]
    models = [metric.wearing(mechanism) for metric in metrics if isinstance(metric, AfterWear)]
    if not models:
        raise ClearanceError(f"There is no parameter `{name}`: no limit is on an `AfterWear`.")
    found = [find(parameters(model), name)[0].value for model in models]
    if any(float(value) != float(found[0]) for value in found):
        raise ClearanceError(f"The limits do not agree about `{name}`: give them the same law and pressure.")
    return found[0]
