"""Designs as simulations: what a design must stand, solved one by one with derivatives, or as lanes without.

What is to hold while a joint wears is many motions in a row, block by block: it is asked one by one, here, in threads.
"""

import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._solo import solo_jit
from clearance_jax.analysis.measure import AbstractMeasure, measured
from clearance_jax.design.lanes import HERE, Lanes, Place
from clearance_jax.design.manufacture import Yield, YieldEstimate, estimate_yield
from clearance_jax.design.scenarios import Scenario, scenarios_of
from clearance_jax.design.specification import Specification
from clearance_jax.design.worn import known_to, moved
from clearance_jax.errors import ClearanceError, Unlivable, WornOut
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace
from clearance_jax.solve.batch import cores_here
from clearance_jax.solve.settings import Settings
from clearance_jax.wear import AbstractAged

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
        metrics: Sequence[AbstractMeasure],
        bounds: Sequence[float],
        names: Sequence[str],
        t1: float,
        solve: Settings,
        place: Place = HERE,
    ):
        self.metrics, self.bounds, self.names = tuple(metrics), tuple(bounds), tuple(names)
        self.mechanism, self.t1, self.solve, self.place = mechanism, t1, solve, place
        self._lanes: dict[bool, Lanes] = {}
        self._sizes: dict[int, int] = {}
        # Those of one motion, which one solve has together.
        self._aged = {i: metric for i, metric in enumerate(self.metrics) if isinstance(metric, AbstractAged)}
        self._plain = tuple(metric.once for i, metric in enumerate(self.metrics) if i not in self._aged)

    def sizes(self) -> list[int]:
        """How many numbers each metric is."""
        return [self._size(i) for i in range(len(self.metrics))]

    def _size(self, i: int) -> int:
        metric = self.metrics[i]

        def value(t1):
            return measured(self.mechanism, {"": metric.once}, t1, self.solve)[""]

        if i not in self._sizes:
            shape = jax.eval_shape(value, jnp.asarray(self.t1)).shape
            self._sizes[i] = len(metric.ages) * int(np.prod(shape))
        return self._sizes[i]

    def limits(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Scaled limits (m,) of a design (n,) in a scenario, and their derivatives (m, n).

        A part that wears out early has no numbers there, and one as made whose wear cannot be followed has none either:
        both have failed.

        **Raises:** `ClearanceError` where the wear of the design itself cannot be followed.
        """
        values, slopes = self._all(x, scenario, gradient)
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
            limits, rows = zip(*self._one_by_one(x, scenarios, gradient), strict=True)
            return np.stack(limits), np.stack(rows) if gradient else None
        # Conditions apart: they may set different names.
        parts = [list(part) for _, part in itertools.groupby(scenarios, lambda one: one.values.keys())]
        found = [self._lanes_of(x, part, gradient) for part in parts]
        limits, rows = zip(*found, strict=True)
        return np.concatenate(limits), np.concatenate(rows) if gradient else None

    def _one_by_one(self, x: np.ndarray, scenarios: Sequence[Scenario], gradient: bool) -> Iterator[tuple]:
        """`limits` in every scenario."""
        if not self._aged:
            yield from (self.limits(x, scenario, gradient) for scenario in scenarios)
            return
        # A life is host work between small solves: several go on beside each other. The first compiles for all.
        yield self.limits(x, scenarios[0], gradient)
        with ThreadPoolExecutor(self.place.cores or cores_here()) as pool:
            yield from pool.map(lambda scenario: self.limits(x, scenario, gradient), scenarios[1:])

    def worst(self, x: np.ndarray, scenarios: Sequence[Scenario], exact: bool = False) -> np.ndarray:
        """The most violated scaled limit of a design in each scenario, shape (scenarios,); infinite where there is no
        motion to the end. Few are solved with derivatives (`exact`) if that program is compiled; lives, which take
        longer than to compile, are not.
        """
        exact = exact and not self._aged and not self._as_lanes(scenarios)
        found = self.together(x, scenarios, exact)[0].max(axis=1)
        return np.where(np.isfinite(found), found, np.inf)

    def _all(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[list, list]:
        """The metrics' values and, with a gradient, derivatives by the variables as made (else none)."""
        values, slopes = [], []
        if self._plain:
            # Numbers of wear are no numbers of the mechanism, and move no metric of one motion.
            mechanism = moved(self.mechanism, self.metrics, scenario.values)
            call, made = _slopes if gradient else _values, jnp.asarray(x * scenario.factors)
            asked = mechanism, self._plain, self.names, made, {}, jnp.asarray(self.t1), self.solve
            values, slopes = call(*asked)
        for i in self._aged:
            value, slope = self._worn(i, x, scenario, self.names if gradient else ())
            values.insert(i, value)
            slopes.insert(i, slope)
        return values, slopes

    def _worn(self, i: int, x: np.ndarray, scenario: Scenario, by: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        try:
            return self._lived(i, x * scenario.factors, scenario.values, by)
        except WornOut:
            pass
        except Unlivable:
            if scenario.designed is None:
                raise
            # Is it this part, or the design, of which no part says what is wrong? The design itself does, here.
            with suppress(WornOut):
                self._lived(i, x, scenario.designed, ())
        count = self._size(i)
        return np.full(count, np.nan), np.full((count, len(by)), np.nan)

    def _lived(self, i: int, x: np.ndarray, given, by: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        metric, solve = self._aged[i], self.solve
        how = {"t0": float(solve.t0), "rtol": float(solve.rtol), "solver": solve.solver}
        how |= {"start": solve.start, "max_steps": solve.max_steps}
        values = known_to(metric, self.mechanism, self.metrics, given) | dict(zip(self.names, x, strict=True))
        return metric.of(self.mechanism, values, self.t1, by, **how)

    def _as_lanes(self, scenarios: Sequence[Scenario]) -> bool:
        if self._aged:
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
        return Lanes(self.mechanism, self._plain, self.t1, self.solve, self.names if gradient else ())


def _measured(mechanism, metrics, names, x, given, t1, solve):
    moved = replace(mechanism, {**given, **dict(zip(names, x, strict=True))})
    # One solve for all of them.
    return list(measured(moved, {str(i): metric for i, metric in enumerate(metrics)}, t1, solve).values())


@solo_jit
def _values(*asked):
    return _measured(*asked), []


@solo_jit
def _slopes(mechanism, metrics, names, x, given, t1, solve):
    def of(x):
        out = _measured(mechanism, metrics, names, x, given, t1, solve)
        return out, out

    slopes, out = jax.jacfwd(of, has_aux=True)(x)
    return out, slopes


def simulations_of(
    specification: Specification, rtol: float | None = None, solver: str | None = None, place: Place = HERE
) -> Simulations:
    """What designs are simulated by, to the given accuracy, which is also that of what goes from age to age."""
    changes = {name: given for name, given in (("rtol", rtol), ("solver", solver)) if given is not None}
    finer = 1.0 if rtol is None else specification.rtol / rtol
    metrics = [limit.simulation_metric.finer(finer) for limit in specification.limits]
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
