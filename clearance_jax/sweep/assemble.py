"""Build the labelled dataset of a sweep: its coordinates, attributes and answers."""

import functools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from clearance_jax._version import __version__
from clearance_jax.parameters import parameters
from clearance_jax.solve.codes import Result, words
from clearance_jax.sweep.grid import NOT_RUN, Grid


def coordinates(grid: Grid) -> Iterator[tuple[str, str, Any, dict[str, str]]]:
    """The name, dimension, values and attributes of every coordinate."""
    for dimension in grid.dims:
        if dimension.models:
            yield dimension.name, dimension.name, dimension.labels, {"long_name": dimension.name}
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
    return {
        "software": _software(),
        "mechanism": question.model.name,
        "t1": float(question.t1),
        "solve": repr(shown),
        **sampled,
        **numbers,
    }


@functools.cache
def _software() -> str:
    """The versions that compute."""
    return f"clearance_jax {__version__}, jax {jax.__version__}, numpy {np.__version__}"


def ending_counts(codes: np.ndarray) -> dict[str, int]:
    """The number of lanes by result code (as text)."""
    distinct, sizes = np.unique(codes, return_counts=True)
    return {str(int(code)): int(size) for code, size in zip(distinct, sizes, strict=True)}


def counts(endings: Iterable[Mapping[str, int]], lanes: int) -> dict[str, Any]:
    """The attributes about failed lanes, from the `ending_counts` of the parts of a dataset."""
    total: Counter[int] = Counter()
    for part in endings:
        total.update({int(code): size for code, size in part.items()})
    run = {code: size for code, size in sorted(total.items()) if code != NOT_RUN}
    wrong = {code: size for code, size in run.items() if code != int(Result.REACHED_END)}
    return {
        "lanes": lanes,
        "failed": sum(wrong.values()),
        "not_run": lanes - sum(run.values()),
        "failures": "; ".join(f"{size} {words(code)}" for code, size in wrong.items()),
    }


def dataset_of(grid: Grid, values: Mapping[str, np.ndarray], provenance: Mapping[str, Any]) -> xr.Dataset:
    """The dataset of answers in memory."""
    names = tuple(dimension.name for dimension in grid.dims)
    data = {name: ((*names, *kind.dims), values[name], kind.attributes) for name, kind in grid.kinds.items()}
    coords = {name: (dim, given, attrs) for name, dim, given, attrs in coordinates(grid)}
    return xr.Dataset(
        data, coords, {**attributes(grid), **counts([ending_counts(values["code"])], grid.count), **provenance}
    )
