"""Numbers that are not the mechanism's own but move a limit all the same: those of how its parts wear."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from clearance_jax.analysis.measure import AbstractMeasure
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import parameters, replace, values_of


def own(mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the values that are not of wear: the mechanism's, and those that nothing knows."""
    known = set(parameters(mechanism))
    of_wear = {name for measure in measures for name in parameters(measure.model(mechanism))} - known
    return {name: value for name, value in values.items() if name not in of_wear}


def moved(mechanism: Mechanism, measures: Iterable[AbstractMeasure], values: Mapping[str, Any]) -> Mechanism:
    """The mechanism with values of its own replaced."""
    return replace(mechanism, own(mechanism, measures, values)) if values else mechanism


def worth(mechanism: Mechanism, measures: Iterable[AbstractMeasure], name: str) -> Any:
    """The value of a number of the mechanism, or of wear.

    **Raises:** `ClearanceError` for an unknown one, and where limits do not agree about it.
    """
    models = [measure.model(mechanism) for measure in measures]
    having = [model for model in models if name in parameters(model)] or [mechanism]
    found = [values_of(model, [name])[name] for model in having]
    if not all(np.array_equal(value, found[0]) for value in found):
        raise ClearanceError(f"The limits do not agree about `{name}`: give them the same law and pressure.")
    return found[0]
