"""The keys of metrics: reductions over signals, counts, Poincare sections and Lyapunov exponents."""

import dataclasses
from typing import Any

from clearance_jax import metrics
from clearance_jax.io.keys.declare import family, kind, summary
from clearance_jax.io.keys.kinds import Key, Names, Quantities, Text, Whole, Word, quantity
from clearance_jax.metrics.crossing import DIRECTIONS, RISING
from clearance_jax.metrics.recurrence import FEWEST, LyapunovExponent, PoincareSection
from clearance_jax.solve.settings import MOST_SAMPLES

METRIC, OF_SIGNAL = "the metric's", "the signal's"
"""Placeholders for the units of a bound, which is the metric's, and of a band or level, which is the signal's."""


def _by_word(base: type) -> dict[str, Any]:
    """Public subclasses of `base`, by their word in study files."""
    public = (getattr(metrics, name) for name in metrics.__all__)
    return {cls.word: cls for cls in public if isinstance(cls, type) and issubclass(cls, base) and cls.word}


def _has(cls: type, name: str) -> bool:
    return any(field.name == name for field in dataclasses.fields(cls))


SIGNALS = _by_word(metrics.AbstractSignal)
OF_ANY_JOINT = metrics.JointReaction, metrics.JointMoment
"""Signals whose joint may be one without clearance."""
_METRICS = _by_word(metrics.AbstractMetric)
REDUCTIONS = {word: cls for word, cls in _METRICS.items() if _has(cls, "signal")}
COUNTS = {word: cls for word, cls in _METRICS.items() if not _has(cls, "signal")}
SECTION, EXPONENT = "poincare-section", "lyapunov-exponent"
RECURRENCES = {SECTION: PoincareSection, EXPONENT: LyapunovExponent}

# Former names of keys.
RENAMED = {"metric": "kind", "bound": "design.limit.NAME.bound"}
# What a signal or count refers to. Its class has a field for each that it needs.
OF: dict[str, Key] = {
    "point": Text("the point, of position-error, path-deviation and acceleration", '"piston"'),
    "body": Text("the body, of orientation-error", '"slider"'),
    "joint": Text(
        "the joint: with clearance, or a gap (`axis_drive`), of contact-force; any, of joint-reaction and joint-moment",
        '"wrist"',
    ),
}
OF_METRIC = OF | {"quantity": Text("the name of a number of the motion, of quantity", '"wrist.penetration"')}
_SIGNAL = Word("the signal that it is of", '"position-error"', allowed=tuple(SIGNALS), required=True)
_SINCE = {"since": quantity("only what comes later counts", '"4 ms"', "s", "the start")}
_TIMES = Quantities("the times, increasing, from t0 to t1", '["0.5 ms", "1 ms"]', unit="s", required=True)
_BAND = {
    "band": quantity("what it must not exceed any more", '"0.05 mm"', OF_SIGNAL, above=0.0, required=True),
    "since": quantity("when the move ends", '"4 ms"', "s", "where the last drive ends its move"),
}
_LEVEL = {
    "level": quantity("the value that it crosses", '"0.05 mm"', OF_SIGNAL, "0"),
    "direction": Word("in which it crosses the level", '"falling"', RISING, allowed=DIRECTIONS),
}


def _keys(cls: type) -> dict[str, Key]:
    if not _has(cls, "signal"):
        needed = {name: key for name, key in OF.items() if _has(cls, name)}
        return {name: dataclasses.replace(key, required=True) for name, key in needed.items()} | _SINCE
    more = {"times": _TIMES} if _has(cls, "times") else _BAND if _has(cls, "band") else _SINCE
    return {"signal": _SIGNAL, **OF_METRIC, **(_LEVEL if _has(cls, "level") else {}), **more}


def _count(default: int, least: int) -> Key:
    return Whole("how many periods, the last ones", "100", least=least, most=MOST_SAMPLES, default=default)


_PERIOD: dict[str, Key] = {
    "period": quantity("the period", '"12 ms"', "s", "a turn of `speed`", above=0.0),
    "speed": Text(
        "instead of it the name of a speed of which a turn is a period, an axis too", '"drive.main.speed"', "`period`"
    ),
}
_OF_RECURRENCES: dict[str, dict[str, Key]] = {
    SECTION: {
        "quantities": Names(
            "what is looked at once a period: numbers that a solution gives by name",
            '["piston.velocity.x", "wrist.eccentricity.x"]',
            required=True,
        ),
        **_PERIOD,
        "count": _count(64, 1),
        "phase": quantity("after the beginning of a period", '"3 ms"', "s", "at the beginning"),
    },
    EXPONENT: {**_PERIOD, "count": _count(50, FEWEST)},
}
_KINDS = {
    word: kind(summary(cls), renamed=RENAMED, **(_OF_RECURRENCES[word] if word in RECURRENCES else _keys(cls)))
    for word, cls in (REDUCTIONS | COUNTS | RECURRENCES).items()
}
METRIC_KINDS = family("metric.NAME", "Metric", "kind", "what is asked of the motion", _KINDS)
del _KINDS
"""Tables by kind of metric."""
