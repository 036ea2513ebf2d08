"""Build the program of a specification: objective, scaled limits and their derivatives at a point."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from clearance_jax.design.asked.manufacture import AsDesigned
from clearance_jax.design.asked.specification import AUTO, Scenario, Specification, scenarios_of
from clearance_jax.design.search.evaluate import FEW, Simulations, simulations_of
from clearance_jax.design.search.program import INSIDE, Evaluation, Program
from clearance_jax.errors import ClearanceError
from clearance_jax.runs.identity import numbers, short, versions
from clearance_jax.runs.identity import settings as in_words
from clearance_jax.solve.settings import QUASI_STATIC

# Active limits stay inside their bounds by this times the solves' `rtol`: about what two solvers differ by.
RESOLVED = 0.3


def formulate(
    specification: Specification,
    rtol: float | None = None,
    solver: str | None = None,
    place: Any = None,
    **options: Any,
) -> Program:
    """The program of a `specification`, solved with the accuracy `rtol` by a `solver` (by default its own).

    **Arguments:** `place`: where many simulations are solved; `options`: as `Program`'s. With `fidelity="auto"` the
    program has a second one for quasi-static poses (`Program.cheap`). Both write their points to the same record.

    **Raises:** `ClearanceError` for a metric that the model of the motion cannot give.
    """
    if specification.fidelity == AUTO:
        shared = {name: options[name] for name in ("record", "known", "progress") if name in options}
        shared["identity"] = _identity(specification, simulations_of(specification, rtol, solver, place))
        options["cheap"] = _program(_posed(specification), simulations_of(_posed(specification), place=place), **shared)
    return _program(specification, simulations_of(specification, rtol, solver, place), **options)


def unposed(specification: Specification) -> str:
    """Why quasi-static poses cannot judge designs, in words; empty if they can."""
    try:
        simulations_of(_posed(specification)).sizes()
    except ClearanceError as error:
        return str(error)
    return ""


def _posed(specification: Specification) -> Specification:
    """The problem by quasi-static poses, which need no neighbours."""
    plain = specification.nominal() if specification.manufacture.among else specification
    return plain.judged_by(QUASI_STATIC)


def _program(specification: Specification, simulations: Simulations, **options: Any) -> Program:
    scenarios, place = scenarios_of(specification), simulations.place
    titles, groups = _titles(specification, simulations, scenarios)

    def evaluate(x, gradient):
        # A program with derivatives is compiled once gradients were asked for. With few variables it then also gives
        # values: to compile another one for values alone would cost more than it saves.
        gradient = gradient or (program.gradients > 0 and len(specification.variables) <= FEW)
        return _evaluate(specification, x, gradient, scenarios, simulations)

    def several(points):
        # One batch: every point is a scenario of the first one, with factors on its variables.
        first = specification.values(points[0])
        factors = [specification.values(x) / first for x in points]
        every = [s._replace(factors=s.factors * factor) for s in scenarios for factor in factors]
        limits = simulations.together(first, every, False)[0].reshape(len(scenarios), len(points), -1)
        return [_point(specification, x, limits[:, i], None) for i, x in enumerate(points)]

    program = Program(
        evaluate,
        specification.names,
        *specification.bounds,
        titles,
        groups=groups,
        several=None if place is None else several,
        fidelity=specification.judge,
        leaders=_leaders(specification, simulations, len(titles)),
        inside=max(INSIDE, RESOLVED * float(simulations.solve.rtol)),
        **{"identity": _identity(specification, simulations), **options},
    )
    return program


def _leaders(specification: Specification, simulations: Simulations, count: int) -> np.ndarray:
    """For each of `count` limits the index of the limit of another model to compare it with. A peak is compared with
    the highest peak of the motion, as the second peak by one model may be another swing than that by the other model.
    """
    if specification.manufacture.title:
        return np.arange(count)
    leaders, size = [], 0  # within one scenario
    for metric, values in zip(simulations.metrics, simulations.sizes(), strict=True):
        leaders += [size] * values if metric.base_metric.ranked else range(size, size + values)
        size += values
    return np.concatenate([np.array(leaders) + scenario for scenario in range(0, count, size)])


def _titles(
    specification: Specification, simulations: Simulations, scenarios: Sequence[Scenario]
) -> tuple[list[str], list[str]]:
    """The title of every limit of the program, and that of the designer's limit that it belongs to."""
    manufacture = specification.manufacture
    if manufacture.title:  # one number for all limits of all parts in a condition
        titles = [manufacture.title + specification.suffix(condition) for condition in specification.conditions]
        return titles, titles
    if manufacture.among:  # one number for each limit of all parts in a condition
        scenarios = [s._replace(title=s.title + manufacture.among) for s in scenarios if s.designed is None]
    pairs = list(zip(specification.limits, simulations.sizes(), strict=True))
    titles = [label + scenario.title for scenario in scenarios for limit, size in pairs for label in limit.labels(size)]
    return titles, [limit.title for _ in scenarios for limit, size in pairs for _ in range(size)]


def _identity(specification: Specification, simulations: Simulations) -> dict[str, Any]:
    """The description of the problem, by names, which tells it from others."""
    described = versions() | numbers(specification.mechanism)
    limits = zip(specification.limits, simulations.metrics, simulations.bounds, strict=True)
    for limit, metric, bound in limits:
        described |= numbers(metric, f" (limit {limit.title})") | {f"bound ({limit.title})": float(bound)}
    for name, cost in zip(specification.variables, specification.costs, strict=False):
        described |= numbers(cost, f" (cost of {name})")
    described |= {f"between ({name})": short(between) for name, between in specification.variables.items()}
    described |= {f"condition {name or 'as given'}": short(of) for name, of in specification.conditions.items()}
    asked = {"t1": specification.t1, "manufacture": specification.manufacture, "common": specification.common}
    if specification.manufacture.among:
        # A search replaces parts as designed by neighbours. Both are one question, with one record.
        asked["manufacture"] = AsDesigned()
    solving = simulations.solve._asdict() | {"fidelity": specification.fidelity}
    return described | in_words(asked) | {f"option {k}": v for k, v in in_words(solving).items()}


def _evaluate(
    specification: Specification, x, gradient, scenarios: Sequence[Scenario], simulations: Simulations
) -> Evaluation:
    return _point(specification, x, *simulations.together(specification.values(x), scenarios, gradient))


def _point(specification: Specification, x: np.ndarray, values: np.ndarray, jacobian: np.ndarray | None) -> Evaluation:
    """The evaluation at `x` from scaled limits in every scenario (scenarios, m) and slopes (scenarios, m, n)."""
    clearances, gradient = specification.values(x), jacobian is not None
    count = len(specification.conditions)
    slopes = [None] * count if jacobian is None else np.split(jacobian, count)
    pairs = zip(np.split(values, count), slopes, strict=True)
    judged, rows = zip(*(specification.manufacture.judge(*pair) for pair in pairs), strict=True)
    values, jacobian = np.concatenate(judged), None if jacobian is None else np.concatenate(rows)
    objective, slope = _objective(specification, clearances)
    if len(x) < len(clearances):  # one common value: its derivative is the sum over the variables
        slope, jacobian = slope.sum(keepdims=True), jacobian if jacobian is None else jacobian.sum(1, keepdims=True)
    return Evaluation(np.array(x), objective, values, slope if gradient else None, jacobian, specification.judge)


def objective_of(specification: Specification, x: np.ndarray) -> float:
    """The objective at variables `x` (n,)."""
    return _objective(specification, specification.values(x))[0]


def _objective(specification: Specification, x: np.ndarray) -> tuple[float, np.ndarray]:
    if specification.common:
        return float(-np.mean(x)), np.full(len(x), -1.0 / len(x))
    pairs = [jax.value_and_grad(cost)(float(c)) for cost, c in zip(specification.costs, x, strict=True)]
    return float(sum(v for v, _ in pairs)), np.array([float(g) for _, g in pairs])
