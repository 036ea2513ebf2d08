"""The section `sweep` of a study: the arguments of `sweep`."""

from typing import Any

import numpy as np

from clearance_jax.ask.question import OPTIONS
from clearance_jax.errors import ClearanceError
from clearance_jax.io.keys.study import AGAIN, AXIS_TABLES, CORRELATION, SWEEP
from clearance_jax.io.scene.scene import read_scene
from clearance_jax.io.study.file import Span, StudyFile
from clearance_jax.io.table import Chosen, TomlTable, naming, variant
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import PARAMETER, units_of
from clearance_jax.sweep.axes import Choice, Sampled, Zipped
from clearance_jax.sweep.scatter import sobol_samples


def sweep_of(study: StudyFile) -> dict[str, Any]:
    """The arguments of `sweep` by name."""
    table = study.table.table("sweep", SWEEP)
    table.need("axis")
    axes = {
        name: _axis(variant(values, where, AXIS_TABLES), name, study) for name, values, where in table.entries("axis")
    }
    varied = {name for axis in axes.values() for name in (axis.values if isinstance(axis, Zipped) else ())}
    ends_vary = "t1" in axes.keys() | varied
    if ends_vary and study.table.has("t1"):
        raise ClearanceError(f"{study.table.key('t1')} is an axis of the sweep too. Take one of the two away.")
    span = Span(study.t0, np.inf) if ends_vary else study.span
    arguments: dict[str, Any] = {
        "mechanism": study.mechanism,
        "axes": axes,
        "outputs": _outputs(table, study, span),
        "t1": None if ends_vary else span.t1,
        "times": table.get("samples"),
        "wrt": table.get("by") or (),
        "derivatives_of": table.get("derivatives_of"),
        **study.options,
    }
    if table.has("again"):
        arguments["again"] = table.table("again", AGAIN).arguments()
    arguments["provenance"] = {"scene": study.scene.text, "study": study.text}
    return arguments


def _outputs(table: TomlTable, study: StudyFile, span: Span) -> dict[str, Any]:
    """What the sweep computes, by name: metrics, and names of quantities."""
    names, quantities = table.get("metrics"), table.get("quantities") or ()
    names = study.metric_names if names is None else names
    if not (names or quantities):
        raise ClearanceError(f"{table.where} asks for nothing: add a table `[metric.NAME]`, or `quantities`.")
    outputs: dict[str, Any] = {name: study.metric(name, span, table.key("metrics")) for name in names}
    for name in quantities:
        if name in outputs:
            raise ClearanceError(f"{table.key('quantities')}: `{name}` is a metric's name too. Rename the metric.")
        outputs[name] = name
    return outputs


def _unit(name: str, mechanism: Mechanism, where: str) -> dict[str, str]:
    """The unit of the number that an axis varies, by its placeholder."""
    with naming(where):
        return {PARAMETER: OPTIONS[name] if name in OPTIONS else units_of(mechanism, [name])[name]}


def _axis(read: Chosen, name: str, study: StudyFile) -> Any:
    kind, table = read
    mechanism, where = study.mechanism, table.where
    if kind == "values":
        return table.get("values", _unit(name, mechanism, where))
    if kind == "range":
        return _range(table, _unit(name, mechanism, where))
    if kind == "zipped":
        table.need("values")
        lists = AXIS_TABLES["values"]
        columns = {}
        for inner, given, there in table.entries("values"):
            column = TomlTable({"values": given, "kind": "values"}, there, lists, _unit(inner, mechanism, there))
            columns[inner] = column.get("values")
        return Zipped(columns)
    if kind in ("sampled", "sensitivity"):
        scatter = study.distributions(table.get("of"), where)
        if kind == "sampled":
            how = table.arguments("kind", "of", "correlation")
            return Sampled(scatter, **how, correlation=_correlation(table) or None)
        with naming(where):
            return Zipped(sobol_samples(scatter, **table.arguments("kind", "of")))
    table.need("scenes")
    files = {label: (given, there) for label, given, there in table.entries("scenes")}
    for given, there in files.values():
        if not isinstance(given, str):
            raise ClearanceError(f"{there} must be the path of a scene file, in quotes.")
    return Choice({label: read_scene(study.path.parent / given).mechanism for label, (given, _) in files.items()})


def _range(table: TomlTable, unit: dict[str, str]) -> np.ndarray:
    first, last = table.get("from", unit), table.get("to", unit)
    if table.get("spacing") == "linear":
        return np.linspace(first, last, table.get("count"))
    if not first * last > 0:
        raise ClearanceError(f"{table.key('spacing')}: equal ratios need a first and a last value of one sign.")
    return np.geomspace(first, last, table.get("count"))


def _correlation(table: TomlTable) -> dict[tuple[str, ...], float]:
    pairs = {}
    for _, values, where in table.entries("correlation"):
        pair = TomlTable(values, where, CORRELATION)
        names = pair.get("between")
        if len(names) != 2:
            raise ClearanceError(f"{pair.key('between')} must be two names, but there are {len(names)}.")
        pairs[names] = pair.get("value")
    return pairs
