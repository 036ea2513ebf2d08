"""Metrics: a reduction over time (`Peak`, `Rms`, `At`, ...) of a signal of a motion (`PositionError`, ...)."""

from clearance_jax.metrics.crossing import CrossingTime, SettlingTime
from clearance_jax.metrics.iso9283 import (
    Accuracy,
    orientation_repeatability,
    path_accuracy,
    path_repeatability,
    pose_accuracy,
    pose_repeatability,
)
from clearance_jax.metrics.measure import AbstractMetric, Function, Reply, Request
from clearance_jax.metrics.path import PathDeviation
from clearance_jax.metrics.recurrence import LyapunovExponent, PoincareSection
from clearance_jax.metrics.reductions import At, EnergyLost, Impacts, Mean, Peak, PNorm, Rms, SoftPeak
from clearance_jax.metrics.signals import (
    AbstractSignal,
    Acceleration,
    ContactForce,
    JointMoment,
    JointReaction,
    OrientationError,
    PositionError,
    Quantity,
)

__all__ = [
    "AbstractMetric",
    "AbstractSignal",
    "Acceleration",
    "Accuracy",
    "At",
    "ContactForce",
    "CrossingTime",
    "EnergyLost",
    "Function",
    "Impacts",
    "JointMoment",
    "JointReaction",
    "LyapunovExponent",
    "Mean",
    "OrientationError",
    "PNorm",
    "PathDeviation",
    "Peak",
    "PoincareSection",
    "PositionError",
    "Quantity",
    "Reply",
    "Request",
    "Rms",
    "SettlingTime",
    "SoftPeak",
    "orientation_repeatability",
    "path_accuracy",
    "path_repeatability",
    "pose_accuracy",
    "pose_repeatability",
]
