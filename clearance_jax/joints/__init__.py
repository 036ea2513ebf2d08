"""Clearance joints: geometry x normal law x friction law."""

from clearance_jax.joints._base import (
    AbstractClearance,
    AbstractElement,
    Action,
    ContactPoint,
    PlayCoordinate,
    PreparedClearance,
    Relative,
)
from clearance_jax.joints.ball import SphericalClearance
from clearance_jax.joints.guide import GuideClearance
from clearance_jax.joints.presets import fitted
from clearance_jax.joints.revolute import RevoluteClearance
from clearance_jax.joints.sleeve import SleeveClearance

__all__ = [
    "AbstractClearance",
    "AbstractElement",
    "Action",
    "ContactPoint",
    "GuideClearance",
    "PlayCoordinate",
    "PreparedClearance",
    "Relative",
    "RevoluteClearance",
    "SleeveClearance",
    "SphericalClearance",
    "fitted",
]
