"""Clearance joints: geometry x normal law x friction law."""

from clearance_jax.joints._base import (
    AbstractClearance,
    Action,
    ContactPoint,
    PlayCoordinate,
    PreparedClearance,
    Relative,
    each_joint,
)
from clearance_jax.joints._element import AbstractElement, Offset
from clearance_jax.joints.ball import SphericalClearance
from clearance_jax.joints.bearings import rolling_bearing
from clearance_jax.joints.bore import Modes
from clearance_jax.joints.elements import PlayDamper, PreloadedBearing
from clearance_jax.joints.fitting import Fitting, PressFit, Tolerance
from clearance_jax.joints.guide import GuideClearance
from clearance_jax.joints.pin import AbstractPin, Sections
from clearance_jax.joints.preloaded import angular_contact_pair, crossed_roller
from clearance_jax.joints.presets import BALL, GUIDE, PIN, SHAFT, PlayNumbers, Preset, fitted, guided, shaft, socket
from clearance_jax.joints.revolute import RevoluteClearance
from clearance_jax.joints.seating import (
    Load,
    Near,
    Seat,
    Seating,
    held_stiffness,
    posed,
    relative_at,
    seat,
    stiffness_at,
)
from clearance_jax.joints.sleeve import SleeveClearance

__all__ = [
    "BALL",
    "GUIDE",
    "PIN",
    "SHAFT",
    "AbstractClearance",
    "AbstractElement",
    "AbstractPin",
    "Action",
    "ContactPoint",
    "Fitting",
    "GuideClearance",
    "Load",
    "Modes",
    "Near",
    "Offset",
    "PlayCoordinate",
    "PlayDamper",
    "PlayNumbers",
    "PreloadedBearing",
    "PreparedClearance",
    "Preset",
    "PressFit",
    "Relative",
    "RevoluteClearance",
    "Seat",
    "Seating",
    "Sections",
    "SleeveClearance",
    "SphericalClearance",
    "Tolerance",
    "angular_contact_pair",
    "crossed_roller",
    "each_joint",
    "fitted",
    "guided",
    "held_stiffness",
    "posed",
    "relative_at",
    "rolling_bearing",
    "seat",
    "shaft",
    "socket",
    "stiffness_at",
]
