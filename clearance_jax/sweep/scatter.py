"""Distributions of numbers that scatter, also by mean, deviation and bounds, and samples for sensitivity indices."""

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import scipy.stats
from jaxtyping import Float
from scipy.stats import qmc

from clearance_jax.errors import ClearanceError, quote


def normal(mean: float, deviation: float, lower: float | None = None, upper: float | None = None) -> Any:
    """A normal distribution, truncated at the bounds if they are given."""
    _check_deviation(mean, deviation)
    if lower is None and upper is None:
        return scipy.stats.norm(mean, deviation)
    ends = -math.inf if lower is None else lower, math.inf if upper is None else upper
    _check_bounds(*ends)
    low, high = ((end - mean) / deviation for end in ends)
    return scipy.stats.truncnorm(low, high, loc=mean, scale=deviation)


def log_normal(mean: float, deviation: float) -> Any:
    """A log-normal distribution, by the mean and the standard deviation of the number itself."""
    _check_deviation(mean, deviation)
    if mean <= 0:
        raise ClearanceError(f"The mean of a log-normal scatter must be above zero, but it is {mean:g}.")
    wide = math.log1p((deviation / mean) ** 2)
    return scipy.stats.lognorm(math.sqrt(wide), scale=mean * math.exp(-0.5 * wide))


def uniform(lower: float, upper: float) -> Any:
    """A uniform distribution between two bounds."""
    _check_bounds(lower, upper)
    return scipy.stats.uniform(lower, upper - lower)


DISTRIBUTIONS: Mapping[str, Callable[..., Any]] = {"normal": normal, "log-normal": log_normal, "uniform": uniform}
"""Distributions by their names in a study."""


def scatter(
    mean: float | None = None,
    deviation: float | None = None,
    lower: float | None = None,
    upper: float | None = None,
    distribution: str = "normal",
) -> Any:
    """How a number scatters: a frozen distribution of `scipy.stats`. You may use any other of those in its place.

    **Arguments:**

    - `mean`, `deviation`: mean and standard deviation [SI]; for parts that are sorted, those before sorting.
    - `lower`, `upper`: bounds of parts that were measured and sorted [SI]: no value lies outside. `None`: no bound.
    - `distribution`: "normal"; "log-normal", for numbers that scatter widely and are never negative, such as wear
      coefficients; "uniform", from `lower` to `upper`.

    **Raises:** `ClearanceError` for numbers that make no distribution.
    """
    if distribution not in DISTRIBUTIONS:
        raise ClearanceError(f"`distribution` must be {', '.join(DISTRIBUTIONS)}, but it is {quote(distribution)}.")
    every = {"mean": mean, "deviation": deviation, "lower": lower, "upper": upper}
    given = {name: number for name, number in every.items() if number is not None}
    known = arguments_of(distribution)
    for name in given.keys() - known.keys():
        raise ClearanceError(f"A {distribution} scatter has no `{name}`: leave it out. It has {', '.join(known)}.")
    needed = [name for name, required in known.items() if required]
    if not given.keys() >= set(needed):
        raise ClearanceError(f"A {distribution} scatter needs `{'` and `'.join(needed)}`.")
    return DISTRIBUTIONS[distribution](**given)


def arguments_of(distribution: str) -> dict[str, bool]:
    """The arguments of a distribution, and whether each is required."""
    taken = inspect.signature(DISTRIBUTIONS[distribution]).parameters.values()
    return {argument.name: argument.default is argument.empty for argument in taken}


def check_scatter(name: str, given: Any) -> None:
    """Raise `ClearanceError` if `given`, for the number `name`, is not a frozen distribution of finite numbers."""
    if not callable(getattr(given, "ppf", None)):
        raise ClearanceError(
            f"`{name}` must scatter by `cj.scatter(...)` or by a frozen distribution of `scipy.stats`, not by "
            f"{quote(given)}."
        )
    if not np.all(np.isfinite(given.ppf(np.array([0.1, 0.9])))):
        raise ClearanceError(f"The distribution by which `{name}` is to scatter has no finite numbers.")


def in_words(given: Any) -> list[Any]:
    """The name and numbers of a distribution, for the attributes of a dataset."""
    dist = getattr(given, "dist", None)
    if dist is None:  # a distribution of scipy's new infrastructure
        return [repr(given)]
    return [dist.name, *map(float, given.args), *(f"{key}={float(value)!r}" for key, value in given.kwds.items())]


def _check_deviation(mean: float, deviation: float) -> None:
    if not (math.isfinite(mean) and 0 < deviation < math.inf):
        raise ClearanceError(f"`deviation` must be greater than zero and finite, but it is {deviation:g}.")


def _check_bounds(lower: float, upper: float) -> None:
    if not lower < upper:
        raise ClearanceError(f"`lower` must be below `upper`, but they are {lower:g} and {upper:g}.")


def sobol_samples(scatter: Mapping[str, Any], count: int, seed: int = 0) -> dict[str, Float[np.ndarray, " lanes"]]:
    """Samples from which `sobol_indices` can compute the indices: count (d + 2) lanes of d numbers.

    **Arguments:**

    - `scatter`: dotted name -> `cj.scatter(...)` or a frozen distribution of `scipy.stats`. The numbers scatter
      independently.
    - `count`: a power of two; `seed`: of the scrambled Sobol sequence.

    **Returns:** the values by name, shape (lanes,), for `cj.Zipped`.

    **Raises:** `ClearanceError` if `count` is not a power of two, or if nothing scatters.
    """
    if count < 2 or count & (count - 1):
        raise ClearanceError(f"`count` must be a power of two, for Sobol's sequence, but it is {count}.")
    if not scatter:
        raise ClearanceError("There is nothing to scatter: give at least one number by its name.")
    for name, law in scatter.items():
        check_scatter(name, law)
    width = len(scatter)
    unit = qmc.Sobol(2 * width, rng=np.random.default_rng(seed)).random(count)
    # A quantile of 0 would be minus infinity.
    unit = np.clip(unit, 2.0**-53, 1 - 2.0**-53)
    halves = unit[:, :width], unit[:, width:]
    ours, others = (
        np.stack([law.ppf(x) for law, x in zip(scatter.values(), half.T, strict=True)], 1) for half in halves
    )
    mixed = [np.where(np.arange(width) == i, others, ours) for i in range(width)]
    every = np.concatenate([ours, others, *mixed])
    return {name: every[:, i] for i, name in enumerate(scatter)}
