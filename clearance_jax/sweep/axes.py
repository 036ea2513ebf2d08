"""The axes of a sweep: the numbers or models at each place along each dimension of the answer."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import scipy.special
from jaxtyping import Float
from scipy.stats import qmc

from clearance_jax.ask.question import OPTIONS
from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import check_bounds, find, parameters
from clearance_jax.sweep.scatter import check_scatter, in_words

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
        shares = _points(self.method, len(self.scatter), self.count, self.seed)
        if self.correlation:
            # Normal scores, correlated by the Cholesky factor.
            shares = scipy.special.ndtr(scipy.special.ndtri(shares) @ self._root(self.correlation).T)
        return {name: law.ppf(shares[:, i]) for i, (name, law) in enumerate(self.scatter.items())}

    def _root(self, correlation: Mapping[tuple[str, str], float]) -> np.ndarray:
        places, matrix = {name: i for i, name in enumerate(self.scatter)}, np.eye(len(self.scatter))
        for pair, value in correlation.items():
            for name in pair:
                if name not in places:
                    raise ClearanceError(f"`correlation`: `{name}` does not scatter. {suggest(str(name), places)}")
            i, k = (places[name] for name in pair)
            if i == k:
                raise ClearanceError(f"`correlation` is between two numbers, but {quote(pair)} is one twice.")
            matrix[i, k] = matrix[k, i] = value
        try:
            return np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            raise ClearanceError("`correlation` contradicts itself: its matrix must be positive definite.") from None


def _points(method: str, width: int, count: int, seed: int) -> Float[np.ndarray, "count width"]:
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
        raise ClearanceError(f"The axis `{name}` must be numbers, but it is {quote(given)}.") from None
    if values.ndim != 1:
        raise ClearanceError(f"The axis `{name}` must be a list of numbers, but it has the shape {values.shape}.")
    if values.size == 0:
        raise ClearanceError(f"The axis `{name}` is empty. Give it at least one value.")
    if not np.all(np.isfinite(values)):
        raise ClearanceError(f"The values of the axis `{name}` must be finite.")
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
                raise ClearanceError(f"The axis `{dimension.name}`: {error}") from None
            units[name] = leaf.unit
            for bad in (values.min(), values.max()):
                check_bounds(bad, leaf.metadata, f"`{name}`", units[name])
    return units
