"""Readings: those that were measured, checked against the motion's quantities, and simulated ones with derivatives."""

import copy
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array

from clearance_jax.ask.question import Question, answer
from clearance_jax.dynamics.quantities import OBSERVED, OF_COORDINATES, quantities
from clearance_jax.errors import ClearanceError, suggest, unknown_name, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import signal_at
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.codes import words
from clearance_jax.solve.settings import Settings
from clearance_jax.units import to_si

TIME = "time"


class Series(NamedTuple):
    """One measured number over time: its `name`; the `reading`, a quantity or signal of the motion; SI `unit`; `values`
    (times,), NaN if missing; `deviation` of the noise (`None`: to be estimated).
    """

    name: str
    reading: str | AbstractSignal
    unit: str
    values: np.ndarray
    deviation: float | None


class Measurement(NamedTuple):
    """Measured data: increasing `times` [s], and the `series` at these."""

    times: np.ndarray
    series: tuple[Series, ...]

    @property
    def values(self) -> np.ndarray:
        """All numbers, shape (times, series)."""
        return np.stack([series.values for series in self.series], axis=1)

    @property
    def known(self) -> np.ndarray:
        """Whether each number was measured, shape (times, series)."""
        return np.isfinite(self.values)

    def until(self, count: int) -> "Measurement":
        """The same measurement, with only the first `count` instants known."""
        late = np.arange(len(self.times)) >= count
        cut = (series._replace(values=np.where(late, np.nan, series.values)) for series in self.series)
        return Measurement(self.times, tuple(cut))


def read_measurement(
    mechanism: Mechanism,
    dataset: xr.Dataset,
    signals: Mapping[str, str | AbstractSignal] | Sequence[str] | None = None,
    deviations: Mapping[str, Any] | None = None,
    books: bool = False,
) -> Measurement:
    """Read a dataset, as `calibrate`. **Raises** `ClearanceError` for what is no quantity of the motion."""
    if not isinstance(dataset, xr.Dataset):
        raise ClearanceError(f"Measured data must be an xarray Dataset, but this is a {type(dataset).__name__}.")
    times, readings, given = _times(dataset), _readings(dataset, signals), dict(deviations or {})
    for name in given:
        if name not in readings:
            raise unknown_name(f"`deviations`: there is no signal `{name}`.", str(name), readings)
    known, series = _numbers(mechanism, books), []
    for name, reading in readings.items():
        series += _series(name, reading, dataset[name], known, _deviation(name, given.get(name)))
    return Measurement(times, tuple(series))


def unit_of(mechanism: Mechanism, name: str, reading: str | AbstractSignal) -> str:
    """The SI unit of the reading of variable `name`. **Raises** `ClearanceError` if there is no such quantity."""
    if isinstance(reading, AbstractSignal):
        return reading.unit
    every = quantities(mechanism, True)
    if reading in every:
        return every[reading].unit
    if reading in OBSERVED and not OBSERVED[reading].unit.startswith("see "):
        return OBSERVED[reading].unit
    return _unit(name, reading, _numbers(mechanism, True))


def _numbers(mechanism: Mechanism, books: bool) -> dict[str, str]:
    """The units of all quantities that are one number."""
    return {
        name: quantity.unit
        for name, quantity in quantities(mechanism, books).items()
        if quantity.place is not None or len(quantity.index) == len(OBSERVED[quantity.variable].dims)
    }


def _readings(dataset: xr.Dataset, signals: Any) -> dict[str, str | AbstractSignal]:
    """The reading of each variable of the dataset, by name."""
    if signals is None:
        signals = [str(name) for name, variable in dataset.data_vars.items() if TIME in variable.dims]
    if isinstance(signals, str):
        signals = (signals,)
    readings = dict(signals) if isinstance(signals, Mapping) else {name: name for name in signals}
    if not readings:
        raise ClearanceError("The dataset has no variable over `time`: there is nothing to compare the motion with.")
    for name in readings:
        if name not in dataset:
            raise unknown_name(f"The dataset has no variable `{name}`.", str(name), map(str, dataset))
    return readings


def _times(dataset: xr.Dataset) -> np.ndarray:
    if TIME not in dataset.coords or dataset[TIME].ndim != 1:
        raise ClearanceError("The dataset lacks a coordinate `time` [s], one number for each measured instant. Add it.")
    given = dataset[TIME]
    if given.dtype.kind not in "fiu":
        raise ClearanceError(f"The coordinate `time` must be numbers in seconds, but it is of type {given.dtype}.")
    times = np.asarray(given.values, float) * _factor(given, "s", "The coordinate `time`")
    if not np.all(np.isfinite(times)):
        raise ClearanceError("The coordinate `time` has values that are not finite. Leave these instants out.")
    if times.size == 0 or not np.all(np.diff(times) > 0):
        raise ClearanceError("The coordinate `time` must increase, each instant once. Sort it, or leave some out.")
    return times


def _factor(array: xr.DataArray, unit: str, where: str) -> float:
    """The factor that converts an array to SI, by its attribute `units`; 1 if it has none."""
    given = array.attrs.get("units")
    if given is None or str(given).startswith("see ") or given == unit or unit == "":
        return 1.0
    return to_si(f"1 {given}", unit, f"{where}, its attribute `units`,")


def _deviation(name: str, given: Any) -> float | None:
    if given is None:
        return None
    try:
        number = float(given)
    except (TypeError, ValueError):
        raise wrong_value(f"The deviation of `{name}`", "one number", given) from None
    if not 0 < number < np.inf:
        raise wrong_value(f"The deviation of `{name}`", "finite and above zero", number, shown=f"{number:g}")
    return number


def _series(
    name: str, reading: Any, array: xr.DataArray, known: Mapping[str, str], deviation: float | None
) -> Iterator[Series]:
    """The series of one variable: one for each place along its other dimensions."""
    if TIME not in array.dims:
        raise ClearanceError(f"The variable `{name}` has no dimension `time`, so it is no signal. Leave it out.")
    if array.dtype.kind not in "fiu":
        raise ClearanceError(f"The variable `{name}` must be numbers, but it is of type {array.dtype}.")
    others = [str(dim) for dim in array.dims if dim != TIME]
    # What is measured, the name of the series, and where it is in the array.
    named: list[tuple[Any, str, dict]] = []
    if isinstance(reading, AbstractSignal):
        if others:
            raise ClearanceError(f"`{name}` must be one number over time, but it has a dimension `{others[0]}` too.")
        named = [(reading, name, {})]
    elif isinstance(reading, str):
        # Series are called as quantities are, with the name of the variable in place of the reading.
        named = [(quantity, quantity.replace(reading, name), at) for quantity, at in _names(reading, array)]
    else:
        raise ClearanceError(
            f"The signal `{name}` must be the name of a quantity or a signal of `clearance_jax.metrics`, but it is a "
            f"{type(reading).__name__}."
        )
    for what, label, at in named:
        unit = what.unit if isinstance(what, AbstractSignal) else _unit(name, what, known)
        values = np.asarray(array.isel(at).values, float) * _factor(array, unit, f"The variable `{name}`")
        values = np.where(np.isfinite(values), values, np.nan)
        if np.all(np.isnan(values)):
            raise ClearanceError(f"Nothing of `{label}` was measured: all its values are NaN. Leave it out.")
        yield Series(label, what, unit, values, deviation)


def _unit(name: str, quantity: str, known: Mapping[str, str]) -> str:
    if quantity not in known:
        raise ClearanceError(
            f"The variable `{name}` cannot be compared with the motion, which has no number `{quantity}`. "
            f'{suggest(quantity, known)} Or say what it is: `signals={{"{name}": "..."}}`.'
        )
    return known[quantity]


def _names(reading: str, array: xr.DataArray) -> Iterator[tuple[str, dict[str, int]]]:
    """The quantities in a variable, and the index of each, by the labels of its dimensions. A variable `position` has
    `piston.position.x` at the labels "piston" and "x", a variable `piston.position` at the label "x".
    """
    dims = [str(dim) for dim in array.dims if dim != TIME]
    for dim in dims:
        if dim not in array.coords:
            raise ClearanceError(f"`{array.name}` has a dimension `{dim}` without labels. Give it a coordinate.")
    for places in itertools.product(*(range(array.sizes[dim]) for dim in dims)):
        at = dict(zip(dims, places, strict=True))
        labels = [str(array[dim].values[place]) for dim, place in at.items()]
        if labels and reading in OBSERVED:
            labels.insert(1, OF_COORDINATES.get(reading, reading))
        else:
            labels.insert(0, reading)
        yield ".".join(labels), at


# Errors of readings over the tolerance of the solves, by order of magnitude.
FLOOR = 10.0


class Readings(AbstractMetric):
    """A metric: quantities by name and signals at times [s], shape (times, quantities and then signals)."""

    quantities: tuple[str, ...] = eqx.field(static=True)
    signals: tuple[AbstractSignal, ...]
    times: Array = eqx.field(converter=lambda t: jnp.asarray(t, float))

    def request(self, mechanism, t1, options):
        return Request(times=self.times)

    def value(self, reply):
        named = [reply.solution[name] for name in self.quantities]
        others = [signal_at(signal, reply, self.times, reply.solution.y) for signal in self.signals]
        return jnp.stack([*named, *others], axis=-1)


class FitPoint(NamedTuple):
    """The readings of the motion at numbers `x` (parameters,): `values` (times, series) and their derivatives `slopes`
    (times, series, parameters); NaN if the motion did not reach its end. `why` says how it ended.
    """

    x: np.ndarray
    values: np.ndarray
    slopes: np.ndarray
    why: str

    @property
    def reached(self) -> bool:
        """Whether all readings and derivatives are finite."""
        return bool(np.all(np.isfinite(self.values)) and np.all(np.isfinite(self.slopes)))


class Instruments:
    """The readings of a mechanism's motion at values `x` of its numbers, by name `numbers(x)`. Each point is solved
    once and kept in `points`, also those of shorter motions; `progress` is called with each. `accuracy` is the relative
    error of readings.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        measurement: Measurement,
        numbers: Callable[[np.ndarray], dict[str, np.ndarray]],
        t1: float,
        settings: Settings,
        progress: Callable[[FitPoint], Any] | None = None,
    ):
        readings = [series.reading for series in measurement.series]
        quantities = tuple(reading for reading in readings if isinstance(reading, str))
        signals = tuple(reading for reading in readings if isinstance(reading, AbstractSignal))
        # The metric has quantities first: the place of each series in it.
        self._order = np.argsort(np.argsort([not isinstance(reading, str) for reading in readings], kind="stable"))
        metric = Readings(quantities, signals, measurement.times)
        self._numbers, self._progress = numbers, progress
        self._question = Question(mechanism, {"": metric}, t1, settings)
        self._times, self._count = measurement.times, len(measurement.times)
        self.accuracy = FLOOR * float(settings.rtol)
        self._seen: dict[tuple[int, bytes], FitPoint] = {}

    @property
    def points(self) -> list[FitPoint]:
        """Every point that was solved, in order."""
        return list(self._seen.values())

    def until(self, count: int) -> "Instruments":
        """The same program for motions that end at instant `count`; later readings repeat the last one."""
        other, end = copy.copy(self), self._times[count - 1]
        readings = dataclasses.replace(self._question.metrics[""], times=np.minimum(self._times, end))
        other._question = dataclasses.replace(self._question, metrics={"": readings}, t1=end)
        other._count = count
        return other

    def __call__(self, x: np.ndarray) -> FitPoint:
        key = self._count, np.asarray(x, float).tobytes()
        if key not in self._seen:
            numbers = self._numbers(x)
            solved = answer(dataclasses.replace(self._question, by=tuple(numbers)), numbers)
            values, slopes = (np.asarray(of[""])[:, self._order] for of in (solved.values, solved.slopes))
            point = FitPoint(np.array(x, float), values, slopes, words(int(solved.ending["code"])))
            # The search cannot use readings without derivatives.
            self._seen[key] = point = point if point.reached else point._replace(values=np.full_like(values, np.nan))
            if self._progress is not None:
                self._progress(point)
        return self._seen[key]
