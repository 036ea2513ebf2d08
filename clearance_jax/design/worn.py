"""Numbers of wear laws in the conditions of a design, which are not numbers of the mechanism."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMeasure
from clearance_jax.parameters import lookup, parameters, replace, values_of


def without_wear(
    mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]
) -> dict[str, Any]:
    """The values that are not of wear: those of the mechanism, and unknown ones."""
    if not values:
        return {}
    known = parameters(mechanism)
    models = [parameters(measure.model(mechanism)) for measure in measures]

    def of_wear(name: str) -> bool:
        return lookup(known, name)[0] is None and any(lookup(model, name)[0] for model in models)

    return {name: value for name, value in values.items() if not of_wear(name)}


def values_for(
    measure: AbstractMeasure, mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]
) -> dict[str, Any]:
    """The values that a measure's model takes: all but those of the wear of other measures."""
    known, kept = parameters(measure.model(mechanism)), without_wear(mechanism, measures, values)
    return {name: value for name, value in values.items() if name in kept or lookup(known, name)[0]}


def replace_values(mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]) -> Mechanism:
    """The mechanism with its values replaced; those of wear are ignored."""
    return replace(mechanism, without_wear(mechanism, measures, values)) if values else mechanism


def sets(values: Mapping[str, Any], name: str) -> bool:
    """Whether `values` set a number `name`: itself, its array, or an entry of it."""
    return any(name == given or _within(name, given) or _within(given, name) for given in values)


def worth(
    mechanism: Mechanism,
    measures: Iterable[AbstractMeasure],
    name: str,
    given: Mapping[str, Any] = MappingProxyType({}),
) -> Any:
    """The value of a number of the mechanism or of wear, after some numbers are set to `given` values.

    **Raises:** `ClearanceError` for an unknown number, and if limits do not agree about it.
    """

    def as_given(model: Any) -> Any:
        known = parameters(model)
        return replace(model, {n: value for n, value in given.items() if lookup(known, n)[0]})

    models = [as_given(measure.model(mechanism)) for measure in measures]
    having = [model for model in models if lookup(parameters(model), name)[0]] or [as_given(mechanism)]
    values = [values_of(model, [name])[name] for model in having]
    if not all(np.array_equal(value, values[0]) for value in values):
        raise ClearanceError(f"The limits do not agree about `{name}`: give them the same law and pressure.")
    return values[0]


def _within(entry: str, array: str) -> bool:
    """Whether a name is an entry `array.i` of an array."""
    head, _, tail = entry.rpartition(".")
    return head == array and tail.isdecimal()
