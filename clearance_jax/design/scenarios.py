"""The scenarios of a design: every condition with every part of the model of manufacture."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.design.specification import Specification


class Scenario(NamedTuple):
    """One simulation of a design: its `title`, `values` of numbers by name, `factors` (n,) on the variables; for a part
    as made, `designed` are the values as designed (`None`: it is the design itself).
    """

    title: str
    values: Mapping[str, jax.Array]
    factors: np.ndarray
    designed: Mapping[str, jax.Array] | None = None


def scenarios_of(specification: Specification, fresh: int = 0, seed: int | None = None) -> list[Scenario]:
    """The scenarios of a problem, condition by condition; `fresh` > 0: with so many new samples, by `seed`."""
    names, manufacture, scenarios = tuple(specification.variables), specification.manufacture, []
    parts = manufacture.parts(names, fresh, seed)
    for condition, values in specification.conditions.items():
        given = {name: jnp.asarray(value, float) for name, value in values.items()}
        worth = {n: np.asarray(specification.worth(n, values)) for n in manufacture.scattered if n not in names}
        for part in parts:
            moved = {n: jnp.asarray(worth[n] * factor, float) for n, factor in part.others.items()}
            moved |= {n: jnp.asarray(value, float) for n, value in part.values.items()}
            title = specification.suffix(condition) + part.title
            designed = None if part.is_design else given
            scenarios.append(Scenario(title, {**given, **moved}, part.factors, designed))
    return scenarios
