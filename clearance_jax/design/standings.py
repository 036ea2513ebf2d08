"""How a design stands to its limits: what each comes to, of which bound, and when."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from clearance_jax.design.answer import Design
from clearance_jax.design.observed import Observed
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.metrics.instants import Instants

# Of so many limits, the nearest to their bounds, a reader sees the pattern.
SHOWN = 12


class Standing(NamedTuple):
    """How near a limit (its `label`) is to its bound in one scenario.

    - `share`: of the bound; `value` and `bound` in `unit`; of a risk of several limits shares of their bounds.
    - `time`: when it is met [s], if the metric is a peak.
    """

    label: str
    unit: str
    value: float
    bound: float
    share: float
    time: float | None


def standings(design: Design, look: Callable[[Scenario], Observed | None] | None = None) -> tuple[Standing, ...]:
    """Of the limits nearest to their bounds, at most `SHOWN`, the nearest first.

    **Arguments:** `look`: observes a scenario, for when its peaks are (default: that is left open).
    """
    program, limits = design.program, design.evaluation.limits
    order = np.argsort(-np.nan_to_num(limits, nan=np.inf))[:SHOWN]
    if design.specification.manufacture.title:
        return tuple(_risk(design, program.limit_names[k], float(1 + limits[k])) for k in order)
    specification = design.specification
    # Where a limit is judged among parts at once, it is one number a condition, and the design itself is looked at.
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
        # It was looked at as new.
        time = None if asked.ages else _instant(seen.get(number), limit, place)
        out.append(Standing(program.limit_names[k], asked.metric.unit, value, asked.bound, share, time))
    return tuple(out)


def _risk(design: Design, label: str, share: float) -> Standing:
    """What all parts come to together: of one limit in its unit, of several a share of their bounds."""
    limits = design.specification.limits
    bound, unit = (limits[0].bound, limits[0].metric.unit) if len(limits) == 1 else (1.0, "")
    return Standing(label, unit, share * bound, bound, share, None)


def _rows(design: Design, scenarios: int) -> list[tuple[int, int]]:
    """Of every number that a scenario's limits are: which limit, and which of its values."""
    titles = [limit.title for limit in design.specification.limits]
    groups = design.program.groups[: len(design.program.groups) // scenarios]
    return [(titles.index(title), groups[:k].count(title)) for k, title in enumerate(groups)]


def _instant(seen: Observed | None, limit: int, place: int) -> float | None:
    instants = None if seen is None else seen.limits[limit]
    return float(instants.times[place]) if isinstance(instants, Instants) else None
