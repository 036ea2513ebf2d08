"""Clearance joints: geometry x normal law x friction law."""

from clearance_jax.joints import gears as gears
from clearance_jax.joints._base import AbstractClearance, PreparedClearance
from clearance_jax.joints.ball import SphericalClearance
from clearance_jax.joints.bearings import angular_contact_pair, crossed_roller, rolling_bearing
from clearance_jax.joints.bore import Modes
from clearance_jax.joints.contact import Action, ContactPoint, JointOutline, PlayCoordinate, Relative
from clearance_jax.joints.elements import AbstractElement, Offset, PlayDamper, PreloadedBearing, ShortBearing
from clearance_jax.joints.fitting import Fitting, PressFit, Tolerance
from clearance_jax.joints.guide import GuideClearance
from clearance_jax.joints.pin import AbstractPin, RevoluteClearance, Sections
from clearance_jax.joints.presets import guide_clearance, pin_clearance, shaft, socket
from clearance_jax.joints.sleeve import SleeveClearance

__all__ = [
    "AbstractClearance",
    "AbstractElement",
    "AbstractPin",
    "Action",
    "ContactPoint",
    "Fitting",
    "GuideClearance",
    "JointOutline",
    "Modes",
    "Offset",
    "PlayCoordinate",
    "PlayDamper",
    "PreloadedBearing",
    "PreparedClearance",
    "PressFit",
    "Relative",
    "RevoluteClearance",
    "Sections",
    "ShortBearing",
    "SleeveClearance",
    "SphericalClearance",
    "Tolerance",
    "angular_contact_pair",
    "crossed_roller",
    "guide_clearance",
    "pin_clearance",
    "rolling_bearing",
    "shaft",
    "socket",
]
