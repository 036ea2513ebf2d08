"""Sobol's global sensitivity indices of a sweep's results, and local derivatives beside them.

The first-order index of a number is the part of the result's variance that vanishes when this number is known. The
total index is the part that remains when all others are known. They differ by interactions with other numbers. See
Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018. The estimates are scipy's (`scipy.stats.sobol_indices`).
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy import stats

from clearance_jax.errors import ClearanceError

# Bootstrap samples of a confidence interval.
DRAWN = 500
Numbers = Float[np.ndarray, " numbers"]
Interval = Float[np.ndarray, "2 numbers"]


class Indices(NamedTuple):
    """Global sensitivity indices of one result, for every number that was varied.

    - `names`; `first`, `total`: the indices, between 0 and 1 up to their error; `first_interval`, `total_interval`: of
      95 % confidence, low and high, by bootstrap.
    - `deviation`: standard deviations of the numbers, `mean` and `variance` of the result, over all lanes.
    - `failed`: lanes that failed.
    """

    names: tuple[str, ...]
    first: Numbers
    total: Numbers
    first_interval: Interval
    total_interval: Interval
    deviation: Numbers
    mean: float
    variance: float
    failed: int

    def linear(self, derivatives: Mapping[str, Any]) -> Numbers:
        """First-order indices of a result linear by `derivatives` (SI): (derivative x deviation)^2 / variance."""
        missing = [name for name in self.names if name not in derivatives]
        if missing:
            raise ClearanceError(f"There is no derivative by `{missing[0]}`.")
        slopes = np.array([float(derivatives[name]) for name in self.names])
        return (slopes * self.deviation) ** 2 / self.variance


def sobol_indices(dataset: xr.Dataset, name: str, seed: int = 0) -> Indices:
    """The sensitivity indices of a result (Sobol indices), with confidence intervals.

    **Arguments:** `dataset`: of a sweep over the samples of `sobol_samples`, along one dimension, with the numbers as
    coordinates; `name`: of the result; `seed`: of the random replacements: if a lane of a sample failed, another sample
    takes its place.

    **Raises:** `ClearanceError` for other lanes, and if no sample is complete.
    """
    values, numbers = dataset[name], _design(dataset[name])
    if numbers is None:
        raise ClearanceError(f"The samples of `{name}` are not those of `sobol_samples`: there are no indices of them.")
    count, blocks = len(numbers), np.stack(list(numbers.values()), -1)
    samples = values.size // (count + 2)
    outcomes = values.values.astype(float).reshape(count + 2, samples)
    whole = np.flatnonzero(np.all(np.isfinite(outcomes), axis=0))
    if not whole.size:
        raise ClearanceError(f"In each draw of `{name}` a motion failed: there are no indices of it.")
    rng = np.random.default_rng(seed)
    kept = np.where(np.isin(np.arange(samples), whole), np.arange(samples), rng.choice(whole, samples))
    used = outcomes[:, kept]
    drawn = [_estimate(used[:, rng.integers(0, samples, samples)]) for _ in range(DRAWN)]
    of_first, of_total = np.percentile(drawn, [2.5, 97.5], axis=0).swapaxes(0, 1)
    failed, deviation = int(np.sum(~np.isfinite(outcomes))), blocks[: 2 * samples].std(axis=0)
    (first, total), mean, variance = _estimate(used), float(used[:2].mean()), float(used[:2].var())
    return Indices(tuple(numbers), first, total, of_first, of_total, deviation, mean, variance, failed)


def is_sobol(values: xr.DataArray) -> bool:
    """Whether the lanes of a result are those of `sobol_samples`."""
    return _design(values) is not None


def middle_derivatives(dataset: xr.Dataset, name: str) -> dict[str, float] | None:
    """The derivatives of a result by all numbers that scatter (`sweep`'s, with `wrt`), in the lane nearest to the
    middle of them in units of their deviations; `None` where they were not asked for.
    """
    slopes, numbers = dataset.get(f"{name}_derivative"), _numbers(dataset[name])
    if slopes is None or not set(numbers) <= set(map(str, slopes["parameter"].values)):
        return None
    gradients = np.stack([slopes.sel(parameter=number).values for number in numbers], -1)
    every = np.stack(list(numbers.values()), -1)
    away = np.sum(((every - every.mean(axis=0)) / every.std(axis=0)) ** 2, axis=1)
    nearest = np.argmin(np.where(np.all(np.isfinite(gradients), axis=1), away, np.inf))
    return {number: float(slope) for number, slope in zip(numbers, gradients[nearest], strict=True)}


def _numbers(values: xr.DataArray) -> dict[str, np.ndarray]:
    """The numbers that vary over the lanes of a result, by name, shape (lanes,) each."""
    return {
        str(key): np.asarray(coordinate.values, float)
        for key, coordinate in values.coords.items()
        if coordinate.dims == values.dims and key not in values.dims and np.issubdtype(coordinate.dtype, np.floating)
    }


def _design(values: xr.DataArray) -> dict[str, np.ndarray] | None:
    """As `_numbers`, in the order of the draw, if the lanes are two samples, and the first one with each number from
    the second in turn; else `None`. (A store has its coordinates in an order of its own.)
    """
    numbers = _numbers(values)
    count = len(numbers)
    if values.ndim != 1 or not numbers or values.size % (count + 2):
        return None
    blocks, ordered = {name: column.reshape(count + 2, -1) for name, column in numbers.items()}, {}
    for i in range(count):
        from_first, from_second = (
            {name for name, column in blocks.items() if np.array_equal(column[2 + i], column[k])} for k in (0, 1)
        )
        moved = from_second - from_first
        if len(moved) != 1 or moved | from_first != set(numbers):
            return None
        ordered |= {name: numbers[name] for name in moved}
    return ordered if len(ordered) == count else None


def _estimate(used: np.ndarray) -> np.ndarray:
    """First-order and total indices, (2, numbers), of results (numbers + 2, samples)."""
    parts = {"f_A": used[:1], "f_B": used[1:2], "f_AB": used[2:, None]}
    indices: Any = stats.sobol_indices(func=parts, n=used.shape[1])
    return np.stack([np.atleast_1d(indices.first_order), np.atleast_1d(indices.total_order)])
