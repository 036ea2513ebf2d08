"""What a design must stand: every condition, with parts as they come out of manufacture."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.design.manufacture import Band, Yield
from clearance_jax.design.specification import Specification


class Scenario(NamedTuple):
    """One simulation that a design must stand: the title of its condition, values by name, factors on the variables;
    of a part as it was made `designed`: the values as they were designed (`None`: it is the design itself).
    """

    title: str
    values: Mapping[str, jax.Array]
    factors: np.ndarray
    designed: Mapping[str, jax.Array] | None = None


def scenarios_of(specification: Specification, fresh: int = 0, seed: int | None = None) -> list[Scenario]:
    """What a design is simulated in, condition by condition; of a `Yield` its samples, or so many fresh ones."""
    names, found = tuple(specification.variables), []
    for condition, values in specification.conditions.items():
        given = {name: jnp.asarray(value, float) for name, value in values.items()}
        where = specification.suffix(condition)
        if isinstance(specification.manufacture, Yield):
            draws = specification.manufacture.draws(names, fresh, seed)
            others = {n: _worth(specification, values, n) * f for n, f in draws.items() if n not in names}
            for i in range(fresh or specification.manufacture.samples):
                moved = {n: jnp.asarray(f[i], float) for n, f in others.items()}
                row = np.array([draws[n][i] for n in names])
                found.append(Scenario(f"{where}, sample {i + 1}", {**given, **moved}, row, given))
        elif isinstance(specification.manufacture, Band):
            for row in specification.manufacture.factors(len(names)):
                shares = " ".join(f"{f:g}" for f in row)
                found.append(Scenario(f"{where}, clearances times {shares}", given, row, given))
        else:
            found.append(Scenario(where, given, np.ones(len(names))))
    return found


def _worth(specification: Specification, values: Mapping, name: str) -> np.ndarray:
    """A number as a condition has it."""
    return np.asarray(values[name] if name in values else specification.worth(name), float)
