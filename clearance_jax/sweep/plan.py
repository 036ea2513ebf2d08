"""The expected time and size of a sweep, its progress, and checks of memory and disk."""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.solve.drivers.batch import BatchReport
from clearance_jax.solve.drivers.lanes import LANES, chunk_on
from clearance_jax.sweep.grid import Grid, Lanes, Partition
from clearance_jax.sweep.store import Answers


class SweepPlan(NamedTuple):
    """The plan of a sweep. It prints itself.

    - `lanes`: their number, of which `known` are answered already; `regions`, `programs`: the numbers of regions, and
      of programs to compile.
    - `seconds`: the expected time of the other lanes, after compiling (`None`: too few lanes for an estimate).
    - `memory`: bytes of answers in memory at once; `disk`: bytes of the store, uncompressed (0 without one).
    - `place`: what the lanes run on, in words.
    """

    lanes: int
    known: int
    regions: int
    programs: int
    seconds: float | None
    memory: int
    disk: int
    place: str

    def __str__(self) -> str:
        new = f" ({self.known} of them known)" if self.known else ""
        time = "a time not known" if self.seconds is None else shown_time(self.seconds)
        where = f"{size(self.memory)} of answers in memory" + (
            f", at most {size(self.disk)} on disk" if self.disk else ""
        )
        what = f"{self.lanes} samples{new} in {self.regions} regions, {self.programs} programs"
        return f"{what}, on {self.place}: {time} after compiling, {where}"


class SweepProgress(NamedTuple):
    """The progress of a sweep: `done` of its `lanes`; `failed` lanes of finished regions; `new` lanes in the `seconds`
    since the first ones were done.
    """

    lanes: int
    done: int
    failed: int
    new: float
    seconds: float

    @property
    def rate(self) -> float:
        """Lanes per second."""
        return self.new / self.seconds if self.seconds > 0 else 0.0

    @property
    def left(self) -> float | None:
        """Remaining time [s]; `None` if it is not known."""
        return (self.lanes - self.done) / self.rate if self.rate > 0 else None

    def __str__(self) -> str:
        left = "" if self.left is None else f", {shown_time(self.left)} to go"
        return f"{self.done} of {self.lanes} samples, {self.failed} failed, {self.rate:.3g} a second{left}"


def check_room(path: Path, needed: int) -> None:
    """Raise `ClearanceError` if a store does not fit on its disk."""
    folder = next((p for p in path.absolute().parents if p.is_dir()), Path("/"))
    free = shutil.disk_usage(folder).free
    # A disk with no room at all gives its own error.
    if needed > free > 0:
        raise ClearanceError(
            f"`{path}` may take {size(needed)}, but there are {size(free)} free. Ask for fewer samples or outputs, "
            "or choose another disk."
        ).about(path, needed)


def size(count: int) -> str:
    """Bytes in words."""
    power = next((k for k in range(4) if count < 1000 ** (k + 1)), 4)
    return f"{count / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"


def shown_time(seconds: float) -> str:
    """A duration in words."""
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def check_memory(needed: int) -> None:
    """Raise `ClearanceError` if answers do not fit in this machine's memory."""
    try:
        whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system tells
        return
    if needed > whole:
        text = (
            f"The answers take {size(needed)}, but this machine has {size(whole)} of memory. Give a `store` to write."
        )
        raise ClearanceError(text).about("store", needed)


# A pilot is run if there are at least so many times its lanes.
SHARE = 4


def choose(partition: Partition, missing: list[int], count: int) -> Lanes:
    """`count` lanes spread over at most `LANES` missing regions; none if few lanes are missing."""
    if sum(partition.size(region) for region in missing) < SHARE * count:
        return np.zeros(0, int)
    regions = [missing[i] for i in np.unique(np.linspace(0, len(missing) - 1, LANES).astype(int))]
    each = -(-count // len(regions))
    # From the first lane of a region to its last one, at equal distances.
    places = [np.arange(each) * (partition.size(region) - 1) // max(each - 1, 1) for region in regions]
    lanes = np.concatenate([partition.lanes(region)[some] for region, some in zip(regions, places, strict=True)])
    return np.unique(lanes[np.linspace(0, len(lanes) - 1, count).astype(int)])


def pilot_time(answers: Answers, missing: list[int], cores: int) -> float | None:
    """The time of a lane with all cores running [s], measured with lanes that are kept; `None`: not known."""
    lanes = choose(answers.partition, missing, chunk_on() * cores)
    if len(lanes) == 0:
        return None
    seconds, values = time_lanes(answers.grid, lanes, cores)
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


Tell = Callable[[SweepProgress], Any] | None


class SweepPace:
    """Counts lanes and reports a `SweepProgress`; the clock starts with the first that are done, after compiling."""

    def __init__(self, answers: Answers, tell: Tell):
        self._lanes, self._tell, self._sizes = answers.grid.count, tell, answers.partition.size
        self._kept = answers.partial_counts()  # counted at the start, and not again when their region ends
        self._done = self._lanes - sum(map(self._sizes, answers.open_regions())) + sum(self._kept.values())
        self._new, self._failed = 0.0, 0
        # When the first lanes were done, and how many these were.
        self._begin: tuple[float, float] | None = None

    def tell(self, more: float) -> None:
        """Report that so many lanes of the current region are done."""
        if self._tell is None:
            return
        now, new = time.perf_counter(), self._new + more
        self._begin = self._begin or (now, new)
        begin, first = self._begin
        self._tell(SweepProgress(self._lanes, self._done + int(more), self._failed, new - first, now - begin))

    def end_region(self, region: int, new: int, wrong: int) -> None:
        """Report a finished region, with the numbers of newly solved and of failed lanes."""
        self._done += self._sizes(region) - self._kept.get(region, 0)
        self._new, self._failed = self._new + new, self._failed + wrong
        self.tell(0.0)
