"""The keys of metrics."""

import dataclasses

from clearance_jax import metrics
from clearance_jax.io.asking_keys import choice_word
from clearance_jax.io.fields import summary
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
COUNTS = {"energy-lost": metrics.EnergyLost, "impacts": metrics.Impacts}

# What keys were called before studies had one form.
RENAMED = {"metric": "kind", "bound": "design.limit.NAME.bound"}
_KIND = Word(
    "kind", "what is asked of the motion", '"peak"', allowed=(*REDUCTIONS, *COUNTS, *RECURRENCES), required=True
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
_REDUCED = Keys(
    "metric.NAME",
    "Metric of a signal",
    "`peak`: the largest value of a signal over time; `rms`: the root of its mean square; `mean`: its mean; `at`: its "
    "values at given times.",
    (
        choice_word(_KIND, "peak"),
        Word("signal", "the signal that it is of", '"position-error"', allowed=tuple(SIGNALS), required=True),
        *OF.values(),
        _SINCE,
        Quantities("times", "of `at`: the times, increasing, from t0 to t1", '["0.5 ms", "1 ms"]', unit="s"),
    ),
    'kind = "peak", "rms", "mean" or "at"',
    RENAMED,
)


def _table(kind: str, title: str, metric: type, *keys: Key) -> Keys:
    return Keys("metric.NAME", title, summary(metric), (choice_word(_KIND, kind), *keys), f'kind = "{kind}"', RENAMED)


METRIC_KINDS = {
    **dict.fromkeys(REDUCTIONS, _REDUCED),
    "energy-lost": _table("energy-lost", "Metric `energy-lost`", metrics.EnergyLost, _SINCE),
    "impacts": _table(
        "impacts",
        "Metric `impacts`",
        metrics.Impacts,
        dataclasses.replace(OF["joint"], help="the joint with clearance", required=True),
        _SINCE,
    ),
    **{kind: _table(kind, f"Metric `{kind}`", cls, *RECURRENCE_KEYS[kind]) for kind, cls in RECURRENCES.items()},
}
"""Of each kind of metric its table."""
METRIC_TABLES = {table.title: table for table in METRIC_KINDS.values()}
