"""Designs as simulations: what a design must stand, solved one by one with derivatives, or as lanes without."""

import itertools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.measure import AbstractMetric, measured
from clearance_jax.design.manufacture import Yield, YieldEstimate, estimate_yield
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.design.specification import Specification
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.batch import batch
from clearance_jax.solve.settings import Settings

# More scenarios than this are solved as lanes, without derivatives.
FEW_SCENARIOS = 250
# Variables up to which derivatives come along with every evaluation.
FEW = 5


class Simulations:
    """Metrics of a mechanism whose numbers `names` are a design's; limits are (value / bound - 1).

    **Arguments:** `metrics` with their `bounds`; `t1` [s]; `solve`: how.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        metrics: Sequence[AbstractMetric],
        bounds: Sequence[float],
        names: Sequence[str],
        t1: float,
        solve: Settings,
    ):
        self.metrics, self.bounds, self.names = tuple(metrics), tuple(bounds), tuple(names)
        self.mechanism, self.t1, self.solve = mechanism, t1, solve

    def sizes(self) -> list[int]:
        """How many numbers each metric is."""

        def size(metric):
            out = jax.eval_shape(
                lambda t1: measured(self.mechanism, {"": metric}, t1, self.solve)[""], jnp.asarray(self.t1)
            )
            return int(np.prod(out.shape))

        return [size(metric) for metric in self.metrics]

    def limits(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Scaled limits (m,) of a design (n,) in a scenario, and their derivatives (m, n)."""
        call = _slopes if gradient else _values
        values, slopes = call(*self._asked(x * scenario.factors, scenario.values))
        bounds = np.concatenate([np.full(np.size(v), bound) for v, bound in zip(values, self.bounds, strict=True)])
        limits = np.concatenate([np.ravel(v) for v in values]) / bounds - 1
        if not gradient:
            return limits, None
        rows = np.concatenate([np.reshape(s, (-1, len(x))) for s in slopes])
        return limits, rows * scenario.factors / bounds[:, None]

    def worst(self, x: np.ndarray, scenarios: Sequence[Scenario], exact: bool = False) -> np.ndarray:
        """The most violated scaled limit of a design in each scenario, shape (scenarios,); infinite where there is no
        motion to the end. Many are solved as lanes, on every core, few one by one, with derivatives (`exact`) if that
        program is compiled. Scenarios of one condition must follow each other.
        """
        if len(scenarios) <= FEW_SCENARIOS:
            found = np.array([self.limits(x, scenario, exact)[0].max() for scenario in scenarios])
            return np.where(np.isfinite(found), found, np.inf)
        # Conditions apart: they may set different names.
        parts = [list(part) for _, part in itertools.groupby(scenarios, lambda one: one.values.keys())]
        return np.concatenate([self._worst_of_lanes(x, part) for part in parts])

    def _worst_of_lanes(self, x: np.ndarray, scenarios: list[Scenario]) -> np.ndarray:
        """`worst` of scenarios that set the same names."""
        points = x * np.stack([s.factors for s in scenarios])
        given = {name: np.stack([s.values[name] for s in scenarios]) for name in scenarios[0].values}
        lane = jax.tree_util.Partial(_lane, self.mechanism, self.metrics, self.names, jnp.asarray(self.t1), self.solve)
        values = batch(lane, (points, given))
        scaled = [v.reshape(len(scenarios), -1) / bound - 1 for v, bound in zip(values, self.bounds, strict=True)]
        found = np.concatenate(scaled, axis=1).max(axis=1)
        return np.where(np.isfinite(found), found, np.inf)

    def _asked(self, x, given) -> tuple:
        return self.mechanism, self.metrics, self.names, jnp.asarray(x), dict(given), jnp.asarray(self.t1), self.solve


def _measured(mechanism, metrics, names, x, given, t1, solve):
    moved = replace(mechanism, {**given, **dict(zip(names, x, strict=True))})
    # One solve for all of them.
    return list(measured(moved, {str(i): metric for i, metric in enumerate(metrics)}, t1, solve).values())


@eqx.filter_jit
def _values(*asked):
    return _measured(*asked), []


@eqx.filter_jit
def _slopes(mechanism, metrics, names, x, given, t1, solve):
    def of(x):
        out = _measured(mechanism, metrics, names, x, given, t1, solve)
        return out, out

    slopes, out = jax.jacfwd(of, has_aux=True)(x)
    return out, slopes


def _lane(mechanism, metrics, names, t1, solve, lane):
    x, given = lane
    return _measured(mechanism, metrics, names, x, given, t1, solve)


def simulations_of(specification: Specification, rtol: float | None = None, solver: str | None = None) -> Simulations:
    """What designs are simulated by, to the given accuracy."""
    changes = {name: given for name, given in (("rtol", rtol), ("solver", solver)) if given is not None}
    metrics = [limit.simulation_metric for limit in specification.limits]
    bounds = [limit.bound for limit in specification.limits]
    return Simulations(
        specification.mechanism,
        metrics,
        bounds,
        tuple(specification.variables),
        specification.t1,
        specification.settings(**changes),
    )


def yield_of(
    specification: Specification, x: np.ndarray, sampled: Sequence[Scenario], exact: bool = False
) -> YieldEstimate:
    """In how many scenarios, as many of each condition, a design holds all limits; the worst condition's."""
    worst = simulations_of(specification).worst(specification.values(x), sampled, exact)
    held = worst.reshape(len(specification.conditions), -1) <= 0
    return min((estimate_yield(row) for row in held), key=lambda y: y.share)


def fresh_yield(specification: Specification, x: np.ndarray, samples: int = 10_000, seed: int = 12345) -> YieldEstimate:
    """The yield of a design (its variables, shape (n,)) on fresh samples; the worst condition's."""
    if not isinstance(specification.manufacture, Yield):
        raise ClearanceError("Only a problem with `manufacture=Yield(...)` has a yield.")
    return yield_of(specification, x, scenarios_of(specification, samples, seed))
