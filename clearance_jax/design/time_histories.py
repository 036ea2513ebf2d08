"""Time histories of a design: the signal of every limit, in every condition."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.ask.lanes import answer
from clearance_jax.ask.question import Question
from clearance_jax.design.answer import Design
from clearance_jax.design.observed import sample_times
from clearance_jax.design.specification import Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.reductions import At
from clearance_jax.solve.settings import settings_of


class TimeHistory(NamedTuple):
    """The `signal` of a `limit` over time.

    - `times` (times,) [s]; `values` (times,) in `unit`, by condition (with one condition only, under an empty name);
      `bound`.
    - `reduction`: the reduction of the signal that is bounded, in words (empty: every value); `since`: from when on
      [s] (`None`: the start).
    """

    limit: str
    signal: str
    unit: str
    reduction: str
    since: float | None
    bound: float
    times: np.ndarray
    values: dict[str, np.ndarray]


def time_histories(design: Design) -> tuple[TimeHistory, ...]:
    """The signal of each limit over time, at the design, without conditions that cannot be simulated.

    **Arguments:** `design`: the answer of a problem.
    """
    specification = design.specification
    times, signals, by_condition = sample_times(specification), _signals(design.specification), {}
    asked = {str(i): At(signal, times) for i, signal in enumerate(signals) if signal is not None}
    for name, given in specification.conditions.items():
        moved = specification.move(design.mechanism, given)
        try:
            settings = settings_of(moved, specification.t1, specification.solving)
            seen = answer(Question(moved, asked, specification.t1, settings)).values
        except (ClearanceError, RuntimeError):
            continue  # a design that could not be simulated is reported as such elsewhere
        by_condition[specification.label(name)] = [seen.get(str(i)) for i in range(len(signals))]
    return histories_of(specification, times, by_condition)


def histories_of(
    specification: Specification, times: np.ndarray, by_condition: Mapping[str, Sequence[Any]]
) -> tuple[TimeHistory, ...]:
    """The time histories of all limits with a signal, from lists of signals by condition."""
    return tuple(
        TimeHistory(
            limit.label,
            limit.signal_label,
            signal.unit,
            limit.reduction,
            limit.since,
            limit.bound,
            times,
            {name: np.asarray(signals[i]) for name, signals in by_condition.items()},
        )
        for i, (limit, signal) in enumerate(zip(specification.limits, _signals(specification), strict=True))
        if signal is not None
    )


def _signals(specification: Specification) -> list[Any]:
    return [getattr(limit.metric.base_metric, "signal", None) for limit in specification.limits]
