"""A few lanes of a sweep ahead of the others, for how long all will take."""

from collections.abc import Callable
from typing import Any

import numpy as np

from clearance_jax.solve.batch import BatchReport
from clearance_jax.solve.lanes import LANES, chunk_on
from clearance_jax.sweep.answers import AbstractAnswers
from clearance_jax.sweep.grid import Grid, Lanes
from clearance_jax.sweep.layout import Partition

# Of fewer lanes than so many times those of a pilot the whole is soon known.
SHARE = 4


def choose(partition: Partition, missing: list[int], count: int) -> Lanes:
    """So many lanes here and there in the missing regions (in `LANES` of them at most: each keeps its own aside); none
    where there are few of them.
    """
    if sum(partition.size(region) for region in missing) < SHARE * count:
        return np.zeros(0, int)
    regions = [missing[i] for i in np.unique(np.linspace(0, len(missing) - 1, LANES).astype(int))]
    each = -(-count // len(regions))
    lanes = [partition.lane(r, i * (partition.size(r) - 1) // max(each - 1, 1)) for r in regions for i in range(each)]
    return np.unique(np.asarray(lanes)[np.linspace(0, len(lanes) - 1, count).astype(int)])


def pilot_time(grid: Grid, answers: AbstractAnswers, missing: list[int], cores: int) -> float | None:
    """How long a lane takes of the time of all cores together [s], by a few of them, whose answers are kept: a lane
    comes out the same in whatever company. `None`: not known.
    """
    lanes = choose(answers.partition, missing, chunk_on() * cores)
    if len(lanes) == 0:
        return None
    seconds, values = time_lanes(grid, lanes, cores)
    keep(answers.partition, answers.keep, lanes, values)
    return seconds / len(lanes)


def time_lanes(grid: Grid, lanes: Lanes, cores: int) -> tuple[float, dict[str, np.ndarray]]:
    """How long these lanes take [s], without compiling, and their answers."""
    reports: list[BatchReport] = []
    values = grid.answer(lanes, cores, report=reports.append)
    return sum(report.running for report in reports), values


def keep(partition: Partition, add: Callable[..., Any], lanes: Lanes, values: dict[str, np.ndarray]) -> None:
    """`add` the answers of lanes to each of their regions: with these, the places there, and the values."""
    regions, places = partition.of(lanes)
    for region in np.unique(regions).tolist():
        here = regions == region
        add(region, places[here], {name: column[here] for name, column in values.items()})
