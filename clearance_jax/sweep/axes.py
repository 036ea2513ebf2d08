"""The axes of a sweep: the numbers or models at each place along each dimension of the answer; numbers that scatter."""

import inspect
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy.special
import scipy.stats
from jaxtyping import Float
from scipy.stats import qmc

from clearance_jax.ask.question import OPTIONS
from clearance_jax.errors import ClearanceError, quote, unknown_name, wrong_value
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import check_bounds, find, parameters

METHODS = ("sobol", "latin-hypercube", "random")


class Zipped(NamedTuple):
    """An axis along which several numbers change together.

    **Arguments:** `values`: name -> values [SI], all of the same shape (n,).
    """

    values: Mapping[str, Any]


class Choice(NamedTuple):
    """An axis over models, each of which compiles a program.

    **Arguments:** `models`: label -> a mechanism, or a function that makes one from the sweep's mechanism (with another
    law or drive, for example).
    """

    models: Mapping[str, Mechanism | Callable[[Mechanism], Mechanism]]


class Sampled(NamedTuple):
    """An axis of random samples of numbers that scatter.

    - `scatter`: name -> how the number scatters: `cj.scatter(...)`, or a frozen distribution of `scipy.stats`.
    - `count`: how many samples.
    - `method`: "sobol" (scrambled; a longer sequence begins with the shorter one), "latin-hypercube" or "random".
    - `seed`: of the scrambling or the random generator; it is recorded.
    - `correlation`: (name, name) -> correlation of the two numbers' normal scores (a Gaussian copula). For normal
      numbers it is the correlation of the numbers themselves.
    """

    scatter: Mapping[str, Any]
    count: int
    method: Literal["sobol", "latin-hypercube", "random"] = "sobol"
    seed: int = 0
    correlation: Mapping[tuple[str, str], float] | None = None

    def draw(self) -> dict[str, Float[np.ndarray, " count"]]:
        """Draw the numbers, by name. **Raises** `ClearanceError` for arguments that nothing can be drawn from."""
        for name, distribution in self.scatter.items():
            check_scatter(name, distribution)
        if not self.scatter or isinstance(self.count, bool) or not isinstance(self.count, int) or self.count < 1:
            raise ClearanceError("`Sampled` wants numbers that scatter, and a count of at least 1.")
        shares = sample_points(self.method, len(self.scatter), self.count, self.seed)
        if self.correlation:
            # Normal scores, correlated by the Cholesky factor.
            shares = scipy.special.ndtr(scipy.special.ndtri(shares) @ self._root(self.correlation).T)
        return {name: law.ppf(shares[:, i]) for i, (name, law) in enumerate(self.scatter.items())}

    def _root(self, correlation: Mapping[tuple[str, str], float]) -> np.ndarray:
        places, matrix = {name: i for i, name in enumerate(self.scatter)}, np.eye(len(self.scatter))
        for pair, value in correlation.items():
            for name in pair:
                if name not in places:
                    raise unknown_name(f"`correlation`: `{name}` does not scatter.", str(name), places)
            i, k = (places[name] for name in pair)
            if i == k:
                raise ClearanceError(f"`correlation` is between two numbers, but {quote(pair)} is one twice.")
            matrix[i, k] = matrix[k, i] = value
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            raise ClearanceError("`correlation` contradicts itself: its matrix must be positive definite.") from None


def sample_points(method: str, width: int, count: int, seed: int) -> Float[np.ndarray, "count width"]:
    """Points of the unit cube by one of the `METHODS`, none of them at its edges."""
    if method == "sobol":
        # Draw a power of two and take the first points: a longer sequence begins with a shorter one.
        points = qmc.Sobol(width, rng=seed).random_base2(max(0, math.ceil(math.log2(count))))[:count]
    elif method == "latin-hypercube":
        points = qmc.LatinHypercube(width, rng=seed).random(count)
    elif method == "random":
        points = np.random.default_rng(seed).random((count, width))
    else:
        raise ClearanceError(f"There is no method {method!r} to sample by. Allowed: {', '.join(METHODS)}.")
    # A quantile of 0 would be minus infinity.
    return np.clip(points, 2.0**-53, 1 - 2.0**-53)


# Read ----------------------------------------------------------------------------------------------------------------


class Dimension(NamedTuple):
    """One dimension of a sweep: `name`, `size`, and at each place numbers by name (`columns`) or a model by its label
    (`models`); `sampling`: how it was drawn, for the attributes.
    """

    name: str
    size: int
    columns: dict[str, Float[np.ndarray, " size"]]
    models: dict[str, Any]
    sampling: dict[str, Any]


def dimensions(axes: Mapping[str, Any]) -> tuple[Dimension, ...]:
    """Read the axes of a sweep. **Raises** `ClearanceError` for an axis that is wrong or empty."""
    if not isinstance(axes, Mapping) or not axes:
        raise ClearanceError('`axes` must be values by name, such as `{"wrist.radial_clearance": [1e-4, 2e-4]}`.')
    dims = tuple(_dimension(str(name), given) for name, given in axes.items())
    for first, other in itertools.combinations(dims, 2):
        for name in (name for name in other.columns if name in first.columns):
            raise ClearanceError(f"`{name}` is varied by the axes `{first.name}` and `{other.name}`. Take one.")
    return dims


def _dimension(name: str, given: Any) -> Dimension:
    if isinstance(given, Choice):
        if not isinstance(given.models, Mapping) or not given.models:
            raise ClearanceError(f"The axis `{name}` must have models by labels, but it has none.")
        models = {str(label): model for label, model in given.models.items()}
        return Dimension(name, len(models), {}, models, {})
    if isinstance(given, Sampled):
        columns, sampling = given.draw(), {"method": given.method, "seed": int(given.seed)}
        sampling["scatter"] = {name: in_words(law) for name, law in given.scatter.items()}
        sampling["correlation"] = {" ".join(pair): float(value) for pair, value in (given.correlation or {}).items()}
        return Dimension(name, given.count, columns, {}, sampling)
    columns = {str(k): _values(k, v) for k, v in (given.values if isinstance(given, Zipped) else {name: given}).items()}
    sizes = {k: len(v) for k, v in columns.items()}
    if not sizes or len(set(sizes.values())) != 1:
        raise ClearanceError(f"The columns of `{name}` must have one length, but they have {quote(sizes)}.")
    return Dimension(name, min(sizes.values()), columns, {}, {})


def _values(name: str, given: Any) -> np.ndarray:
    try:
        values = np.array(given, float)
    except (TypeError, ValueError):
        raise wrong_value(f"The axis `{name}`", "numbers", given) from None
    if values.ndim != 1:
        raise ClearanceError(f"The axis `{name}` must be a list of numbers, but it has the shape {values.shape}.")
    if values.size == 0:
        raise ClearanceError(f"The axis `{name}` is empty. Give it at least one value.")
    if not np.all(np.isfinite(values)):
        raise ClearanceError(f"The values of the axis `{name}` must be finite.").about(name, allowed="finite")
    return values


def models_of(mechanism: Mechanism, dims: Sequence[Dimension]) -> list[Mechanism]:
    """The model at every combination of labels, in C order of the dimensions; without labels the sweep's own."""
    models = [mechanism]
    for dimension in dims:
        if dimension.models:
            models = [_model(model, given, dimension, k) for model in models for k, given in dimension.models.items()]
    return models


def _model(mechanism: Mechanism, given: Any, dimension: Dimension, label: str) -> Mechanism:
    made = given if isinstance(given, Mechanism) else given(mechanism) if callable(given) else None
    if not isinstance(made, Mechanism):
        raise ClearanceError(
            f"`{label}` of the axis `{dimension.name}` must be a mechanism, or a function from one to another, but it "
            f"is {quote(given)}."
        )
    return made


def units_of_columns(model: Mechanism, dims: Sequence[Dimension]) -> dict[str, str]:
    """The SI units of all columns. **Raises** `ClearanceError` for values that the model does not allow."""
    known, units = parameters(model), {}
    for dimension in dims:
        for name, values in dimension.columns.items():
            if name in OPTIONS:
                units[name] = OPTIONS[name]
                continue
            try:
                leaf, _ = find(known, name)
            except ClearanceError as error:
                raise error.at(f"The axis `{dimension.name}`") from None
            units[name] = leaf.unit
            for bad in (values.min(), values.max()):
                check_bounds(bad, leaf.metadata, f"`{name}`", units[name])
    return units


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
        raise wrong_value("The mean of a log-normal scatter", "above zero", mean, shown=f"{mean:g}")
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
        raise wrong_value("`distribution`", ", ".join(DISTRIBUTIONS), distribution)
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
        ).about(name, given)
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
        raise wrong_value("`deviation`", "greater than zero and finite", deviation, shown=f"{deviation:g}")


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
        raise wrong_value("`count`", "a power of two, for Sobol's sequence", count, str(count))
    if not scatter:
        raise ClearanceError("There is nothing to scatter: give at least one number by its name.")
    for name, law in scatter.items():
        check_scatter(name, law)
    width = len(scatter)
    unit = sample_points("sobol", 2 * width, count, seed)
    laws, halves = scatter.values(), (unit[:, :width], unit[:, width:])
    ours, others = (np.stack([law.ppf(x) for law, x in zip(laws, half.T, strict=True)], 1) for half in halves)
    mixed = [np.where(np.arange(width) == i, others, ours) for i in range(width)]
    every = np.concatenate([ours, others, *mixed])
    return {name: every[:, i] for i, name in enumerate(scatter)}
