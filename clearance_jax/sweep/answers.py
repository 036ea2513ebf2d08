"""Where the answers of a sweep are kept while it runs: in memory, or in a store."""

import abc
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from clearance_jax.sweep.assemble import dataset_of
from clearance_jax.sweep.grid import NOT_RUN, Grid, Lanes, ran_in_vain
from clearance_jax.sweep.layout import Partition

Values = dict[str, np.ndarray]
"""Of lanes every variable by its name, shape (lanes, ...)."""


class AbstractAnswers(abc.ABC):
    """The answers so far, region by region of a `partition`."""

    partition: Partition
    on_disk: ClassVar[bool]

    @abc.abstractmethod
    def open_regions(self) -> list[int]:
        """The regions that are still to be answered."""

    @abc.abstractmethod
    def partial_answers(self, region: int) -> Values:
        """What is known of the lanes of a missing region already; `code` says of which (`NOT_RUN`: unknown)."""

    @abc.abstractmethod
    def keep(self, region: int, places: Lanes, values: Mapping[str, np.ndarray]) -> None:
        """Keep what has become of lanes at these places of a missing region, until the whole is written."""

    @abc.abstractmethod
    def partial_counts(self) -> dict[int, int]:
        """Of how many lanes of missing regions something is kept."""

    @abc.abstractmethod
    def write(self, region: int, values: Mapping[str, np.ndarray], **fields: Any) -> None:
        """Keep the answers of a whole region; `said` of them in the journal, if there is one."""

    @abc.abstractmethod
    def read(self, region: int) -> Values:
        """The answers of a region."""

    @abc.abstractmethod
    def regions_to_repeat(self, settings: str) -> Iterable[int]:
        """Regions with lanes that failed, and have not been run again with these settings (in words)."""

    @abc.abstractmethod
    def dataset(self) -> xr.Dataset:
        """Everything."""


class InMemory(AbstractAnswers):
    """Answers in memory, as one region."""

    on_disk = False

    def __init__(self, grid: Grid, provenance: Mapping[str, Any]):
        self.grid, self.provenance = grid, provenance
        self.partition = Partition(grid.shape, grid.shape)
        self._known, self._values = grid.blank(grid.count), None

    def open_regions(self):
        return [0] if self._values is None else []

    def partial_answers(self, region):
        return self._known

    def keep(self, region, places, values):
        for name, column in values.items():
            self._known[name][places] = column

    def partial_counts(self):
        return {0: int(np.sum(self._known["code"] != NOT_RUN))} if self._values is None else {}

    def write(self, region, values, **fields):
        self._values = dict(values)

    def read(self, region):
        assert self._values is not None
        return self._values

    def regions_to_repeat(self, settings):
        return [0] if np.any(ran_in_vain(self.read(0)["code"])) else []

    def dataset(self):
        shape = self.grid.shape
        values = {name: column.reshape(*shape, *column.shape[1:]) for name, column in self.read(0).items()}
        return dataset_of(self.grid, values, self.provenance)
