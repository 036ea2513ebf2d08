"""How a design stands with its limits: values, bounds and instants of peaks, and signals over time."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.ask.question import Question, answer
from clearance_jax.design.answer import Design
from clearance_jax.design.asked.specification import Scenario, Specification, scenarios_of
from clearance_jax.design.judge.observed import Observed, sample_times
from clearance_jax.errors import ClearanceError
from clearance_jax.metrics.observed import Instants
from clearance_jax.metrics.reductions import At
from clearance_jax.solve.settings import settings_of

# The number of limits that are shown, the nearest to their bounds.
SHOWN = 12


class Standing(NamedTuple):
    """How near a limit (its `label`) is to its bound in one scenario: `share`, value over bound; `value` and `bound` in
    `unit` (for a risk of several limits, shares of their bounds); the `time` of the peak [s], if the metric is one.
    """

    label: str
    unit: str
    value: float
    bound: float
    share: float
    time: float | None


def standings(design: Design, look: Callable[[Scenario], Observed | None] | None = None) -> tuple[Standing, ...]:
    """The standings of the limits nearest to their bounds, at most `SHOWN`, the nearest first.

    **Arguments:** `look`: observes a scenario, for the instants of its peaks (default: these are `None`).
    """
    program, limits, specification = design.program, design.evaluation.limits, design.specification
    order = np.argsort(-np.nan_to_num(limits, nan=np.inf))[:SHOWN]
    if specification.manufacture.title:
        # The risk of all parts: in the unit of a single limit, or as a share of several bounds.
        asked = specification.limits[0]
        bound, unit = (asked.bound, asked.metric.unit) if len(specification.limits) == 1 else (1.0, "")
        shares = ((program.limit_names[k], float(1 + limits[k])) for k in order)
        return tuple(Standing(label, unit, share * bound, bound, share, None) for label, share in shares)
    # A limit that is judged among parts is one number for a condition; its peak is that of the design itself.
    scenarios = scenarios_of(specification.nominal() if specification.manufacture.among else specification)
    # For every number of a scenario's limits: the index of the limit, and which of its values it is.
    titles = [limit.title for limit in specification.limits]
    groups = program.groups[: len(program.groups) // len(scenarios)]
    rows = [(titles.index(title), groups[:k].count(title)) for k, title in enumerate(groups)]
    seen: dict[int, Observed | None] = {}
    out = []
    for k in order.tolist():
        limit, place = rows[k % len(rows)]
        number, asked = k // len(rows), specification.limits[limit]
        if look is not None and number not in seen:
            seen[number] = look(scenarios[number])
        value, share = float((1 + limits[k]) * asked.bound), float(1 + limits[k])
        # The observed mechanism is new.
        observed = None if asked.ages else seen.get(number)
        instants = None if observed is None else observed.limits[limit]
        time = float(instants.times[place]) if isinstance(instants, Instants) else None
        out.append(Standing(program.limit_names[k], asked.metric.unit, value, asked.bound, share, time))
    return tuple(out)


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
    times, signals, by_condition = sample_times(specification), [limit.signal for limit in specification.limits], {}
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
            limit.signal.unit,
            limit.reduction,
            limit.since,
            limit.bound,
            times,
            {name: np.asarray(signals[i]) for name, signals in by_condition.items()},
        )
        for i, limit in enumerate(specification.limits)
        if limit.signal is not None
    )
