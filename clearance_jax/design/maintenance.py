"""Maintenance intervals: the cycles for which limits hold while a joint wears, as a function of the clearances."""

from typing import NamedTuple

import numpy as np

from clearance_jax.design.answer import Design
from clearance_jax.design.evaluate import Simulations
from clearance_jax.design.specification import Limit, Scenario, scenarios_of
from clearance_jax.design.worn import without_wear
from clearance_jax.wear import AbstractAged

# Clearances are chosen to last about so many times the cycles asked for, if wear is even; lives are simulated up to the
# last factor.
TIMES, LONGEST = (0.5, 1.0, 2.0, 4.0, 7.0), 20
# Shares of the designed clearances if an error does not grow with them.
SHARES = np.array([0.5, 0.7, 0.85, 1.0, 1.2])


class Maintenance(NamedTuple):
    """After how many cycles a `limit` (its label) is met, as a function of the clearances.

    - `shares` (n,): factors on all designed clearances; `lives` (n,), by condition (with one condition only, under an
      empty name): cycles until the limit is met, infinite if more than `most`.
    - `asked`: the number of cycles for which the limit must hold.
    """

    limit: str
    asked: int
    most: int
    shares: np.ndarray
    lives: dict[str, np.ndarray]


def maintenances(design: Design) -> tuple[Maintenance, ...]:
    """For each limit that must hold while a joint wears, after how many cycles it is met, for parts as designed.

    **Arguments:** `design`: the answer of a problem.

    **Raises:** `ClearanceError` if a life cannot be computed.
    """
    limits = [(limit, limit.metric) for limit in design.specification.limits]
    return tuple(_of(design, limit, metric) for limit, metric in limits if isinstance(metric, AbstractAged))


def _of(design: Design, limit: Limit, metric: AbstractAged) -> Maintenance:
    parts = design.specification.nominal()
    asked, shares, lives = max(metric.cycles[-1], 1), _shares(design, limit), {}
    for condition, given in parts.conditions.items():
        columns = {name: shares * value for name, value in design.clearances.items()}
        of_wear = given.keys() - without_wear(parts.mechanism, [metric], given).keys()
        columns |= {name: np.full(len(shares), float(given[name])) for name in of_wear}
        now = parts.move(parts.mechanism, given)
        life = metric.lives(now, columns, parts.t1, limit.bound, LONGEST * asked, **parts.options)
        lives[parts.label(condition)] = life.end
    return Maintenance(limit.label, asked, LONGEST * asked, shares, lives)


def _shares(design: Design, limit: Limit) -> np.ndarray:
    """The shares of the designed clearances at which lives are simulated, by the room that limits leave for wear."""
    parts, x = design.specification.nominal(), design.specification.values(design.evaluation.x)
    names, metrics = tuple(parts.variables), [limit.metric.base_metric]
    simulations = Simulations(parts.mechanism, metrics, [limit.bound], names, parts.t1, parts.settings())

    def margin(scenario: Scenario) -> float:
        """The share by which clearances can grow until the limit of the new mechanism is met."""
        # Numbers of wear do not affect a new part.
        new = scenario._replace(values=without_wear(parts.mechanism, [limit.metric], scenario.values))
        values, slopes = simulations.limits(x, new, True)
        assert slopes is not None
        k = int(np.argmax(values))
        grows = float(slopes[k] @ x)
        return -float(values[k]) / grows if grows > 0 else np.nan

    room = min(map(margin, scenarios_of(parts)))
    shares = 1 + room * (1 - np.array(TIMES))
    return np.sort(shares[shares > 0.1]) if room > 0 else SHARES
