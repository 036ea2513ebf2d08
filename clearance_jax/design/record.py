"""Conversion of evaluated designs to records of a journal and back."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from clearance_jax.design.evaluation import Evaluation


def record_of(point: Evaluation) -> dict[str, Any]:
    """A design as a record."""
    return {k: _plain(v.tolist() if isinstance(v, np.ndarray) else v) for k, v in point._asdict().items()}


def _plain(value: Any) -> Any:
    """A value for JSON: numbers that are not finite as text."""
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def evaluation_of(record: Mapping[str, Any]) -> Evaluation:
    """The design of a record."""
    arrays = ("x", "limits", "gradient", "jacobian")
    values = {k: None if record[k] is None else np.asarray(record[k], float) for k in arrays}
    return Evaluation(objective=float(record["objective"]), fidelity=record["fidelity"], **values)
