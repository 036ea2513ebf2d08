"""Samples for global sensitivity indices (`results.sobol`), by Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from clearance_jax.errors import ClearanceError
from clearance_jax.sweep.scatter import check_scatter


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
    ours, others = (
        np.stack([law.ppf(half[:, i]) for i, law in enumerate(scatter.values())], axis=1)
        for half in (unit[:, :width], unit[:, width:])
    )
    mixed = [np.where(np.arange(width) == i, others, ours) for i in range(width)]
    every = np.concatenate([ours, others, *mixed])
    return {name: every[:, i] for i, name in enumerate(scatter)}
