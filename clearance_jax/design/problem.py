"""The question a designer asks: which clearances, so that errors and forces stay within bounds, at the least cost."""

import copy
import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearance_jax.analysis.metrics import AbstractMetric, Peak
from clearance_jax.analysis.trust import gradient_report
from clearance_jax.design.answer import Design
from clearance_jax.design.costs import AbstractCost
from clearance_jax.design.evaluate import FEW, Scenario, Simulations
from clearance_jax.design.made import Band, Yield, Yielded, counted
from clearance_jax.design.program import Point, Program
from clearance_jax.design.solvers import GRADIENT_FREE, INTERRUPTED, SPENT, run
from clearance_jax.errors import ClearanceError
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import check_values, parameters, replace, values_of
from clearance_jax.solve.simulate import check_arguments

# Peaks that are limits each: where the highest changes place, the next one has been watched already.
PEAKS = 3


class Limit(eqx.Module):
    """A metric that must not exceed a bound (> 0, in the metric's unit) in any condition."""

    metric: AbstractMetric
    bound: float
    name: str = eqx.field(static=True, default="")

    def __check_init__(self):
        if not (np.isfinite(self.bound) and self.bound > 0):
            raise ClearanceError(f"The bound of a limit must be a positive number, but it is {self.bound}.")

    @property
    def title(self) -> str:
        """The given name, or the metric's."""
        signal = getattr(self.metric, "signal", None)
        parts = [type(self.metric).__name__] + ([] if signal is None else [type(signal).__name__])
        of = next((getattr(signal, n) for n in ("point", "joint", "body") if hasattr(signal, n)), None)
        return self.name or " ".join(parts) + ("" if of is None else f" of {of}")


class ToleranceProblem:
    """Clearances by name, bounds on them, limits on the motion, and what clearances cost.

    **Arguments:**

    - `mechanism`, `t1`: the motion, from 0 to `t1` [s].
    - `variables`: name -> (least, greatest), positive, in the parameter's unit.
    - `limits`: `Limit`s.
    - `cost`: one cost function for all variables, or name -> cost function; `None`: the largest clearance is wanted,
      common to all variables where there are several.
    - `conditions`: name of the condition -> values by parameter name (speeds, loads, friction, phases), or a sequence
      of such values; every limit must hold in each. None: the mechanism as it is.
    - `made`: how parts come out of manufacture, a `Band` or a `Yield`; None: as designed.
    - `rtol`, `solver`: of the solves.

    **Raises:** `ClearanceError` for unknown names, bounds that contradict each other, numbers that are not finite.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        t1: float,
        variables: Mapping[str, tuple[float, float]],
        limits: Sequence[Limit],
        cost: AbstractCost | Mapping[str, AbstractCost] | None = None,
        conditions: Mapping[str, Mapping[str, Any]] | Sequence[Mapping[str, Any]] | None = None,
        made: Band | Yield | None = None,
        rtol: float = 1e-8,
        solver: str = "tsit5",
    ):
        check_arguments(mechanism, 0.0, t1, rtol, solver)
        self.mechanism, self.t1, self.limits = mechanism, float(t1), tuple(limits)
        self.variables = {name: (float(low), float(high)) for name, (low, high) in variables.items()}
        if not self.variables or not self.limits:
            raise ClearanceError("A design problem wants at least one variable and one limit.")
        called = [limit.title for limit in self.limits]
        for title in called:
            if called.count(title) > 1:
                raise ClearanceError(f"Two limits are called `{title}`: give each a name of its own.")
        self.rtol, self.solver, self.made = rtol, solver, made
        self.common = cost is None
        self.costs = _costs(cost, tuple(self.variables))
        if not conditions:
            conditions = [{}]
        if not isinstance(conditions, Mapping):
            conditions = {f"condition {i + 1}": c for i, c in enumerate(conditions)}
        self.conditions = {name: dict(values) for name, values in conditions.items()}
        for name, values in self.conditions.items():
            try:
                moved = replace(mechanism, values)
                for end in (0, 1):
                    check_values(replace(moved, {name: ends[end] for name, ends in self.variables.items()}))
                if isinstance(made, Yield):
                    values_of(moved, tuple(made.scatter))  # an unknown name raises here
                known = parameters(moved)
            except ClearanceError as error:
                raise ClearanceError(f"In `{name}`: {error}") from None
            for variable in self.variables:
                if variable in values:
                    raise ClearanceError(f"`{variable}` is a variable, so `{name}` cannot set it.")
                if variable in known and np.ndim(known[variable].value):
                    raise ClearanceError(f"`{variable}` is an array: name one of its entries, `{variable}.0`.")
        self._metrics = tuple(
            Peak(limit.metric.signal, PEAKS)
            if isinstance(limit.metric, Peak) and limit.metric.count == 1
            else limit.metric
            for limit in self.limits
        )

        self.bounds = [limit.bound for limit in self.limits]

    def as_designed(self) -> "ToleranceProblem":
        """The same problem for parts that come out exactly as designed."""
        problem = copy.copy(self)
        problem.made = None
        return problem

    @property
    def names(self) -> tuple[str, ...]:
        """What the solver varies: the variables, or their common value."""
        return ("common clearance",) if self.common and len(self.variables) > 1 else tuple(self.variables)

    def program(self, rtol: float | None = None, solver: str | None = None, **options: Any) -> Program:
        """The problem as numbers, solved with the given accuracy; `options` as `Program`'s."""
        bounds = np.array(list(self.variables.values()))
        if len(self.names) < len(self.variables):
            bounds = np.array([[bounds[:, 0].max(), bounds[:, 1].min()]])
        simulations = self.simulations(rtol, solver)
        scenarios = self.scenarios()
        if isinstance(self.made, Yield):
            titles = groups = [f"yield of {self.made.target:.4g}{self._in(condition)}" for condition in self.conditions]
        else:
            sizes = simulations.sizes()
            titles = [
                limit.title + (f", peak {k + 1}" if size > 1 else "") + scenario.title
                for scenario in scenarios
                for limit, size in zip(self.limits, sizes, strict=True)
                for k in range(size)
            ]
            pairs = list(zip(self.limits, sizes, strict=True))
            groups = [limit.title for _ in scenarios for limit, size in pairs for _ in range(size)]

        def evaluate(x, gradient):
            # To do without derivatives is another program to compile, which for a few variables takes longer than it
            # can save.
            gradient = gradient or (program.gradients > 0 and len(self.variables) <= FEW)
            return self._evaluate(x, gradient, scenarios, simulations)

        program = Program(
            evaluate,
            self.names,
            bounds[:, 0],
            bounds[:, 1],
            titles,
            groups=groups,
            identity=self._identity(simulations.solve),
            **options,
        )
        return program

    def simulations(self, rtol: float | None = None, solver: str | None = None) -> Simulations:
        """What designs are simulated by."""
        solve = {"rtol": rtol or self.rtol, "solver": solver or self.solver}
        return Simulations(self.mechanism, self._metrics, self.bounds, tuple(self.variables), self.t1, solve)

    def _identity(self, solve) -> str:
        """A short text that another problem does not have."""
        leaves, structure = jax.tree.flatten(eqx.filter((self.mechanism, self.costs, self._metrics), eqx.is_array_like))
        asked = (self.t1, self.variables, self.conditions, self.made, solve, self.bounds)
        text = repr(([np.asarray(leaf).tolist() for leaf in leaves], str(structure), asked))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def scenarios(self, fresh: int = 0, seed: int | None = None) -> list[Scenario]:
        """What a design is simulated in, condition by condition; of a `Yield` its samples, or so many fresh ones."""
        names, found = tuple(self.variables), []
        for condition, values in self.conditions.items():
            given = {name: jnp.asarray(value, float) for name, value in values.items()}
            where = self._in(condition)
            if isinstance(self.made, Yield):
                draws = self.made.draws(names, fresh, seed)
                known = parameters(replace(self.mechanism, values))
                others = {n: np.asarray(known[n].value) * f for n, f in draws.items() if n not in names}
                for i in range(fresh or self.made.samples):
                    moved = {n: jnp.asarray(f[i], float) for n, f in others.items()}
                    row = np.array([draws[n][i] for n in names])
                    found.append(Scenario(f"{where}, sample {i + 1}", {**given, **moved}, row))
            elif isinstance(self.made, Band):
                for row in self.made.factors(len(names)):
                    found.append(Scenario(f"{where}, clearances times {' '.join(f'{f:g}' for f in row)}", given, row))
            else:
                found.append(Scenario(where, given, np.ones(len(names))))
        return found

    def yielded(self, x: np.ndarray, samples: int = 10_000, seed: int = 12345) -> Yielded:
        """The yield of a design (its variables, shape (n,)) on fresh samples; the worst condition's."""
        if not isinstance(self.made, Yield):
            raise ClearanceError("Only a problem with `made=Yield(...)` has a yield.")
        return self.counted(x, self.scenarios(samples, seed))

    def counted(self, x: np.ndarray, scenarios: Sequence[Scenario], exact: bool = False) -> Yielded:
        """In how many scenarios, as many of each condition, a design holds all limits; the worst condition's."""
        wide = np.broadcast_to(x, (len(self.variables),))
        held = self.simulations().worst(wide, scenarios, exact).reshape(len(self.conditions), -1) <= 0
        return min((counted(row) for row in held), key=lambda y: y.share)

    def clearances(self, x: np.ndarray) -> dict[str, float]:
        """The variables by name of a solver's point."""
        return dict(zip(self.variables, np.broadcast_to(x, (len(self.variables),)).tolist(), strict=True))

    def solve(
        self,
        method: Literal["auto", "slsqp", "trust-constr", "augmented-lagrangian", "projected-adam", "cobyqa", "cma-es"]
        | str = "slsqp",
        start: Mapping[str, float] | None = None,
        starts: int = 1,
        seed: int = 0,
        record: str | Path | None = None,
        most: int = 1_000_000,
        progress: Callable[[Point], None] | None = None,
    ) -> "Design":
        """The best design found, which holds its limits in a simulation of its own (see `Design.feasible`).

        **Arguments:** `method`: "auto" asks `gradient_report` at the start whether gradients are worth having, and else
        takes "cobyqa"; `start`: values by name (default: the geometric middle of the bounds); `starts`: so many in all,
        the others at random between the bounds (impacts make many local optima); `record`: a file with every evaluated
        point, from which an interrupted run goes on; `most` evaluations; `progress`: called with each.
        """
        program = self.program(record=record, most=most, progress=progress)
        x = np.sqrt(program.lower * program.upper)
        if start is not None:
            given = np.array([float(start[name]) for name in self.variables])
            x = np.array([given.min()]) if len(self.names) < len(self.variables) else given
        if program.best is not None:
            x = program.best.x
        note = ""
        if method == "auto":
            note = self._distrust(x)
            method = "cobyqa" if note else "slsqp"
        if method not in GRADIENT_FREE:
            self._check_derivatives(x)
        # Finer than the solves it cannot be.
        options = {"tolerance": 10 * self.rtol} if method == "slsqp" else {}
        stopped, rng = run(program, method, x, **options), np.random.default_rng(seed)
        for _ in range(starts - 1):
            # A solver that gave up is one thing, an end to all of it another.
            if stopped not in (INTERRUPTED, SPENT):
                other = np.exp(rng.uniform(np.log(program.lower), np.log(program.upper)))
                stopped = run(program, method, other, **options)
        return Design(self, program, method, program.best or program.nearest, stopped, note)

    def _check_derivatives(self, x):
        """Raise for a metric without derivatives, before anything is spent."""
        values = self.clearances(x)
        for limit, metric in zip(self.limits, self._metrics, strict=True):

            def of(c, metric=metric):
                moved = replace(self.mechanism, {name: c * v for name, v in values.items()})
                return metric(moved, jnp.asarray(self.t1), rtol=self.rtol, solver=self.solver)

            try:
                jax.eval_shape(jax.jacfwd(of), jnp.ones(()))
            except ClearanceError as error:
                raise ClearanceError(f"Limit `{limit.title}`: {error} Or choose method='cobyqa'.") from None

    def _distrust(self, x) -> str:
        """Why gradients are useless at a point, in words; empty where they are not."""
        for name, values in self.conditions.items():
            moved = replace(self.mechanism, {**values, **self.clearances(x)})
            for limit in self.limits:
                samples = max(16, len(self.variables) + 3)
                try:
                    report = gradient_report(
                        moved,
                        limit.metric,
                        tuple(self.variables),
                        self.t1,
                        rtol=self.rtol,
                        samples=samples,
                        on_untrusted="ignore",
                    )
                except (ClearanceError, RuntimeError) as error:
                    return f"There are no gradients to trust ({name}, {limit.title}): {error}"
                if not report.trusted:
                    return f"Gradients are not to be trusted ({name}, {limit.title}): {report.reasons[0]}"
        return ""

    def _in(self, condition) -> str:
        return f" ({condition})" if len(self.conditions) > 1 else ""

    def _evaluate(self, x, gradient, scenarios, simulations) -> Point:
        wide = np.broadcast_to(x, (len(self.variables),))
        limits, rows = zip(*(simulations.limits(wide, s, gradient) for s in scenarios), strict=True)
        values, jacobian = np.stack(limits), np.stack(rows) if gradient else None
        if isinstance(self.made, Yield):
            values, jacobian = self._at_risk(values, jacobian)
        else:
            values = values.ravel()
            jacobian = None if jacobian is None else jacobian.reshape(-1, len(wide))
        objective, slope = self._objective(wide)
        if len(x) < len(wide):
            slope, jacobian = slope.sum(keepdims=True), jacobian if jacobian is None else jacobian.sum(1, keepdims=True)
        return Point(np.array(x), objective, values, slope if gradient else None, jacobian)

    def _at_risk(self, values, jacobian):
        """Of scaled limits (scenarios, m) and slopes (scenarios, m, n): conditional values at risk, one a condition."""
        assert isinstance(self.made, Yield)
        risks, slopes = [], []
        for k in range(len(self.conditions)):
            part = slice(k * self.made.samples, (k + 1) * self.made.samples)
            which = np.argmax(values[part], axis=1)
            worst = np.take_along_axis(values[part], which[:, None], 1)[:, 0]
            weights = self.made.weights(worst)
            risks.append(float(weights @ worst))
            if jacobian is not None:
                slopes.append(weights @ np.take_along_axis(jacobian[part], which[:, None, None], 1)[:, 0])
        return np.array(risks), None if jacobian is None else np.stack(slopes)

    def _objective(self, x) -> tuple[float, np.ndarray]:
        if self.common:
            return float(-np.mean(x)), np.full(len(x), -1.0 / len(x))
        pairs = [jax.value_and_grad(cost)(float(c)) for cost, c in zip(self.costs, x, strict=True)]
        return float(sum(v for v, _ in pairs)), np.array([float(g) for _, g in pairs])


def _costs(cost, names) -> list[Callable]:
    if cost is None:
        return []
    if not isinstance(cost, Mapping):
        return [cost] * len(names)
    missing = [name for name in names if name not in cost]
    if missing:
        raise ClearanceError(f"There is no cost for `{missing[0]}`. Give one for every variable.")
    return [cost[name] for name in names]
