"""Designs as simulations: what a design must stand, solved one by one with derivatives, or as lanes without.

What is to hold while a joint wears is many motions in a row, block by block: it is asked one by one, with derivatives.
"""

import itertools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.measure import AbstractMetric, measured
from clearance_jax.design.lanes import HERE, Lanes, Place
from clearance_jax.design.manufacture import Yield, YieldEstimate, estimate_yield
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.design.specification import Specification
from clearance_jax.design.worn import moved
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.settings import Settings
from clearance_jax.wear import AfterWear

# More scenarios than this are solved as lanes, without derivatives.
FEW_SCENARIOS = 250
# Variables up to which derivatives come along with every evaluation.
FEW = 5


class Simulations:
    """Metrics of a mechanism whose numbers `names` are a design's; limits are (value / bound - 1).

    **Arguments:** `metrics` with their `bounds`; `t1` [s]; `solve`: how; `place`: where, if there are many.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        metrics: Sequence[AbstractMetric | AfterWear],
        bounds: Sequence[float],
        names: Sequence[str],
        t1: float,
        solve: Settings,
        place: Place = HERE,
    ):
        self.metrics, self.bounds, self.names = tuple(metrics), tuple(bounds), tuple(names)
        self.mechanism, self.t1, self.solve, self.place = mechanism, t1, solve, place
        self._lanes: dict[bool, Lanes] = {}
        # Those of one motion, which one solve has together.
        self._plain = tuple(metric for metric in self.metrics if not isinstance(metric, AfterWear))

    def sizes(self) -> list[int]:
        """How many numbers each metric is."""

        def size(metric) -> int:
            if isinstance(metric, AfterWear):
                return len(metric.cycles) * size(metric.metric)
            out = jax.eval_shape(
                lambda t1: measured(self.mechanism, {"": metric}, t1, self.solve)[""], jnp.asarray(self.t1)
            )
            return int(np.prod(out.shape))

        return [size(metric) for metric in self.metrics]

    def limits(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Scaled limits (m,) of a design (n,) in a scenario, and their derivatives (m, n)."""
        values, slopes = self._all(x * scenario.factors, scenario.values, gradient)
        bounds = np.concatenate([np.full(np.size(v), bound) for v, bound in zip(values, self.bounds, strict=True)])
        limits = np.concatenate([np.ravel(v) for v in values]) / bounds - 1
        if not gradient:
            return limits, None
        rows = np.concatenate([np.reshape(s, (-1, len(x))) for s in slopes])
        return limits, rows * scenario.factors / bounds[:, None]

    def together(
        self, x: np.ndarray, scenarios: Sequence[Scenario], gradient: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """`limits` of a design in every scenario, shape (scenarios, m), and derivatives (scenarios, m, n); not a number
        where there is no motion to the end. Many, and all on a cluster, are solved as lanes, few one by one. Scenarios
        of one condition must follow each other.
        """
        if not self._as_lanes(scenarios):
            limits, rows = zip(*(self.limits(x, scenario, gradient) for scenario in scenarios), strict=True)
            return np.stack(limits), np.stack(rows) if gradient else None
        # Conditions apart: they may set different names.
        parts = [list(part) for _, part in itertools.groupby(scenarios, lambda one: one.values.keys())]
        found = [self._lanes_of(x, part, gradient) for part in parts]
        limits, rows = zip(*found, strict=True)
        return np.concatenate(limits), np.concatenate(rows) if gradient else None

    def worst(self, x: np.ndarray, scenarios: Sequence[Scenario], exact: bool = False) -> np.ndarray:
        """The most violated scaled limit of a design in each scenario, shape (scenarios,); infinite where there is no
        motion to the end. Few are solved with derivatives (`exact`) if that program is compiled.
        """
        found = self.together(x, scenarios, exact and not self._as_lanes(scenarios))[0].max(axis=1)
        return np.where(np.isfinite(found), found, np.inf)

    def _all(self, x, given, gradient: bool) -> tuple[list, list]:
        """The metrics' values and, with a gradient, derivatives by the design (else none)."""
        values, slopes = [], []
        if self._plain:
            # Numbers of wear are no numbers of the mechanism, and move no metric of one motion.
            mechanism = moved(self.mechanism, given)
            call = _slopes if gradient else _values
            asked = mechanism, self._plain, self.names, jnp.asarray(x), {}, jnp.asarray(self.t1), self.solve
            values, slopes = call(*asked)
        if len(self._plain) == len(self.metrics):
            return values, slopes
        one, other = iter(values), iter(slopes)
        pairs = [
            self._worn(metric, x, given, gradient)
            if isinstance(metric, AfterWear)
            else (next(one), next(other) if gradient else None)
            for metric in self.metrics
        ]
        return [value for value, _ in pairs], [slope for _, slope in pairs]

    def _worn(self, metric: AfterWear, x, given, gradient: bool) -> tuple[np.ndarray, np.ndarray]:
        solve = self.solve
        how = {"t0": float(solve.t0), "rtol": float(solve.rtol), "solver": solve.solver}
        how |= {"start": solve.start, "max_steps": solve.max_steps}
        values = {**given, **dict(zip(self.names, x, strict=True))}
        return metric.of(self.mechanism, values, self.t1, self.names if gradient else (), **how)

    def _as_lanes(self, scenarios: Sequence[Scenario]) -> bool:
        if len(self._plain) < len(self.metrics):
            return False
        many = len(scenarios) > FEW_SCENARIOS or (self.place.client is not None and len(scenarios) > 1)
        # Of an array entries can be named, one by one; of an array of arrays not.
        return many and all(np.ndim(value) < 2 for value in scenarios[0].values.values())

    def _lanes_of(self, x: np.ndarray, scenarios: list[Scenario], gradient: bool):
        """`together` of scenarios that set the same names, as lanes."""
        factors = np.stack([scenario.factors for scenario in scenarios])
        numbers = dict(zip(self.names, (x * factors).T, strict=True))
        for name in scenarios[0].values:
            column = np.stack([np.asarray(scenario.values[name]) for scenario in scenarios])
            numbers |= {name: column} if column.ndim == 1 else {f"{name}.{i}": one for i, one in enumerate(column.T)}
        lanes = self._lanes.setdefault(gradient, self._made(gradient))
        values, slopes = lanes.solved(numbers, self.place)
        count = len(scenarios)
        scaled = [v.reshape(count, -1) / bound - 1 for v, bound in zip(values, self.bounds, strict=True)]
        rows = [s.reshape(count, -1, len(x)) / bound for s, bound in zip(slopes, self.bounds, strict=gradient)]
        limits = np.concatenate(scaled, axis=1)
        return limits, np.concatenate(rows, axis=1) * factors[:, None] if gradient else None

    def _made(self, gradient: bool) -> Lanes:
        return Lanes(self.mechanism, self.metrics, self.t1, self.solve, self.names if gradient else ())


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


def simulations_of(
    specification: Specification, rtol: float | None = None, solver: str | None = None, place: Place = HERE
) -> Simulations:
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
        place,
    )


def yield_of(
    specification: Specification,
    x: np.ndarray,
    sampled: Sequence[Scenario],
    exact: bool = False,
    place: Place = HERE,
) -> YieldEstimate:
    """In how many scenarios, as many of each condition, a design holds all limits; the worst condition's."""
    worst = simulations_of(specification, place=place).worst(specification.values(x), sampled, exact)
    held = worst.reshape(len(specification.conditions), -1) <= 0
    return min((estimate_yield(row) for row in held), key=lambda y: y.share)


def fresh_yield(
    specification: Specification, x: np.ndarray, samples: int = 10_000, seed: int = 12345, place: Place = HERE
) -> YieldEstimate:
    """The yield of a design (its variables, shape (n,)) on fresh samples; the worst condition's."""
    if not isinstance(specification.manufacture, Yield):
        raise ClearanceError("Only a problem with `manufacture=Yield(...)` has a yield.")
    return yield_of(specification, x, scenarios_of(specification, samples, seed), place=place)
