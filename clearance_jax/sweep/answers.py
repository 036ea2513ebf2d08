"""The answers of a sweep while it runs, and as a labelled dataset; here those in memory (on disk: `sweep.store`)."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from clearance_jax._version import __version__
from clearance_jax.parameters import parameters
from clearance_jax.solve.codes import Result, words
from clearance_jax.sweep.grid import NOT_RUN, Grid, Partition, ran_in_vain


def coordinates(grid: Grid) -> Iterator[tuple[str, str, Any, dict[str, str]]]:
    """The name, dimension, values and attributes of every coordinate."""
    for dimension in grid.dims:
        if dimension.models:
            yield dimension.name, dimension.name, list(dimension.models), {"long_name": dimension.name}
        elif dimension.name not in dimension.columns:
            yield dimension.name, dimension.name, np.arange(dimension.size), {"long_name": dimension.name, "units": "1"}
        for name, values in dimension.columns.items():
            yield name, dimension.name, values, {"units": grid.units[name], "long_name": name}
    for name, (dim, values) in grid.coordinates.items():
        yield name, dim, values, {"units": "s"} if name == "time" else {}


def attributes(grid: Grid) -> dict[str, Any]:
    """The attributes of the dataset: versions, model, settings, seeds."""
    question = grid.questions[0]
    sampled = {f"sampling.{d.name}": repr(d.sampling) for d in grid.dims if d.sampling}
    numbers = {f"parameter.{n}": np.asarray(leaf.value).tolist() for n, leaf in parameters(question.model).items()}
    settings = {k: v for k, v in question.settings._asdict().items() if v is not None and k != "save_at"}
    shown = {k: np.asarray(v).tolist() if isinstance(v, jax.Array) else v for k, v in settings.items()}
    software = f"clearance_jax {__version__}, jax {jax.__version__}, numpy {np.__version__}"
    asked = {"mechanism": question.model.name, "t1": float(question.t1), "solve": repr(shown)}
    return {"software": software} | asked | sampled | numbers


def ending_counts(codes: np.ndarray) -> dict[str, int]:
    """The number of lanes by result code (as text)."""
    distinct, sizes = np.unique(codes, return_counts=True)
    return {str(int(code)): int(size) for code, size in zip(distinct, sizes, strict=True)}


def counts(endings: Iterable[Mapping[str, int]], lanes: int) -> dict[str, Any]:
    """The attributes about failed lanes, from the `ending_counts` of the parts of a dataset."""
    total = sum((Counter({int(code): size for code, size in part.items()}) for part in endings), Counter())
    run = {code: size for code, size in sorted(total.items()) if code != NOT_RUN}
    wrong = {code: size for code, size in run.items() if code != int(Result.REACHED_END)}
    return {
        "lanes": lanes,
        "failed": sum(wrong.values()),
        "not_run": lanes - sum(run.values()),
        "failures": "; ".join(f"{size} {words(code)}" for code, size in wrong.items()),
    }


Values = dict[str, np.ndarray]
"""Every variable by its name, shape (lanes, ...)."""


class InMemory:
    """Answers in memory, as one region; its methods are those of a `Store`."""

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
        grid, values = self.grid, self.read(0)
        names = tuple(dimension.name for dimension in grid.dims)
        data = {
            name: ((*names, *kind.dims), values[name].reshape(*grid.shape, *values[name].shape[1:]), kind.attributes)
            for name, kind in grid.kinds.items()
        }
        coords = {name: (dim, given, attrs) for name, dim, given, attrs in coordinates(grid)}
        total = counts([ending_counts(values["code"])], grid.count)
        return xr.Dataset(data, coords, {**attributes(grid), **total, **self.provenance})
