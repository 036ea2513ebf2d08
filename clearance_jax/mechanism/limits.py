"""What a coordinate's drive can do, as a robot's data sheet says: inverse kinematics keeps within, motion does not."""

from typing import NamedTuple


class Limits(NamedTuple):
    """Least and largest value of a coordinate [rad or m], largest rate, largest effort; `None` where there is none."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None
