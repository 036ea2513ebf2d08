"""Sweep files: TOML with units to the arguments of `sweep`, on top of a scene file. Keys are strict, as a scene's."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.errors import ClearanceError
from clearance_jax.io.asking import Asked, asked
from clearance_jax.io.asking_keys import PARAMETER
from clearance_jax.io.metric import Span, metric_of
from clearance_jax.io.recurrence_keys import RECURRENCE_KEYS, recurrence_of
from clearance_jax.io.scene import read_scene
from clearance_jax.io.sweep_keys import AGAIN, AXIS_TABLES, CORRELATION, OUTPUT_TABLES, SCATTER_TABLES, SOLVE, SWEEP
from clearance_jax.io.table import Table, chosen, naming
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import units_of
from clearance_jax.sweep.axes import OPTIONS, Choice, Sampled, Zipped
from clearance_jax.sweep.distributions import AbstractDistribution, LogNormal, Normal, TruncatedNormal, Uniform
from clearance_jax.sweep.saltelli import sobol_samples

_LAWS = {"normal": Normal, "log-normal": LogNormal, "uniform": Uniform, "truncated-normal": TruncatedNormal}


class SweepFile(NamedTuple):
    """What a sweep file says: the arguments of `sweep` by name, its name and text."""

    arguments: dict[str, Any]
    name: str
    text: str


def load_sweep(path: str | Path) -> SweepFile:
    """Read a sweep file. **Raises:** `ClearanceError` naming the file, the key and the fix."""
    path = Path(path)
    with naming(str(path)):
        return _sweep(asked(path, "sweep", SWEEP))


def _sweep(sweep: Asked) -> SweepFile:
    top, mechanism, path = sweep.table, sweep.mechanism, sweep.path
    for key in ("axis", "output"):
        top.need(key)
    axes = {name: _axis(name, values, where, mechanism, path) for name, values, where in top.named("axis")}
    varied = {name for given in axes.values() for name in (given.values if isinstance(given, Zipped) else ())}
    given = not ({"t1"} & (axes.keys() | varied))
    span = sweep.span() if given else Span(sweep.scene.solve.get("t0", 0.0), np.inf)
    arguments: dict[str, Any] = {
        "mechanism": mechanism,
        "axes": axes,
        "outputs": {name: _output(values, where, mechanism, span) for name, values, where in top.named("output")},
        "t1": span.t1 if given else None,
        "times": top.get("samples"),
        "wrt": top.get("wrt") or (),
        "derivatives_of": top.get("derivatives_of"),
        **sweep.usual("t0", "rtol", "solver", "start"),
        **top.table("solve", SOLVE).given(),
    }
    if top.has("again"):
        arguments["again"] = top.table("again", AGAIN).given()
    arguments["provenance"] = {"scene": sweep.scene.text, "sweep": sweep.text}
    return SweepFile(arguments, sweep.name, sweep.text)


def _unit(name: str, mechanism: Mechanism, where: str) -> dict[str, str]:
    """The unit of what an axis varies, by the word that its keys have for it."""
    with naming(where):
        return {PARAMETER: OPTIONS[name] if name in OPTIONS else units_of(mechanism, [name])[name]}


def _axis(name: str, values: Any, where: str, mechanism: Mechanism, path: Path) -> Any:
    kind, table = chosen(values, where, AXIS_TABLES)
    if kind == "values":
        return table.get("values", _unit(name, mechanism, where))
    if kind == "range":
        unit = _unit(name, mechanism, where)
        first, last = table.get("from", unit), table.get("to", unit)
        if table.get("spacing") == "linear":
            return np.linspace(first, last, table.get("count"))
        if not first * last > 0:
            raise ClearanceError(f"{table.key('spacing')}: equal ratios need a first and a last value of one sign.")
        return np.geomspace(first, last, table.get("count"))
    if kind == "zipped":
        table.need("values")
        lists = AXIS_TABLES["values"]
        return Zipped(
            {
                inner: Table({"values": given, "kind": "values"}, there, lists, _unit(inner, mechanism, there)).get(
                    "values"
                )
                for inner, given, there in table.named("values")
            }
        )
    if kind == "sampled":
        return _sampled(table, mechanism)
    if kind == "sensitivity":
        with naming(where):
            return Zipped(sobol_samples(_scatter(table, mechanism), **table.given("kind", "scatter")))
    table.need("scenes")
    files = {label: (given, there) for label, given, there in table.named("scenes")}
    for given, there in files.values():
        if not isinstance(given, str):
            raise ClearanceError(f"{there} must be the path of a scene file, in quotes.")
    return Choice({label: read_scene(path.parent / given).mechanism for label, (given, _) in files.items()})


def _scatter(table: Table, mechanism: Mechanism) -> dict[str, AbstractDistribution]:
    """How each parameter of an axis scatters."""
    table.need("scatter")
    found = {}
    for name, values, where in table.named("scatter"):
        law, own = chosen(values, where, SCATTER_TABLES, _unit(name, mechanism, where))
        found[name] = _LAWS[law](**own.given("law"))
    return found


def _sampled(table: Table, mechanism: Mechanism) -> Sampled:
    scatter, pairs = _scatter(table, mechanism), {}
    for _, values, where in table.named("correlation"):
        own = Table(values, where, CORRELATION)
        names = own.get("between")
        if len(names) != 2:
            raise ClearanceError(f"{own.key('between')} must be two names, but there are {len(names)}.")
        pairs[names] = own.get("value")
    return Sampled(scatter, **table.given("kind", "scatter", "correlation"), correlation=pairs or None)


def _output(values: Any, where: str, mechanism: Mechanism, span: Span) -> Any:
    read = chosen(values, where, OUTPUT_TABLES)
    if read.word in RECURRENCE_KEYS:
        return recurrence_of(read)
    return read.table.get("of") if read.word == "quantity" else metric_of(read, mechanism, span)
