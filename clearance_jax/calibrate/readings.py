"""Simulated readings of a motion and their derivatives, at values of the fitted numbers."""

import copy
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from clearance_jax.ask.lanes import answer
from clearance_jax.ask.question import Question
from clearance_jax.calibrate.measurement import Measurement
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric, Request
from clearance_jax.metrics.reductions import signal_at
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.solve.codes import words
from clearance_jax.solve.settings import Settings

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
    """The readings of a mechanism's motion at values of its numbers `names`. Each point is solved once and kept in
    `points`, also those of shorter motions; `progress` is called with each. `accuracy` is the relative error of
    readings.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        measurement: Measurement,
        names: Sequence[str],
        t1: float,
        settings: Settings,
        progress: Callable[[FitPoint], Any] | None = None,
    ):
        readings = [series.reading for series in measurement.series]
        quantities = tuple(reading for reading in readings if isinstance(reading, str))
        signals = tuple(reading for reading in readings if isinstance(reading, AbstractSignal))
        # The metric has quantities first.
        self._order = np.argsort(sorted(range(len(readings)), key=lambda i: not isinstance(readings[i], str)))
        self._question = Question(
            mechanism, {"": Readings(quantities, signals, measurement.times)}, t1, settings, names
        )
        self._names, self._progress = tuple(names), progress
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
            solved = answer(self._question, dict(zip(self._names, x, strict=True)))
            values = np.asarray(solved.values[""])[:, self._order]
            slopes = np.asarray(solved.slopes[""])[:, self._order]
            point = FitPoint(np.array(x, float), values, slopes, words(int(solved.ending["code"])))
            # The search cannot use readings without derivatives.
            self._seen[key] = point = point if point.reached else point._replace(values=np.full_like(values, np.nan))
            if self._progress is not None:
                self._progress(point)
        return self._seen[key]
