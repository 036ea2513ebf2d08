"""Simulations of a design: its limits in scenarios, with derivatives by its variables.

A limit that must hold while a joint wears needs many motions one after another. Its scenarios are solved in threads of
this process.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np

from clearance_jax.ask.answers import answers, as_lanes
from clearance_jax.ask.question import Question, answer, shapes_of
from clearance_jax.design.asked.conditions import values_for, without_wear
from clearance_jax.design.asked.specification import Scenario, Specification, scenarios_of
from clearance_jax.design.search.yields import YieldEstimate, estimate_yield, samples_to_judge
from clearance_jax.errors import ClearanceError, WearFailure, WornThrough
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMeasure
from clearance_jax.solve.drivers.batch import cores_here, side_by_side, usual_cores
from clearance_jax.solve.settings import QUASI_STATIC, Settings
from clearance_jax.wear import AbstractAged

# The largest number of variables for which every evaluation has derivatives.
FEW = 5


class Simulations:
    """The simulations of designs, whose variables are the numbers `names` of a mechanism. `metrics` with their
    `bounds`: scaled limits are value / bound - 1; `t1` [s]; `solve`: the settings; `place`: where many simulations are
    solved.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        metrics: Sequence[AbstractMeasure],
        bounds: Sequence[float],
        names: Sequence[str],
        t1: float,
        solve: Settings,
        place: Any = None,
    ):
        self.metrics, self.bounds, self.names = tuple(metrics), tuple(bounds), tuple(names)
        self.mechanism, self.t1, self.solve, self.place = mechanism, t1, solve, place
        # Metrics of one motion are solved together; those of wear one by one.
        self._aged = {i: metric for i, metric in enumerate(self.metrics) if isinstance(metric, AbstractAged)}
        self._plain = {str(i): metric.base_metric for i, metric in enumerate(self.metrics) if i not in self._aged}
        if self._aged and solve.fidelity == QUASI_STATIC:
            raise ClearanceError(
                "Wear follows the impacts and the sliding of a motion, which quasi-static poses do not have: use "
                '`fidelity = "dynamics"`.'
            )

    def sizes(self) -> list[int]:
        """The number of values of each metric."""
        questions = (Question(self.mechanism, {"": m.base_metric}, self.t1, self.solve) for m in self.metrics)
        counts = [int(np.prod(shapes_of(question, ()).values[""].shape)) for question in questions]
        return [count * len(self._aged[i].cycles) if i in self._aged else count for i, count in enumerate(counts)]

    def limits(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[np.ndarray, np.ndarray | None]:
        """Scaled limits (m,) of a design (n,) in a scenario, and their derivatives (m, n).

        Limits are NaN for a part that wears through, and for a part as made whose wear cannot be simulated.

        **Raises:** `ClearanceError` if the wear of the design itself cannot be simulated.
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
        """`limits` of a design in every scenario (scenarios, m), and derivatives (scenarios, m, n); NaN if a motion did
        not reach its end. Scenarios of one condition must be neighbours in the list.
        """
        # One batch solves all scenarios, unless parts wear or a condition sets a matrix, whose entries have no names.
        if self._aged or any(np.ndim(value) > 1 for value in scenarios[0].values.values()):
            first = self.limits(x, scenarios[0], gradient)  # compiles for all
            # Wear is mostly work of the host between small solves, also with a GPU.
            cores = cores_here() if self._aged else usual_cores()
            with ThreadPoolExecutor(min(cores, side_by_side())) as pool:
                others = pool.map(lambda scenario: self.limits(x, scenario, gradient), scenarios[1:])
                limits, rows = zip(first, *others, strict=True)
            return np.stack(limits), np.stack(rows) if gradient else None
        # Conditions apart: they may set different names.
        parts = [list(part) for _, part in itertools.groupby(scenarios, lambda scenario: scenario.values.keys())]
        limits, rows = zip(*(self._alike(x, part, gradient) for part in parts), strict=True)
        return np.concatenate(limits), np.concatenate(rows) if gradient else None

    def worst(self, x: np.ndarray, scenarios: Sequence[Scenario], exact: bool = False) -> np.ndarray:
        """The most violated scaled limit of a design in each scenario (scenarios,), infinite if a motion did not reach
        its end. `exact`: use the search's compiled program, which has derivatives, if scenarios are few.
        """
        exact = exact and len(x) <= FEW and not self._aged and not as_lanes(len(scenarios), self.place)
        worst = self.together(x, scenarios, exact)[0].max(axis=1)
        return np.where(np.isfinite(worst), worst, np.inf)

    def _question(self, gradient: bool) -> Question:
        """The question to one motion."""
        return Question(self.mechanism, self._plain, self.t1, self.solve, self.names if gradient else ())

    def _in_order(self, by_metric: Mapping[str, Any]) -> list:
        """The values by metric of one motion as a list in order; empty if there are none."""
        return [np.asarray(by_metric[name]) for name in self._plain] if by_metric else []

    def _all(self, x: np.ndarray, scenario: Scenario, gradient: bool) -> tuple[list, list]:
        """The values of all metrics and, with `gradient`, their derivatives by the variables as made."""
        values, slopes = [], []
        if self._plain:
            # Numbers of wear do not belong to the mechanism, and do not affect metrics of one motion.
            given = without_wear(self.mechanism, self.metrics, scenario.values)
            made = dict(zip(self.names, x * scenario.factors, strict=True))
            # Numbers inside the question: `together` has the same program.
            answered = answer(self._question(gradient).at({**given, **made}))
            values, slopes = self._in_order(answered.values), self._in_order(answered.slopes)
        for i in self._aged:
            value, slope = self._worn_values(i, x, scenario, self.names if gradient else ())
            values.insert(i, value)
            slopes.insert(i, slope)
        return values, slopes

    def _worn_values(self, i: int, x: np.ndarray, scenario: Scenario, by: tuple[str, ...]) -> tuple:
        try:
            return self._simulate_wear(i, x * scenario.factors, scenario.values, by)
        except WornThrough:
            pass
        except WearFailure:
            if scenario.designed is None:
                raise
            # A part as made may fail: its limits are NaN. But if the design itself fails too, raise its error.
            with suppress(WornThrough):
                self._simulate_wear(i, x, scenario.designed, ())
        count = self.sizes()[i]
        return np.full(count, np.nan), np.full((count, len(by)), np.nan)

    def _simulate_wear(self, i: int, x: np.ndarray, given, by: tuple[str, ...]) -> tuple:
        metric, solve = self._aged[i], self.solve
        how = {"t0": float(solve.t0), "rtol": float(solve.rtol), "solver": solve.solver}
        how |= {"start": solve.start, "max_steps": solve.max_steps}
        values = values_for(metric, self.mechanism, self.metrics, given) | dict(zip(self.names, x, strict=True))
        return metric.of(self.mechanism, values, self.t1, by, **how)

    def _alike(self, x: np.ndarray, scenarios: list[Scenario], gradient: bool):
        """`together` for scenarios that set the same names, without metrics of wear; no slopes without `gradient`."""
        factors = np.stack([scenario.factors for scenario in scenarios])
        numbers = dict(zip(self.names, (x * factors).T, strict=True))
        for name in scenarios[0].values:
            values = np.stack([np.asarray(scenario.values[name]) for scenario in scenarios])
            numbers |= {name: values} if values.ndim == 1 else {f"{name}.{i}": x for i, x in enumerate(values.T)}
        answered, count = answers(self._question(gradient), numbers, self.place), len(scenarios)
        values, slopes = self._in_order(answered.values), self._in_order(answered.slopes)
        scaled = [v.reshape(count, -1) / bound - 1 for v, bound in zip(values, self.bounds, strict=True)]
        rows = [s.reshape(count, -1, len(x)) / bound for s, bound in zip(slopes, self.bounds, strict=gradient)]
        limits = np.concatenate(scaled, axis=1)
        return limits, np.concatenate(rows, axis=1) * factors[:, None] if gradient else None


def simulations_of(
    specification: Specification, rtol: float | None = None, solver: str | None = None, place: Any = None
) -> Simulations:
    """The simulations of a problem's designs, with the given accuracy, also of wear."""
    changes = {name: given for name, given in (("rtol", rtol), ("solver", solver)) if given is not None}
    finer = 1.0 if rtol is None else specification.rtol / rtol
    metrics, bounds = zip(*((limit.metric_solved(finer), limit.bound) for limit in specification.limits), strict=True)
    names, t1, solve = tuple(specification.variables), specification.t1, specification.settings(**changes)
    return Simulations(specification.mechanism, metrics, bounds, names, t1, solve, place)


def most_violated(
    specification: Specification, exact: bool, place: Any, *accuracy: Any
) -> Callable[[np.ndarray], float]:
    """The most violated limit as a function of a design, which may lie outside of the bounds of its variables; `exact`
    as of `Simulations.worst`, `accuracy` as of `simulations_of`.
    """
    simulations, scenarios = simulations_of(specification, *accuracy, place=place), scenarios_of(specification)
    return lambda x: float(np.max(simulations.worst(x, scenarios, exact)))


def yield_of(
    specification: Specification, x: np.ndarray, sampled: Sequence[Scenario], exact: bool, place: Any
) -> YieldEstimate:
    """The yield of a design on `sampled` scenarios, the same number in each condition; that of the worst condition."""
    worst = simulations_of(specification, place=place).worst(specification.values(x), sampled, exact)
    holds = worst.reshape(len(specification.conditions), -1) <= 0
    return min((estimate_yield(row) for row in holds), key=lambda y: y.share)


def fresh_yield(
    specification: Specification, x: np.ndarray, samples: int | None = None, seed: int = 12345, place: Any = None
) -> YieldEstimate:
    """The yield of a design on fresh samples (default: as many as its target needs), in the worst condition."""
    if not specification.manufacture.is_sampled:
        raise ClearanceError("Only a problem with `manufacture=Yield(...)` has a yield.")
    samples = samples_to_judge(getattr(specification.manufacture, "target", None)) if samples is None else samples
    return yield_of(specification, x, scenarios_of(specification, samples, seed), False, place)
