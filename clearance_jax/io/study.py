"""Study files: TOML with units to a tolerance problem, on top of a scene file. Keys are strict, as a scene's."""

import dataclasses
import itertools
import warnings
from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.design.costs import AbstractCost, CostTable, Exponential, ExponentialReciprocal, Reciprocal
from clearance_jax.design.manufacture import Band, Yield
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.specification import Limit
from clearance_jax.errors import ClearanceError, quoted, suggest
from clearance_jax.io.files import read_toml
from clearance_jax.io.plausible import ImplausibleWarning, implausible
from clearance_jax.io.scene import Scene, read_scene
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.study_keys import (
    COST_TABLES,
    COUNTS,
    LIMIT_TABLES,
    MANUFACTURE_TABLES,
    METRIC,
    OF,
    OF_ANY_JOINT,
    PARAMETER,
    REDUCTIONS,
    SIGNALS,
    SOLVE,
    STUDY,
    VARIABLE,
    VERIFY,
)
from clearance_jax.io.table import Chosen, Table, chosen, entries, naming
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import replace, units_of
from clearance_jax.units import to_si


class Study(NamedTuple):
    """What a study file says: the problem, how to solve it (arguments of `solve` and `verify`), its name and text."""

    problem: ToleranceProblem
    solve: dict[str, Any]
    verify: dict[str, Any]
    name: str
    text: str


class Span(NamedTuple):
    """From when to when the motion is looked at [s]."""

    t0: float
    t1: float


def load_study(path: str | Path) -> Study:
    """Read a study file. **Raises:** `ClearanceError` naming the file, the key and the fix."""
    path = Path(path)
    text, values = read_toml(path, "study file")
    with naming(str(path)):
        return _study(path, Table(values, f"{path}:", STUDY), text)


def _study(path: Path, top: Table, text: str) -> Study:
    scene = read_scene(path.parent / top.get("scene"))
    mechanism = replace(scene.mechanism, values_by_name(top.named("set"), scene.mechanism))
    said = implausible(mechanism)
    if said:
        warnings.warn(f"{path}: {said}", ImplausibleWarning, stacklevel=3)
    span = _span(top, scene)
    variables, costs = _variables(top, mechanism)
    solve = top.table("solve", SOLVE)
    problem = ToleranceProblem(
        mechanism,
        span.t1,
        variables,
        _limits(top, mechanism, span),
        cost=costs or None,
        conditions=_conditions(top, mechanism),
        manufacture=_manufacture(top.chosen("manufacture", MANUFACTURE_TABLES)) if top.has("manufacture") else None,
        cost_unit=top.get("cost_unit") or "cost units",
        rtol=solve.get("rtol") or scene.solve.get("rtol", 1e-8),
        solver=solve.get("solver") or scene.solve.get("solver", "tsit5"),
        start=scene.solve.get("start", "centre"),
        t0=span.t0,
    )
    search = {"method": solve.get("method"), **solve.given("method", "rtol", "solver")}
    return Study(problem, search, top.table("verify", VERIFY).given(), top.get("name") or path.stem, text)


def _span(top: Table, scene: Scene) -> Span:
    t0, t1 = scene.solve.get("t0", 0.0), top.get("t1") if top.has("t1") else scene.solve.get("t1")
    if t1 is None:
        raise ClearanceError(f"{top.where} lacks the key `t1`, and so does the scene. Add it.")
    if t1 <= t0:
        raise ClearanceError(f"{top.key('t1')} must be greater than the scene's t0 = {t0:g} s, but it is {t1:g} s.")
    return Span(t0, t1)


def _conditions(top: Table, mechanism: Mechanism) -> dict[str, dict[str, float]]:
    tables = top.named("condition")
    return {name: values_by_name(entries(values, where), mechanism) for name, values, where in tables}


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


def _limits(top: Table, mechanism: Mechanism, span: Span) -> list[Limit]:
    tables = top.named("limit")
    return [_limit(name, chosen(values, where, LIMIT_TABLES), mechanism, span) for name, values, where in tables]


def _limit(name: str, read: Chosen, mechanism: Mechanism, span: Span) -> Limit:
    """`metric` over a `signal` of a `point`, `body` or `joint` ("at" given `times`); or a count of a `joint`."""
    kind, table = read
    if kind in COUNTS:
        metric = COUNTS[kind](**_of(COUNTS[kind], kind, table, mechanism))
    else:
        word = table.get("signal")
        signal = SIGNALS[word](**_of(SIGNALS[word], word, table, mechanism))
        metric = REDUCTIONS[kind](signal, *([_times(table, span)] if kind == "at" else []))
    if kind != "at" and table.has("since"):
        metric = dataclasses.replace(metric, since=_since(table, span))
    return Limit(metric, table.get("bound", {METRIC: metric.unit}), name)


def _of(cls: type, word: str, table: Table, mechanism: Mechanism) -> dict[str, str]:
    """What a signal or a count is of, by the names that its class has for it."""
    joints = mechanism.all_joints() if cls in OF_ANY_JOINT else mechanism.clearance_joints()
    names = {
        "point": [point.name for point in mechanism.points],
        "body": [body.name for body in mechanism.bodies],
        "joint": [joint.name for joint in joints],
    }
    wanted = {field.name for field in dataclasses.fields(cls)} & set(OF)
    for key in (key for key in OF if key in table.values and key not in wanted):
        raise ClearanceError(f"{table.key(key)} has no effect: `{word}` is of a {' and a '.join(wanted)}. Remove it.")
    found = {}
    for key in wanted:
        table.need(key)
        found[key] = table.get(key)
        if found[key] not in names[key]:
            kind = "joint with clearance" if key == "joint" and cls not in OF_ANY_JOINT else key
            raise ClearanceError(
                f"{table.key(key)}: the scene has no {kind} {quoted(found[key])}. " + suggest(found[key], names[key])
            )
    return found


def _times(table: Table, span: Span) -> list[float]:
    times = table.get("times")
    increasing = all(a < b for a, b in itertools.pairwise(times))
    if not (increasing and span.t0 <= times[0] and times[-1] <= span.t1):
        raise ClearanceError(
            f"{table.key('times')} must increase from t0 = {span.t0:g} s to t1 = {span.t1:g} s at most, but they are "
            f"{quoted(times)} s."
        )
    return times


def _since(table: Table, span: Span) -> float:
    since = table.get("since")
    if not span.t0 <= since < span.t1:
        raise ClearanceError(
            f"{table.key('since')} must lie between t0 = {span.t0:g} s and t1 = {span.t1:g} s, but it is {since:g} s."
        )
    return since


# Manufacture ---------------------------------------------------------------------------------------------------------


def _manufacture(read: Chosen) -> Band | Yield:
    """`least`, the share of a clearance that a band goes down to; or the scatter, and the share that must hold."""
    kind, table = read
    if kind == "band":
        return Band(**table.given("kind"))
    # Percentages are read as such, which pint takes for a unit.
    scatter = {name: to_si(value, "percent", where) / 100 for name, value, where in table.named("scatter")}
    return Yield(scatter, **table.given("kind", "scatter"))
