"""Study files: TOML with units to a tolerance problem, on top of a scene file. Keys are strict, as a scene's."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from clearance_jax.analysis import metrics
from clearance_jax.design.costs import AbstractCost, CostTable, Exponential, ExponentialReciprocal, Reciprocal
from clearance_jax.design.manufacture import Band, Yield
from clearance_jax.design.methods import METHOD_CHOICES
from clearance_jax.design.problem import ToleranceProblem
from clearance_jax.design.specification import Limit
from clearance_jax.errors import ClearanceError
from clearance_jax.io.scene import Table, load_scene, parse_setting
from clearance_jax.parameters import replace, units_of
from clearance_jax.solve.simulate import SOLVERS
from clearance_jax.units import to_si

SIGNALS = {
    "position-error": metrics.PositionError,
    "path-deviation": metrics.PathDeviation,
    "orientation-error": metrics.OrientationError,
    "contact-force": metrics.ContactForce,
    "acceleration": metrics.Acceleration,
}
REDUCTIONS = {"peak": metrics.Peak, "rms": metrics.Rms, "mean": metrics.Mean, "at": metrics.At}
COUNTS = {"energy-lost": metrics.EnergyLost, "impacts": metrics.Impacts}
LONGEST_UNIT = 20  # characters of `cost_unit`: it stands in the heads of tables
COSTS = {"reciprocal", "exponential", "exponential-reciprocal", "table"}


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
    try:
        text = path.read_text(encoding="utf-8")
        top = Table(tomllib.loads(text), f"{path}:")
    except OSError as error:
        raise ClearanceError(f"Cannot read the study file `{path}`: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ClearanceError(f"`{path}` is not valid TOML: {error}.") from None
    try:
        return _study(path, top, text)
    except ClearanceError as error:
        if str(path) in str(error):
            raise
        raise ClearanceError(f"{path}: {error}") from None


def _study(path: Path, top: Table, text: str) -> Study:
    scene = load_scene(path.parent / str(top.need("scene")))
    mechanism = scene.mechanism
    mechanism = replace(mechanism, _values(top.table("set"), mechanism))
    variables, costs = {}, {}
    for name, table in top.tables("variable"):
        unit = _unit(table, name, mechanism)
        variables[name] = tuple(to_si(table.need(end), unit, table.key(end)) for end in ("least", "greatest"))
        if table.has("cost"):
            costs[name] = _cost(table.table("cost"), unit)
        table.finish(("cost",))
    limits = [_limit(name, table) for name, table in top.tables("limit")]
    conditions = {name: _values(table, mechanism) for name, table in top.tables("condition")}
    if top.has("made"):
        raise ClearanceError(f"{top.key('made')} is called `manufacture` now. Rename the table.")
    manufacture = _manufacture(top.table("manufacture")) if top.has("manufacture") else None
    t1 = top.number("t1", "s")
    if t1 is None and "t1" not in scene.solve:
        raise ClearanceError(f"{top.where} lacks the key `t1`, and so does the scene. Add it.")
    solver = top.table("solve")
    problem_options: dict[str, Any] = {
        "rtol": solver.get("rtol", scene.solve.get("rtol", 1e-8)),
        "solver": solver.word("solver", SOLVERS, scene.solve.get("solver", "tsit5")),
    }
    solve = {"method": solver.word("method", METHOD_CHOICES, "slsqp"), **_numbers(solver, starts=1, most=1)}
    solver.finish()
    verify = top.table("verify")
    checks = _numbers(verify, sweep=2, starts=0, samples=1)
    if verify.has("reoptimise"):
        checks["reoptimise"] = bool(verify.get("reoptimise"))
    verify.finish()
    name = str(top.get("name", path.stem))
    cost_unit = _cost_unit(top)
    top.finish()
    problem = ToleranceProblem(
        mechanism,
        scene.solve["t1"] if t1 is None else t1,
        variables,
        limits,
        cost=costs or None,
        conditions=conditions,
        manufacture=manufacture,
        cost_unit=cost_unit,
        **problem_options,
    )
    return Study(problem, solve, checks, name, text)


def _cost_unit(top: Table) -> str:
    """What the costs' constants are counted in."""
    unit = top.get("cost_unit", "cost units")
    if not isinstance(unit, str) or not 0 < len(unit.strip()) <= LONGEST_UNIT:
        raise ClearanceError(
            f'{top.key("cost_unit")} must be a short word, but it is {unit!r:.60}. Write it as "EUR", or leave it out.'
        )
    return unit.strip()


def _unit(table: Table, name: str, mechanism) -> str:
    return units_of(mechanism, [name])[name]


def _values(table: Table, mechanism) -> dict[str, float]:
    """Parameters by name from quantities."""
    return dict(parse_setting(f"{name}={table.get(name)}", mechanism) for name in table.values)


def _numbers(table: Table, **least: int) -> dict[str, int]:
    """Whole numbers that are there, each at least so large."""
    found = {}
    for name, smallest in least.items():
        if table.has(name):
            value = table.get(name)
            if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
                raise ClearanceError(
                    f"{table.key(name)} must be a whole number of at least {smallest}, but it is {value!r}."
                )
            found[name] = value
    return found


def _limit(name: str, table: Table) -> Limit:
    """`metric` over a `signal` of a `point`, `body` or `joint` ("at" given `times`); or a count of a `joint`."""
    kind = table.word("metric", {*REDUCTIONS, *COUNTS})
    if kind in REDUCTIONS:
        signal = SIGNALS[table.word("signal", SIGNALS)]
        times = ([to_si(v, "s", table.key("times")) for v in table.need("times")],) if kind == "at" else ()
        metric = REDUCTIONS[kind](signal(**_names(signal, table)), *times)
    else:
        metric = COUNTS[kind](**_names(COUNTS[kind], table))
    bound = table.need("bound")
    limit = Limit(metric, to_si(bound, metric.unit, table.key("bound")), name)
    table.finish()
    return limit


def _names(cls, table: Table) -> dict[str, str]:
    return {field.name: str(table.need(field.name)) for field in dataclasses.fields(cls)}


def _cost(table: Table, unit: str) -> AbstractCost:
    """Constants are in a currency times or over a power of the variable's unit: `factor = "20 um"`."""
    law = table.word("law", COSTS)
    if law == "table":
        sizes = [to_si(v, unit, table.key("clearances")) for v in table.need("clearances")]
        cost: AbstractCost = CostTable(sizes, [to_si(v, "", table.key("costs")) for v in table.need("costs")])
    else:
        power, inverse = table.number("power", ""), f"1/({unit})" if unit else ""
        fixed = table.number("fixed", "") or 0.0
        table.need("factor")
        if law == "exponential":
            table.need("rate")
            cost = Exponential(table.number("factor", ""), table.number("rate", inverse), fixed)
        else:
            power = 1.0 if power is None else power
            factor = table.number("factor", f"({unit})**{power:g}" if unit else "")
            if law == "reciprocal":
                cost = Reciprocal(factor, power, fixed)
            else:
                table.need("rate")
                cost = ExponentialReciprocal(factor, table.number("rate", inverse), power, fixed)
    table.finish()
    return cost


def _manufacture(table: Table) -> Band | Yield:
    """`least`, the share of a clearance that a band goes down to; or the scatter, and the share that must hold."""
    kind = table.word("kind", {"band", "yield"})
    if kind == "band":
        table.need("least")
        manufacture: Band | Yield = Band(table.number("least", ""), **_numbers(table, points=2, corners=0))
    else:
        inner = table.table("scatter")
        # Percentages are read as such, which pint takes for a unit.
        scatter = {name: to_si(inner.get(name), "percent", inner.key(name)) / 100 for name in inner.values}
        target = table.number("target", "")
        options = {} if target is None else {"target": target}
        manufacture = Yield(scatter, **options, **_numbers(table, samples=1, seed=0))
    table.finish()
    return manufacture
