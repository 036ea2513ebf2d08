"""The standings of a design: the value of each limit, its bound, and the instant of its peak."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clearance_jax.design.answer import Design
from clearance_jax.design.observed import Observed
from clearance_jax.design.specification import Scenario, scenarios_of
from clearance_jax.metrics.instants import Instants

# The number of limits that are shown, the nearest to their bounds.
SHOWN = 12


class Standing(NamedTuple):
    """How near a limit (its `label`) is to its bound in one scenario.

    - `share`: value over bound; `value` and `bound` in `unit` (for a risk of several limits, shares of their bounds).
    - `time`: the instant of the peak [s], if the metric is a peak.
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
    program, limits = design.program, design.evaluation.limits
    order = np.argsort(-np.nan_to_num(limits, nan=np.inf))[:SHOWN]
    if design.specification.manufacture.title:
        return tuple(_risk(design, program.limit_names[k], float(1 + limits[k])) for k in order)
    specification = design.specification
    # A limit that is judged among parts is one number for a condition; its peak is that of the design itself.
    scenarios = scenarios_of(specification.nominal() if specification.manufacture.among else specification)
    rows = _rows(design, len(scenarios))
    seen: dict[int, Observed | None] = {}
    out = []
    for k in order.tolist():
        limit, place = rows[k % len(rows)]
        number, asked = k // len(rows), design.specification.limits[limit]
        if look is not None and number not in seen:
            seen[number] = look(scenarios[number])
        value, share = float((1 + limits[k]) * asked.bound), float(1 + limits[k])
        # The observed mechanism is new.
        time = None if asked.ages else _instant(seen.get(number), limit, place)
        out.append(Standing(program.limit_names[k], asked.metric.unit, value, asked.bound, share, time))
    return tuple(out)


def _risk(design: Design, label: str, share: float) -> Standing:
    """The standing of the risk of all parts: in the unit of a single limit, or as a share of several bounds."""
    limits = design.specification.limits
    bound, unit = (limits[0].bound, limits[0].metric.unit) if len(limits) == 1 else (1.0, "")
    return Standing(label, unit, share * bound, bound, share, None)


def _rows(design: Design, scenarios: int) -> list[tuple[int, int]]:
    """For every number of a scenario's limits: the index of the limit, and which of its values it is."""
    titles = [limit.title for limit in design.specification.limits]
    groups = design.program.groups[: len(design.program.groups) // scenarios]
    return [(titles.index(title), groups[:k].count(title)) for k, title in enumerate(groups)]


def _instant(seen: Observed | None, limit: int, place: int) -> float | None:
    instants = None if seen is None else seen.limits[limit]
    return float(instants.times[place]) if isinstance(instants, Instants) else None
