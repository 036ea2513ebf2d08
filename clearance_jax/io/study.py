"""Study files: TOML with units to a tolerance problem, on top of a scene file. Keys are strict, as a scene's."""

import itertools
import warnings
from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.design.costs import AbstractCost, CostTable, Exponential, ExponentialReciprocal, Reciprocal
from clearance_jax.design.manufacture import MANUFACTURE, AbstractManufacture
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.specification import Limit
from clearance_jax.errors import ClearanceError, quoted
from clearance_jax.io.asking import Asked, asked
from clearance_jax.io.asking_keys import PARAMETER
from clearance_jax.io.metric import Span, metric_of
from clearance_jax.io.metric_keys import METRIC
from clearance_jax.io.plausible import ImplausibleWarning, implausible
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.study_keys import (
    COST_TABLES,
    LIFE,
    LIMIT_TABLES,
    MANUFACTURE_TABLES,
    SOLVE,
    STUDY,
    VARIABLE,
    VERIFY,
)
from clearance_jax.io.table import Chosen, Table, chosen, entries, naming
from clearance_jax.io.wear_model import wear_model
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric
from clearance_jax.parameters import units_of
from clearance_jax.units import to_si
from clearance_jax.wear import AfterWear, WearModel


class Study(NamedTuple):
    """What a study file says: the problem, how to solve it (arguments of `solve` and `verify`), its name and text."""

    problem: ToleranceProblem
    solve: dict[str, Any]
    verify: dict[str, Any]
    name: str
    text: str


def load_study(path: str | Path) -> Study:
    """Read a study file. **Raises:** `ClearanceError` naming the file, the key and the fix."""
    path = Path(path)
    with naming(str(path)):
        return _study(asked(path, "study", STUDY))


def _study(study: Asked) -> Study:
    top, mechanism, usual = study.table, study.mechanism, study.usual("rtol", "solver", "start")
    said = implausible(mechanism)
    if said:
        warnings.warn(f"{study.path}: {said}", ImplausibleWarning, stacklevel=3)
    span = study.span()
    life = _life(top, mechanism, span) if top.has("life") else None
    mechanism = mechanism if life is None else life.model.mechanism
    variables, costs = _variables(top, mechanism)
    solve = top.table("solve", SOLVE)
    problem = ToleranceProblem(
        mechanism,
        span.t1,
        variables,
        _limits(top, mechanism, span, life),
        cost=costs or None,
        conditions=_conditions(top, mechanism if life is None else life.model),
        manufacture=_manufacture(top.chosen("manufacture", MANUFACTURE_TABLES)) if top.has("manufacture") else None,
        cost_unit=top.get("cost_unit") or "cost units",
        rtol=solve.get("rtol") or usual.get("rtol", 1e-8),
        solver=solve.get("solver") or usual.get("solver", "tsit5"),
        start=solve.get("start") or usual.get("start", "centre"),
        t0=span.t0,
    )
    search = {"method": solve.get("method"), **solve.given("method", "rtol", "solver", "start")}
    return Study(problem, search, top.table("verify", VERIFY).given(), study.name, study.text)


def _conditions(top: Table, model: Any) -> dict[str, dict[str, float]]:
    tables = top.named("condition")
    return {name: values_by_name(entries(values, where), model) for name, values, where in tables}


# Variables and what they cost ----------------------------------------------------------------------------------------


def _variables(top: Table, mechanism: Mechanism) -> tuple[dict[str, tuple[float, float]], dict[str, AbstractCost]]:
    """Bounds and costs by the variables' names."""
    bounds, costs = {}, {}
    for name, values, where in top.named("variable"):
        with naming(where):
            unit = units_of(mechanism, [name])[name]
        table = Table(values, where, VARIABLE, {PARAMETER: unit})
        bounds[name] = least, greatest = table.get("least"), table.get("greatest")
        if not 0 < least < greatest:
            raise ClearanceError(
                f"{where}: its bounds contradict each other: 0 < least < greatest must hold, but they are "
                f"{least:g} and {greatest:g} {unit}".rstrip()
                + "."
            )
        if table.has("cost"):
            costs[name] = _cost(table.chosen("cost", COST_TABLES), unit)
    return bounds, costs


def _cost(read: Chosen, unit: str) -> AbstractCost:
    """Constants are in a currency times or over a power of the variable's unit: `factor = "20 um"`."""
    law, table = read
    if law == "table":
        return _cost_table(table)
    words = {f"1/{PARAMETER}": f"1/({unit})" if unit else ""}
    fixed = table.get("fixed")
    if law == "exponential":
        return Exponential(table.get("factor"), table.get("rate", words), fixed)
    power = table.get("power")
    factor = table.get("factor", {f"{PARAMETER} to the power": f"({unit})**{power:g}" if unit else ""})
    if law == "reciprocal":
        return Reciprocal(factor, power, fixed)
    return ExponentialReciprocal(factor, table.get("rate", words), power, fixed)


def _cost_table(table: Table) -> CostTable:
    clearances, costs = table.get("clearances"), table.get("costs")
    if any(b > a for a, b in itertools.pairwise(costs)):
        raise ClearanceError(f"{table.key('costs')} must fall as the clearance grows, but it is {quoted(costs)}.")
    with naming(table.where):
        return CostTable(clearances, costs)


# Limits --------------------------------------------------------------------------------------------------------------


class _Life(NamedTuple):
    """What a table `life` says."""

    model: WearModel
    sectors: int | None
    tolerance: float

    def aged(self, metric: AbstractMetric, cycles: tuple[int, ...]) -> AfterWear:
        """A metric after so many cycles of wear."""
        model = self.model
        how = {"joint": model.joint, "wear": model.wear, "pressure": model.pressure, "cycle": model.cycle}
        return AfterWear(metric, cycles=cycles, sectors=self.sectors, tolerance=self.tolerance, **how)


def _life(top: Table, mechanism: Mechanism, span: Span) -> _Life:
    table = top.table("life", LIFE)
    cycle = table.get("cycle")
    if cycle is not None and cycle <= span.t0:
        raise ClearanceError(
            f"{table.key('cycle')} must be greater than the scene's t0 = {span.t0:g} s, but it is {cycle:g} s."
        )
    model = wear_model(table, mechanism, span.t1 if cycle is None else cycle)
    return _Life(model, table.get("sectors"), table.get("tolerance"))


def _limits(top: Table, mechanism: Mechanism, span: Span, life: _Life | None) -> list[Limit]:
    read = [(name, chosen(values, where, LIMIT_TABLES)) for name, values, where in top.named("limit")]
    if life is not None and not any(one.table.has("cycles") for _, one in read):
        raise ClearanceError(f"{top.key('life')} has no effect: no limit has `cycles`. Add them to one, or remove it.")
    return [_limit(name, one, mechanism, span, life) for name, one in read]


def _limit(name: str, read: Chosen, mechanism: Mechanism, span: Span, life: _Life | None) -> Limit:
    metric = metric_of(read, mechanism, span)
    bound = read.table.get("bound", {METRIC: metric.unit})
    if not read.table.has("cycles"):
        return Limit(metric, bound, name)
    if life is None:
        raise ClearanceError(
            f"{read.table.key('cycles')} has no effect without a table `life`, which says how a joint wears. Add it."
        )
    return Limit(life.aged(metric, read.table.get("cycles")), bound, name)


# Manufacture ---------------------------------------------------------------------------------------------------------


def _manufacture(read: Chosen) -> AbstractManufacture:
    kind, table = read
    given = table.given("kind")
    for key in (key for key, value in given.items() if isinstance(value, dict)):
        # Percentages are read as such, which pint takes for a unit.
        given[key] = {name: to_si(value, "percent", where) / 100 for name, value, where in table.named(key)}
    return MANUFACTURE[kind](**given)
