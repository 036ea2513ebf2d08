"""The section `design` of a study: a tolerance problem, how it is solved, and how its answer is proved."""

import itertools
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.design.asked.classes import Candidates, Entry, ToleranceClass, classes_of, priced
from clearance_jax.design.asked.conditions import Payload, condition_product
from clearance_jax.design.asked.costs import COSTS, POWER, AbstractCost
from clearance_jax.design.asked.manufacture import MANUFACTURE, AbstractManufacture
from clearance_jax.design.asked.problem import ToleranceProblem
from clearance_jax.design.asked.specification import Limit
from clearance_jax.errors import ClearanceError, naming, quote, unknown_name, wrong_value
from clearance_jax.io.keys import design as keys
from clearance_jax.io.keys.metric import METRIC
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.study.file import StudyFile, expand_entries, of_parameter
from clearance_jax.io.study.wear import WearAsked
from clearance_jax.io.table import Chosen, TomlTable, entries
from clearance_jax.io.trajectory import read_trajectory
from clearance_jax.joints.gears import backlash, thickness_allowances
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import PARAMETER
from clearance_jax.wear import AfterWear

OF_CLASSES = "class_costs", "class_least", "class_greatest"


class DesignAsked(NamedTuple):
    """The section as read: the problem, and the arguments of `solve`, `verify` and, if asked for, `tradeoff`."""

    problem: ToleranceProblem
    solve: dict[str, Any]
    verify: dict[str, Any]
    tradeoff: dict[str, Any] | None = None


def design_of(study: StudyFile, wear: WearAsked | None) -> DesignAsked:
    """Read the section. **Raises:** `ClearanceError` naming the key and the fix."""
    table = study.table.table("design", keys.DESIGN)
    mechanism, model = (study.mechanism,) * 2 if wear is None else (wear.model.mechanism, wear.model)
    trajectories = {}
    for name, file, where in table.entries("trajectory"):
        with naming(where):
            path = study.folder / keys.TRAJECTORY.read(file, where, {})
            trajectories[name] = read_trajectory(path, mechanism)
    if trajectories:
        if wear is not None:
            raise ClearanceError(f"{table.key('trajectory')}: with a section `wear` the scene drives the mechanism.")
        # The numbers of these drives are varied to make the others.
        model = mechanism = mechanism.with_drives(next(iter(trajectories.values())))
    variable_entries = expand_entries(table, "variable", mechanism).items()
    tables = {name: of_parameter(name, *entry, keys.VARIABLE, mechanism) for name, entry in variable_entries}
    variables, costs = _variables(tables)
    limits = [_limit(name, TomlTable(inner, at, keys.LIMIT), study, wear) for name, inner, at in table.entries("limit")]
    how = {"cost": costs or None, "conditions": _conditions(table, mechanism, model, trajectories)}
    how |= {"manufacture": _manufacture(table, study, model, tuple(tables)), **table.only("cost_unit")}
    options = {**study.options, **table.only("fidelity")}
    problem = ToleranceProblem(mechanism, study.span.t1, variables, limits, **how, **options)
    search = {"method": table.get("method"), **table.only("starts", "most")}
    verify = table.table("verify", keys.VERIFY)
    if classes := _classes(table, tables, problem):
        search["classes"] = classes
        verify.refuse("starts", "reoptimise", why="has no effect where `classes` are chosen. Leave it out.")
    return DesignAsked(problem, search, verify.arguments(), _tradeoff(table, problem))


def _tradeoff(top: TomlTable, problem: ToleranceProblem) -> dict[str, Any] | None:
    """The arguments of `tradeoff`; `None`: not asked for."""
    if not top.has("tradeoff"):
        return None
    table = top.table("tradeoff", keys.TRADEOFF)
    limit, limits = table.get("limit"), [limit.title for limit in problem.specification.limits]
    if problem.specification.manufacture.title:
        table.refuse("limit", why="has no effect: a yield is of all limits at once. Leave it out.")
    if limit is not None and limit not in limits:
        raise unknown_name(f"{table.key('limit')}: there is no limit {quote(limit)}.", limit, limits)
    for factor in table.get("factors") or ():
        if not factor > 0:
            table.refuse("factors", why=f"must be above 0, but one is {factor:g}. Leave it out.")
    return table.arguments()


def _classes(top: TomlTable, tables: dict[str, TomlTable], problem: ToleranceProblem) -> Candidates:
    """Candidate classes by variable, with their costs if given. They are checked before any solve."""
    chosen = {}
    for name, table in tables.items():
        if not table.has("classes"):
            table.refuse(*OF_CLASSES, "gears", why="has no effect without `classes`. Add them.")
            continue
        words = table.get("classes")
        for key, given in table.only(*OF_CLASSES).items():
            if len(given) != len(words):
                table.refuse(key, why=f"must be as many as `classes`, {len(words)}, but they are {len(given)}.")
        entries, costs = _entries(table, words), table.get("class_costs")
        chosen[name] = dict(zip(entries, costs, strict=True)) if costs else entries
    with naming(top.where):
        if chosen:
            priced(problem.specification, classes_of(problem.specification, chosen))
    return chosen


def _entries(table: TomlTable, words: tuple[str, ...]) -> tuple[Entry, ...]:
    """The classes of a variable by their names: fits, classes of gears, or those of the file itself."""
    if table.has("class_least") or table.has("class_greatest"):
        table.need("class_least", "class_greatest")
        table.refuse("gears", why="has no effect beside `class_least`, which says the classes. Leave one of them out.")
        ends = zip(words, table.get("class_least"), table.get("class_greatest"), strict=True)
        return tuple(ToleranceClass(*each) for each in ends)
    if not table.has("gears"):
        return words
    for i, word in enumerate(words):
        with naming(f"{table.key('classes')}[{i}]"):
            for part in word.split("/"):
                thickness_allowances(1e-3, part)
    gears = table.table("gears", keys.GEARS)
    given = gears.arguments("internal")
    if len(given["teeth"]) != 2 or not all(count.is_integer() for count in given["teeth"]):
        raise wrong_value(gears.key("teeth"), "two whole numbers, of pinion and wheel", given["teeth"])
    pinion, wheel = map(int, given["teeth"])
    given["teeth"] = pinion, -wheel if gears.get("internal") else wheel
    if np.ndim(both := given.get("centre_tolerance", 0.0)):
        given["centre_tolerance"] = tuple(map(float, both))
    with naming(gears.where):
        return tuple(backlash(tolerance_class=tuple(w.split("/")) if "/" in w else w, **given) for w in words)


def _conditions(table: TomlTable, mechanism: Mechanism, model: Any, trajectories: dict) -> dict[str, dict[str, Any]]:
    """The product of conditions, trajectories, payloads and speeds: numbers by the name of each condition."""
    tables = table.entries("condition")
    conditions = {name: values_by_name(entries(values, where), model) for name, values, where in tables}
    payloads = {}
    for name, values, where in table.entries("payload"):
        with naming(where):
            payloads[name] = Payload(**TomlTable(values, where, keys.PAYLOAD).arguments())
    if not (trajectories or payloads or table.has("speed")):
        return conditions
    with naming(table.where):
        return condition_product(mechanism, trajectories, payloads, table.get("speed"), conditions)


def _variables(tables: dict[str, TomlTable]) -> tuple[dict[str, tuple[float, float]], dict[str, AbstractCost]]:
    bounds, costs = {}, {}
    for name, table in tables.items():
        unit, where = table.words[PARAMETER], table.where
        bounds[name] = lower, upper = table.get("lower"), table.get("upper")
        if not 0 < lower < upper:
            given = f"{lower:g} and {upper:g} {unit}".rstrip()
            why = "its bounds contradict each other: 0 < lower < upper must hold"
            raise ClearanceError(f"{where}: {why}, but they are {given}.").about(where, upper)
        if table.has("cost"):
            costs[name] = _cost(table.variant("cost", keys.COST_TABLES), unit)
    return bounds, costs


def _cost(read: Chosen, unit: str) -> AbstractCost:
    """The cost law. Its constants have powers of the variable's unit: `factor = "20 um"`."""
    law, table = read
    if law == "table" and any(b > a for a, b in itertools.pairwise(table.get("costs"))):
        table.refuse("costs", why=f"must fall as the clearance grows, but it is {quote(table.get('costs'))}.")
    power = table.get("power") if law.endswith("reciprocal") else 1.0
    units = {f"1/{PARAMETER}": f"1/({unit})", POWER: f"({unit})**{power:g}"}
    # Longer placeholders come first: they contain the parameter's.
    table.words = {**(units if unit else dict.fromkeys(units, "")), **table.words}
    with naming(table.where):
        return COSTS[law](**table.arguments("law"))


def _limit(name: str, table: TomlTable, study: StudyFile, wear: WearAsked | None) -> Limit:
    metric: Any = study.metric(name, study.span, table.where)
    bound = table.get("bound", {METRIC: metric.unit})
    if wear is None:
        table.refuse("cycles", why="has no effect without a section `wear`, which says how a joint wears. Add it.")
    elif table.has("cycles"):
        how = {name: getattr(wear.model, name) for name in ("joint", "wear", "pressure", "cycle")}
        how |= {name: wear.options[name] for name in ("sectors", "tolerance")}
        metric = AfterWear(metric, cycles=table.get("cycles"), **how)
    return Limit(metric, bound, name)


def _manufacture(top: TomlTable, study: StudyFile, model: Any, names: tuple[str, ...]) -> AbstractManufacture | None:
    if not top.has("manufacture"):
        return None
    kind, table = top.variant("manufacture", keys.MANUFACTURE_TABLES)
    arguments = table.arguments("kind", "of")
    if "of" in [key.name for key in keys.MANUFACTURE_TABLES[kind].keys]:
        arguments["scatter"] = _scatter(study, table, model, names)
    return MANUFACTURE[kind](**arguments)


def _scatter(study: StudyFile, table: TomlTable, model: Any, variables: tuple[str, ...]) -> dict[str, Any]:
    """Of each number that scatters the relative deviation about its value, or its distribution."""
    scatters, asked = {}, study.scatter(table.get("of"), model, table.where)
    for name, how in asked.items():
        about = how.relative is not None and (how.mean, how.lower, how.upper) == (None, None, None)
        if about and how.distribution in ("normal", "log-normal"):
            scatters[name] = how.relative
        elif name in variables:
            raise ClearanceError(
                f"{how.where}: of a yield a variable scatters about what is designed: give a `deviation` in percent, "
                "and nothing else; it scatters normal or log-normal, not uniform."
            ).about(how.where)
        else:
            scatters |= study.distributions([name], table.where, model)
    return scatters
