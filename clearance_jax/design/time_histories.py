"""What happens over time at a design: every signal that a limit is about, in every condition."""

from typing import NamedTuple

import numpy as np

from clearance_jax.analysis.metrics import At
from clearance_jax.design.answer import Design
from clearance_jax.errors import ClearanceError
from clearance_jax.parameters import replace

SAMPLES = 1001


class TimeHistory(NamedTuple):
    """The signal of a limit over `times` [s], in `unit`, by condition (without a name where there is one only);
    `metric`: what of it the bound is on ("Peak").
    """

    limit: str
    unit: str
    metric: str
    bound: float
    times: np.ndarray
    values: dict[str, np.ndarray]


def time_histories(design: Design) -> tuple[TimeHistory, ...]:
    """One for each limit on a signal; without the conditions that cannot be simulated."""
    specification = design.specification
    several = len(specification.conditions) > 1
    times = np.linspace(0, specification.t1, SAMPLES)
    solve = {"rtol": specification.rtol, "solver": specification.solver}
    out = []
    for limit in specification.limits:
        signal = getattr(limit.metric, "signal", None)
        if signal is None:
            continue
        values = {}
        for name, given in specification.conditions.items():
            moved = replace(design.mechanism, given)
            try:
                values[name if several else ""] = np.asarray(At(signal, times)(moved, specification.t1, **solve))
            except (ClearanceError, RuntimeError):
                continue  # a design that could not be simulated is reported as such elsewhere
        out.append(TimeHistory(limit.label, signal.unit, type(limit.metric).__name__, limit.bound, times, values))
    return tuple(out)
