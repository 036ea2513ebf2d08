"""The answers of a sweep while it runs: the interface, and answers in memory (those on disk: `sweep.store`)."""

import abc
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
import xarray as xr

from clearance_jax.sweep.assemble import dataset_of
from clearance_jax.sweep.grid import NOT_RUN, Grid, Lanes, ran_in_vain
from clearance_jax.sweep.layout import Partition

Values = dict[str, np.ndarray]
"""Every variable by its name, shape (lanes, ...)."""


class AbstractAnswers(abc.ABC):
    """The answers so far, by regions of a `partition`."""

    partition: Partition
    on_disk: ClassVar[bool]

    @abc.abstractmethod
    def open_regions(self) -> list[int]:
        """The regions without answers."""

    @abc.abstractmethod
    def partial_answers(self, region: int) -> Values:
        """The values of a missing region, as far as they are known; the `code` of an unknown lane is `NOT_RUN`."""

    @abc.abstractmethod
    def keep(self, region: int, places: Lanes, values: Mapping[str, np.ndarray]) -> None:
        """Keep the values of lanes at these places of a missing region, until the whole region is written."""

    @abc.abstractmethod
    def partial_counts(self) -> dict[int, int]:
        """How many lanes of each missing region are kept."""

    @abc.abstractmethod
    def write(self, region: int, values: Mapping[str, np.ndarray], **fields: Any) -> None:
        """Keep the answers of a whole region, with more `fields` of its record in the journal, if there is one."""

    @abc.abstractmethod
    def read(self, region: int) -> Values:
        """The answers of a region."""

    @abc.abstractmethod
    def regions_to_repeat(self, settings: str) -> Iterable[int]:
        """The regions with failed lanes that have not been solved again with these settings (in words)."""

    @abc.abstractmethod
    def dataset(self) -> xr.Dataset:
        """All answers as a dataset."""


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
