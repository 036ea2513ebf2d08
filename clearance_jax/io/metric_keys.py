"""The keys of metrics."""

import dataclasses

from clearance_jax import metrics
from clearance_jax.io.fields import kind_of, summary
from clearance_jax.io.kinds import Key, Quantities, Quantity, Text, Word
from clearance_jax.io.recurrence_keys import RECURRENCE_KEYS, RECURRENCES
from clearance_jax.io.table import Keys

SIGNALS = {
    "position-error": metrics.PositionError,
    "path-deviation": metrics.PathDeviation,
    "orientation-error": metrics.OrientationError,
    "contact-force": metrics.ContactForce,
    "acceleration": metrics.Acceleration,
    "joint-reaction": metrics.JointReaction,
    "joint-moment": metrics.JointMoment,
}
OF_ANY_JOINT = metrics.JointReaction, metrics.JointMoment
"""Signals whose joint may be one without clearance."""
REDUCTIONS = {"peak": metrics.Peak, "rms": metrics.Rms, "mean": metrics.Mean, "at": metrics.At}
SETTLING, OF_SIGNAL = "settling-time", "the signal's"
"""The kind that a band is of, and the unit of a band, which the signal decides."""
COUNTS = {"energy-lost": metrics.EnergyLost, "impacts": metrics.Impacts}

# What keys were called before studies had one form.
RENAMED = {"metric": "kind", "bound": "design.limit.NAME.bound"}
_KIND = Word(
    "kind",
    "what is asked of the motion",
    '"peak"',
    allowed=(*REDUCTIONS, SETTLING, *COUNTS, *RECURRENCES),
    required=True,
)
_SINCE = Quantity("since", "only what comes later counts", '"4 ms"', unit="s", absent="the start")
# What a signal or a count is of; which of them it wants, its class says.
OF = {
    "point": Text("point", "the point, of position-error, path-deviation and acceleration", '"piston"'),
    "body": Text("body", "the body, of orientation-error", '"slider"'),
    "joint": Text(
        "joint", "the joint: with clearance, of contact-force; any, of joint-reaction and joint-moment", '"wrist"'
    ),
}
_SIGNAL = Word("signal", "the signal that it is of", '"position-error"', allowed=tuple(SIGNALS), required=True)
_BAND = Quantity(
    "band", "what it must not exceed any more", '"0.05 mm"', unit=OF_SIGNAL, bounds={"above": 0.0}, required=True
)
_END = Quantity("since", "when the move ends", '"4 ms"', unit="s", absent="where the last drive ends its move")
_TIMES = Quantities("times", "the times, increasing, from t0 to t1", '["0.5 ms", "1 ms"]', unit="s", required=True)


def _metric(kind: str, cls: type, *keys: Key) -> Keys:
    return kind_of("metric.NAME", "Metric", _KIND, kind, summary(cls), *keys)._replace(renamed=RENAMED)


METRIC_KINDS = {
    **{
        kind: _metric(kind, cls, _SIGNAL, *OF.values(), _TIMES if kind == "at" else _SINCE)
        for kind, cls in REDUCTIONS.items()
    },
    SETTLING: _metric(SETTLING, metrics.SettlingTime, _SIGNAL, *OF.values(), _BAND, _END),
    "energy-lost": _metric("energy-lost", metrics.EnergyLost, _SINCE),
    "impacts": _metric("impacts", metrics.Impacts, dataclasses.replace(OF["joint"], required=True), _SINCE),
    **{kind: _metric(kind, cls, *RECURRENCE_KEYS[kind]) for kind, cls in RECURRENCES.items()},
}
"""Of each kind of metric its table."""
