"""The progress of a sweep, reported to a callback."""

import time
from collections.abc import Callable
from typing import Any

from clearance_jax.sweep.answers import AbstractAnswers
from clearance_jax.sweep.grid import Grid
from clearance_jax.sweep.plan import SweepProgress

Tell = Callable[[SweepProgress], Any] | None


class SweepPace:
    """Counts the lanes of a sweep and reports a `SweepProgress`. The clock starts with the first lanes that are done,
    so that compiling does not count.
    """

    def __init__(self, grid: Grid, answers: AbstractAnswers, tell: Tell):
        self._lanes, self._tell, self._sizes = grid.count, tell, answers.partition.size
        self._kept = answers.partial_counts()  # counted at the start, and not again when their region ends
        self._done = self._lanes - sum(map(self._sizes, answers.open_regions())) + sum(self._kept.values())
        self._new, self._failed = 0.0, 0
        self._begin: tuple[float, float] | None = None

    def tell(self, more: float) -> None:
        """Report that so many lanes of the current region are done."""
        if self._tell is None:
            return
        now, new = time.perf_counter(), self._new + more
        self._begin = self._begin or (now, new)
        done = self._done + int(more)
        self._tell(SweepProgress(self._lanes, done, self._failed, new - self._begin[1], now - self._begin[0]))

    def end_region(self, region: int, new: int, wrong: int) -> None:
        """Report a finished region, with the numbers of newly solved and of failed lanes."""
        self._done += self._sizes(region) - self._kept.get(region, 0)
        self._new, self._failed = self._new + new, self._failed + wrong
        self.tell(0.0)
