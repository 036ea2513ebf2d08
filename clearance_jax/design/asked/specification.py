"""The specification of a tolerance problem, checked: variables, limits, conditions, costs, options; its scenarios."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax._basis.module import Module
from clearance_jax.design.asked.conditions import NONE, sets, values_for, without_wear, worth
from clearance_jax.design.asked.manufacture import AbstractManufacture, AsDesigned
from clearance_jax.errors import ClearanceError, wrong_value
from clearance_jax.mechanism._base import drive_breaks
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMeasure, as_measure, begin_of
from clearance_jax.parameters import check_values, parameters, replace, units_of
from clearance_jax.solve.settings import DYNAMICS, QUASI_STATIC, Settings, SolveOptions, settings_of
from clearance_jax.wear import AbstractAged

# Each of so many peaks is a limit of its own: the search then sees the one that becomes the highest.
PEAKS = 3
# Options of the solves that a problem may have.
KNOWN = ("t0", "rtol", "solver", "start", "max_steps")
# Models of the motion that judge designs; `AUTO`: searched by quasi-static poses, judged by the dynamics.
AUTO = "auto"
FIDELITY_CHOICES = (DYNAMICS, QUASI_STATIC, AUTO)


class Limit(Module):
    """A metric that must not exceed a bound in any condition.

    **Arguments:**

    - `metric`: a metric, or a function `f(solution)` or `f(mechanism, solution)`. A `wear.AfterWear` must hold while a
      joint wears.
    - `bound` > 0, in the metric's unit; `name`: how reports call the limit, by default as the metric.
    """

    metric: AbstractMeasure = eqx.field(converter=as_measure)
    bound: float
    name: str = eqx.field(static=True, default="")

    def __check_init__(self):
        if not (np.isfinite(self.bound) and self.bound > 0):
            raise wrong_value("The bound of a limit", "a positive number", self.bound, str(self.bound), name="bound")

    def known(self, mechanism: Mechanism) -> "Limit":
        """The limit with the unit that its signal has in a mechanism."""
        return dataclasses.replace(self, metric=self.metric.with_metric(self.metric.base_metric.known(mechanism)))

    @property
    def signal(self) -> Any:
        """The signal that is bounded; `None`: the metric has none."""
        return getattr(self.metric.base_metric, "signal", None)

    @property
    def title(self) -> str:
        """The given name, or the metric's."""
        aged = self._aged
        return self.name or self.metric.base_metric.title + ("" if aged is None else f" worn at {aged.joint}")

    @property
    def label(self) -> str:
        """What is bounded, in words: "piston: position error", or "NAME: position error of piston"."""
        return self._label(self.metric.base_metric.label)

    @property
    def signal_label(self) -> str:
        """The signal of the metric in words, of the new mechanism; the label if there is no signal."""
        of = self.label if self.signal is None else self._label(self.signal.label)
        return of + " as new" * bool(self.ages)

    @property
    def reduction(self) -> str:
        """The reduction of the signal in words; empty if every value is bounded."""
        return self.metric.base_metric.reduction

    @property
    def ages(self) -> tuple[str, ...]:
        """The suffix of the label at each age at which it must hold; none if it must hold for new parts only."""
        aged = self._aged
        return () if aged is None else tuple(f", after {cycles} cycles of wear" for cycles in aged.cycles)

    @property
    def _aged(self) -> AbstractAged | None:
        return self.metric if isinstance(self.metric, AbstractAged) else None

    @property
    def since(self) -> float | None:
        """The time from which on the limit counts [s]; `None`: from the start."""
        since = getattr(self.metric.base_metric, "since", None)
        return None if since is None else float(since)

    def _label(self, what: str) -> str:
        part = self.metric.base_metric.part
        name = self.name or part
        whole = what if part in ("", name) else f"{what} of {part}"
        return f"{name}: {whole}" if name else whole

    def labels(self, count: int) -> list[str]:
        """The label of each of the `count` values of `simulation_metric`: "piston: position error, peak 1"."""
        ages = self.ages or ("",)
        components = self.metric.base_metric.components(count // len(ages))
        return [self.label + (f", {component}" if component else "") + age for age in ages for component in components]

    @property
    def simulation_metric(self) -> AbstractMeasure:
        """The metric to be solved for: instead of one peak the `PEAKS` highest."""
        return self.metric_solved()

    def metric_solved(self, accuracy: float = 1.0) -> AbstractMeasure:
        """`simulation_metric`, for solves (and simulations of wear) that are `accuracy` times more accurate."""
        metric = self.metric.with_metric(self.metric.base_metric.several(PEAKS))
        if isinstance(metric, AbstractAged):
            return dataclasses.replace(metric, tolerance=metric.tolerance / accuracy)
        return metric


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Specification:
    """The arguments of a `ToleranceProblem` in one form.

    - `mechanism`, `t1` [s], `variables`, `limits`, `manufacture`: as of the problem.
    - `costs`: one for each variable, in the order of `variables`; empty if the largest clearance is wanted.
    - `conditions`: by name, at least one; `options`: of the solves; `cost_unit`: what costs are counted in.
    - `fidelity`: by which model of the motion designs are judged.

    **Raises:** `ClearanceError` for unknown names, two limits of one title, and numbers that are not finite or out of
    bounds.
    """

    mechanism: Mechanism
    t1: float
    variables: dict[str, tuple[float, float]]
    limits: tuple[Limit, ...]
    costs: tuple[Callable, ...]
    conditions: dict[str, dict[str, Any]]
    manufacture: AbstractManufacture
    options: SolveOptions
    cost_unit: str = "cost units"
    fidelity: str = DYNAMICS

    def __post_init__(self):
        if self.fidelity not in FIDELITY_CHOICES:
            raise wrong_value("`fidelity`", ", ".join(FIDELITY_CHOICES), self.fidelity)
        settings = self.settings()
        for limit in self.limits:
            begin_of(getattr(limit.metric.base_metric, "since", None), self.t1, settings)
        self.manufacture.check()
        if not self.variables or not self.limits:
            raise ClearanceError("A design problem wants at least one variable and one limit.")
        for title, count in Counter(limit.title for limit in self.limits).items():
            if count > 1:
                raise ClearanceError(f"Two limits are called `{title}`: give each a name of its own.")
        for name, values in self.conditions.items():
            self._check_condition(name, values)

    def _check_condition(self, name: str, values: dict[str, Any]) -> None:
        try:
            for given in values:
                self.worth(given)  # an unknown name raises here
            now = self.move(self.mechanism, values)
            for ends in zip(*self.variables.values(), strict=True):
                check_values(replace(now, dict(zip(self.variables, ends, strict=True))))
            for metric in self.metrics:
                check_values(replace(metric.model(now), values_for(metric, now, self.metrics, values)))
            for scattered in self.manufacture.scattered:
                self.worth(scattered)
                if scattered not in self.variables:
                    mean = self.worth(scattered, values)
                    self.manufacture.check_worth(scattered, mean, sets(values, scattered))
            known = parameters(now)
            # The drives of the mechanism end before t1, but those of the condition do not.
            last, given_last = (max(np.asarray(drive_breaks(m)).tolist(), default=0.0) for m in (now, self.mechanism))
            end = self.t1 * (1 + 1e-9)
            if any(given.startswith("drive.") for given in values) and given_last <= end < last:
                raise ClearanceError(
                    f"its drives move until {last:.6g} s, and the motion ends at t1 = {self.t1:.6g} s, before they "
                    f"come to rest: let it last as long as the slowest condition, t1 = {last:.6g}."
                ).about("t1", float(self.t1), last)
        except ClearanceError as error:
            raise error.at(f"In `{name}`") from None
        for variable in self.variables:
            if variable in values:
                raise ClearanceError(f"`{variable}` is a variable, so `{name}` cannot set it.").about(variable, name)
            if variable in known and np.ndim(known[variable].value):
                raise ClearanceError(f"`{variable}` is an array: name one of its entries, `{variable}.0`.")

    @property
    def metrics(self) -> list[AbstractMeasure]:
        """Those of its limits."""
        return [limit.metric for limit in self.limits]

    def worth(self, name: str, given: Mapping[str, Any] = NONE) -> Any:
        """The value of a number, the mechanism's or that of wear, in a condition that sets the `given` values.
        **Raises** `ClearanceError` for an unknown one.
        """
        return worth(self.mechanism, self.metrics, name, given)

    def move(self, mechanism: Mechanism, values: Mapping[str, Any]) -> Mechanism:
        """The mechanism with the values of a condition or scenario, of which those of wear are ignored."""
        return replace(mechanism, without_wear(mechanism, self.metrics, values)) if values else mechanism

    def settings(self, **changes: Any) -> Settings:
        """The settings of the solves, with some options changed."""
        return settings_of(self.mechanism, self.t1, {**self.solving, **changes}, (*KNOWN, "fidelity"))

    @property
    def solving(self) -> SolveOptions:
        """The options of the solves that judge a design."""
        return {**self.options, "fidelity": DYNAMICS if self.fidelity == AUTO else self.fidelity}

    def judged_by(self, fidelity: str) -> "Specification":
        """The same, judged by another model of the motion."""
        return dataclasses.replace(self, fidelity=fidelity)

    @property
    def judge(self) -> str:
        """What judges designs, in words: the model of the motion, and neighbours if these count."""
        return f"{self.solving.get('fidelity')}{self.manufacture.among}"

    @property
    def t0(self) -> float:
        """Start of the motion [s]."""
        return float(self.settings().t0)

    @property
    def start(self) -> str:
        """Where pins start: "centre" or "settled"."""
        return self.settings().start

    @property
    def rtol(self) -> float:
        """Accuracy of the solves."""
        return float(self.settings().rtol)

    @property
    def solver(self) -> Any:
        """The solver of the solves."""
        return self.settings().solver

    @property
    def common(self) -> bool:
        """Whether the largest common clearance of all variables is wanted, not the least cost."""
        return not self.costs

    @property
    def names(self) -> tuple[str, ...]:
        """The names of what the solver varies: the variables, or their common value."""
        return ("common clearance",) if self.common and len(self.variables) > 1 else tuple(self.variables)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest values of what the solver varies."""
        lower, upper = np.array(list(self.variables.values())).T
        return (lower, upper) if len(self.names) == len(lower) else (lower.max(keepdims=True), upper.min(keepdims=True))

    @property
    def units(self) -> dict[str, str]:
        """The variables' units by name."""
        return units_of(self.mechanism, self.variables)

    def values(self, x: np.ndarray) -> np.ndarray:
        """The variables' values at a solver's point."""
        return np.broadcast_to(x, (len(self.variables),))

    def clearances(self, x: np.ndarray) -> dict[str, float]:
        """The variables by name at a solver's point."""
        return dict(zip(self.variables, self.values(x).tolist(), strict=True))

    def label(self, condition: str) -> str:
        """A condition's name if there are several conditions, else empty."""
        return condition if len(self.conditions) > 1 else ""

    def suffix(self, condition: str) -> str:
        """The suffix of a title for a condition; empty if there is only one."""
        return f" ({condition})" if self.label(condition) else ""

    def as_designed(self) -> "Specification":
        """`nominal`, but limits that are judged among neighbours still are."""
        return self if self.manufacture.among else self.nominal()

    def nominal(self) -> "Specification":
        """The same for parts exactly as designed."""
        return dataclasses.replace(self, manufacture=AsDesigned())


class Scenario(NamedTuple):
    """One simulation of a design: its `title`, `values` of numbers by name, `factors` (n,) on the variables; for a part
    as made, `designed` are the values without scatter (`None`: it is as designed).
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
        means = {n: np.asarray(specification.worth(n, values)) for n in manufacture.scattered if n not in names}
        for part in parts:
            moved = {n: jnp.asarray(means[n] * factor, float) for n, factor in part.others.items()}
            moved |= {n: jnp.asarray(value, float) for n, value in part.values.items()}
            title = specification.suffix(condition) + part.title
            designed = None if part.is_design else given
            scenarios.append(Scenario(title, {**given, **moved}, part.factors, designed))
    return scenarios
