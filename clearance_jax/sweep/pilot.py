"""Time a few lanes of a sweep, to estimate how long all will take."""

from collections.abc import Callable
from typing import Any

import numpy as np

from clearance_jax.solve.batch import BatchReport
from clearance_jax.solve.lanes import LANES, chunk_on
from clearance_jax.sweep.answers import AbstractAnswers
from clearance_jax.sweep.grid import Grid, Lanes
from clearance_jax.sweep.layout import Partition

# A pilot is run if there are at least so many times its lanes.
SHARE = 4


def choose(partition: Partition, missing: list[int], count: int) -> Lanes:
    """`count` lanes spread over at most `LANES` missing regions, as each has its own partial results; none if few lanes
    are missing.
    """
    if sum(partition.size(region) for region in missing) < SHARE * count:
        return np.zeros(0, int)
    regions = [missing[i] for i in np.unique(np.linspace(0, len(missing) - 1, LANES).astype(int))]
    each = -(-count // len(regions))
    lanes = [partition.lane(r, i * (partition.size(r) - 1) // max(each - 1, 1)) for r in regions for i in range(each)]
    return np.unique(np.asarray(lanes)[np.linspace(0, len(lanes) - 1, count).astype(int)])


def pilot_time(grid: Grid, answers: AbstractAnswers, missing: list[int], cores: int) -> float | None:
    """The time of a lane with all cores running [s], measured with a few lanes whose answers are kept; `None`: not
    known.
    """
    lanes = choose(answers.partition, missing, chunk_on() * cores)
    if len(lanes) == 0:
        return None
    seconds, values = time_lanes(grid, lanes, cores)
    keep(answers.partition, answers.keep, lanes, values)
    return seconds / len(lanes)


def time_lanes(grid: Grid, lanes: Lanes, cores: int) -> tuple[float, dict[str, np.ndarray]]:
    """The time of these lanes [s], without compiling, and their answers."""
    reports: list[BatchReport] = []
    values = grid.answer(lanes, cores, report=reports.append)
    return sum(report.running for report in reports), values


def keep(partition: Partition, add: Callable[..., Any], lanes: Lanes, values: dict[str, np.ndarray]) -> None:
    """Call `add(region, places, values)` for each region of the lanes."""
    regions, places = partition.of(lanes)
    for region in np.unique(regions).tolist():
        here = regions == region
        add(region, places[here], {name: column[here] for name, column in values.items()})
