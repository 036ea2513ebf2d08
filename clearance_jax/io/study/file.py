"""The part of a study file that its sections share: scene, changed numbers, time span, metrics and scatter."""

import dataclasses
import itertools
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from clearance_jax._basis.patterns import expand
from clearance_jax.errors import ClearanceError, naming, quote, unknown_name, wrong_value
from clearance_jax.io.files import read_toml
from clearance_jax.io.keys import metric as metrics
from clearance_jax.io.keys.declare import Keys
from clearance_jax.io.keys.scene import SOLVING
from clearance_jax.io.keys.study import SCATTER, SOLVE, STUDY
from clearance_jax.io.scene.scene import Scene, read_scene
from clearance_jax.io.settings import values_by_name
from clearance_jax.io.table import Chosen, TomlTable, variant
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.functions import contact_names, numbers_of, refuse_closed, refuse_gap
from clearance_jax.metrics.measure import AbstractMetric
from clearance_jax.metrics.recurrence import LyapunovExponent, PoincareSection
from clearance_jax.metrics.signals import AbstractSignal
from clearance_jax.parameters import PARAMETER, parameters, replace, units_of, values_of
from clearance_jax.sweep.axes import arguments_of, scatter
from clearance_jax.units import to_si

# Solve options that a study takes from its scene.
OF_THE_SCENE = ("t0", "fidelity", *(key.name for key in SOLVING.keys))


class Span(NamedTuple):
    """Time span of a motion [s]."""

    t0: float
    t1: float


class Scatter(NamedTuple):
    """The scatter of a number as the file gives it [SI]; `relative`: deviation over mean, if given in percent."""

    distribution: str
    mean: float | None
    deviation: float | None
    relative: float | None
    lower: float | None
    upper: float | None
    where: str


class StudyFile:
    """A study file; `table`: its top, `mechanism`: with the study's numbers set, `options`: those of the solve."""

    def __init__(self, path: Path):
        self.path = path
        # Files are named as seen from the study, of a link from the file that it leads to.
        self.folder = (path.resolve() if path.is_symlink() else path).parent
        self.text, values = read_toml(path, "study file")
        if "scene" not in values and ("body" in values or "joint" in values):
            raise ClearanceError(f"`{path}` is a scene, and not a study: use `clearance simulate`, or `cj.load`.")
        self.table = TomlTable(values, f"{path}:", STUDY)
        self.name = self.table.get("name") or path.stem
        self.scene: Scene = read_scene(self.folder / self.table.get("scene"))
        numbers = values_by_name(self.table.entries("set"), self.scene.mechanism)
        self.mechanism: Mechanism = replace(self.scene.mechanism, numbers)
        usual = {name: value for name, value in self.scene.solve.items() if name in OF_THE_SCENE}
        self.options: dict[str, Any] = usual | self.table.table("solve", SOLVE).arguments()

    @property
    def t0(self) -> float:
        """Start time of the motions [s]."""
        return self.options.get("t0", 0.0)

    @cached_property
    def span(self) -> Span:
        """From the scene's t0 to the study's t1, or the scene's if the study has none."""
        t1 = self.table.get("t1")
        t1 = self.scene.solve.get("t1") if t1 is None else t1
        if t1 is None:
            raise ClearanceError(f"{self.table.where} lacks the key `t1`, and the scene has none. Add it.")
        return self.span_to(t1, self.table.key("t1"))

    def span_to(self, t1: float, where: str) -> Span:
        """From the scene's t0 to `t1` [s]; `where`: the key of t1, for messages."""
        if t1 <= self.t0:
            raise wrong_value(where, f"greater than the scene's t0 = {self.t0:g} s", t1, shown=f"{t1:g} s")
        return Span(self.t0, t1)

    @property
    def metric_names(self) -> list[str]:
        """Names of the study's metrics."""
        return [name for name, _, _ in self.table.entries("metric")]

    def metric(self, name: str, span: Span, where: str) -> AbstractMetric:
        """The metric of a name, for a motion over `span`; `where`: the key that asks for it, for messages."""
        for key, values, there in self.table.entries("metric"):
            if key == name:
                return metric_of(variant(values, there, metrics.METRIC_KINDS), self.mechanism, span)
        raise unknown_name(f"{where}: the study has no metric `{name}`.", name, self.metric_names, where)

    def scatter(self, names: Iterable[str] | None, model: Any, where: str) -> dict[str, Scatter]:
        """The scatter of the named numbers of a model (`None`: of all that scatter); `where`: the key that asks."""
        tables = expand_entries(self.table, "scatter", model)
        wanted = tuple(tables) if names is None else tuple(names)
        if not wanted:
            raise ClearanceError(f"{where}: nothing scatters. Say how, by tables `[scatter.NAME]`.")
        scatters = {}
        for name in wanted:
            if name not in tables:
                raise unknown_name(f"{where}: `{name}` does not scatter.", name, tables, where)
            scatters[name] = _scatter(of_parameter(name, *tables[name], SCATTER, model))
        return scatters

    def distributions(self, names: Iterable[str] | None, where: str, model: Any = None) -> dict[str, Any]:
        """As `scatter`, as distributions; `model`: by default the mechanism."""
        model, out = self.mechanism if model is None else model, {}
        for name, how in self.scatter(names, model, where).items():
            mean, deviation = how.mean, how.deviation
            if "mean" in arguments_of(how.distribution) and mean is None:
                mean = float(np.asarray(values_of(model, [name])[name]))
            if how.relative is not None:
                deviation = how.relative * (1.0 if mean is None else abs(mean))
            with naming(how.where):
                out[name] = scatter(mean, deviation, how.lower, how.upper, how.distribution)
        return out


def of_parameter(name: str, values: Any, where: str, keys: Keys, model: Any) -> TomlTable:
    """The table of a number of a model, in the number's unit. **Raises** `ClearanceError` for an unknown name."""
    with naming(where):
        return TomlTable(values, where, keys, {PARAMETER: units_of(model, [name])[name]})


def expand_entries(table: TomlTable, key: str, model: Any) -> dict[str, tuple[Any, str]]:
    """Entries of the table `key`, name -> (value, place), a name with `*` expanded to all numbers that match."""
    with naming(table.key(key)):
        tables = {name: (values, where) for name, values, where in table.entries(key)}
        return expand(tables, parameters(model)) if any("*" in name for name in tables) else tables


def _scatter(table: TomlTable) -> Scatter:
    given, deviation, relative = table.values.get("deviation"), None, None
    if isinstance(given, str) and given.split()[-1:] in (["percent"], ["%"]):
        relative = to_si(given.replace("%", "percent"), "percent", table.key("deviation")) / 100
        if not 0 < relative < 10:
            raise wrong_value(table.key("deviation"), "above 0 percent", given, shown=str(given))
    else:
        deviation = table.get("deviation")
    distribution, mean, lower, upper = (table.get(name) for name in ("distribution", "mean", "lower", "upper"))
    return Scatter(distribution, mean, deviation, relative, lower, upper, table.where)


def metric_of(read: Chosen, mechanism: Mechanism, span: Span) -> AbstractMetric:
    """The metric of a table, for a motion over `span`: of a signal, a count, or a recurrence."""
    kind, table = read
    if kind in metrics.RECURRENCES:
        return _recurrence(read)
    if kind in metrics.COUNTS:
        fields: dict[str, Any] = _of(metrics.COUNTS[kind], kind, table, mechanism)
    else:
        fields = {"signal": signal_of(table, mechanism)}
        table.words = {metrics.OF_SIGNAL: fields["signal"].unit}
    fields |= table.arguments("kind", "signal", *metrics.OF_METRIC)
    times, since = fields.get("times"), fields.get("since", span.t0)
    if times and not (
        span.t0 <= times[0] and times[-1] <= span.t1 and all(a < b for a, b in itertools.pairwise(times))
    ):
        bounds = f"from t0 = {span.t0:g} s to t1 = {span.t1:g} s"
        table.refuse("times", why=f"must increase {bounds} at most, but they are {quote(times)} s.")
    if not span.t0 <= since < span.t1:
        bounds = f"between t0 = {span.t0:g} s and t1 = {span.t1:g} s"
        table.refuse("since", why=f"must lie {bounds}, but it is {since:g} s.")
    return (metrics.COUNTS | metrics.REDUCTIONS)[kind](**fields)


def signal_of(table: TomlTable, mechanism: Mechanism) -> AbstractSignal:
    """The `signal` of a table, of the `point`, `body` or `joint` beside it."""
    word = table.get("signal")
    return metrics.SIGNALS[word](**_of(metrics.SIGNALS[word], word, table, mechanism)).known(mechanism)


def _of(cls: type, word: str, table: TomlTable, mechanism: Mechanism) -> dict[str, str]:
    """The point, body, joint or quantity of a signal or count, by the field names of its class."""
    joints = [joint.name for joint in mechanism.all_joints()]
    names = {
        "point": [point.name for point in mechanism.points],
        "body": [body.name for body in mechanism.bodies],
        "joint": joints if cls in metrics.OF_ANY_JOINT else contact_names(mechanism),
        "quantity": numbers_of(mechanism),
    }
    wanted = {field.name for field in dataclasses.fields(cls)} & set(metrics.OF_METRIC)
    for key in (key for key in metrics.OF_METRIC if key in table.values and key not in wanted):
        text = f"{table.key(key)} has no effect: `{word}` is of a {' and a '.join(wanted)}. Remove it."
        raise ClearanceError(text).about(table.key(key))
    parts: dict[str, Any] = {}
    for key in wanted:
        table.need(key)
        parts[key] = table.get(key)
        if parts[key] not in names[key]:
            with naming(table.key(key)):
                (refuse_gap if cls in metrics.OF_ANY_JOINT else refuse_closed)(mechanism, parts[key])
            kind = "joint with clearance" if key == "joint" and cls not in metrics.OF_ANY_JOINT else key
            text = f"{table.key(key)}: the scene has no {kind} {quote(parts[key])}."
            raise unknown_name(text, parts[key], names[key], table.key(key))
    return parts


def _recurrence(read: Chosen) -> PoincareSection | LyapunovExponent:
    kind, table = read
    if table.has("period") == table.has("speed"):
        fix = "Give the one that you know."
        text = f"{table.where} must have one of the keys `period` and `speed`. {fix}"
        raise ClearanceError(text).about(table.key("period"))
    period: Any = table.get("period" if table.has("period") else "speed")
    if kind == metrics.EXPONENT:
        return LyapunovExponent(period, table.get("count"), uncertainty=True)
    return PoincareSection(table.get("quantities"), period, table.get("count"), table.get("phase") or 0.0)
