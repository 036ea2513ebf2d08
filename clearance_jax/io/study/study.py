"""Reads study files (TOML with units), and their section `sweep`. Unknown keys are errors."""

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax.ask.question import OPTIONS
from clearance_jax.errors import ClearanceError, naming
from clearance_jax.io.keys.study import AGAIN, AXIS_TABLES, CORRELATION, SWEEP
from clearance_jax.io.scene.scene import ImplausibleWarning, implausible, read_scene
from clearance_jax.io.study.calibrate import calibration_of
from clearance_jax.io.study.design import DesignAsked, design_of
from clearance_jax.io.study.file import Span, StudyFile
from clearance_jax.io.study.wear import WearAsked, wear_of
from clearance_jax.io.table import Chosen, TomlTable, variant
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.parameters import PARAMETER, units_of
from clearance_jax.sweep.axes import Choice, Sampled, Zipped, sobol_samples


class Study(NamedTuple):
    """A study file as read.

    - `name` of the study, `text` of the file, `scene_text` of its scene; `mechanism`: that of the scene, with the
      numbers that the study sets.
    - `sweep`: the arguments of `cj.sweep`; `design`: the problem, how to solve and verify it; `wear`: how a joint
      wears; `calibrate`: the arguments of `cj.calibrate`. `None`: the study has no such section.
    """

    name: str
    text: str
    scene_text: str
    mechanism: Mechanism
    sweep: dict[str, Any] | None
    design: DesignAsked | None
    wear: WearAsked | None
    calibrate: dict[str, Any] | None


def load_study(path: str | Path) -> Study:
    """Read a study file. It warns if sizes in its scene are not plausible.

    **Arguments:** `path`: of the file.

    **Raises:** `ClearanceError` naming the file, the key and the fix.
    """
    path = Path(path)
    with naming(str(path)):
        asked = StudyFile(path)
        if warning := implausible(asked.mechanism):
            warnings.warn(f"{path}: {warning}", ImplausibleWarning, stacklevel=2)
        table = asked.table
        if not any(table.has(section) for section in ("sweep", "design", "wear", "calibrate")):
            fix = "Add a section `sweep`, `design`, `wear` or `calibrate`."
            raise ClearanceError(f"{table.where} asks for nothing. {fix}")
        wear = wear_of(asked) if table.has("wear") else None
        design = design_of(asked, wear) if table.has("design") else None
        limits = () if design is None else design.problem.specification.limits
        if wear is not None and wear.cycles is None and not any(limit.ages for limit in limits):
            why = "has no effect: it lacks the key `cycles`, how many it lives, and no limit of a design has `cycles`."
            table.refuse("wear", why=f"{why} Add one of them.")
        sweep = sweep_of(asked) if table.has("sweep") else None
        calibrate = calibration_of(asked) if table.has("calibrate") else None
        return Study(asked.name, asked.text, asked.scene.text, asked.mechanism, sweep, design, wear, calibrate)


def sweep_of(study: StudyFile) -> dict[str, Any]:
    """The arguments of `sweep` by name."""
    table = study.table.table("sweep", SWEEP)
    table.need("axis")
    entries = table.entries("axis")
    axes = {name: _axis(variant(values, where, AXIS_TABLES), name, study) for name, values, where in entries}
    varied = {name for axis in axes.values() for name in (axis.values if isinstance(axis, Zipped) else ())}
    ends_vary = "t1" in axes.keys() | varied
    if ends_vary and study.table.has("t1"):
        raise ClearanceError(f"{study.table.key('t1')} is an axis of the sweep too. Take one of the two away.")
    span = Span(study.t0, np.inf) if ends_vary else study.span
    arguments = {"mechanism": study.mechanism, "axes": axes, "outputs": _outputs(table, study, span)}
    arguments |= {"t1": None if ends_vary else span.t1, "times": table.get("samples"), "wrt": table.get("by") or ()}
    arguments |= {"derivatives_of": table.get("derivatives_of"), **study.options}
    if table.has("again"):
        arguments["again"] = table.table("again", AGAIN).arguments()
    return arguments | {"provenance": {"scene": study.scene.text, "study": study.text}}


def _outputs(table: TomlTable, study: StudyFile, span: Span) -> dict[str, Any]:
    """What the sweep computes, by name: metrics, and names of quantities."""
    names = table.get("metrics") if table.has("metrics") else study.metric_names
    quantities = table.get("quantities") or ()
    if not (names or quantities):
        raise ClearanceError(f"{table.where} asks for nothing: add a table `[metric.NAME]`, or `quantities`.")
    outputs: dict[str, Any] = {name: study.metric(name, span, table.key("metrics")) for name in names}
    for name in quantities:
        if name in outputs:
            raise ClearanceError(f"{table.key('quantities')}: `{name}` is a metric's name too. Rename the metric.")
        outputs[name] = name
    return outputs


def _unit(name: str, mechanism: Mechanism, where: str) -> dict[str, str]:
    with naming(where):
        return {PARAMETER: OPTIONS[name] if name in OPTIONS else units_of(mechanism, [name])[name]}


def _axis(read: Chosen, name: str, study: StudyFile) -> Any:
    kind, table = read
    mechanism, where = study.mechanism, table.where
    if kind == "values":
        return table.get("values", _unit(name, mechanism, where))
    if kind == "range":
        unit = _unit(name, mechanism, where)
        first, last, count = table.get("from", unit), table.get("to", unit), table.get("count")
        if table.get("spacing") == "linear":
            return np.linspace(first, last, count)
        if not first * last > 0:
            raise ClearanceError(f"{table.key('spacing')}: equal ratios need a first and a last value of one sign.")
        return np.geomspace(first, last, count)
    if kind == "zipped":
        table.need("values")
        columns = {}
        for inner, given, there in table.entries("values"):
            one_list = {"values": given, "kind": "values"}
            column = TomlTable(one_list, there, AXIS_TABLES["values"], _unit(inner, mechanism, there))
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
    scenes = {}
    for label, given, there in table.entries("scenes"):
        if not isinstance(given, str):
            raise ClearanceError(f"{there} must be the path of a scene file, in quotes.")
        scenes[label] = read_scene(study.folder / given).mechanism
    return Choice(scenes)


def _correlation(table: TomlTable) -> dict[tuple[str, ...], float]:
    pairs = {}
    for _, values, where in table.entries("correlation"):
        pair = TomlTable(values, where, CORRELATION)
        names = pair.get("between")
        if len(names) != 2:
            raise ClearanceError(f"{pair.key('between')} must be two names, but there are {len(names)}.")
        pairs[names] = pair.get("value")
    return pairs
