"""Metrics from tables of a study: a reduction over a signal, a count, or a recurrence."""

import dataclasses
import itertools
from typing import Any, NamedTuple

from clearance_jax.dynamics.quantities import quantities
from clearance_jax.errors import ClearanceError, quote, suggest
from clearance_jax.io import recurrence_keys
from clearance_jax.io.metric_keys import COUNTS, OF_ANY_JOINT, OF_METRIC, OF_SIGNAL, RECURRENCES, REDUCTIONS, SIGNALS
from clearance_jax.io.table import Chosen, TomlTable
from clearance_jax.mechanism.mechanism import Mechanism
from clearance_jax.metrics.measure import AbstractMetric
from clearance_jax.metrics.recurrence import LyapunovExponent, PoincareSection
from clearance_jax.metrics.signals import AbstractSignal, numbers_of


class Span(NamedTuple):
    """Time span of a motion [s]."""

    t0: float
    t1: float


def metric_of(read: Chosen, mechanism: Mechanism, span: Span) -> AbstractMetric:
    """The metric of a table, for a motion over `span`: of a signal, a count, or a recurrence."""
    kind, table = read
    if kind in RECURRENCES:
        return _recurrence(read)
    make = (COUNTS if kind in COUNTS else REDUCTIONS)[kind]
    wanted = {field.name for field in dataclasses.fields(make)}
    given: dict[str, Any] = {}
    if kind in COUNTS:
        given |= _of(make, kind, table, mechanism)
    else:
        given["signal"] = signal_of(table, mechanism)
    if "times" in wanted:
        given["times"] = _times(table, span)
    if "band" in wanted:
        given["band"] = table.get("band", {OF_SIGNAL: given["signal"].unit})
    if "level" in wanted:
        given["level"] = table.get("level", {OF_SIGNAL: given["signal"].unit}) or 0.0
        given |= {"direction": table.get("direction")} if table.has("direction") else {}
    if "since" in wanted and table.has("since"):
        given["since"] = _since(table, span)
    return make(**given)


def signal_of(table: TomlTable, mechanism: Mechanism) -> AbstractSignal:
    """The `signal` of a table, of the `point`, `body` or `joint` beside it."""
    word = table.get("signal")
    given = _of(SIGNALS[word], word, table, mechanism)
    if "quantity" in given:
        given["called"] = quantities(mechanism, energy_balance=False)[given["quantity"]].unit
    return SIGNALS[word](**given)


def _of(cls: type, word: str, table: TomlTable, mechanism: Mechanism) -> dict[str, str]:
    """The point, body, joint or quantity of a signal or count, by the field names of its class."""
    joints = mechanism.all_joints() if cls in OF_ANY_JOINT else mechanism.clearance_joints()
    names = {
        "point": [point.name for point in mechanism.points],
        "body": [body.name for body in mechanism.bodies],
        "joint": [joint.name for joint in joints],
        "quantity": numbers_of(mechanism),
    }
    wanted = {field.name for field in dataclasses.fields(cls)} & set(OF_METRIC)
    for key in (key for key in OF_METRIC if key in table.values and key not in wanted):
        raise ClearanceError(f"{table.key(key)} has no effect: `{word}` is of a {' and a '.join(wanted)}. Remove it.")
    parts = {}
    for key in wanted:
        table.need(key)
        parts[key] = table.get(key)
        if parts[key] not in names[key]:
            kind = "joint with clearance" if key == "joint" and cls not in OF_ANY_JOINT else key
            raise ClearanceError(
                f"{table.key(key)}: the scene has no {kind} {quote(parts[key])}. " + suggest(parts[key], names[key])
            )
    return parts


def _recurrence(read: Chosen) -> PoincareSection | LyapunovExponent:
    """The metric that a table describes; an exponent with its uncertainty."""
    kind, table = read
    if table.has("period") == table.has("speed"):
        raise ClearanceError(
            f"{table.where} must have one of the keys `period` and `speed`. Give the one that you know."
        )
    period: Any = table.get("period") if table.has("period") else table.get("speed")
    if kind == recurrence_keys.EXPONENT:
        return LyapunovExponent(period, table.get("count"), uncertainty=True)
    return PoincareSection(table.get("quantities"), period, table.get("count"), table.get("phase") or 0.0)


def _times(table: TomlTable, span: Span) -> list[float]:
    times = table.get("times")
    increasing = all(a < b for a, b in itertools.pairwise(times))
    if not (increasing and span.t0 <= times[0] and times[-1] <= span.t1):
        raise ClearanceError(
            f"{table.key('times')} must increase from t0 = {span.t0:g} s to t1 = {span.t1:g} s at most, but they are "
            f"{quote(times)} s."
        )
    return times


def _since(table: TomlTable, span: Span) -> float:
    since = table.get("since")
    if not span.t0 <= since < span.t1:
        raise ClearanceError(
            f"{table.key('since')} must lie between t0 = {span.t0:g} s and t1 = {span.t1:g} s, but it is {since:g} s."
        )
    return since
