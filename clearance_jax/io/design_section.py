"""The section `design` of a study: a tolerance problem, how it is solved, and how its answer is proved."""

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

from clearance_jax.design.costs import COSTS, POWER, AbstractCost
from clearance_jax.design.manufacture import MANUFACTURE, AbstractManufacture
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.specification import Limit
from clearance_jax.errors import ClearanceError, quote
from clearance_jax.io.asking import Asked, Scatter
from clearance_jax.io.asking_keys import METRIC
from clearance_jax.io.design_keys import COST_TABLES, DESIGN, LIMIT, MANUFACTURE_TABLES, VARIABLE, VERIFY
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.table import Chosen, Table, entries, naming
from clearance_jax.io.wear_section import WearAsked
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import PARAMETER, units_of
from clearance_jax.wear import AfterWear


class DesignAsked(NamedTuple):
    """What the section says: the problem, and how to solve and to verify it (arguments of `solve` and `verify`)."""

    problem: ToleranceProblem
    solve: dict[str, Any]
    verify: dict[str, Any]


def design_of(study: Asked, wear: WearAsked | None) -> DesignAsked:
    """What the section says. **Raises:** `ClearanceError` naming the key and the fix."""
    table = study.table.table("design", DESIGN)
    mechanism, model = (study.mechanism,) * 2 if wear is None else (wear.model.mechanism, wear.model)
    variables, costs = _variables(table, mechanism)
    limits = [_limit(name, Table(values, where, LIMIT), study, wear) for name, values, where in table.entries("limit")]
    problem = ToleranceProblem(
        mechanism,
        study.span.t1,
        variables,
        limits,
        cost=costs or None,
        conditions=_conditions(table, model),
        manufacture=_manufacture(table, study, model),
        cost_unit=table.get("cost_unit") or "cost units",
        **{**study.options, **table.only("fidelity")},
    )
    search = {"method": table.get("method"), **table.only("starts", "most")}
    return DesignAsked(problem, search, table.table("verify", VERIFY).arguments())


def _conditions(table: Table, model: Any) -> dict[str, dict[str, float]]:
    tables = table.entries("condition")
    return {name: values_by_name(entries(values, where), model) for name, values, where in tables}


# Variables and what they cost ----------------------------------------------------------------------------------------


def _variables(top: Table, mechanism: Mechanism) -> tuple[dict[str, tuple[float, float]], dict[str, AbstractCost]]:
    """Bounds and costs by the variables' names."""
    bounds, costs = {}, {}
    for name, values, where in top.entries("variable"):
        with naming(where):
            unit = units_of(mechanism, [name])[name]
        table = Table(values, where, VARIABLE, {PARAMETER: unit})
        bounds[name] = lower, upper = table.get("lower"), table.get("upper")
        if not 0 < lower < upper:
            raise ClearanceError(
                f"{where}: its bounds contradict each other: 0 < lower < upper must hold, but they are "
                f"{lower:g} and {upper:g} {unit}".rstrip()
                + "."
            )
        if table.has("cost"):
            costs[name] = _cost(table.variant("cost", COST_TABLES), unit)
    return bounds, costs


def _cost(read: Chosen, unit: str) -> AbstractCost:
    """Constants are in a currency times or over a power of the variable's unit: `factor = "20 um"`."""
    law, table = read
    if law == "table" and any(b > a for a, b in itertools.pairwise(table.get("costs"))):
        raise ClearanceError(
            f"{table.key('costs')} must fall as the clearance grows, but it is {quote(table.get('costs'))}."
        )
    power = table.get("power") if law.endswith("reciprocal") else 1.0
    own = {f"1/{PARAMETER}": f"1/({unit})", POWER: f"({unit})**{power:g}"}
    # The longer words come first: they have the parameter's in them.
    table.words = {**(own if unit else dict.fromkeys(own, "")), **table.words}
    with naming(table.where):
        return COSTS[law](**table.arguments("law"))


# Limits --------------------------------------------------------------------------------------------------------------


def _limit(name: str, table: Table, study: Asked, wear: WearAsked | None) -> Limit:
    metric: Any = study.metric(name, study.span, table.where)
    bound = table.get("bound", {METRIC: metric.unit})
    if table.has("cycles"):
        if wear is None:
            raise ClearanceError(
                f"{table.key('cycles')} has no effect without a section `wear`, which says how a joint wears. Add it."
            )
        model, options = wear.model, wear.options
        how = {"joint": model.joint, "wear": model.wear, "pressure": model.pressure, "cycle": model.cycle}
        how |= {"sectors": options["sectors"], "tolerance": options["tolerance"]}
        metric = AfterWear(metric, cycles=table.get("cycles"), **how)
    return Limit(metric, bound, name)


# Manufacture ---------------------------------------------------------------------------------------------------------


def _manufacture(top: Table, study: Asked, model: Any) -> AbstractManufacture | None:
    if not top.has("manufacture"):
        return None
    kind, table = top.variant("manufacture", MANUFACTURE_TABLES)
    given = table.arguments("kind", "of")
    if "of" in [key.name for key in MANUFACTURE_TABLES[kind].keys]:
        given["scatter"] = _relative(study.scatter(table.get("of"), model, table.where))
    return MANUFACTURE[kind](**given)


def _relative(scatter: Mapping[str, Scatter]) -> dict[str, float]:
    """Relative deviations of numbers that scatter about what is designed."""
    found = {}
    for name, given in scatter.items():
        if given.relative is None or any(number is not None for number in (given.mean, given.lower, given.upper)):
            raise ClearanceError(
                f"{given.where}: of a yield a number scatters about what is designed, or what the scene has: give a "
                "`deviation` in percent, and nothing else."
            )
        if given.distribution not in ("normal", "log-normal"):
            raise ClearanceError(
                f"{given.where}: of a yield a number scatters normal or log-normal, not {given.distribution}."
            )
        found[name] = given.relative
    return found
