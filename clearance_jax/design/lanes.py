"""Simulations of designs as the lanes of a sweep: on every core, or on the workers of a cluster."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.analysis.measure import AbstractMetric
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import values_of
from clearance_jax.solve.settings import Settings
from clearance_jax.sweep.axes import Dimension, Zipped
from clearance_jax.sweep.cluster import client_of
from clearance_jax.sweep.gather import gathered
from clearance_jax.sweep.question import Question, ask


class Place(NamedTuple):
    """Where lanes are solved: here, or by a dask `client`; on so many `cores` (`None`: all here, one a worker)."""

    client: Any = None
    cores: int | None = None


HERE = Place()


@contextmanager
def place_of(cluster: Any, cores: int | None = None) -> Iterator[Place]:
    """The place that is meant by a cluster: a dask client, the address of a scheduler, or "local"; `None`: here."""
    if cluster is None:
        yield Place(None, cores)
        return
    with client_of(cluster, cores or 1) as client:
        yield Place(client, cores)


class Lanes:
    """Metrics of a mechanism to `t1` [s], and their derivatives by the numbers `wrt`, over any numbers by name."""

    def __init__(
        self,
        mechanism: Mechanism,
        metrics: Sequence[AbstractMetric],
        t1: float,
        solve: Settings,
        wrt: Sequence[str] = (),
    ):
        self.mechanism, self.t1, self.wrt = mechanism, t1, tuple(wrt)
        self.metrics = {f"metric_{i}": metric for i, metric in enumerate(metrics)}
        self.options = {name: value for name, value in solve._asdict().items() if name != "save_at"}
        self._asked: dict[tuple[str, ...], Question] = {}

    def solved(self, numbers: Mapping[str, np.ndarray], place: Place) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Of `numbers` by name, shape (lanes,) each, the metrics' values (lanes, ...) and slopes (lanes, ..., wrt),
        none without `wrt`; not a number where a motion has no end.
        """
        columns = {name: np.asarray(values, float) for name, values in numbers.items()}
        count = len(next(iter(columns.values())))
        question = self._question(tuple(columns))
        # Numbers out of their bounds are no mistake here: such a part was made, and its lane says that it fails.
        question = dataclasses.replace(question, dims=(Dimension("scenario", count, columns, {}, {}),))
        if place.client is None:
            found = question.answer(np.arange(count), place.cores)
        else:
            found = gathered(place.client, question, place.cores or 1)
        slopes = [found[f"{name}_derivative"] for name in self.metrics] if self.wrt else []
        return [found[name] for name in self.metrics], slopes

    def _question(self, names: tuple[str, ...]) -> Question:
        """What is asked of each lane, checked with the mechanism's own numbers."""
        if names not in self._asked:
            own = {name: np.asarray(value)[None] for name, value in values_of(self.mechanism, names).items()}
            axes = {"scenario": Zipped(own)}
            self._asked[names] = ask(self.mechanism, axes, self.metrics, self.t1, self.wrt, options=self.options)
        return self._asked[names]
