"""Lanes, varied numbers and results of a sweep's dataset, and their labels in figures.

The variable `code` has the result code of every lane. Its dimensions are named after numbers, or count (`sample`). A
coordinate of floats along them is a number that varies. If several along one dimension are all monotone, `tidy` keeps
one of them. The attribute `metric` of a result is the kind of its metric.
"""

import functools
import itertools
import re
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from clearance_jax.errors import ClearanceError, unknown_name
from clearance_jax.units import to_si

CODE = "code"
# What every lane has beside its results.
ENDINGS = (CODE, "steps", "rejected", "energy_residual", "validity", "again")
# Codes of a lane that has not been run, and of one that reached its end.
NOT_RUN, REACHED = -1, 0
# A motion is chaotic, or stable, where its exponent is away from zero by more than so many times its uncertainty.
BEYOND = 2.0
# Units in which numbers are shown whose largest one is below a bound.
PREFIXES = {
    "m": ((1e-3, 1e6, "µm"), (10.0, 1e3, "mm")),
    "m/s": ((1.0, 1e3, "mm/s"),),
    "s": ((1e-3, 1e6, "µs"), (1.0, 1e3, "ms")),
    "N": ((1e4, 1.0, "N"), (np.inf, 1e-3, "kN")),
}


class AxisScale(NamedTuple):
    """How a number is shown: multiplied by `factor`, under a `name`, in a `unit`."""

    factor: float
    name: str
    unit: str

    @property
    def label(self) -> str:
        """The label of an axis: name and unit."""
        return self.name + (f", {self.unit}" if self.unit else "")


def tidy(dataset: xr.Dataset) -> xr.Dataset:
    """A sweep with one number along each dimension whose numbers are all monotone: that of the dimension's name, or the
    first one, which then names the dimension. Numbers that scatter stay.
    """
    for dim in lanes_of(dataset):
        along = [name for name in variables(dataset) if dataset[name].dims == (dim,)]
        if along == [dim]:  # in whatever order it was given
            dataset = dataset.sortby(dim)
        steps = [np.diff(dataset[name].values) for name in along]
        if not along or not all(np.all(step > 0) or np.all(step < 0) for step in steps):
            continue
        kept = dim if dim in along else along[0]
        if dim not in along:  # it counts lanes, which says no more than a number in its place
            dataset = dataset.drop_vars(dim, errors="ignore").swap_dims({dim: kept})
        dataset = dataset.drop_vars([name for name in along if name != kept])
    return dataset


def lanes_of(dataset: xr.Dataset) -> tuple[str, ...]:
    """The dimensions along which lanes lie. **Raises** `ClearanceError` for a dataset that is no sweep."""
    if CODE not in dataset:
        raise ClearanceError("There is nothing to draw: this is no result of a sweep, for no sample has a `code`.")
    return tuple(str(dim) for dim in dataset[CODE].dims)


def variables(dataset: xr.Dataset) -> tuple[str, ...]:
    """The numbers that vary over the lanes, in the order of their dimensions."""
    lanes = lanes_of(dataset)
    # What only counts its lanes is whole numbers.
    floats = {str(name): x.dims for name, x in dataset.coords.items() if np.issubdtype(x.dtype, np.floating)}
    varied = [name for name, dims in floats.items() if dims and set(dims) <= set(lanes)]
    return tuple(sorted(varied, key=lambda name: lanes.index(str(floats[name][0]))))


def results(dataset: xr.Dataset) -> tuple[str, ...]:
    """The results that are one real number a lane."""
    lanes = set(lanes_of(dataset))
    return tuple(
        str(name)
        for name, values in dataset.data_vars.items()
        if name not in ENDINGS and set(values.dims) == lanes and np.issubdtype(values.dtype, np.floating)
    )


def endings(dataset: xr.Dataset) -> tuple[int, int]:
    """How many lanes failed, and how many have not been run yet."""
    code = dataset[CODE].fillna(NOT_RUN)
    return int(((code != REACHED) & (code != NOT_RUN)).sum()), int((code == NOT_RUN).sum())


class Exponent(NamedTuple):
    """A Lyapunov exponent of every lane, and its uncertainty where that is known."""

    value: xr.DataArray
    uncertainty: xr.DataArray | None

    @property
    def sign(self) -> np.ndarray:
        """Of every lane, (lanes,): 1 or -1 where it is beyond its uncertainty, 0 where it may be zero or is missing."""
        values = self.value.values.astype(float).ravel()
        least = 0.0 if self.uncertainty is None else BEYOND * self.uncertainty.values.astype(float).ravel()
        return np.where(values > least, 1, np.where(values < -least, -1, 0))


def exponent_of(dataset: xr.Dataset, name: str) -> Exponent:
    """A largest Lyapunov exponent, lanes in the order of `code`."""
    exponent = result(dataset, name).transpose(*dataset[CODE].dims, ...)
    if "estimate" in exponent.dims:
        return Exponent(*(exponent.sel(estimate=which, drop=True) for which in ("value", "uncertainty")))
    return Exponent(exponent, None)


def result(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """A result. **Raises** `ClearanceError` for an unknown name."""
    if name not in dataset.data_vars:
        raise unknown_name(f"This sweep has no result `{name}`.", name, map(str, dataset.data_vars))
    return dataset[name]


def number(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """A number that varies. **Raises** `ClearanceError` for another one."""
    if name not in variables(dataset):
        raise unknown_name(f"`{name}` does not vary in this sweep.", name, variables(dataset))
    return dataset[name]


def of_lanes(dataset: xr.Dataset, array: xr.DataArray) -> np.ndarray:
    """A number or a result lane by lane: shape (lanes, ...), real."""
    code = dataset[CODE]
    values = array.broadcast_like(code).transpose(*code.dims, ...).values.astype(float)
    return values.reshape(code.size, *values.shape[code.ndim :])


def axis_scale(dataset: xr.Dataset, name: str) -> AxisScale:
    """How a number that varies is shown: in the unit in which the study's file has it, if there is one. **Raises**
    `ClearanceError` for another number.
    """
    array, written = number(dataset, name), written_unit(str(dataset.attrs.get("study", "")), name)
    usual = display(array)
    if not written:
        return usual
    factor = 1 / to_si(f"1 {written}", str(array.attrs["units"]), name)
    return AxisScale(factor, usual.name, written.replace("um", "µm"))


@functools.cache
def written_unit(study: str, name: str) -> str:
    """The unit in which the text of a study file has an axis or a scattered number; empty if it has none."""
    try:
        tables: dict[str, Any] = tomllib.loads(study)
    except tomllib.TOMLDecodeError:  # the attribute is a text of the user's
        return ""
    axes = tables.get("sweep", {}).get("axis", {})
    zipped = [axis["values"] for axis in axes.values() if "values" in axis and isinstance(axis["values"], dict)]
    for known in (axes, *zipped, tables.get("scatter", {})):
        given = known.get(name, ())
        values = given.values() if isinstance(given, dict) else given
        for text in itertools.chain(*(value if isinstance(value, list) else [value] for value in values)):
            unit = re.fullmatch(r"[-+\d.eE_]+\s*([^\d\s%].*)", text) if isinstance(text, str) else None
            if unit is not None:
                return unit[1]
    return ""


def scaled(dataset: xr.Dataset, array: xr.DataArray, name: str | None = None) -> tuple[AxisScale, np.ndarray]:
    """How a number or a result is shown (`axis_scale`, `display`), and its values so, lane by lane (`of_lanes`)."""
    axis = axis_scale(dataset, str(array.name)) if array.name in variables(dataset) else display(array, name)
    return axis, axis.factor * of_lanes(dataset, array)


def display(array: xr.DataArray, name: str | None = None) -> AxisScale:
    """Factor, name and unit in which a number or a result is shown, by its size."""
    unit, values = str(array.attrs.get("units", "")), np.abs(array.values.astype(float))
    finite = values[np.isfinite(values)]
    largest, factor = float(finite.max()) if finite.size else 0.0, 1.0
    for bound, times, other in PREFIXES.get(unit, ()):
        if largest < bound:
            factor, unit = times, other
            break
    # The `long_name` of a metric is that of its kind; the user's own name says more.
    key, title = str(array.name), str(array.attrs.get("long_name", array.name))
    title = words(key) if "metric" in array.attrs or title == key else title
    return AxisScale(factor, title if name is None else name, "" if unit == "1" else unit.replace("^2", "²"))


def scale(values: np.ndarray) -> str:
    """The scale of an axis: "log" for values in equal ratios (those of `spacing = "log"`), else "linear"."""
    if len(values) < 3 or np.any(values <= 0):
        return "linear"
    ratios, steps = np.diff(np.log(values)), np.diff(values)
    return "log" if np.ptp(ratios) < 1e-6 * abs(ratios[0]) and np.ptp(steps) > 1e-3 * abs(steps[0]) else "linear"


def words(name: str) -> str:
    """A dotted name as words."""
    return name.replace("_", " ").replace(".", " ")


def spread_places(counts: int, most: int) -> list[int]:
    """At most so many of `counts` places, evenly chosen, both ends among them."""
    return sorted({int(k) for k in np.linspace(0, counts - 1, min(most, counts)).round()})


def place_words(dataset: xr.Dataset, place: Mapping[str, int]) -> str:
    """The position of a part of a sweep along some dimensions, in words."""
    told = []
    for dim, k in place.items():
        if dim in variables(dataset):
            told.append(f"{axis_scale(dataset, dim).name} {value_words(dataset, dim, k)}")
        else:
            told.append(str(dataset[dim].values[k]) if dim in dataset.coords else f"{dim} {k}")
    return ", ".join(told)


def title_of(dataset: xr.Dataset, dim: str) -> str:
    """What a dimension is called in a legend."""
    return axis_scale(dataset, dim).name if dim in variables(dataset) else dim


def value_words(dataset: xr.Dataset, dim: str, k: int) -> str:
    """The k-th value along a dimension, with its unit."""
    if dim not in variables(dataset):
        return str(dataset[dim].values[k]) if dim in dataset.coords else str(k)
    axis = axis_scale(dataset, dim)
    return f"{axis.factor * float(dataset[dim][k]):.4g} {axis.unit}".strip()


def slice_grid(dataset: xr.Dataset, axis: str) -> tuple[xr.Dataset, str]:
    """The lanes along one axis of a grid in the middle of its other axes, and this middle in words; else all lanes."""
    if axis not in lanes_of(dataset):
        return dataset, ""
    place = {dim: dataset.sizes[dim] // 2 for dim in lanes_of(dataset) if dim != axis}
    return dataset.isel(place), place_words(dataset, place)
