"""The keys of metrics, as every file has them that asks something of a motion."""

import dataclasses
from collections.abc import Mapping

from clearance_jax import metrics
from clearance_jax.io.asking_keys import choosing
from clearance_jax.io.fields import summary
from clearance_jax.io.kinds import Key, Quantities, Quantity, Text, Word
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

METRIC = "the metric's"
"""The unit of a bound, which the metric decides."""
_SIGNAL = Word("signal", "the signal that it is of", '"position-error"', allowed=tuple(SIGNALS), required=True)
_TIMES = Quantities("times", "the times, increasing, from t0 to t1", '["0.5 ms", "1 ms"]', unit="s", required=True)
_SINCE = Quantity("since", "only what comes later counts", '"4 ms"', unit="s", absent="the start")
# What a signal or a count is of; which of them it wants, its class says.
OF = {
    "point": Text("point", "the point, of position-error, path-deviation and acceleration", '"piston"'),
    "body": Text("body", "the body, of orientation-error", '"slider"'),
    "joint": Text(
        "joint", "the joint: with clearance, of contact-force; any, of joint-reaction and joint-moment", '"wrist"'
    ),
}
# Of each metric what it is and what it is of.
METRIC_KEYS = {
    **{
        name: (summary(reduction), (_SIGNAL, *OF.values(), _TIMES if name == "at" else _SINCE))
        for name, reduction in REDUCTIONS.items()
    },
    "energy-lost": (summary(metrics.EnergyLost), (_SINCE,)),
    "impacts": (
        summary(metrics.Impacts),
        (dataclasses.replace(OF["joint"], help="the joint with clearance", required=True), _SINCE),
    ),
}
_BOUND = Quantity("bound", "what it must not exceed", '"0.2 mm"', unit=METRIC, bounds={"above": 0.0}, required=True)
_BOUNDS = {"energy-lost": '"1 J"', "impacts": "3"}


def metric_tables(
    name: str,
    title: str,
    head: Word,
    metrics: Mapping[str, tuple[str, tuple[Key, ...]]] = METRIC_KEYS,
    bounded: bool = False,
) -> dict[str, Keys]:
    """Of each metric its table, which its word chooses by the key `head`; `bounded`: with a `bound` beside it."""
    found = {}
    for metric, (help, keys) in metrics.items():
        bound: tuple[Key, ...] = (dataclasses.replace(_BOUND, example=_BOUNDS.get(metric, _BOUND.example)),)
        keys = (choosing(head, metric), *keys, *(bound if bounded else ()))
        found[metric] = Keys(name, f"{title} `{metric}`", help, keys, f'{head.name} = "{metric}"')
    return found
