"""Limits of a coordinate's drive from a robot's data sheet; inverse kinematics respects them, a motion does not."""

from typing import NamedTuple


class Limits(NamedTuple):
    """Limits of a coordinate, as a data sheet says. `None`: there is no such limit.

    **Arguments:** `lower`, `upper`: least and greatest value [rad or m]; `velocity`: largest rate [rad/s or m/s];
    `effort`: largest torque [N m] or force [N].
    """

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None
