"""The keys of metrics."""

import dataclasses
from typing import Any

from clearance_jax import metrics
from clearance_jax.io.fields import kind_of, summary
from clearance_jax.io.kinds import Key, Quantities, QuantityKey, Text, Word
from clearance_jax.io.recurrence_keys import RECURRENCE_KEYS, RECURRENCES
from clearance_jax.io.table import Keys
from clearance_jax.metrics.crossing import DIRECTIONS, RISING


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
OF_SIGNAL = "the signal's"
"""Placeholder for the unit of a band or level, which is the signal's."""

# Former names of keys.
RENAMED = {"metric": "kind", "bound": "design.limit.NAME.bound"}
_KIND = Word(
    "kind", "what is asked of the motion", '"peak"', allowed=(*REDUCTIONS, *COUNTS, *RECURRENCES), required=True
)
_SINCE = QuantityKey("since", "only what comes later counts", '"4 ms"', unit="s", absent="the start")
# What a signal or count refers to. Its class has a field for each that it needs.
OF = {
    "point": Text("point", "the point, of position-error, path-deviation and acceleration", '"piston"'),
    "body": Text("body", "the body, of orientation-error", '"slider"'),
    "joint": Text(
        "joint", "the joint: with clearance, of contact-force; any, of joint-reaction and joint-moment", '"wrist"'
    ),
}
OF_METRIC = OF | {
    "quantity": Text("quantity", "the name of a number of the motion, of quantity", '"wrist.penetration"')
}
_SIGNAL = Word("signal", "the signal that it is of", '"position-error"', allowed=tuple(SIGNALS), required=True)
_BAND = QuantityKey(
    "band", "what it must not exceed any more", '"0.05 mm"', unit=OF_SIGNAL, bounds={"above": 0.0}, required=True
)
_END = QuantityKey("since", "when the move ends", '"4 ms"', unit="s", absent="where the last drive ends its move")
_LEVEL = QuantityKey("level", "the value that it crosses", '"0.05 mm"', unit=OF_SIGNAL, absent="0")
_DIRECTION = Word("direction", "in which it crosses the level", '"falling"', allowed=DIRECTIONS, absent=RISING)
_TIMES = Quantities("times", "the times, increasing, from t0 to t1", '["0.5 ms", "1 ms"]', unit="s", required=True)


def _metric(kind: str, cls: type, *keys: Key) -> Keys:
    return kind_of("metric.NAME", "Metric", _KIND, kind, summary(cls), *keys)._replace(renamed=RENAMED)


def _reduction_keys(cls: type) -> tuple[Key, ...]:
    """Keys of a reduction beside those of its signal."""
    if _has(cls, "level"):
        return _LEVEL, _DIRECTION, _SINCE
    return (_TIMES,) if _has(cls, "times") else (_BAND, _END) if _has(cls, "band") else (_SINCE,)


METRIC_KINDS = {
    **{
        kind: _metric(kind, cls, _SIGNAL, *OF_METRIC.values(), *_reduction_keys(cls))
        for kind, cls in REDUCTIONS.items()
    },
    **{
        kind: _metric(
            kind, cls, *(dataclasses.replace(OF[name], required=True) for name in OF if _has(cls, name)), _SINCE
        )
        for kind, cls in COUNTS.items()
    },
    **{kind: _metric(kind, cls, *RECURRENCE_KEYS[kind]) for kind, cls in RECURRENCES.items()},
}
"""Tables by kind of metric."""
