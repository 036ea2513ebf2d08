"""Lives of one joint for many values of numbers that a designer chooses, or that scatter from part to part."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np
import scipy.stats
import xarray as xr

from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.parameters import check_values, replace, units_of
from clearance_jax.runs.journal import refuse_in_words
from clearance_jax.solve.drivers.batch import cores_here
from clearance_jax.solve.settings import SolveOptions
from clearance_jax.sweep.axes import Sampled
from clearance_jax.units import format_quantity
from clearance_jax.wear.criteria import AbstractCriterion
from clearance_jax.wear.history import Profile, simulate_wear
from clearance_jax.wear.model import WearModel


class Failures(NamedTuple):
    """The probability that a joint has reached its bound (first passage) as a function of the number of cycles.

    - `cycles` (n,), `probability` (n,).
    - `low`, `high` (n,): between these it lies with a `confidence` (Clopper and Pearson 1934, at each number of
      cycles).
    """

    cycles: np.ndarray
    probability: np.ndarray
    low: np.ndarray
    high: np.ndarray
    confidence: float


class ServiceLives(NamedTuple):
    """The lives of a joint for many values of its numbers.

    - `values` by name, each (n,), with their `units`.
    - `end` (n,): the end of each life [cycles], infinite if the bound was not reached within `cycles`.
    - `evaluations`: how many cycles were computed in all.
    """

    values: Mapping[str, np.ndarray]
    end: np.ndarray
    cycles: int
    evaluations: int
    units: Mapping[str, str]

    def failures(self, confidence: float = 0.95) -> Failures:
        """The probability of failure over the life, if the values are samples of scattering numbers."""
        if not 0 < confidence < 1:
            raise wrong_value("`confidence`", "between 0 and 1", confidence, shown=str(confidence))
        n = len(self.end)
        ends = np.sort(self.end[np.isfinite(self.end)])
        failed = np.arange(len(ends) + 1)
        rest = 0.5 * (1 - confidence)
        low = scipy.stats.beta.ppf(rest, np.maximum(failed, 1), n - failed + 1)
        high = scipy.stats.beta.ppf(1 - rest, failed + 1, np.maximum(n - failed, 1))
        low, high = np.where(failed == 0, 0.0, low), np.where(failed == n, 1.0, high)
        return Failures(np.concatenate([[0.0], ends]), failed / n, low, high, confidence)

    def interval(self, failing: float) -> float:
        """The maintenance interval [cycles] after which at most a share `failing` of the samples has failed; infinite
        if fewer fail within `cycles`.
        """
        if not 0 <= failing < 1:
            raise wrong_value("The share that may fail", "at least 0 and below 1", failing, str(failing))
        ends = np.sort(self.end)
        return float(ends[int(np.floor(failing * len(ends) * (1 + 1e-12)))])

    def to_dataset(self) -> xr.Dataset:
        """The values and lives over the dimension `part`."""
        data: dict[str, Any] = {n: ("part", x, {"units": self.units[n]}) for n, x in self.values.items()}
        data["life"] = "part", self.end, {"units": "cycles", "long_name": "life"}
        return xr.Dataset(data, attrs={"cycles": self.cycles, "evaluations": self.evaluations})

    def __str__(self) -> str:
        ended = int(np.isfinite(self.end).sum())
        shortest = f", the first at cycle {self.end.min():.6g}" if ended else ""
        ranges = ", ".join(
            f"{name} " + " to ".join(format_quantity(float(bound), self.units[name]) for bound in (v.min(), v.max()))
            for name, v in self.values.items()
        )
        return f"{len(self.end)} lives over {ranges}: {ended} ended within {self.cycles} cycles{shortest}"


def service_lives(
    model: WearModel,
    cycles: int,
    values: Mapping[str, Any] | Sampled,
    *,
    until: AbstractCriterion | Callable[[Profile], float],
    sectors: int | None = None,
    tolerance: float = 1e-3,
    longest: int | None = None,
    journal: str | Path | None = None,
    cores: int | None = None,
    progress: Callable[[float], None] | None = None,
    **options: Unpack[SolveOptions],
) -> ServiceLives:
    """Simulate the wear of the joint of a model once for each of many values, side by side.

    **Arguments:**

    - `model`, `cycles`, `until`, `tolerance`, `longest` and the options: as of `simulate_wear`.
    - `values`: name -> numbers (n,), or a `Sampled`: numbers of the mechanism, the law ("wear.coefficient") and the
      pressure. Clearances give the maintenance interval against clearance. Numbers that scatter give the probability of
      failure over the life.
    - `sectors`: by default one number for all values, the largest that one of them needs.
    - `journal`: a folder that keeps every life while it is computed: an interrupted run goes on from there. You may
      have added values at the end.
    - `cores`: how many lives are computed at the same time; by default as many as there are cores.
    - `progress`: called with the fraction of the lives that is done.

    **Raises:** `ClearanceError` as `simulate_wear`, for unknown names, and for values of different lengths.
    """
    drawn = values.draw() if isinstance(values, Sampled) else values
    columns = {name: np.atleast_1d(np.asarray(column, float)) for name, column in drawn.items()}
    counts = {column.shape for column in columns.values()}
    if len(counts) != 1 or len(count := counts.pop()) != 1 or count[0] == 0:
        raise ClearanceError("`values` must be numbers by name, of each name as many, and at least one.")
    units = units_of(model, list(columns))
    rows = [replace(model, {name: float(column[i]) for name, column in columns.items()}) for i in range(*count)]
    for row in rows:
        check_values(row)
    if journal is not None:
        with refuse_in_words(f"`{journal}`"):
            Path(journal).mkdir(exist_ok=True)
    if sectors is None:
        sectors = max(row.sectors(dict(options)) for row in rows)

    how = {"sectors": sectors, "tolerance": tolerance, "longest": longest, "until": until, **options}

    def life(i: int):
        return simulate_wear(rows[i], cycles, journal=journal and Path(journal) / f"{i}.jsonl", **how)

    histories = []
    with ThreadPoolExecutor(cores or cores_here()) as pool:
        # The first compiles for all.
        for history in chain([life(0)], pool.map(life, range(1, *count))):
            histories.append(history)
            if progress is not None:
                progress(len(histories) / len(rows))
    end = np.array([np.inf if history.end is None else history.end for history in histories])
    return ServiceLives(columns, end, cycles, sum(history.evaluations for history in histories), units)
